"""Runs with an estimated total error: time integration, mesh and beam theory.

The error of a run is estimated from its differences from runs with looser tolerances and coarser
meshes. Two successive differences give the observed ratio of the errors, and Richardson
extrapolation gives the error of the finest run. The constants below were calibrated on the
mechanisms of validation/certificates.
"""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from beamdae.beams.beam import EXACT_FORMULATION
from beamdae.beams.remeshing import BaseMesh, choose_base_meshes, with_meshes
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    ProgressError,
    call_progress,
    format_distinct,
    list_first,
    require_choice,
    require_finite,
    require_positive,
    require_progress,
    warn_of_incomplete_result,
)
from beamdae.integrators import Radau
from beamdae.integrators.limits import Progress
from beamdae.interrupts import (
    PARTIAL_RESULTS,
    Interrupted,
    PartialResult,
    acknowledge,
    attach_partial,
    interruptible,
)
from beamdae.parts.forces.contact import Contact
from beamdae.parts.forces.friction import Friction
from beamdae.parts.mechanism import Mechanism, require_start
from beamdae.results.certificate import MAX_ACCURACY, Certificate, CertificateRun, ErrorBudget
from beamdae.results.columns import (
    Header,
    drift_limits,
    mark_required_columns,
    mark_resting_columns,
    mark_vanishing_columns,
    measure_amplitudes,
    remove_unit,
    require_certified_columns,
    require_observed,
)
from beamdae.results.outcome import Status
from beamdae.results.run_data import find_drift
from beamdae.results.solution import Solution
from beamdae.simulation import as_equations, compute_output_times, unpack_model

Array = np.ndarray

_MIN_ACCURACY = 1e-6
# First runs: elements in the coarsest mesh of a beam without attachments between its ends, which
# are more for accuracies below a limit, and rtol.
_FIRST_ELEMENTS, _FIRST_ELEMENTS_FOR_SMALL_ERRORS = 1, 2
_SMALL_ERROR = 3e-3
_FIRST_RTOL_RATIO = 0.1  # rtol / accuracy
_MAX_FIRST_RTOL = 1e-3
_MAX_RTOL = 0.1  # of Radau
_RTOL_STEP = 10.0
# The first meshes are three, or two if a beam has more elements in the coarsest one, because of its
# curvature or attachments.
_FIRST_HALVINGS = 2
_MAX_COARSEST_ELEMENTS = 4

# Limits of the refinement.
_MIN_RTOL = 1e-9
_MAX_ELEMENTS = 32
_MAX_STEP_DECADES = 2
_MAX_STEP_HALVINGS = 2
# Orders of the errors used to choose the next run.
_ORDER_IN_RTOL = 0.8
_ORDER_IN_LENGTH = 3.5
# Part of the accuracy at which the time error and the mesh error are aimed, each.
_TARGET_SHARE = 0.4
# A refinement that does not reduce the largest error by this factor is a stagnation.
_MIN_REDUCTION = 1.5
_MAX_STAGNATIONS = 2
_MAX_NAMES = 3  # of columns in a sentence
# Small motions matter next to large ones, such as vibrations of a vehicle that travels.
_UNITS_OF_MOTION = ("m", "rad", "m/s", "rad/s")

# Error estimate. Errors decrease in a geometric sequence: if a refinement multiplies them by q, the
# error of the finer of two runs is q / (1 - q) times their difference.
_TIME_SAFETY_FACTOR = 1.25
_MESH_SAFETY_FACTOR = 1.25
# Limits of the observed ratios q of a decade of rtol and of a halving of all elements.
_MIN_TIME_RATIO, _MAX_TIME_RATIO = 0.1, 0.6
_MIN_MESH_RATIO, _MAX_MESH_RATIO = 0.02, 0.5
# Contacts, stick-slip and impacts reduce the order in time, which two differences need not show.
_MIN_NONSMOOTH_TIME_RATIO = 0.3
# Runs of few steps have not reached the order of the method.
_MIN_TIME_RATIO_OF_FEW_STEPS = 0.2
_FEW_STEPS = 200
# The curvature jumps at ends of elements, which reduces the order if points slide over them.
_MIN_MESH_RATIO_WITH_SLIDERS = 0.2
# A difference by tolerance that exceeds the accuracy is extrapolated only as far as the numbers of
# steps support: errors are proportional to (number of steps)^-5. If a decade of rtol multiplies the
# steps by more than the limit, the finer run resolves vibrations that the coarser one passes over.
_ORDER_IN_STEP = 5  # of Radau
_MAX_STEP_RATIO_PER_DECADE = 1.9
# Ratio of a halving if only two meshes are possible; two elements are halved, or more.
_MESH_RATIO_OF_TWO_ELEMENTS = 0.15
_MESH_RATIO = 0.1
_THEORY_SAFETY_FACTOR = 1.25
# Smallest stated error relative to the accuracy. Much smaller differences contain rounding errors
# and errors of Newton's method, and do not decrease in a geometric sequence.
_FLOOR = 3e-6
# The formulations of the model are kept if exact beams need more steps by this factor, and the
# theory error is at most this part of the accuracy. Times would make the choice irreproducible.
_MAX_EXACT_STEP_RATIO = 3.0
_MAX_KEPT_THEORY_SHARE = 0.2

