"""Checks of a mechanism before a run: mobility, redundancy, start and frequencies."""

from __future__ import annotations

import time as clock
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.accuracy.errors import Errors
from beamdae.accuracy.runs import check_errors
from beamdae.analysis.eigenproblems.eigensolution import (
    FrequencyRange,
    compute_frequency_range,
)
from beamdae.beams.damping import EXAMPLE_DAMPING, find_undamped_beams
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.dependent_constraints import (
    DependentSet,
    analyze_constraint_rank,
    describe_dependent_sets,
    find_dependent_sets,
)
from beamdae.equations.starts.mobility import (
    find_free_groups,
    find_free_motions,
    find_loose_groups,
)
from beamdae.equations.starts.reduced_equations import drop_dependent_constraints
from beamdae.equations.starts.rigid_motions import describe_free_motion
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    format_count,
    list_first,
    require_choice,
    require_positive,
)
from beamdae.integrators.auto import Auto
from beamdae.integrators.run_plan import plan_run
from beamdae.interrupts import interruptible
from beamdae.model_checks.contacts import (
    deep_rest_warnings,
    start_inside_warnings,
    starts_in_equilibrium,
)
from beamdae.model_functions import HasOrigin, Model
from beamdae.parts.mechanism import Mechanism, require_start
from beamdae.parts.rotation import Rotation
from beamdae.read_only import read_only_data
from beamdae.results.solution import Solution
from beamdae.results.start_changes import StartSummary, compare_start
from beamdae.simulation import as_equations, simulate

Array = np.ndarray

_MAX_FREE_MOTIONS = 8  # in the description
_MAX_ERRORS = 8

# Largest numbers of constraints and coordinates for dense factorizations; the time grows with their
# cube.
_MAX_CONSTRAINTS = 1500
_MAX_COORDINATES = 600
# Maximum wall times of the run that measures the cost, and of its pilot runs [s].
_MAX_MEASURED_TIME = 1.0
_MAX_PILOT_TIME = 3.0
# Steps of a run, minutes of small models, from which on beams without damping have a warning.
_MIN_STEPS_OF_LONG_RUN = 5e4


@dataclass(frozen=True)
class ConstraintResidual:
    """Largest constraint residuals of a part at the start.

    Attributes
    ----------
    part
        Name of the part; "constraint" for all constraints of a constrained system.
    position, velocity
        Largest |g| [m or rad] and |g_dot| [m/s or rad/s] before the start is made consistent.
    acceleration
        Largest |g_ddot| [m/s^2 or rad/s^2] after the start is made consistent, or None if no
        consistent start was found.
    """

    part: str
    position: float
    velocity: float
    acceleration: float | None


@dataclass(frozen=True)
class RunPrediction:
    """Order-of-magnitude prediction of the cost of a run with `Auto()`, from its first steps.

    Attributes
    ----------
    steps, seconds
        Number of steps, and wall time [s] without assembly, consistent start and compilation.
    method
        Method that `Auto` selects.
    covered_share
        Fraction of the run that was measured [-].
    """

    steps: float
    seconds: float
    method: str
    covered_share: float


