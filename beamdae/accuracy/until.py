"""Analyses that are repeated with refined steps and meshes until measured errors are small."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import wraps
from typing import Any, NamedTuple

import numpy as np

from beamdae.accuracy.errors import CAUSES, CAUSES_AT_REST, Errors
from beamdae.accuracy.refinement import refine_mechanism
from beamdae.accuracy.runs import limit_companions
from beamdae.beams.beam import beams_of
from beamdae.beams.remeshing import list_fixed_beams
from beamdae.errors import (
    BeamdaeError,
    format_count,
    format_percent,
    join_names,
    list_first,
    require_between,
)
from beamdae.integrators import Integrator
from beamdae.integrators.limits import Progress
from beamdae.interrupts import Interrupted, acknowledge, attach_partial
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_functions import Model
from beamdae.parts.mechanism import AS_DRAWN, Mechanism
from beamdae.results.columns import (
    mark_required_columns,
    remove_unit,
    require_accurate_columns,
    require_observed,
)
from beamdae.results.outcome import Status, replace_with_errors

Array = np.ndarray

_MIN_ACCURACY, _MAX_ACCURACY = 1e-6, 0.1
_MAX_RUNS = 6
_MAX_UNKNOWNS = 4000  # of beams
_MIN_RTOL, _MIN_STEP_RATIO = 1e-10, 0.01
# Part of the accuracy at which the errors of steps and of elements and strains aim, each.
_SHARE = 0.4
# Stated errors are up to a fifth too small where errors decrease slowly.
_SAFE_PART = 2.0 * _SHARE
_MIN_TIME_LIMIT = 1e-3  # of a run after the deadline [s]
_TIME_RATIO = 1.0 / 3.0  # a companion has about this part of the errors of steps
# A refinement that does not reduce the largest error by this factor is a stagnation.
_MIN_REDUCTION, _MAX_STAGNATIONS = 1.5, 2
_MAX_NAMES = 6
_OK = Status("ok", "")


class Analysis(NamedTuple):
    """An analysis that is repeated with refined models.

    Attributes
    ----------
    name
        Name of the public function.
    analyze
        Function of a model and an integrator that returns a result with `errors`.
    method
        Integrator of the first result; None for analyses without steps.
    start
        Start of the model; beams whose coordinates it names are not refined.
    observed
        Function of a result that returns its columns of which, by default, only positions, angles
        and deflections must be accurate. All other values must.
    is_run
        True for runs, whose companions are runs as well. The limit of time of the integrator
        applies to all of them together.
    progress
        Progress function of companions.
    """

    name: str
    analyze: Callable[[Any, Integrator | None], Any]
    method: Integrator | None = None
    start: Any = None
    observed: Callable[[Any], Collection[str]] = lambda result: ()
    is_run: bool = False
    progress: Progress | None = None


def require_columns(name: str, columns: Any, headers: Sequence[str]) -> None:
    """Reject names of columns that must be accurate if they are not observed."""
    names = require_accurate_columns(name, columns)
    require_observed(name, headers)
    mark_required_columns(name, names, headers)


class _Request(NamedTuple):
    """Required accuracy and columns, and limits of all runs: `time.perf_counter` and time [s]."""

    accuracy: float
    columns: tuple[str, ...] | None
    deadline: float
    time_limit: float

    @property
    def remaining_time(self) -> float | None:
        remaining = max(self.deadline - clock.perf_counter(), _MIN_TIME_LIMIT)
        return remaining if np.isfinite(remaining) else None

    def limit(self, method: Integrator | None) -> Integrator | None:
        limited: Any = method
        remaining = self.remaining_time
        return method if remaining is None else replace(limited, time_limit=remaining)


class _Step(NamedTuple):
    """Model, integrator and result of a run."""

    model: Any
    method: Integrator | None
    result: Any


@single_threaded
def reach_accuracy(analysis: Analysis, model: Any, accuracy: Any, columns: Any = None) -> Any:
    """Repeat an analysis until the errors of the required columns are small enough.

    Parameters
    ----------
    analysis
        The analysis.
    model
        A mechanism, or a model whose beams are not refined.
    accuracy
        Largest error [-]; None for a single analysis.
    columns
        Names of the columns that must be accurate; None for the default, see `Analysis`.

    Returns
    -------
    Any
        The last result with known errors; `errors.status` says what was reached, and why not more.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, or the first analysis fails.
    Interrupted
        If Ctrl-C ends the call before there is a result, or if results have no status. The last
        result with known errors, or the first one so far, is its partial result and that of other
        exceptions; results with a status are returned with the status "interrupted" instead.
    """
    if accuracy is None:
        if columns is not None:
            raise BeamdaeError(
                f"{analysis.name}: accuracy_columns requires accuracy; pass both or neither."
            )
        return analysis.analyze(model, analysis.method)
    accuracy = require_between(analysis.name, "accuracy", accuracy, _MIN_ACCURACY, _MAX_ACCURACY)
    names = require_accurate_columns(analysis.name, columns)
    time_limit = getattr(analysis.method, "time_limit", None) if analysis.is_run else None
    time_limit = time_limit or np.inf
    request = _Request(accuracy, names, clock.perf_counter() + time_limit, time_limit)
    result = None
    try:
        for improved in _refine_results(analysis, request, model):
            result = improved
    except KeyboardInterrupt as problem:
        partial = getattr(problem, "partial", None) if result is None else result
        if partial is None:
            raise
        acknowledge()
        reason = getattr(problem, "reason", "interrupted")
        if not hasattr(partial, "status"):
            raise Interrupted(reason, partial, analysis.name) from None
        return replace_with_errors(partial, status=Status("interrupted", reason))
    except Exception as problem:
        if result is not None:
            attach_partial(problem, result)
        raise
    return result


def _refine_results(analysis: Analysis, request: _Request, model: Any) -> Iterator[Any]:
    """Yield the first result and those with known errors; the last one has the final status."""
    step = _analyze(analysis, request, model, analysis.method)
    known, error, least, stagnations = step.result, np.inf, np.inf, 0
    yield known
    description, reason, count = "errors are not known", "", 1
    while not reason:
        with limit_companions(request.remaining_time, analysis.progress):
            errors = step.result.errors
        required = _mark_required(analysis, request, step.result, errors)
        totals = np.where(required, np.nan_to_num(errors.total, nan=np.inf), 0.0)
        if errors.reason or not required.any() or not np.isfinite(totals.max()):
            names = [remove_unit(x) for x in np.array(errors.headers)[~np.isfinite(totals)]]
            reason = errors.reason or f"{list_first(names, _MAX_NAMES) or 'nothing'} is not finite"
            break
        known, error = step.result, float(totals.max())
        description = _describe(errors, int(np.argmax(totals)))
        vars(known)["errors"] = replace(errors, status=Status("limited", description))
        yield known
        stagnations += not error < least / _MIN_REDUCTION
        least = min(least, error)
        if error <= _SAFE_PART * request.accuracy:
            break
        if stagnations >= _MAX_STAGNATIONS:
            reason = (
                "errors do not decrease with refinement, as at fronts, in chaotic motions, under "
                "moving loads and in sliding joints"
            )
        elif count == _MAX_RUNS:
            reason = f"this is the last of {_MAX_RUNS} runs"
        else:
            try:
                step, count = _improve(analysis, request, step, errors, totals), count + 1
                before, status = (getattr(x, "status", _OK) for x in (known, step.result))
                # Paths may end early at any accuracy, as at the maximum of a load.
                reason = "" if status.kind in ("ok", before.kind) else status.sentence
            except BeamdaeError as limit:
                reason = str(limit)
    if reason and clock.perf_counter() >= request.deadline:
        reason = f"the time limit of {request.time_limit:g} s is reached"
    if error <= request.accuracy:
        last = step.model() if isinstance(step.model, Model) else step.model
        kept = list_fixed_beams(last, analysis.start) if isinstance(last, Mechanism) else {}
        reason = "; ".join(
            f"{name} keeps its elements and strains, because {why}" for name, why in kept.items()
        )
    status = Status("limited", f"{description}; {reason}") if reason else Status("ok", description)
    vars(known)["errors"] = replace(vars(known)["errors"], status=status)
    yield known


def _improve(
    analysis: Analysis, request: _Request, step: _Step, errors: Errors, totals: Array
) -> _Step:
    """Return a run in which errors that exceed their share of the accuracy are reduced.

    This is an earlier one, with the steps of the companion or the companion itself, if it is likely
    to be accurate enough.
    """
    target = _SHARE * request.accuracy
    model, method, _ = step
    name, value = errors.refined.accuracy
    split: Any = errors._split
    if analysis.is_run and name == "rtol" and _TIME_RATIO * totals.max() <= 2.0 * target:
        return _reuse(step, split.companion)
    by = {x: float(np.max(np.abs(y[totals > 0.0]))) for x, y in errors.causes.items()}
    if not np.isfinite(sum(by.values())):
        raise BeamdaeError("a run with refined steps fails")
    by_time = by.pop("time")
    by_model = max(by.values())
    if by_time > min(target, by_model):
        ratio = max(min(target / by_time, 0.5), _MIN_STEP_RATIO)
        value *= ratio ** (1.0 / errors.refined.order) if name == "step" else ratio
        if name == "rtol" and value < _MIN_RTOL:
            raise BeamdaeError(f"the next one needs rtol < {_MIN_RTOL:g}")
        changed: Any = method
        method = replace(changed, **{name: value})
    if by_model > min(target, by_time):
        model = _refine_beams(analysis, model)
    return _analyze(analysis, request, model, method)


def _analyze(analysis: Analysis, request: _Request, model: Any, method: Integrator | None) -> _Step:
    result = analysis.analyze(model, request.limit(method))
    status = getattr(result, "status", _OK)
    if status.kind == "interrupted":
        raise Interrupted(status.sentence, result)
    return _Step(model, method, result)


def _reuse(step: _Step, run: Any) -> _Step:
    """Return a companion as the next step."""
    method: Any = step.method
    method = replace(method, rtol=run.made_by.accuracy.value)
    model = step.model
    if isinstance(model, Mechanism) and run.equations.mechanism is not None:
        model = run.equations.mechanism
    return _Step(model, method, run)


def _refine_beams(analysis: Analysis, model: Any) -> Any:
    """Return the model with the meshes, strains and friction of its companion.

    Raises
    ------
    BeamdaeError
        If no beam can be refined, or the mesh is too fine.
    """
    start = AS_DRAWN if analysis.start is None else analysis.start
    causes = CAUSES if analysis.method is not None else CAUSES_AT_REST

    def refine(mechanism: Any) -> Mechanism:
        if not isinstance(mechanism, Mechanism):
            raise BeamdaeError("the beams of this model are not refined; pass a mechanism")
        finer, refined = refine_mechanism(mechanism, start, causes)
        if not refined.causes:
            raise BeamdaeError("no beam can be refined")
        if sum(len(x.coordinates) for x in beams_of(finer)) > _MAX_UNKNOWNS:
            raise BeamdaeError(f"the next mesh has more than {_MAX_UNKNOWNS} unknowns")
        return finer

    if not isinstance(model, Model):
        return refine(model)
    build = model.build
    refine(model())
    return replace(model, build=wraps(build)(lambda **parameters: refine(build(**parameters))))


def _mark_required(
    analysis: Analysis, request: _Request, result: Any, errors: Errors
) -> np.ndarray:
    """Return the mask of the columns that must be accurate."""
    headers = errors.headers
    if request.columns is not None:
        return mark_required_columns(analysis.name, request.columns, headers)
    observed = analysis.observed(result)
    is_observed = np.array([x in observed for x in headers], bool)
    required = ~is_observed
    names = [x for x in headers if x in observed]
    required[is_observed] = mark_required_columns(analysis.name, None, names)
    return required


def _describe(errors: Errors, worst: int) -> str:
    """Return the largest error with the settings of a result."""
    refined = errors.refined
    name, value = refined.accuracy
    texts = [f"{name}={value:.2g}"] if name else []
    if refined.elements:
        counts = [f"{format_count(n, 'element')} of {x}" for x, n in refined.elements.items()]
        texts.append(list_first(counts, _MAX_NAMES))
    if refined.degrees:
        degrees = [f"degree {degree} of {beam}" for beam, degree in refined.degrees.items()]
        texts.append(list_first(degrees, _MAX_NAMES))
    if (refined.elements or refined.degrees) and not refined.inexact:
        texts.append("exact strains")
    settings = f", with {join_names(texts)}" if texts else ""
    return (
        f"{remove_unit(errors.headers[worst])} has the largest error, "
        f"{format_percent(float(errors.total[worst]))} of "
        f"{errors.relative_to[worst]}{settings}"
    )