# Columns that exceed the accuracy at no more than this fraction of the samples may jump at events;
# their difference is then measured at matching events.
_MAX_JUMP_FRACTION = 0.05
# The error grows exponentially if it grows by at least this factor over the fitted range, and an
# exponential fits better than a power of time.
_MIN_GROWTH = 1e3
_MIN_FITTED_SAMPLES = 20
# Larger differences, relative to half the range, do not decrease in proportion to the error.
_SATURATION = 0.3
_AS_WRITTEN = "as written"


@interruptible
def certify(
    model: Any,
    accuracy: float = 0.01,
    columns: Sequence[str] | str | None = None,
    t_end: float | None = None,
    output_step: float | None = None,
    start: Any = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
    *,
    partial: PartialResult = "raise",
) -> Certificate:
    """Simulate a model to a required accuracy and return the solution with its error budget.

    The integrator is `Radau`. The tolerance and the meshes are refined until the estimated sum of
    the errors of time integration, mesh and beam theory is within `accuracy`, for each required
    column and over the whole run, or until a limit is reached. Where possible, elements end at the
    attachments of a beam. Beams are geometrically exact in the solution, unless their formulation
    or mesh must not change, or floating frames are accurate enough and need less than a third of
    the steps; the budget also lists the theory error of the formulations that the model specifies.

    The errors of the solution are extrapolated from its differences from runs with looser
    tolerances and coarser meshes, with the observed ratio of two successive differences. The budget
    is an estimate by comparison of runs, not a proof. It does not include errors of Reissner's beam
    theory itself, or of materials, joints and data.

    Parameters
    ----------
    model
        A model function, a mechanism, a constrained system or equations of motion. For the last
        two, the budget contains the time error only.
    accuracy
        Largest permitted error of a column relative to half its range [-], from 1e-6 to 0.1. For
        columns that are constant but for errors, such as the stress in a steady rotation, it is
        relative to the largest magnitude; for positions and angles, at most to the size of the
        mechanism or 1 rad.
    columns
        Observed columns, or names of observables, that must be within the accuracy. Defaults to all
        positions, angles and deflections [m, rad] or, if there are none, to all columns. The budget
        lists the other columns as well.
    t_end
        End time [s]. Defaults to the model's end time.
    output_step
        Time between rows of the result [s]. Defaults to a thousandth of the end time. Errors are
        estimated at these times.
    start
        "as drawn", "equilibrium", or positions and velocities by name; see `simulate`. Defaults to
        the start of the model.
    time_limit
        Maximum total wall time of all runs [s]. Defaults to no limit.
    progress
        Function called repeatedly during each run with the time reached [s]; see `simulate`.
    partial
        "return" to return the certificate so far if the call is interrupted, with the status
        "interrupted", instead of raising `Interrupted`. Before the end of the first run,
        `Interrupted` is raised in any case.

    Returns
    -------
    Certificate
        The solution and its budget. If the accuracy is not reached, `status` gives the reason, and
        `good_until` and `growth_rate` describe the error.

    Raises
    ------
    BeamdaeError
        If the model or a setting is invalid, nothing is observed, or the time limit is reached
        before the first run.
    Interrupted
        If Ctrl-C ends the call; `Interrupted.partial` is the certificate of the runs so far, or
        None before the end of the first run.
    Exception
        Any exception of `progress`, with this certificate as the attribute `partial`.

    Warns
    -----
    BeamdaeWarning
        If the accuracy is not reached, with the reason.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> bob = mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
    >>> rod = mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), bob.point))
    >>> mech.observe("bob", bob.point)
    >>> certificate = bd.certify(mech, accuracy=0.001, t_end=1.0)
    >>> certificate.status.success
    True
    """
    require_choice("certify", "partial", partial, PARTIAL_RESULTS)
    accuracy = require_finite("certify", "accuracy", accuracy)
    if not _MIN_ACCURACY <= accuracy <= MAX_ACCURACY:
        least, most, given = format_distinct(_MIN_ACCURACY, MAX_ACCURACY, accuracy)
        raise BeamdaeError(
            f"certify: accuracy must lie between {least} and {most}, got {given}; 0.01 is 1 %."
        )
    required = require_certified_columns("certify", columns)
    if time_limit is not None:
        time_limit = require_positive("certify", "time_limit", time_limit)
    if start is not None:
        require_start("certify", start)
    require_progress("certify", progress)
    model, t_end, description = unpack_model("certify", model, t_end)
    times = compute_output_times("certify", t_end, output_step)
    description["t_end"] = float(times[-1])
    task = _Task(model, times, accuracy, required, start, time_limit, progress, description)
    try:
        certificate = _Certification(task).result()
    except ProgressError as error:
        # With the certificate of the runs so far.
        raise error.problem from None
    if certificate.status.kind == "interrupted" and partial == "raise":
        raise Interrupted(certificate.status.sentence, certificate, "certify")
    if not certificate.status.success:
        name = description.get("name", "certify")
        warn_of_incomplete_result(f"{name}: not certified; {certificate.status.sentence}.")
    return certificate