@read_only_data
@dataclass(frozen=True)
class Check:
    """Properties and defects of a mechanism; `str(check)` is a report.

    Attributes
    ----------
    name
        Name of the model function; "mechanism" if the model was built without one.
    coordinates, states, constraints, rank
        Numbers of coordinates, of first-order states (and values of sampled controllers) among
        them, of constraints, and of independent constraints at the start; `rank` is None if there
        are more than 1500 constraints.
    rigid_mobility
        Degrees of freedom if beams are rigid, with drivers as constraints; None if `rank` is None.
    dependent
        Minimal sets of dependent constraints; empty if `rank` is None.
    free_motions
        Descriptions of the motions that the joints and drivers allow if beams are rigid; empty if
        `rank` is None.
    loose
        Groups of parts that no joint connects to the ground; empty for constrained systems.
    residuals
        Constraint residuals of each part with constraints.
    start
        Changes of the requested start that make it consistent, or None if no consistent start was
        found.
    spectrum
        Range of the natural frequencies. None if no consistent start was found, or the model has
        more than 600 coordinates or 1500 constraints.
    prediction
        Predicted cost of a run. None if no prediction was requested, the end time is not known, the
        mechanism cannot be run, or the run failed or took no step.
    problem
        Reason why the mechanism cannot be run, or "".
    warnings
        Sentences about the start (see `StartSummary.warning`), sections that are higher than
        their beams are long, contacts that start inside a surface, columns with errors above 4 %,
        and beams without damping in runs with more than 50 000 predicted steps.
    errors
        Errors of the observed columns, see `Solution.errors`, if there are any and the predicted
        run is complete; otherwise None.
    free_groups
        Groups of `loose` that no spring or other force holds in place, without bodies of contacts.
        Empty for models with inactive parts.
    """

    name: str
    coordinates: int
    states: int
    constraints: int
    rank: int | None
    rigid_mobility: int | None
    dependent: tuple[DependentSet, ...]
    free_motions: tuple[str, ...]
    loose: tuple[tuple[str, ...], ...]
    residuals: tuple[ConstraintResidual, ...]
    start: StartSummary | None
    spectrum: FrequencyRange | None
    prediction: RunPrediction | None
    problem: str
    warnings: tuple[str, ...] = ()
    errors: Errors | None = None
    free_groups: tuple[tuple[str, ...], ...] = ()

    def __repr__(self) -> str:
        return f"<Check of {self.name}: mobility {self.mobility}; {self.verdict}>"

    @property
    def verdict(self) -> str:
        """The reason why a run is not possible, or "ready to run".

        The latter is followed by the number of warnings, the groups of `free_groups` and the rate
        of a motion that grows from the start.
        """
        if self.problem:
            return self.problem
        notes = []
        if self.warnings:
            notes.append(f"{format_count(len(self.warnings), 'warning')} about its results")
        if self.free_groups:
            groups = "; ".join(list_first(group) for group in self.free_groups)
            notes.append(f"no joint or spring connects {groups} to the ground")
        if self.spectrum is not None and self.spectrum.growth:
            notes.append(self.spectrum.growth)
        return "ready to run" + f", but {'; '.join(notes)}" * bool(notes)

    def _repr_html_(self) -> str:
        from beamdae.report.tables import format_html_table

        return format_html_table(describe_check(self))

    def __str__(self) -> str:
        facts = describe_check(self)
        width = max(map(len, facts))
        return "\n".join([self.name, *(f"{topic:<{width}}  {x}" for topic, x in facts.items())])

    @property
    def mobility(self) -> int | None:
        """Degrees of freedom: `coordinates` - `states` - `rank`; None if `rank` is None."""
        return None if self.rank is None else self.coordinates - self.states - self.rank

    @property
    def ok(self) -> bool:
        """True if the mechanism can be run."""
        return not self.problem


def describe_check(check: Check) -> dict[str, str]:
    """Return the results of a `Check` as texts by topic, the verdict first."""
    facts = {"verdict": check.verdict}
    if check.mobility is not None:
        states = f" - {check.states} states" if check.states else ""
        facts["mobility"] = (
            f"{check.rigid_mobility} with rigid beams and fixed drivers; {check.mobility} = "
            f"{check.coordinates} coordinates{states} - {check.rank} independent constraints"
        )
        if dependent := describe_dependent_sets(check.dependent):
            facts["dependent constraints"] = dependent
        if check.free_motions:
            motions = [*check.free_motions[:_MAX_FREE_MOTIONS]]
            if omitted := len(check.free_motions) - len(motions):
                motions.append(f"and {omitted} more")
            facts["free motions"] = "; ".join(motions)
    else:
        facts["mobility"] = (
            f"not computed: {check.coordinates} coordinates, {check.constraints} constraints"
        )
    if loose := "; ".join(", ".join(group) for group in check.loose):
        facts["unconnected parts"] = f"no joint connects to the ground: {loose}"
    facts["start"] = _describe_start(check)
    if check.spectrum is not None:
        facts |= _describe_frequencies(check.spectrum)
    elif check.start is not None:
        facts["frequencies"] = "not computed: too many coordinates or constraints"
    if check.errors is not None and not check.errors.reason:
        total = dict(zip(check.errors.headers, check.errors.total.tolist(), strict=True))
        named = sorted((name for name in total if total[name] > 0.0), key=lambda x: -total[x])
        if named:
            facts["errors"] = list_first([f"{total[x]:.2g} ({x})" for x in named], _MAX_ERRORS)
    if check.prediction is not None:
        p = check.prediction
        facts["predicted cost"] = (
            f"about {_round(p.steps)} steps of {p.method}, {_round(p.seconds)} s, measured in "
            f"{100.0 * p.covered_share:.3g} % of a run"
        )
    for k, warning in enumerate(check.warnings, start=1):
        facts["warning" if len(check.warnings) == 1 else f"warning {k}"] = warning
    return facts


def _round(value: float) -> str:
    """Return the value with one significant digit, without an exponent below a million."""
    return f"{float(f'{value:.1g}'):g}"


