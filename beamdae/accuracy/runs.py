"""Errors of the columns of a run, measured by a companion run with everything refined."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from typing import Any

import numpy as np

from beamdae import integrators
from beamdae.accuracy.errors import FACTOR, Errors, Refined, measure_errors
from beamdae.accuracy.refinement import Refinement, refine
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.measures import ObservedRows
from beamdae.errors import (
    BeamdaeError,
    require_progress,
    short_repr,
)
from beamdae.integrators.integrator import Integrator, require_integrator
from beamdae.integrators.limits import Progress
from beamdae.integrators.pilot_run import reuse_motion
from beamdae.interrupts import Interrupted, interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.results.columns import Header, is_position
from beamdae.results.noise import MAX_ERROR_TO_VALUE_RATIO, constant_limits, mark_noise
from beamdae.results.run_data import RunData
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory
from beamdae.simulation import is_unchecked

Array = np.ndarray

_RTOL_RATIO = 1.0 / 3.0
# Fixed steps share blind spots with half their length: another method takes their place.
_RTOL_BESIDE_STEPS, _STEP_RATIO = 1e-4, 0.37
# Resonances amplify errors of steps, and many data errors of predictions; also of `verify`.
RTOL_BESIDE_ACCURATE_STEPS = 1e-6
_MAX_STEPS_RATIO, _MIN_MAX_STEPS = 8, 3000
_MIN_RTOL = 1e-10
# Runs are checked by themselves up to this time [s], or this multiple of their own.
_MIN_TIME_LIMIT, _MAX_TIME_RATIO = 2.0, 8.0

# Largest time of a companion [s], and its progress function; None without.
_limits: ContextVar[tuple[float | None, Progress | None]] = ContextVar(
    "limits", default=(None, None)
)


_ROUNDING = 1e-12  # of displacements, relative to the largest position


@contextmanager
def limit_companions(time: float | None, progress: Progress | None = None) -> Iterator[None]:
    """Within the context, each companion run ends after this time [s] and calls `progress`."""
    token = _limits.set((time, progress))
    try:
        yield
    finally:
        _limits.reset(token)


@single_threaded
def measure_run(run: Solution) -> Errors:
    """Return the errors of the observed columns of a run.

    Raises
    ------
    Interrupted
        If the companion is interrupted.
    """
    if reason := _find_obstacle(run):
        return leave_unchecked(run, reason)
    # The run caches its errors, which refer to a copy: a cycle would keep both in memory.
    twin = replace(run)
    vars(twin).update(vars(run))
    run = twin
    method, (_, progress) = refine_method(run), _limits.get()

    def repeat(causes: Collection[str]) -> tuple[Solution, Refined]:
        refinement, motion = refine_equations(run, causes)
        companion = _repeat(run, method, refinement.equations, motion, progress)
        return companion, refinement.refined.with_steps(run.made_by)

    return measure_errors(leave_unchecked(run, "a refined run cannot begin"), run, repeat, _compare)


@interruptible
@single_threaded
def verify(
    solution: Solution, integrator: Integrator | None = None, progress: Progress | None = None
) -> Errors:
    """Compare a run with one by a different method and a tighter tolerance.

    Parameters
    ----------
    solution
        The run.
    integrator
        Integrator of the second run. Defaults to `Radau`, or to `GeneralizedAlpha` if Radau made
        the run, with a tenth of the tolerance, but at least 1e-10. If the run has fixed steps, the
        tolerance is 1e-6.
    progress
        Progress function of the second run; see `simulate`.

    Returns
    -------
    Errors
        The differences of the observed columns. They contain no error of the mesh and the strains.

    Raises
    ------
    BeamdaeError
        If `solution` is not a solution, `integrator` is not an integrator, or `progress` is not a
        function.
    Interrupted
        If the second run is interrupted.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> bob = mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
    >>> rod = mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), bob.point))
    >>> mech.observe("bob", bob.point)
    >>> bool(bd.verify(bd.simulate(mech, t_end=1.0)).largest < 1e-3)
    True
    """
    if not isinstance(solution, Solution):
        raise BeamdaeError(
            f"verify: solution must be a Solution of a run, got {short_repr(solution)}."
        )
    if integrator is not None:
        require_integrator("verify", integrator)
    require_progress("verify", progress)
    if reason := _find_obstacle(solution):
        return leave_unchecked(solution, reason)
    own: Any = solution.made_by
    name, value = own.accuracy
    if integrator is None:
        rtol = max(0.1 * value, _MIN_RTOL) if name == "rtol" else RTOL_BESIDE_ACCURATE_STEPS
        is_radau = solution.integrator.get("method") == "Radau"
        integrator = (integrators.GeneralizedAlpha if is_radau else integrators.Radau)(rtol=rtol)
    other = _repeat(solution, integrator, solution.equations, solution.trajectory, progress)
    refined = Refined(accuracy=(name, value), order=own.order, method=integrator.label)
    return _compare(solution, other, refined, factor=1.0)


def find_companion(result: Any) -> Any:
    """Return what is compared by the `errors` of a result, such as a refined run, or None."""
    if "errors" not in vars(result) and is_unchecked():
        return None
    split: Any = result.errors._split
    return None if split is None else split.companion


def check_errors(result: Any, run: Solution, progress: Progress | None = None) -> Iterator[str]:
    """Yield the sentences of the errors of a result, which are measured unless this takes long.

    Parameters
    ----------
    result
        The result; runs without observed columns have no sentences.
    run
        The result, or a typical run of it.
    progress
        Progress function of companions.
    """
    if is_unchecked() or (result is run and not run.columns):
        return
    if "errors" not in vars(result):
        spent = run.statistics.setup_time + run.statistics.wall_time
        limit = max(_MIN_TIME_LIMIT, _MAX_TIME_RATIO * spent)
        with limit_companions(limit, progress):
            errors = result.errors
        if errors.has_failed and "time limit" in errors.reason:
            del vars(result)["errors"]
            yield (
                f"errors: not checked, because a refined repetition takes more than {limit:.2g} s; "
                "use the errors of the result."
            )
            return
    yield from result.errors.sentences()


def _find_obstacle(run: Solution) -> str:
    if not run.status.success:
        return "the run stopped early"
    if not isinstance(run.made_by, Integrator):
        return "the run was loaded from a file"
    if run.trajectory.start != 0.0:
        return "the run was resumed"
    return "the run has a single row" if len(run.t) < 2 else ""


def leave_unchecked(run: Solution, reason: str) -> Errors:
    """Return the errors of a run that cannot be checked."""
    sizes = [np.max(np.abs(x), initial=0.0) for x in run.columns.values()]
    return Errors.unchecked(tuple(run.columns), np.array(sizes), reason)


def _compare(run: Solution, other: Solution, refined: Refined, factor: float = FACTOR) -> Errors:
    if not other.status.success:
        reason = f"{refined} does not reach the end ({other.status.sentence})"
        return replace(leave_unchecked(run, reason), refined=refined, has_failed=True)
    if not run.columns:
        return leave_unchecked(run, "no column is observed")
    return compare_columns(run, other, refined, factor)


def refine_method(run: Solution, rtol_beside_steps: float = _RTOL_BESIDE_STEPS) -> Integrator:
    """Return the integrator of a companion run: a third of the tolerance, or `Radau`."""
    method: Any = run.made_by
    name, value = method.accuracy
    max_steps = max(_MAX_STEPS_RATIO * run.trajectory.steps, _MIN_MAX_STEPS)
    changes: dict[str, Any] = {"rtol": _RTOL_RATIO * value, "max_steps": max_steps}
    changes["time_limit"], _ = _limits.get()
    if name == "step":
        method = integrators.Radau(max_step=_STEP_RATIO * value)
        changes["rtol"] = rtol_beside_steps
    return replace(method, **{x: y for x, y in changes.items() if hasattr(method, x)})


def refine_equations(run: Solution, causes: Collection[str]) -> tuple[Refinement, Trajectory]:
    """Return refined equations with the start of the run, and its motion in their coordinates."""
    start = run.equations.start
    request = None if start is None else start.request
    refinement = refine(run.equations, request or AS_DRAWN, causes)
    if refinement.equations is run.equations:
        return refinement, run.trajectory
    matrix = refinement.prolongation
    if request is None:
        first = run.trajectory.intervals[0].rows
        q, v = refinement.prolong(first.q[0]), matrix @ first.v[0]
        refinement = refinement._replace(equations=replace(refinement.equations, q0=q, v0=v))
    intervals = []
    for interval in run.trajectory.intervals:
        q, v, *others = interval.rows
        rows = State(refinement.prolong(q.T).T, (matrix @ v.T).T, *others)
        intervals.append(replace(interval, rows=rows))
    return refinement, Trajectory(tuple(intervals))


def _repeat(
    run: Solution,
    method: Integrator,
    equations: EquationsOfMotion,
    motion: Trajectory,
    progress: Progress | None = None,
) -> Solution:
    """Repeat a run with other equations and another method at the same output times."""
    begin = run.trajectory.start  # The rows of `Solution.at_times` may begin later.
    is_later = run.t[0] > begin
    with reuse_motion(motion):
        times = np.append(begin, run.t) if is_later else run.t
        other: Solution = method.integrate(equations, times, progress)
    if other.status.kind == "interrupted":
        raise Interrupted(other.status.sentence)
    return replace(other, t=other.t[int(is_later) :], model=run.model)


def compare_columns(
    run: RunData, other: RunData, refined: Refined, factor: float = FACTOR, has_phase: bool = True
) -> Errors:
    """Return the errors of the observed columns of a run beside a more accurate one.

    Values are the largest magnitudes of the extremes at all steps and rows. Errors are the larger
    one of the differences of the extremes, relative to half the range of the column, and of the
    root mean square of the differences at rows, relative to that of the deviations from the mean;
    of columns that are constant but for errors, relative to their largest magnitude. They are zero
    for columns that are rounding errors or violations of constraints in both runs, and not a number
    for columns with gaps.

    Parameters
    ----------
    run, other
        The runs.
    refined
        What the second run refines.
    factor
        Ratio of errors and differences.
    has_phase
        False to compare extremes only, because the times of the rows differ.
    """
    headers = tuple(run.columns)
    count = min(len(run.t), len(other.t))  # An event may end one of them slightly earlier.
    rows, finer = (_stack(x)[:count] for x in (run, other))
    limits, finer_limits = _find_extremes(run, rows), _find_extremes(other, finer)
    rtol = max(x.integrator.get("rtol") or 0.0 for x in (run, other))
    amplitude, is_constant = _measure_amplitudes(other.equations, finer, rtol)
    scale = np.where(is_constant, amplitude, 0.5 * np.ptp(finer_limits, axis=0))
    deviation = np.where(is_constant, amplitude, finer.std(axis=0))
    differences = _subtract_rows(rows, finer, scale)
    pairs = (
        (np.abs(limits - finer_limits).max(axis=0), scale),
        (differences.max(axis=0), scale),
        (np.sqrt(np.mean(differences**2, axis=0)), deviation),
    )
    half_range = 0.5 * np.maximum(np.ptp(rows, axis=0), np.ptp(finer, axis=0))
    is_noise = mark_noise(run, finer, half_range, np.abs(rows - finer).max(axis=0), other)
    with np.errstate(divide="ignore", invalid="ignore"):
        peaks, largest, means = (
            np.where(is_noise | (x == 0.0), 0.0, x / size) for x, size in pairs
        )
    values, others = (np.abs(x).max(axis=0) for x in (limits, finer_limits))
    relative_to = tuple("its value" if x else "half its range" for x in is_constant)
    total, at_rows = peaks, np.full(len(headers), np.nan)
    if has_phase:
        total, at_rows = np.maximum(peaks, means), largest
    return Errors(headers, values, others, factor * total, at_rows, refined, relative_to)


def _subtract_rows(rows: Array, finer: Array, scale: Array) -> Array:
    """Return the magnitudes of the differences at rows.

    Where a column changes by half its scale or more between two rows, they do not resolve when: the
    difference is that from the interval between the neighbors.
    """
    low, high = finer.copy(), finer.copy()
    jumps = np.abs(np.diff(finer, axis=0)) > 0.5 * scale
    for of_row, neighbors in ((slice(1, None), finer[:-1]), (slice(None, -1), finer[1:])):
        low[of_row] = np.where(jumps, np.minimum(low[of_row], neighbors), low[of_row])
        high[of_row] = np.where(jumps, np.maximum(high[of_row], neighbors), high[of_row])
    return np.maximum(np.maximum(rows - high, low - rows), 0.0)


def _measure_amplitudes(
    equations: EquationsOfMotion, rows: Array, rtol: float
) -> tuple[Array, Array]:
    """Return the amplitude of each column, to which errors are relative, and a mask.

    The amplitude is half the range or, for columns that are constant but for errors, such as the
    stress in a steady rotation, the largest magnitude. The mask is True for these columns. The
    magnitude of positions and angles is that of the displacement from the drawing, which does not
    depend on the origin, and at most the size of the mechanism, or 1 rad. Columns that vary by more
    than a thousandth of their magnitude, such as small deflections from zero, are not constant.

    Parameters
    ----------
    equations
        The equations of motion.
    rows
        Values of the observed columns (k, columns).
    rtol
        Tolerance of the columns.
    """
    headers, length = equations.observed_headers, equations.length
    half_range = 0.5 * np.ptp(rows, axis=0)
    sizes = {"m": length, "rad": 1.0}
    limits = np.array([sizes.get(Header.of(header).unit, np.inf) for header in headers])
    largest = np.minimum(np.max(np.abs(_subtract_drawing(equations, rows)), axis=0), limits)
    is_constant = half_range <= constant_limits(headers, rows, length, rtol)
    is_constant &= (half_range <= MAX_ERROR_TO_VALUE_RATIO * largest) & (largest > 0.0)
    return np.where(is_constant, largest, half_range), is_constant


def _subtract_drawing(equations: EquationsOfMotion, rows: Array) -> Array:
    """Return observed columns (k, columns), with displacements for positions and angles.

    Displacements are those from the drawing. They do not depend on the origin, of which their
    rounding errors are removed.
    """
    is_placement = [is_position(x) for x in equations.observed_headers]
    if not any(is_placement):
        return rows
    mechanism, q, zero = equations.mechanism, equations.q0, np.zeros((1, equations.n))
    if mechanism is not None:
        q = np.concatenate([part.initial_position for part in mechanism.parts.values()])
    time, lam = np.zeros((1, 2)), np.zeros((1, equations.m))
    displacements = rows - ObservedRows(equations)(time, q[None], zero, zero, lam)[0]
    is_rounding = np.abs(displacements) <= _ROUNDING * np.max(np.abs(rows), axis=0)
    return np.where(is_placement, np.where(is_rounding, 0.0, displacements), rows)


def _stack(run: RunData) -> Array:
    """Return the columns (k, columns), with gaps throughout columns that are not finite."""
    rows = np.stack(list(run.columns.values()), axis=1)
    return np.where(np.isfinite(rows).all(axis=0), rows, np.nan)


def _find_extremes(run: RunData, rows: Array) -> Array:
    """Return the extremes (2, columns) at rows and, if they are known, at steps."""
    limits = np.stack([rows.min(axis=0), rows.max(axis=0)])
    for k, header in enumerate(run.columns):
        if header in run.step_extremes:
            at_steps = run.step_extremes[header]
            limits[:, k] = min(limits[0, k], at_steps.min), max(limits[1, k], at_steps.max)
    return limits