@dataclass(frozen=True)
class _Task:
    """Model and settings of a certificate."""

    model: Any
    times: Array
    accuracy: float
    required: Sequence[str] | None
    start: Any
    time_limit: float | None
    progress: Progress | None
    description: dict[str, Any]
    begin: float = field(default_factory=clock.perf_counter)
    # Equations by halvings and formulation, shared by runs with different tolerances.
    equations: dict[tuple[int, bool], EquationsOfMotion] = field(default_factory=dict)

    @cached_property
    def base_meshes(self) -> dict[str, BaseMesh]:
        """Coarsest mesh of each beam, by name; empty unless the model is a mechanism."""
        if not isinstance(self.model, Mechanism):
            return {}
        is_small = self.accuracy < _SMALL_ERROR
        elements = _FIRST_ELEMENTS_FOR_SMALL_ERRORS if is_small else _FIRST_ELEMENTS
        return choose_base_meshes(self.model, elements, self.start)

    def build(self, halvings: int, exact: bool) -> EquationsOfMotion:
        """Return the equations on a mesh; `exact` replaces floating frames where possible."""
        if (halvings, exact) not in self.equations:
            self.equations[halvings, exact] = self._assemble(halvings, exact)
        return self.equations[halvings, exact]

    def _assemble(self, halvings: int, exact: bool) -> EquationsOfMotion:
        if not self.base_meshes:
            return as_equations("certify", self.model, self.start, sampled=True)
        meshes = {name: base.refined(halvings) for name, base in self.base_meshes.items()}
        formulations = {
            name: EXACT_FORMULATION
            for name, base in self.base_meshes.items()
            if exact and base.can_be_exact
        }
        return as_equations(
            "certify", with_meshes(self.model, meshes, formulations), self.start, sampled=True
        )

    def element_counts(self, halvings: int) -> dict[str, int]:
        return {name: base.refined(halvings).elements for name, base in self.base_meshes.items()}

    def run(self, halvings: int, rtol: float, exact: bool) -> _Run:
        """Run the model on one mesh with one tolerance.

        Raises
        ------
        _RunError
            If the run is not completed.
        """
        begin = clock.process_time()
        remaining = None
        if self.time_limit is not None:
            remaining = self.time_limit - (clock.perf_counter() - self.begin)
            if remaining <= 0.0:
                raise _RunError(
                    Status("limited", f"reached the time limit of {self.time_limit:g} s"), None
                )
        equations = self.build(halvings, exact)
        headers = equations.observed_headers
        require_observed("certify", headers)
        # Wrong names are rejected before the run.
        mark_required_columns("certify", self.required, headers)
        # Their exceptions end the certificate, too.
        progress = None if self.progress is None else partial(call_progress, self.progress)
        try:
            solution = Radau(rtol, time_limit=remaining).integrate(equations, self.times, progress)
        except Interrupted as problem:
            if problem.partial is None:
                raise
            acknowledge()
            solution = problem.partial
        solution = replace(solution, model=self.description)
        run = _Run(solution, halvings, rtol, exact, clock.process_time() - begin)
        if not solution.status.success:
            raise _RunError(solution.status, run)
        return run


class _RunError(Exception):
    """A run was not completed."""

    def __init__(self, status: Status, run: _Run | None) -> None:
        super().__init__(status.sentence)
        self.status = status
        self.run = run


@dataclass(frozen=True)
class _Run:
    """A run; `halvings` is how often the elements of the coarsest mesh were halved."""

    solution: Solution
    halvings: int
    rtol: float
    exact: bool
    processor_time: float

    @property
    def steps(self) -> int:
        return self.solution.trajectory.steps

    @cached_property
    def rows(self) -> Array:
        """Observed columns (k, columns)."""
        return np.stack(list(self.solution.columns.values()), axis=1)

    @cached_property
    def amplitude(self) -> Array:
        """Values to which errors are relative, see `measure_amplitudes`."""
        return self._amplitudes[0]

    @cached_property
    def is_at_rest(self) -> Array:
        """True for columns that are noise, at the level of rounding errors or compared with others.

        Constant columns are exempt, because they may have another value on another mesh.
        """
        headers, length = list(self.solution.columns), self.solution.equations.length
        amplitude, is_constant = self._amplitudes
        mechanism = self.solution._sizes_of_mechanism
        is_noise = mark_resting_columns(headers, self.rows, amplitude, length, others=mechanism)
        is_motion = np.array([Header.of(x).unit in _UNITS_OF_MOTION for x in headers], bool)
        is_vanishing = mark_vanishing_columns(headers, amplitude, length, others=mechanism)
        is_noise |= is_vanishing & ~is_motion
        return is_noise & ~is_constant

    @cached_property
    def _amplitudes(self) -> tuple[Array, Array]:
        return measure_amplitudes(self.solution.equations, self.rows, self.rtol)