def _describe_start(check: Check) -> str:
    if check.start is None:
        return "no consistent start"
    change = check.start.largest
    if change is None:
        text = "there are no coordinates"
    elif change.displacement > 0.0:
        distance = f"{change.displacement:.3g} m ({change.coordinate})"
        text = f"closing the joints moves {change.part} by {distance}"
    else:
        text = "the joints are closed"
    return f"{check.start.request}; {text}"


def _describe_frequencies(frequencies: FrequencyRange) -> dict[str, str]:
    if frequencies.massless:
        return {"mass": f"singular: {frequencies.massless} has no inertia"}
    facts = {}
    lowest, highest = frequencies.lowest, frequencies.highest
    if highest is not None and lowest is not None:
        facts["frequencies"] = f"{lowest:.4g} to {highest:.4g} Hz"
    if frequencies.growth:
        facts["unstable"] = frequencies.growth
    return facts


@interruptible
def check(
    model: Any,
    t_end: float | None = None,
    predict: bool = True,
    start: Rotation | str | Mapping[str, float] | None = None,
) -> Check:
    """Check a model without a complete run.

    Determines mobility, dependent constraints, free motions, constraint residuals at the start,
    natural frequencies, errors and the cost of a run.

    Parameters
    ----------
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
    t_end
        End time [s] of the predicted run. Defaults to the model's end time; if the model has none,
        no run is predicted.
    predict
        True to predict the cost from a run that is stopped after 1 s of wall time, in addition to
        at most 3 s for its pilot runs. If the run does not reach its end, its cost is extrapolated
        in proportion to the time.
    start
        Start of the run, as in `simulate`, but no earlier run. Defaults to the start of the model.

    Returns
    -------
    Check
        Results of the checks. If the model cannot be run, `problem` gives the reason.

    Raises
    ------
    BeamdaeError
        If an argument is invalid or the equations cannot be assembled.
    Interrupted
        If Ctrl-C ends the call.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> bar = mech.add(bd.RigidBody("bar", 1.0, 0.1, center=(0.5, 0.0)))
    >>> hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0)))
    >>> findings = bd.check(mech, predict=False)
    >>> findings.mobility, findings.free_motions
    (1, ('bar can rotate about (0, 0)',))
    """
    name, predict = "mechanism", require_choice("check", "predict", predict, (True, False))
    if isinstance(model, (Model, HasOrigin)) and model.origin is not None:
        name, t_end = model.origin.name, model.origin.t_end if t_end is None else t_end
    end = None if t_end is None else require_positive("check", "t_end", t_end)
    if start is not None:
        start = require_start("check", start)
    equations = as_equations("check", model, start, sampled=True)
    active = equations.initially_active
    starter, state, problem = _plan_start(active, end or 1.0)
    # This solver includes redundant constraints, unlike `starter`.
    time, solver = time_on_branch(equations.breakpoints, 0.0, end), ConsistencySolver(active)
    q = equations.q0 if state is None else state.q
    v = equations.v0 if state is None else state.v
    loose = find_loose_groups(equations) if equations.mechanism else ()
    findings = Check(
        name,
        equations.n,
        len(equations.states),
        equations.m,
        rank=None,
        rigid_mobility=None,
        dependent=(),
        free_motions=(),
        # A constrained system has no parts, and the meaning of its coordinates is unknown.
        loose=loose,
        residuals=_constraint_residuals(solver, time, state),
        start=None if state is None else compare_start(equations, state),
        spectrum=None,
        prediction=None,
        problem=problem,
        warnings=_collect_warnings(equations, starter, time, state),
        free_groups=find_free_groups(equations, time, q, end or 1.0),
    )
    if equations.m <= _MAX_CONSTRAINTS:
        joints = analyze_constraint_rank(solver, time, q)
        motions = find_free_motions(equations, q, joints)
        findings = replace(
            findings,
            rank=joints.rank,
            rigid_mobility=len(motions),
            dependent=find_dependent_sets(solver, time, q, v, joints),
            free_motions=tuple(describe_free_motion(equations, q, x) for x in motions),
        )
        if state is not None and equations.n <= _MAX_COORDINATES:
            spectrum = compute_frequency_range(starter.equations, time, state)
            findings = replace(findings, spectrum=spectrum)
    if predict and end is not None and not problem:
        prediction, run = _predict_run(equations, end)
        # The errors of runs that were stopped are not those of the motion.
        is_measured = run is not None and run.status.success
        stated = tuple(check_errors(run, run)) if run is not None and is_measured else ()
        errors = vars(run).get("errors") if is_measured else None
        sentences = (
            *findings.warnings,
            *stated,
            *_undamped_beam_warning(equations.mechanism, prediction),
        )
        findings = replace(findings, prediction=prediction, errors=errors, warnings=sentences)
    return findings


