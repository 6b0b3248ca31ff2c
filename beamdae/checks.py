"""What a mechanism is, and what is wrong with it, without a run to its end."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.analysis.linear_dynamics.symmetric_eigenproblem import (
    FrequencyRange,
    compute_frequency_range,
)
from beamdae.beams.beam import Beam
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.mobility import (
    count_rigid_mobility,
    describe_free_motions,
    find_loose_groups,
)
from beamdae.equations.starts.reduced_equations import drop_dependent_constraints
from beamdae.equations.starts.redundant_constraints import (
    DependentSet,
    analyze_constraint_rank,
    find_dependent_sets,
)
from beamdae.errors import BeamdaeError, BeamdaeWarning, require_choice, require_positive
from beamdae.integrators.auto import Auto
from beamdae.integrators.run_plan import branch_time, plan_run
from beamdae.model_functions import HasOrigin, Model
from beamdae.parts.mechanism import Mechanism
from beamdae.report.terminal.check_report import describe_check
from beamdae.results.diagnostics.start_changes import StartSummary, compare_start
from beamdae.simulation import as_equations, simulate

Array = np.ndarray

# Constraints and coordinates whose matrices are looked at as a whole: that takes their cube.
_MOST_CONSTRAINTS, _MOST = 1500, 600
# Seconds a trial run may take.
_TRIAL = 1.0
# Errors of curvature times length: on the hub beam the tip deformation is off by 3e-4 of its
# amplitude at 4e-3, and by 1e-2 at 1.5e-2 (validation/mesh_convergence).
_GOOD, _FAIR = 5e-3, 5e-2


@dataclass(frozen=True)
class ConstraintResidual:
    """By how much a part's constraints are off at the start as it was asked for.

    Attributes
    ----------
    part
        Its name.
    position, velocity
        Largest |g| [m or rad] and |g_dot| [m/s or rad/s] before anything is made consistent.
    acceleration
        Largest |g_ddot| at the consistent start, or None if there is none.
    """

    part: str
    position: float
    velocity: float
    acceleration: float | None


@dataclass(frozen=True)
class MeshAssessment:
    """How well the elements of a beam follow its curve.

    Attributes
    ----------
    beam
        Its name.
    length_error
        Largest relative error of arc length of an element.
    curvature_error
        Largest error of curvature times the length of the beam.
    verdict
        "good", "fair" or "coarse", and what helps.
    """

    beam: str
    length_error: float
    curvature_error: float
    verdict: str


@dataclass(frozen=True)
class RunPrediction:
    """What a run with `Auto()` will take, to the order of magnitude, from a trial of a second.

    Attributes
    ----------
    steps, seconds
        Steps, and time without building and compiling.
    method
        Which method Auto takes, and why.
    reached
        How far the trial came, of the whole run.
    """

    steps: float
    seconds: float
    method: str
    reached: float


@dataclass(frozen=True)
class Check:
    """What a mechanism is and what is wrong with it; `str` tells all of it.

    Attributes
    ----------
    name
        Of the model.
    coordinates, constraints, rank
        n, m and the number of independent constraints at the start; None where it is too large.
    rigid_mobility
        Degrees of freedom if all beams are rigid, with drivers as constraints.
    dependent
        Minimal sets of constraints that depend on each other.
    free_motions
        What the bodies can do, in words.
    loose
        Groups of parts that nothing ties to the others.
    residuals
        By how much constraints are off, by part.
    start
        What the joints change of the start asked for, or None if there is no start.
    spectrum
        Natural frequencies, or None: without a start, or of more than 600 coordinates.
    meshes
        Of each beam.
    prediction
        Steps and time of a run, or None.
    problem
        Why the mechanism cannot be run, or "".
    """

    name: str
    coordinates: int
    constraints: int
    rank: int | None
    rigid_mobility: int | None
    dependent: tuple[DependentSet, ...]
    free_motions: tuple[str, ...]
    loose: tuple[tuple[str, ...], ...]
    residuals: tuple[ConstraintResidual, ...]
    start: StartSummary | None
    spectrum: FrequencyRange | None
    meshes: tuple[MeshAssessment, ...]
    prediction: RunPrediction | None
    problem: str

    def __repr__(self) -> str:
        told = self.problem or "it can be run"
        return f"<Check of {self.name}: mobility {self.mobility}; {told}>"

    def _repr_html_(self) -> str:
        from beamdae.report.run_summary import format_html_table

        return format_html_table(describe_check(self))

    def __str__(self) -> str:
        """All of it as text."""
        told = describe_check(self)
        width = max(map(len, told))
        return "\n".join([self.name, *(f"{topic:<{width}}  {x}" for topic, x in told.items())])

    @property
    def mobility(self) -> int | None:
        """Degrees of freedom: coordinates less independent constraints."""
        return None if self.rank is None else self.coordinates - self.rank

    @property
    def ok(self) -> bool:
        """Whether it can be run."""
        return not self.problem


def check(model: Any, t_end: float | None = None, predict: bool = True) -> Check:
    """Look a model through without running it to its end.

    Parameters
    ----------
    model
        A model function (with its defaults), a mechanism, a constrained system or equations.
    t_end
        End time [s] of the run to predict; default the model's own, without one none is.
    predict
        Whether a trial run of at most a second is made.

    Raises
    ------
    BeamdaeError
        If the model cannot be stated; what is stated but cannot be run is told by `Check.problem`.
    """
    name, predict = "mechanism", require_choice("check", "predict", predict, (True, False))
    if isinstance(model, (Model, HasOrigin)) and model.origin is not None:
        name, t_end = model.origin.name, model.origin.t_end if t_end is None else t_end
    end = None if t_end is None else require_positive("check", "t_end", t_end)
    equations = as_equations("check", model)
    starter, state, problem = _plan_start(equations, end or 1.0)
    time, own = _first_branch(equations, end or 1.0), ConsistencySolver(equations)
    q = equations.q0 if state is None else state.q
    v = equations.v0 if state is None else state.v
    found = Check(
        name,
        equations.n,
        equations.m,
        rank=None,
        rigid_mobility=None,
        dependent=(),
        free_motions=(),
        # Coordinates of other systems may be anything.
        loose=find_loose_groups(equations) if equations.mechanism else (),
        residuals=_constraint_residuals(own, time, state),
        start=None if state is None else compare_start(equations, state),
        spectrum=None,
        meshes=_assess_meshes(equations.mechanism),
        prediction=None,
        problem=problem,
    )
    if equations.m <= _MOST_CONSTRAINTS:
        joints = analyze_constraint_rank(own, time, q)
        found = replace(
            found,
            rank=joints.rank,
            rigid_mobility=count_rigid_mobility(equations, q, joints),
            dependent=find_dependent_sets(own, time, q, v, joints),
            free_motions=describe_free_motions(equations, q, joints),
        )
        if state is not None and equations.n <= _MOST:
            found = replace(found, spectrum=compute_frequency_range(starter.equations, time, state))
    if predict and end is not None and not problem:
        found = replace(found, prediction=_predict_run(equations, end))
    return found


def _first_branch(equations: EquationsOfMotion, end: float) -> Array:
    inner = min((b for b in equations.breakpoints if 0.0 < b < end), default=end)
    return np.array([0.0, branch_time(0.0, inner)])


def _plan_start(equations: EquationsOfMotion, end: float) -> tuple[ConsistencySolver, Any, str]:
    """What starts the mechanism, its consistent state if there is one, and why it cannot be run.

    Where constraints depend on each other it is that of those that do not.
    """
    time, own, problem = _first_branch(equations, end), equations, ""
    few = equations.m <= _MOST_CONSTRAINTS
    if few and (by := drop_dependent_constraints(equations, time)) is not None:
        own = by.equations
        try:
            if equations.redundant:
                by.require_agreement(time)
            else:
                plan_run(equations, np.array([0.0, end]))
        except BeamdaeError as wrong:
            problem = str(wrong)
    try:
        route = plan_run(own, np.array([0.0, end]))
    except BeamdaeError as wrong:
        return ConsistencySolver(own), None, problem or str(wrong)
    return route.starter, route.state, problem


def _constraint_residuals(
    starter: ConsistencySolver, time: Array, state: Any
) -> tuple[ConstraintResidual, ...]:
    e = starter.equations
    g, rate, _ = np.abs(starter.constraint_levels(time, e.q0, e.v0))
    if state is not None:
        last = np.abs(starter.constraint_levels(time, state.q, state.v, state.a)[2])
    parts = [name.rpartition(".")[0] or name for name in e.lam_names]
    found = []
    for part in dict.fromkeys(parts):
        own = np.array([name == part for name in parts])
        accelerated = None if state is None else float(last[own].max())
        found.append(
            ConstraintResidual(part, float(g[own].max()), float(rate[own].max()), accelerated)
        )
    return tuple(found)


def _assess_meshes(mechanism: Mechanism | None) -> tuple[MeshAssessment, ...]:
    beams = mechanism.parts.values() if mechanism else ()
    found = []
    for beam in beams:
        if isinstance(beam, Beam):
            length, curvature = beam.mesh.length_error, beam.kinematics.curvature_error
            off = max(length, curvature)
            grade = "good" if off <= _GOOD else "fair" if off <= _FAIR else "coarse"
            finer = f", elements={2 * beam.mesh.elements} would be better" * (grade != "good")
            found.append(MeshAssessment(beam.name, length, curvature, grade + finer))
    return tuple(found)


def _predict_run(equations: EquationsOfMotion, end: float) -> RunPrediction | None:
    """From a trial run of at most a second; of a second one, if the first had loops to compile."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BeamdaeWarning)
        solution = simulate(equations, Auto(time_limit=_TRIAL), end, output_step=end)
        if not solution.status.success:
            solution = simulate(equations, Auto(time_limit=_TRIAL), end, output_step=end)
    reached = solution.trajectory.end / end
    if not reached > 0.0 or solution.status.kind == "failed":
        return None
    took, chosen = solution.statistics, solution.integrator
    told = f"{chosen.get('method', '')}, {chosen.get('auto', '')}".rstrip(", ")
    return RunPrediction(took.steps / reached, took.wall_time / reached, told, reached)