@dataclass(frozen=True)
class _Difference:
    """Differences of two runs relative to half the range of the columns of the finer run.

    Attributes
    ----------
    t
        Times of the rows (k,) [s].
    rows
        Absolute differences (k, columns); 0 for columns at rest.
    event_shift
        Largest difference between the times of matched events [s]; 0 if events were not matched.
    """

    t: Array
    rows: Array
    event_shift: float = 0.0

    @cached_property
    def largest(self) -> Array:
        return np.asarray(np.max(self.rows, axis=0))


def _compare(coarse: _Run, fine: _Run, accuracy: float) -> _Difference:
    count = min(len(coarse.rows), len(fine.rows))
    # The last rows differ in time if an event ends the runs.
    times = fine.solution.t[:count]
    if coarse.solution.t[count - 1] != times[-1]:
        count -= 1
        times = times[:-1]
    rows = _scale(coarse.rows[:count] - fine.rows[:count], coarse, fine)
    exceeding = np.mean(rows > accuracy, axis=0)
    jumps = (exceeding > 0.0) & (exceeding <= _MAX_JUMP_FRACTION)
    if not jumps.any():
        return _Difference(times, rows)
    matched = _match_events(coarse, fine, times)
    if matched is None:
        return _Difference(times, rows)
    coarse_rows, shift = matched
    rows[:, jumps] = _scale(coarse_rows - fine.rows[:count], coarse, fine)[:, jumps]
    return _Difference(times, rows, shift)


