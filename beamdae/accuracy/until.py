"""Runs that are refined until their measured errors are small enough."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from beamdae.accuracy.errors import Errors
from beamdae.accuracy.runs import refine_equations, run_companion, split_time
from beamdae.beams.beam import beams_of
from beamdae.beams.remeshing import list_fixed_beams
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    format_distinct,
    format_percent,
    join_names,
    list_first,
    require_finite,
    require_positive,
    require_progress,
    warn_of_incomplete_result,
    warn_of_result,
    warnings_are_ignored,
)
from beamdae.integrators import Radau
from beamdae.integrators.limits import Progress
from beamdae.interrupts import Interrupted, acknowledge, attach_partial, interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.parts.mechanism import require_start
from beamdae.results.columns import (
    mark_required_columns,
    remove_unit,
    require_accurate_columns,
    require_observed,
)
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution
from beamdae.simulation import as_equations, compute_output_times, unpack_model

Array = np.ndarray

_MIN_ACCURACY, _MAX_ACCURACY = 1e-6, 0.1
_ACCURACY_TO_RTOL = 10.0  # of the first run
_MIN_RTOL, _MIN_RTOL_FACTOR = 1e-10, 0.01
_MAX_ELEMENTS = 64  # of a beam
# Part of the accuracy at which the errors of steps and of elements and strains aim, each.
_SHARE = 0.4
# Stated errors are up to a fifth too small where errors decrease slowly.
_SAFE_PART = 2.0 * _SHARE
_MIN_TIME_LIMIT = 1e-3  # of a run after the deadline [s]
# A companion has about this part of the time error, and of the errors of elements and strains.
_TIME_RATIO, _MODEL_RATIO = 1.0 / 3.0, 1.0 / 8.0
# A refinement that does not reduce the largest error by this factor is a stagnation.
_MIN_REDUCTION, _MAX_STAGNATIONS = 1.5, 2
_MAX_NAMES = 6


@interruptible
@single_threaded
def refine_until(
    model: Any,
    accuracy: float = 0.01,
    *,
    columns: Sequence[str] | str | None = None,
    t_end: float | None = None,
    output_step: float | None = None,
    start: Any = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Simulate a model with steps and elements that are refined until the errors are small enough.

    The integrator is `Radau`. The `errors` of each run are measured; steps, elements and strains
    that contribute too much are refined: a smaller rtol, elements halved or quartered together with
    strain="exact" and smaller friction speeds.

    Parameters
    ----------
    model
        A model function, a mechanism, a constrained system or equations of motion.
    accuracy
        Largest error of a required column [-], from 1e-6 to 0.1; see `Errors`.
    columns
        Observed columns, or names of observables, that must be accurate. Defaults to all positions,
        angles and deflections [m, rad] or, if there are none, to all columns.
    t_end
        End time [s]. Defaults to the model's end time.
    output_step
        Time between rows of the result [s]. Defaults to a thousandth of the end time.
    start
        "as drawn", "equilibrium", or positions and velocities by name; see `simulate`. Defaults to
        the start of the model.
    time_limit
        Maximum total wall time of all runs [s]. Defaults to no limit.
    progress
        Function called repeatedly during each run with the time reached [s]; see `simulate`.

    Returns
    -------
    Solution
        The accurate run with its `errors`; `equations.mechanism` has the refined beams. If the
        accuracy is not reached, this is the last run with known errors, and `status` gives the
        reason: a limit of time or elements, errors that do not decrease, or beams that keep their
        elements.

    Raises
    ------
    BeamdaeError
        If the model or a setting is invalid, or nothing is observed.
    Interrupted
        If Ctrl-C ends the call; `Interrupted.solution` is the last run with known errors, or the
        first run so far.
    Exception
        Exceptions of `progress`. Their attribute `solution` is the same.

    Warns
    -----
    BeamdaeWarning
        If the accuracy is not reached, with the reason, and for each of `Solution.warnings`.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> bob = mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
    >>> rod = mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), bob.point))
    >>> mech.observe("bob", bob.point)
    >>> solution = bd.refine_until(mech, accuracy=0.001, t_end=1.0)
    >>> solution.status.success, solution.errors.largest < 0.001
    (True, True)
    """
    accuracy = require_finite("refine_until", "accuracy", accuracy)
    if not _MIN_ACCURACY <= accuracy <= _MAX_ACCURACY:
        least, most, given = format_distinct(_MIN_ACCURACY, _MAX_ACCURACY, accuracy)
        raise BeamdaeError(
            f"refine_until: accuracy must lie between {least} and {most}, got {given}; 0.01 is 1 %."
        )
    names = require_accurate_columns("refine_until", columns)
    if time_limit is not None:
        time_limit = require_positive("refine_until", "time_limit", time_limit)
    if start is not None:
        require_start("refine_until", start)
    require_progress("refine_until", progress)
    model, t_end, description = unpack_model("refine_until", model, t_end)
    times = compute_output_times("refine_until", t_end, output_step)
    description["t_end"] = float(times[-1])
    equations = as_equations("refine_until", model, start, sampled=True)
    headers = equations.observed_headers
    require_observed("refine_until", headers)
    required = mark_required_columns("refine_until", names, headers)
    time_limit = np.inf if time_limit is None else time_limit
    deadline = clock.perf_counter() + time_limit
    task = _Task(times, accuracy, required, time_limit, deadline, progress)
    solution = None
    try:
        for run in _refine_runs(task, equations):
            solution = _with_status(run, run.status, model=description)
    except Interrupted as problem:
        solution = problem.partial if solution is None else solution
        if isinstance(solution, Solution):
            acknowledge()
            status = Status("interrupted", problem.reason)
            solution = _with_status(solution, status, model=description)
            raise Interrupted(problem.reason, solution, "refine_until") from None
        raise
    except Exception as problem:
        if solution is not None:
            attach_partial(problem, solution)
        raise
    assert solution is not None
    if not solution.status.success:
        name, reason = description.get("name", "refine_until"), solution.status.sentence
        warn_of_incomplete_result(f"{name}: accuracy {accuracy:g} is not reached; {reason}.")
    if not warnings_are_ignored():
        warn_of_result(solution.warnings, solution.equations.build_warnings)
    return solution


