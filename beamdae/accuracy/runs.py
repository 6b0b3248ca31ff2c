"""Errors of runs, measured by a companion run with everything refined together."""

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
from beamdae.accuracy.values import compare_columns
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
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