def _scale(differences: Array, coarse: _Run, fine: _Run) -> Array:
    """Return differences of two runs relative to the amplitudes; 0 for columns at rest.

    Columns that move by no more than the drift of the constraints are at rest.
    """
    headers, length = list(fine.solution.columns), fine.solution.equations.length
    drifts = (drift_limits(headers, length, *find_drift(run.solution)) for run in (coarse, fine))
    largest = 0.5 * np.max(np.abs(differences), axis=0), 0.5 * np.ptp(fine.rows, axis=0)
    is_drift = [x <= limit for x, limit in zip(largest, drifts, strict=True)]
    is_at_rest = fine.is_at_rest | np.all(is_drift, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(is_at_rest, 0.0, np.abs(differences) / fine.amplitude)


def _match_events(coarse: _Run, fine: _Run, times: Array) -> tuple[Array, float] | None:
    """Return the coarse rows at times mapped by matching events, and the largest time shift [s].

    Returns None if the runs have no events, different sequences of events, or simultaneous events.
    """
    records = coarse.solution.event_records, fine.solution.event_records
    sequences = [[(record.name, record.direction) for record in x] for x in records]
    if not sequences[0] or sequences[0] != sequences[1]:
        return None
    end = float(times[-1])
    moments = [np.array([record.t for record in x]) for x in records]
    inside = np.max(moments, axis=0) < end
    before, after = (np.concatenate([[times[0]], x[inside], [end]]) for x in moments)
    if np.any(np.diff(before) <= 0.0) or np.any(np.diff(after) <= 0.0):
        return None
    at = np.interp(times, after, before)
    rows = np.stack(list(replace(coarse.solution, t=at).columns.values()), axis=1)
    return rows, float(np.max(np.abs(before - after)))


@dataclass
class _Certification:
    """Runs of one certificate, and the error budget of the last run."""

    task: _Task

    def __post_init__(self) -> None:
        self._runs: list[_Run] = []
        self._theory: Array | float = 0.0
        self._theory_as_written: Array | float = 0.0
        self._time: Array = np.zeros(0)
        self._mesh: Array = np.zeros(0)
        # Factors of the errors for a decade of rtol and for a halving of all elements.
        self._time_ratio: Array = np.zeros(0)
        self._mesh_ratio: Array = np.zeros(0)
        self._last_difference: _Difference | None = None
        self._exact = True

    # Data of the last run.

    @property
    def _last(self) -> _Run:
        """The finest run with the chosen formulation, or the finest of all if none has it."""
        runs = [run for run in self._runs if run.exact == self._exact] or self._runs
        return max(runs, key=lambda run: (run.halvings, -run.rtol))

    @cached_property
    def _required(self) -> Array:
        headers = list(self._last.solution.columns)
        return mark_required_columns("certify", self.task.required, headers)

    @cached_property
    def _beams(self) -> list[BaseMesh]:
        return list(self.task.base_meshes.values())

    @property
    def _can_refine_mesh(self) -> bool:
        counts = self.task.element_counts(self._last.halvings)
        refinable = [counts[x.beam.name] for x in self._beams if not x.fixed_by]
        return bool(refinable) and 2 * max(refinable) <= _MAX_ELEMENTS

    @property
    def _time_ratio_limits(self) -> tuple[float, float]:
        model, last = self.task.model, self._last
        parts = model.parts.values() if isinstance(model, Mechanism) else ()
        has_contacts = any(isinstance(part, (Contact, Friction)) for part in parts)
        lower = _MIN_TIME_RATIO
        if has_contacts or last.solution.event_records:
            lower = _MIN_NONSMOOTH_TIME_RATIO
        elif last.steps < _FEW_STEPS:
            lower = _MIN_TIME_RATIO_OF_FEW_STEPS
        return lower, _MAX_TIME_RATIO

    @property
    def _mesh_ratio_limits(self) -> tuple[float, float]:
        has_sliders = any(base.has_slider for base in self._beams)
        return (_MIN_MESH_RATIO_WITH_SLIDERS if has_sliders else _MIN_MESH_RATIO), _MAX_MESH_RATIO

    @property
    def _first_halvings(self) -> int:
        """Halvings of the finest of the first meshes."""
        if not self._has_mesh:
            return 0
        counts = [base.mesh.elements for base in self._beams if not base.fixed_by]
        return _FIRST_HALVINGS if max(counts) <= _MAX_COARSEST_ELEMENTS else 1

    @property
    def _has_mesh(self) -> bool:
        return any(not base.fixed_by for base in self._beams)

    @property
    def _total(self) -> Array:
        return np.asarray(self._time + self._mesh + np.nan_to_num(self._theory))

    def _run(self, halvings: int, rtol: float, exact: bool) -> _Run:
        run = self.task.run(halvings, rtol, exact)
        self._runs.append(run)
        return run

    # The algorithm.

    def result(self) -> Certificate:
        """Refine until the required columns are within the accuracy or a limit is reached."""
        try:
            status = self._refine()
        except _RunError as problem:
            if not self._runs:
                if problem.status.kind == "interrupted":
                    raise KeyboardInterrupt from None
                if problem.run is None:
                    raise BeamdaeError(
                        f"certify: {problem.status.sentence} before the first run; increase "
                        "time_limit."
                    ) from None
                self._runs.append(problem.run)
            status = problem.status
            sentence = f"a run was not completed: {status.sentence}"
            status = Status(status.kind, sentence)
        except ProgressError as error:
            status = Status("failed", str(error))
            attach_partial(error.problem, self._certificate(status) if self._runs else None)
            raise
        except KeyboardInterrupt:
            acknowledge()
            # Runs return their status; this interrupt came while equations were assembled or runs
            # were compared.
            if not self._runs:
                raise
            status = Status("interrupted", "interrupted between two runs")
        return self._certificate(status)

    def _refine(self) -> Status:
        """Run the first meshes and tolerances, and refine them further if necessary.

        The first run has the intermediate mesh and tolerance. Up to two coarser and two finer runs
        give up to two differences by mesh and two by tolerance.
        """
        rtol = min(_FIRST_RTOL_RATIO * self.task.accuracy, _MAX_FIRST_RTOL)
        first = self._first_run(rtol)
        self._choose_formulation(first)
        first = next(run for run in self._runs if run.exact == self._exact)
        coarse = None
        if first.halvings:
            coarse = self._try_run(first.halvings - 1, first.rtol, self._exact)
        base = coarse or first
        loose_rtol = min(_RTOL_STEP * first.rtol, _MAX_RTOL)
        loose = self._try_run(base.halvings, loose_rtol, self._exact)
        halvings = first.halvings + self._has_mesh
        finer = self._run(halvings, first.rtol / _RTOL_STEP, self._exact)
        middle = self._run(halvings, first.rtol, self._exact) if self._has_mesh else first
        by_time = self._compare(middle, finer).largest
        self._time_ratio = self._observe_ratio(
            self._compare(loose, base).largest if loose else None,
            by_time,
            self._time_ratio_limits,
        )
        self._time_ratio = self._limit_ratio_by_steps(self._time_ratio, by_time, middle, finer)
        time = _extrapolate(by_time, _TIME_SAFETY_FACTOR, self._time_ratio)
        mesh = np.zeros(len(time))
        self._mesh_ratio = np.full(len(time), _MAX_MESH_RATIO)
        if self._has_mesh:
            by_mesh = self._compare(first, middle).largest
            self._mesh_ratio = self._observe_ratio(
                self._compare(coarse, first).largest if coarse else None,
                by_mesh,
                self._mesh_ratio_limits,
                self._expected_mesh_ratio(first),
            )
            mesh = _extrapolate(by_mesh, _MESH_SAFETY_FACTOR, self._mesh_ratio)
            self._compare(first, finer)
        self._set(time, mesh)
        return self._refine_further()

    def _first_run(self, rtol: float) -> _Run:
        """Return the first run with exact beams, repeated once with finer settings if it fails."""
        halvings = max(self._first_halvings - 1, 0)
        run = self._try_run(halvings, rtol, exact=True)
        if run is None:
            run = self._run(halvings + self._has_mesh, rtol / _RTOL_STEP, exact=True)
        return run

    def _try_run(self, halvings: int, rtol: float, exact: bool) -> _Run | None:
        """Return a run, or None if it fails."""
        try:
            return self._run(halvings, rtol, exact)
        except _RunError as problem:
            if problem.status.kind != "failed":
                raise
        return None

    def _observe_ratio(
        self,
        before: Array | None,
        last: Array,
        limits: tuple[float, float],
        expected: float | None = None,
    ) -> Array:
        """Return the ratio of the last two differences of each column, within `limits`.

        The ratio of a column is at least the median of the required columns, because differences of
        single columns may be small by chance. If `before` is None, the ratio is `expected`, but at
        least the lower limit; if `expected` is None, too, it is the upper limit.
        """
        lower, upper = limits
        if before is None:
            return np.full(len(last), upper if expected is None else max(expected, lower))
        is_moving = (before > 0.0) & (last > 0.0)
        ratios = np.divide(last, before, out=np.full(len(last), np.nan), where=is_moving)
        known_ratios = ratios[is_moving & self._required]
        typical = float(np.median(known_ratios)) if len(known_ratios) else upper
        return np.clip(np.fmax(ratios, typical), lower, upper)

    def _limit_ratio_by_steps(
        self, ratio: Array, differences: Array, coarse: _Run, fine: _Run
    ) -> Array:
        """Return ratios that are not smaller than the numbers of steps support.

        Only the ratios of columns whose difference exceeds the accuracy are changed: for the other
        columns, even the coarser run is about as accurate as required.
        """
        lower, upper = self._time_ratio_limits
        decades = np.log10(coarse.rtol / fine.rtol)
        growth = fine.steps / max(coarse.steps, 1)
        is_newly_resolved = growth > _MAX_STEP_RATIO_PER_DECADE**decades
        supported = upper if is_newly_resolved else np.clip(growth**-_ORDER_IN_STEP, lower, upper)
        return np.where(differences > self.task.accuracy, np.maximum(ratio, supported), ratio)

    def _expected_mesh_ratio(self, coarse: _Run) -> float:
        """Return the ratio of the errors for a halving if there are only two meshes."""
        if not all(base.is_aligned for base in self._beams):
            return _MAX_MESH_RATIO
        fewest = min(self.task.element_counts(coarse.halvings).values())
        return _MESH_RATIO_OF_TWO_ELEMENTS if fewest <= 2 else _MESH_RATIO

    def _choose_formulation(self, first: _Run) -> None:
        """Keep the model's formulations if they are accurate and need far fewer steps."""
        if not any(base.can_be_exact and not base.is_exact for base in self._beams):
            return
        written = self._try_run(first.halvings, first.rtol, exact=False)
        if written is None:
            self._theory_as_written = np.nan
            return
        theory = _THEORY_SAFETY_FACTOR * self._compare(written, first).largest
        self._theory_as_written = theory
        is_accurate = np.all(theory[self._required] <= _MAX_KEPT_THEORY_SHARE * self.task.accuracy)
        if is_accurate and first.steps > _MAX_EXACT_STEP_RATIO * written.steps:
            self._exact, self._theory = False, theory

    def _refine_further(self) -> Status:
        accuracy, stagnations = self.task.accuracy, 0
        while not self._is_certified():
            if stagnations == _MAX_STAGNATIONS:
                return self._refusal("failed", "the error does not decrease with refinement")
            last, worst = self._last, self._worst_total()
            failing = self._required & ~(self._total <= accuracy)
            target = _TARGET_SHARE * accuracy
            decades = _refinement(self._time[failing], target, 10.0, _ORDER_IN_RTOL)
            halvings = _refinement(self._mesh[failing], target, 2.0, _ORDER_IN_LENGTH)
            decades = min(decades, _MAX_STEP_DECADES)
            halvings = min(halvings, _MAX_STEP_HALVINGS)
            if not self._has_mesh or (halvings and not self._can_refine_mesh):
                halvings = 0
            elif halvings == 2 and 4 * self._largest_count() > _MAX_ELEMENTS:
                halvings = 1
            if not decades and not halvings:
                if self._can_refine_mesh or not self._has_mesh:
                    decades, halvings = 1, int(self._has_mesh)
                else:
                    return self._refusal(
                        "limited",
                        f"the estimated error exceeds {accuracy:g} with {self._largest_count()} "
                        f"elements, and at most {_MAX_ELEMENTS} are allowed",
                    )
            rtol = last.rtol / 10.0**decades
            if rtol < _MIN_RTOL:
                return self._refusal("limited", f"the time error requires rtol < {_MIN_RTOL:g}")
            run = self._run(last.halvings + halvings, rtol, self._exact)
            difference = self._compare(last, run)
            self._update(difference, last, run)
            # `not >=` also counts errors that are not numbers.
            if not worst >= _MIN_REDUCTION * self._worst_total():
                stagnations += 1
        return Status("ok", f"all required columns are within {accuracy:g} of half their range")

    def _update(self, difference: _Difference, last: _Run, run: _Run) -> None:
        """Set the errors of `run` from its difference from `last`.

        If mesh and tolerance both change, the difference is divided between mesh and time in the
        ratio of the expected differences. If it is larger than expected, the errors are assumed to
        decrease more slowly than observed before.
        """
        decades = round(np.log10(last.rtol / run.rtol))
        halvings = run.halvings - last.halvings
        time_ratio, mesh_ratio = self._time_ratio**decades, self._mesh_ratio**halvings
        time_change = (1.0 - time_ratio) * self._time
        mesh_change = (1.0 - mesh_ratio) * self._mesh
        expected = np.maximum(time_change + mesh_change, np.finfo(float).tiny)
        d = difference.largest
        slowness = np.maximum(d / expected, 1.0)
        time_ratio = np.clip(slowness * time_ratio, *self._time_ratio_limits)
        mesh_ratio = np.clip(slowness * mesh_ratio, *self._mesh_ratio_limits)
        by_time, by_mesh = d * time_change / expected, d * mesh_change / expected
        if decades:
            time_ratio = self._limit_ratio_by_steps(time_ratio, by_time, last, run)
        self._set(
            _extrapolate(by_time, _TIME_SAFETY_FACTOR, time_ratio) if decades else self._time,
            _extrapolate(by_mesh, _MESH_SAFETY_FACTOR, mesh_ratio) if halvings else self._mesh,
        )

    def _set(self, time: Array, mesh: Array) -> None:
        # In one statement, so that an interrupt hardly ever separates them.
        self._time, self._mesh = np.maximum(time, _FLOOR * self.task.accuracy), mesh

    def _compare(self, coarse: _Run, fine: _Run) -> _Difference:
        self._last_difference = _compare(coarse, fine, self.task.accuracy)
        return self._last_difference

    def _is_certified(self) -> bool:
        return bool(np.all(self._total[self._required] <= self.task.accuracy))

    def _worst_total(self) -> float:
        return float(np.max(self._total[self._required], initial=0.0))

    def _largest_count(self) -> int:
        counts = self.task.element_counts(self._last.halvings)
        return max(counts[x.beam.name] for x in self._beams if not x.fixed_by)

    # The result.

    def _refusal(self, kind: Any, reason: str) -> Status:
        columns = np.array(list(self._last.solution.columns))
        total = np.where(self._required, self._total, 0.0)
        worst = int(np.nanargmax(np.where(np.isnan(total), np.inf, total)))
        return Status(
            kind,
            f"{reason}; {columns[worst]} is known to {total[worst]:.2g} of half its range",
        )

    def _certificate(self, status: Status) -> Certificate:
        last = self._last
        count = len(last.solution.columns)
        is_assessed = len(self._time) == count
        unknown = np.full(count, np.nan)
        is_mechanism = isinstance(self.task.model, Mechanism)
        time = self._time.copy() if is_assessed else unknown
        half_range, missed = last.amplitude.copy(), last.solution.missed_peaks
        for k, column in enumerate(last.solution.columns):
            if column in missed and is_assessed:
                half_range[k] = missed[column].half_range
                time[k] = max(time[k], missed[column].error)
        is_mesh_known = is_assessed and is_mechanism and (self._has_mesh or not self._beams)
        mesh = self._mesh if is_mesh_known else unknown
        notes = [
            f"{base.beam.name}: mesh and theory are not assessed, because {base.fixed_by}."
            for base in self._beams
            if base.fixed_by
        ]
        notes += [
            f"{base.beam.name}: the theory is not assessed, because the beam has custom kinematics."
            for base in self._beams
            if base.has_custom_kinematics and not base.fixed_by
        ]
        if not is_mechanism:
            notes.append("equations of motion: mesh and theory are not assessed.")
        good_until, growth_rate = float(last.solution.t[0]), np.nan
        if status.success:
            good_until = float(last.solution.t[-1])
            sentence = status.sentence + self._name_other_columns(self._total + time - self._time)
            if notes:
                sentence += "; see the notes for what is not assessed"
            status = Status("ok", sentence)
        elif is_assessed and self._last_difference is not None:
            good_until, growth_rate = self._describe_growth(self._last_difference, self._total)
            rate = (
                ""
                if np.isnan(growth_rate)
                else (
                    f"; errors grow by exp({growth_rate:.2g} t), a Lyapunov time of "
                    f"{1.0 / growth_rate:.2g} s"
                )
            )
            status = Status(
                status.kind, f"{status.sentence}; good until t = {good_until:.4g} s{rate}"
            )
        required = np.array(list(last.solution.columns))[self._required].tolist()
        peaks = [missed[x] for x in required if x in missed]
        peaks = [peak for peak in peaks if peak.error > self.task.accuracy]
        if status.success and peaks:
            peak = max(peaks, key=lambda x: x.importance)
            status = Status("limited", f"{peak.description}; reduce output_step=")
            good_until = peak.time
        is_theory_known = is_mechanism and (
            not self._beams or any(base.can_be_exact for base in self._beams)
        )
        theory = np.zeros(count) + self._theory if is_theory_known else unknown
        budget = ErrorBudget(
            columns=tuple(last.solution.columns),
            half_range=half_range,
            time=time,
            mesh=mesh,
            theory=theory,
            theory_as_written=np.zeros(count) + self._theory_as_written
            if is_theory_known
            else unknown,
            required=self._required,
        )
        return Certificate(
            solution=last.solution,
            error_budget=budget,
            accuracy=self.task.accuracy,
            status=status,
            good_until=good_until,
            growth_rate=growth_rate,
            event_shift=self._last_difference.event_shift if self._last_difference else 0.0,
            formulations={
                base.beam.name: EXACT_FORMULATION
                if self._exact and base.can_be_exact
                else base.beam.formulation
                for base in self._beams
            },
            elements=self.task.element_counts(last.halvings),
            # The run of the solution is the last one.
            runs=tuple(
                CertificateRun(
                    EXACT_FORMULATION if run.exact else _AS_WRITTEN,
                    run.rtol,
                    sum(self.task.element_counts(run.halvings).values()),
                    run.steps,
                    run.processor_time,
                )
                for run in sorted(self._runs, key=lambda run: run is last)
            ),
            notes=tuple(notes),
        )

    def _name_other_columns(self, total: Array) -> str:
        """Return the end of a sentence on columns that are not required and exceed the accuracy.

        `total` contains the errors, with those of the extremes that the rows miss.
        """
        columns = list(self._last.solution.columns)
        is_other = ~self._required & ~(total <= self.task.accuracy)
        worst = sorted(np.flatnonzero(is_other), key=lambda k: -np.nan_to_num(total[k], nan=np.inf))
        if not worst:
            return ""
        names = list_first(
            [f"{remove_unit(columns[k])} ({total[k]:.2g})" for k in worst], _MAX_NAMES
        )
        sentence = f"; columns that are not required exceed it: {names}"
        if np.any(self._total[worst] <= self.task.accuracy):
            sentence += ", also because the rows miss extremes (reduce output_step=)"
        return sentence

    def _describe_growth(self, difference: _Difference, errors: Array) -> tuple[float, float]:
        """Return the time [s] up to which errors are within the accuracy, and the growth rate.

        The growth rate [1/s] is NaN if the errors do not grow exponentially.
        """
        required = self._required
        envelope = np.maximum.accumulate(difference.rows[:, required], axis=0)
        growth_rate = _growth_rate(difference.t, np.max(envelope, axis=1))
        largest = np.maximum(difference.largest[required], np.finfo(float).tiny)
        ratios = errors[required] / largest
        if not np.isnan(growth_rate):
            # Errors that grow exponentially saturate, and are limited by rounding: the ratio of the
            # largest values does not hold before.
            ratios = np.maximum(ratios, 1.0)
        is_within = np.all(envelope * ratios <= self.task.accuracy, axis=1)
        beyond = np.flatnonzero(~is_within)
        index = max(int(beyond[0]) - 1, 0) if len(beyond) else len(difference.t) - 1
        return float(difference.t[index]), growth_rate


def _extrapolate(differences: Array, safety_factor: float, ratio: Array) -> Array:
    """Return the error of the finer run if the refinement multiplies the error by `ratio`.

    Differences above `_SATURATION` are not reduced: two runs of a chaotic motion eventually differ
    by as much as the motion itself varies, at any tolerance.
    """
    errors = safety_factor * ratio / (1.0 - ratio) * differences
    return np.where(differences > _SATURATION, np.maximum(differences, errors), errors)


def _refinement(errors: Array, target: float, base: float, order: float) -> int:
    """Return n such that refinement by `base`**n should reduce the errors to the target."""
    excess = float(np.max(errors, initial=0.0)) / target
    if not excess > 1.0:
        return 0
    return int(np.ceil(np.log(excess) / np.log(base) / order)) if np.isfinite(excess) else 1


def _growth_rate(t: Array, error: Array) -> float:
    """Return the exponential growth rate [1/s] of an error, or NaN if no exponential fits."""
    positive = error[error > 0.0]
    if not len(positive):
        return np.nan
    usable = (error > 0.0) & (error < _SATURATION) & (t > t[0])
    if usable.sum() < _MIN_FITTED_SAMPLES:
        return np.nan
    x, y = t[usable], np.log(error[usable])
    if y[-1] - y[0] < np.log(_MIN_GROWTH):
        return np.nan
    by_time, by_log_time = (np.polyfit(z, y, 1, full=True) for z in (x, np.log(x - t[0])))
    rate = float(by_time[0][0])
    return rate if by_time[1].sum() < by_log_time[1].sum() else np.nan