class _Task(NamedTuple):
    """Output times [s], required accuracy and columns (mask), and limits of all runs."""

    times: Array
    accuracy: float
    required: Array
    time_limit: float  # of all runs [s]
    deadline: float  # of `time.perf_counter` [s]
    progress: Progress | None

    @property
    def limits(self) -> tuple[float | None, Progress | None]:
        """Limit of the time of the next run [s], or None, and the function `progress`."""
        remaining = max(self.deadline - clock.perf_counter(), _MIN_TIME_LIMIT)
        return (remaining if np.isfinite(remaining) else None), self.progress

    def integrate(self, equations: EquationsOfMotion, rtol: float) -> Solution:
        time_limit, progress = self.limits
        return Radau(rtol, time_limit=time_limit).integrate(equations, self.times, progress)


def _refine_runs(task: _Task, equations: EquationsOfMotion) -> Iterator[Solution]:
    """Yield the first run and runs with known errors; the last one has the final status."""
    run = task.integrate(equations, task.accuracy / _ACCURACY_TO_RTOL)
    yield run
    if not run.status.success:
        return
    solution, error, least, stagnations = run, np.inf, np.inf, 0
    description, reason = "errors are not known", ""
    try:
        while error > _SAFE_PART * task.accuracy:
            errors, companion = run_companion(run, *task.limits)
            if companion is None:
                if solution is run:
                    solution = _with_status(run, run.status, errors)
                raise BeamdaeError(errors.reason)
            total = np.where(task.required, errors.total, 0.0)
            worst = int(np.argmax(np.where(np.isnan(total), np.inf, total)))
            column, settings = remove_unit(errors.headers[worst]), _describe_settings(run, errors)
            if not np.isfinite(total[worst]):
                raise BeamdaeError(f"{column} is not finite")
            error = float(total[worst])
            description = (
                f"{column} has the largest error, {format_percent(error)} of half its range, with "
                f"{settings}"
            )
            solution = _with_status(run, Status("limited", description), errors)
            yield solution
            stagnations += not error < least / _MIN_REDUCTION
            least = min(least, error)
            if stagnations >= _MAX_STAGNATIONS:
                raise BeamdaeError("errors do not decrease with refinement")
            if error > _SAFE_PART * task.accuracy:
                run = _refine_run(task, run, companion, errors)
                if not run.status.success:
                    raise BeamdaeError(run.status.sentence)
    except BeamdaeError as limit:
        is_late = clock.perf_counter() >= task.deadline
        reason = f"the time limit of {task.time_limit:g} s is reached" if is_late else str(limit)
    if error <= task.accuracy:
        kept = {} if equations.mechanism is None else list_fixed_beams(equations.mechanism)
        sentences = [f"{x} keeps its elements and strains, because {y}" for x, y in kept.items()]
        reason = "; ".join(sentences)
    status = Status("limited", f"{description}; {reason}") if reason else Status("ok", description)
    yield _with_status(solution, status)