def _plan_start(equations: EquationsOfMotion, end: float) -> tuple[ConsistencySolver, Any, str]:
    """Return the start solver, the consistent state or None, and why no run is possible.

    The reason is empty if the model can be run. If the model has at most 1500 constraints, the
    solver and the state exclude dependent constraints.
    """
    independent, problem = equations, ""
    reduction = None
    if equations.m <= _MAX_CONSTRAINTS:
        time = time_on_branch(equations.breakpoints, 0.0, end)
        reduction = drop_dependent_constraints(equations, time)
    if reduction is not None:
        independent = reduction.equations
        try:
            if equations.redundant:
                reduction.require_agreement(time)
            else:
                plan_run(equations, np.array([0.0, end]))
        except BeamdaeError as error:
            problem = str(error)
    try:
        run_plan = plan_run(independent, np.array([0.0, end]))
    except BeamdaeError as error:
        return ConsistencySolver(independent), None, problem or str(error)
    return run_plan.starter, run_plan.state, problem


def _collect_warnings(
    equations: EquationsOfMotion, starter: ConsistencySolver, time: Array, state: Any
) -> tuple[str, ...]:
    """Return the warnings about single parts; `state` is the consistent start or None."""
    sentences = list(equations.build_warnings)
    if state is not None:
        sentences += filter(None, (compare_start(equations, state).warning,))
        sentences += start_inside_warnings(equations, starter.equations, time, state)
        if starts_in_equilibrium(equations):
            sentences += deep_rest_warnings(equations, time[None], state.q[None])
    return tuple(sentences)


def _constraint_residuals(
    solver: ConsistencySolver, time: Array, state: Any
) -> tuple[ConstraintResidual, ...]:
    e = solver.equations
    drawn_q = e.q0 if e.start is None or e.start.closed_q is None else e.start.q
    g, g_dot, _ = np.abs(solver.constraint_levels(time, drawn_q, e.v0))
    if state is not None:
        g_ddot = np.abs(solver.constraint_levels(time, state.q, state.v, state.a)[2])
    parts = [name.rpartition(".")[0] or name for name in e.lam_names]
    residuals = []
    for part in dict.fromkeys(parts):
        rows = np.array([name == part for name in parts])
        acceleration = None if state is None else float(g_ddot[rows].max())
        position, velocity = float(g[rows].max()), float(g_dot[rows].max())
        residuals.append(ConstraintResidual(part, position, velocity, acceleration))
    return tuple(residuals)


def _predict_run(
    equations: EquationsOfMotion, end: float
) -> tuple[RunPrediction | None, Solution | None]:
    """Measure the cost of a run, or extrapolate it; None if the run fails or takes no step.

    The second result is the measured run, which has the pilot runs of a complete run, so that it
    has the same method and error control. `progress` stops it, because `time_limit` of the
    integrator would change the pilot runs. If it is stopped, steps of the same mean length continue
    it. The times begin with the first steps, after compilation.
    """
    pilot_began = main_began = 0.0

    def stop(t: float) -> str | None:
        nonlocal pilot_began, main_began
        now = clock.perf_counter()
        pilot_began = pilot_began or now
        if t > 0.0 and not main_began:
            main_began = now
        limit = main_began + _MAX_MEASURED_TIME if main_began else pilot_began + _MAX_PILOT_TIME
        return "measured" if now > limit else None

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BeamdaeWarning)
        run = simulate(equations, Auto(), end, progress=stop)
    wall_time, steps = run.statistics.wall_time, run.statistics.steps
    main_time = min(clock.perf_counter() - main_began, wall_time) if main_began else 0.0
    reached = run.trajectory.end
    if not reached > 0.0 or run.status.kind == "failed":
        return None, None
    growth = 1.0 if run.status.success else end / reached
    method = run.integrator.get("method", "")
    seconds = wall_time - main_time + main_time * growth
    return RunPrediction(steps * growth, seconds, method, reached / end), run


def _undamped_beam_warning(
    mechanism: Mechanism | None, prediction: RunPrediction | None
) -> Iterator[str]:
    """Yield a warning if a run is long and beams have no damping."""
    if prediction is None or prediction.steps < _MIN_STEPS_OF_LONG_RUN:
        return
    if beams := find_undamped_beams(mechanism):
        yield (
            f"{list_first(beams)}: without damping, vibrations of beams do not decay, "
            f"and steps that follow them (about {prediction.steps:.0e}) make runs long; set "
            f"damping= of the sections, such as {EXAMPLE_DAMPING:g} s."
        )
