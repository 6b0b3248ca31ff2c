"""Pseudo-arc-length continuation of periodic motions past folds: `bd.frequency_response`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from beamdae import deferred
from beamdae.analysis.continuation.critical import (
    BRANCH,
    DOUBLING,
    FLUTTER,
    LIMIT,
    explain_counts,
)
from beamdae.analysis.continuation.engine import (
    CurveError,
    Point,
    Steps,
    follow,
    prescribe_parameter,
)
from beamdae.analysis.parameter_range import ParameterRange
from beamdae.analysis.periodic.load_periods import Loads
from beamdae.analysis.periodic.period_map import PeriodMap, adopt_radau, build_periodic_equations
from beamdae.analysis.periodic.shooting import (
    DAMPING_REMEDY,
    MAX_SETTLING_PERIODS,
    PeriodProblem,
    Tolerance,
    settle_and_solve,
)
from beamdae.errors import (
    BeamdaeError,
    format_exception,
    require_choice,
    require_count,
    require_finite,
    require_positive,
    require_progress,
    warn_of_incomplete_result,
    warn_of_result,
    warnings_are_ignored,
)
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.interrupts import (
    PARTIAL_RESULTS,
    Interrupted,
    PartialResult,
    acknowledge,
    interruptible,
)
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_functions import Model
from beamdae.model_parameters import conversion_factor
from beamdae.results.frequency_response import (
    FrequencyResponse,
    ResponsePoint,
)
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import floquet_multipliers

_NAME = "frequency_response"
# Largest relative tolerance of the runs; with larger ones, their errors dominate the tangents.
_MAX_RTOL = 1e-8
# Smallest permitted step, relative to the first step.
_MIN_STEP_RATIO = 1e-3
# Critical points are located with this error, relative to a step.
_RESOLUTION = 3e-3
_FOLD = "fold"
_KINDS = {LIMIT: _FOLD, BRANCH: "branch point", DOUBLING: DOUBLING, FLUTTER: "torus point"}


@single_threaded
@interruptible
def frequency_response(
    model: Model,
    parameter: str,
    between: tuple[float, float],
    period: Callable[[float], float] | None = None,
    integrator: Integrator | None = None,
    step: float = 0.02,
    max_step: float = 0.1,
    settle: int = 20,
    tolerance: float | None = None,
    max_points: int = 400,
    t_start: float = 0.0,
    *,
    start: Any = None,
    parameters: Mapping[str, Any] | None = None,
    progress: Callable[[ResponsePoint], None] | None = None,
    partial: PartialResult = "raise",
    accuracy: float | None = None,
    accuracy_columns: Sequence[str] | str | None = None,
) -> FrequencyResponse:
    """Follow a periodic motion of a model over the frequency of its loads or another parameter.

    Pseudo-arc-length continuation (Keller 1977) with the single shooting of `periodic` follows the
    motion past folds, where the parameter reverses, and where it is unstable.

    Parameters
    ----------
    model
        Model function, called as `model(**{parameter: value})`.
    parameter
        Name of a numeric parameter of the model.
    between
        Values of the parameter at which the curve begins and ends, ascending or descending.
    period
        Function that returns the period of the loads [s] for a value of the parameter. Required
        unless the parameter is a frequency or an angular frequency by its unit, such as Hz, rad/s
        or rpm, or has no unit, which stands for Hz.
    integrator
        Integrator with fixed steps, or `Radau`. Defaults to Radau(1e-8). Larger tolerances are
        reduced to 1e-8, and other integrators with adaptive steps are replaced by `Radau`, because
        tangents of the curve require accurate runs.
    step, max_step
        Length of the first step and largest permitted length of a step along the curve. The root
        mean square change of the state is measured relative to the amplitudes, the change of the
        parameter relative to its range.
    settle
        Number of periods to run before the first periodic motion is sought, 0 to 10 000.
    tolerance
        Largest permitted difference between the states at the end and at the start of a period,
        relative to the amplitudes. Defaults as in `periodic`.
    max_points
        Maximum number of points on the curve, at least 2.
    t_start
        Time [s] at which periods begin.
    start
        Start of the search for the first motion, as in `periodic`; if there are several motions, it
        decides which one is followed. Defaults to the start of the model.
    parameters
        Values of other parameters of the model that differ from the defaults.
    progress
        Function that is called with each point of the curve, a `ResponsePoint`.
    partial
        "return" to return the curve so far if the call is interrupted, with the status
        "interrupted", instead of raising `Interrupted`.
    accuracy
        Largest error of the required columns [-], from 1e-6 to 0.1, see `Errors`.
    accuracy_columns
        Columns of `errors` that must be accurate. Defaults to positions, angles and
        deflections [m, rad] of the measured motions or, if there are none, all columns.

    Returns
    -------
    FrequencyResponse
        The motions in order along the curve. `status` states why the curve ends, or why no first
        motion was found.

    Raises
    ------
    BeamdaeError
        If an argument is invalid or, at the first point, `period` fails, loads or drivers are not
        periodic, parts are inactive, or events stop the run, switch parts or cause impacts.
    Interrupted
        If Ctrl-C ends the call; `Interrupted.partial` is the curve so far, which may be
        empty.
    Exception
        Any exception of `progress`.

    Warns
    -----
    BeamdaeWarning
        If no first motion is found, or the curve ends inside the range; and for each of
        `FrequencyResponse.warnings`.
    """
    span = ParameterRange.of(
        _NAME, model, ("parameter", parameter), ("between", between), parameters
    )
    span.model.complete({parameter: span.first})
    method = Radau(_MAX_RTOL) if integrator is None else integrator
    require_integrator(_NAME, method)
    method = adopt_radau(method, _MAX_RTOL)
    begin = require_finite(_NAME, "t_start", t_start)
    first_step = require_positive(_NAME, "step", step)
    largest = max(first_step, require_positive(_NAME, "max_step", max_step))
    ratio = first_step / largest
    steps = Steps(largest, True, 1.0, largest, first=ratio, smallest=_MIN_STEP_RATIO * ratio)
    settle = require_count(_NAME, "settle", settle, 0, MAX_SETTLING_PERIODS)
    max_points = require_count(_NAME, "max_points", max_points, least=2)
    require_choice(_NAME, "partial", partial, PARTIAL_RESULTS)
    require_progress(_NAME, progress)
    unit = span.model.parameter_info[parameter].unit or ("Hz" if period is None else "")
    period_at = _period_of_unit(parameter, unit) if period is None else period

    def trace(model: Model, method: Integrator) -> FrequencyResponse:
        limits = Tolerance.for_integrator(_NAME, tolerance, method)
        refined = replace(span, model=model)
        points: list[ResponsePoint] = []
        critical: list[tuple[str, float]] = []
        status, share = Status("ok", "reached the end of the range"), 0.0
        try:
            for point, share, found in _follow_motions(
                refined, period_at, method, begin, limits, start, settle, steps
            ):
                critical += found
                points.append(point)
                if progress is not None:
                    progress(point)
                if share < 0.0 and point.forward != points[0].forward:
                    folds = [value for kind, value in critical if kind == _FOLD]
                    raise CurveError(
                        f"the curve folds back at {parameter} = {folds[-1]:.6g} and returned to "
                        "the start of the range; begin on another branch, with another start= or "
                        "value of between="
                    )
                if len(points) == max_points and share != 1.0:
                    sentence = f"stopped at the maximum of {max_points} points at "
                    sentence += f"{span.describe(share)}; increase max_points"
                    status = Status("limited", sentence)
                    break
        except CurveError as error:
            reason = re.sub("^(periodic|frequency_response): ", "", str(error)).rstrip(".")
            status = Status("failed", f"{span.describe(share)}: {reason}")
        except KeyboardInterrupt:
            acknowledge()
            where = f"at {span.describe(share)}" if points else "before the first point"
            status = Status("interrupted", f"interrupted {where}")
        if points:
            equations = points[0].solution.equations
        else:
            equations = build_periodic_equations(_NAME, refined.build(0.0))
        headers = tuple(x for y in equations.observables for x in y.headers)
        return FrequencyResponse(
            parameter, tuple(points), status, unit.strip("-"), tuple(critical), headers
        )

    until = deferred.module("accuracy.until")
    analysis = until.Analysis(
        _NAME,
        trace,
        method,
        start,
        lambda response: response.errors.headers,
    )
    response = until.reach_accuracy(analysis, span.model, accuracy, accuracy_columns)
    status = response.status
    if status.kind == "interrupted" and partial == "raise":
        raise Interrupted(status.sentence, response, _NAME)
    if not status.success:
        warn_of_incomplete_result(f"{_NAME}: {status.sentence}.")
    if not warnings_are_ignored():
        warn_of_result(response._list_warnings(includes_model=False)[not status.success :])
    return response


def _period_of_unit(parameter: str, unit: str) -> Callable[[float], float]:
    """Return the period [s] as a function of a frequency or an angular frequency with a unit."""
    for base, turn in (("Hz", 1.0), ("rad/s", 2.0 * np.pi)):
        factor = conversion_factor(unit, base)
        if factor is not None:
            return lambda value: turn / (float(factor) * value)
    raise BeamdaeError(
        f"{_NAME}: {parameter} [{unit}] is not a frequency; pass period=, a function of the "
        "parameter."
    )


def _follow_motions(
    span: ParameterRange,
    period_at: Callable[[float], float],
    integrator: Integrator,
    t_start: float,
    tolerance: Tolerance,
    start: Any,
    settle: int,
    steps: Steps,
) -> Iterator[tuple[ResponsePoint, float, list[tuple[str, float]]]]:
    """Yield motions, shares of the range, and kinds and values of critical points before.

    Raises
    ------
    CurveError
        If the first or the next motion is not found.
    """

    def map_at(share: float, start: Any = None) -> PeriodMap:
        try:
            period = period_at(span.value(share))
        except Exception as error:
            raise BeamdaeError(
                f"{_NAME}: the function period= failed at {span.describe(share)}: "
                f"{format_exception(error)}."
            ) from error
        period = require_positive(_NAME, "period", period)
        equations = build_periodic_equations(_NAME, span.build(share), start)
        return PeriodMap.from_equations(equations, integrator, t_start, period)

    def describe(point: Point, rate: float) -> ResponsePoint:
        run, monodromy = point.linearization.run, point.linearization.matrix.monodromy
        return ResponsePoint(
            span.value(point.p),
            run.period_map.period,
            run.solution,
            floquet_multipliers(monodromy),
            rate * (span.last - span.first) > 0.0,
        )

    period_map = map_at(0.0, start)
    Loads(period_map.equations, t_start, period_map.period).require_repeating()
    linear = settle_and_solve(period_map, settle, tolerance)
    if linear.run.relative_deviation > tolerance.accepted:
        raise CurveError(
            f"no periodic motion was found; change start=, increase settle=, or {DAMPING_REMEDY}"
        )
    problem = PeriodProblem(map_at, tolerance, varies=True)
    first = problem.complete(Point(problem, linear.run.state, 0.0, linear), np.zeros(0))
    yield describe(first, 1.0), 0.0, []
    explain = partial(explain_counts, resolution=_RESOLUTION)
    try:
        for segment, found in follow(first, prescribe_parameter, 1.0, steps, explain):
            point = describe(segment.end, float(segment.tangent[-1]))
            yield point, segment.end.p, [(_KINDS[x.kind], span.value(x.point.p)) for x in found]
    except CurveError as error:
        if isinstance(error, BeamdaeError):
            raise
        raise CurveError(f"{error}; reduce step=, or {DAMPING_REMEDY}") from None