def _refine_run(task: _Task, run: Solution, companion: Solution, errors: Errors) -> Solution:
    """Return a run in which errors that exceed their share of the accuracy are reduced.

    This is an earlier one, with the steps of the companion or the companion itself, if it is likely
    to be accurate enough.
    """
    rtol, target = run.integrator["rtol"], _SHARE * task.accuracy
    equations = run.equations
    if companion.equations is equations:
        timed, by_time, by_model = companion, errors.total, np.zeros_like(errors.total)
    else:
        timed, by_time, by_model = split_time(run, companion, *task.limits)
        if not timed.status.success:
            raise BeamdaeError(timed.status.sentence)
    time, model = (float(np.max(x[task.required])) for x in (by_time, by_model))
    if _TIME_RATIO * time <= target and _MODEL_RATIO * model <= target:
        is_model_accurate = model <= target
        if not is_model_accurate:
            _require_few_elements(companion.equations)
        return timed if is_model_accurate else companion
    if model > target:
        equations = companion.equations
        if _MODEL_RATIO * model > target:
            refinement, _ = refine_equations(companion)
            equations = equations if refinement is None else refinement.equations
        _require_few_elements(equations)
    if time > target:
        rtol *= max(target / time, _MIN_RTOL_FACTOR)
    if rtol < _MIN_RTOL:
        raise BeamdaeError(f"the next one needs rtol < {_MIN_RTOL:g}")
    return task.integrate(equations, rtol)


def _require_few_elements(equations: EquationsOfMotion) -> None:
    for beam in beams_of(equations.mechanism):
        if (count := beam.mesh.elements) > _MAX_ELEMENTS:
            raise BeamdaeError(
                f"the next run needs {count} elements of {beam.name}, more than {_MAX_ELEMENTS}"
            )


def _describe_settings(run: Solution, errors: Errors) -> str:
    rtol, refined = run.integrator["rtol"], errors.refined
    texts = [f"rtol={rtol:.2g}"]
    if refined.elements:
        counts = [f"{count} elements of {name}" for name, count in refined.elements.items()]
        texts.append(list_first(counts, _MAX_NAMES))
        if not refined.inexact:
            texts.append("exact strains")
    return join_names(texts)


def _with_status(
    run: Solution, status: Status, errors: Errors | None = None, **changes: Any
) -> Solution:
    """Return a run with another status, and with known errors, by default those of the run."""
    solution = replace(run, status=status, **changes)
    known = vars(run).get("errors") if errors is None else errors
    if known is not None:
        vars(solution)["errors"] = known
    return solution
