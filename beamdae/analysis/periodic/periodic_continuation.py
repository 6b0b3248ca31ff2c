"""Pseudo-arc-length continuation of periodic motions past folds: `bd.frequency_response`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae import deferred
from beamdae.analysis.continuation.critical import (
    BRANCH,
    DOUBLING,
    FLUTTER,
    LIMIT,
    CriticalPoint,
    explain_counts,
)
from beamdae.analysis.continuation.engine import (
    CurveError,
    Point,
    Segment,
    Steps,
    follow,
    prescribe_parameter,
)
from beamdae.analysis.periodic.load_periods import Loads
from beamdae.analysis.periodic.period_map import PeriodMap, adopt_radau, build_periodic_equations
from beamdae.analysis.periodic.shooting import (
    DAMPING_REMEDY,
    MAX_SETTLING_PERIODS,
    PeriodProblem,
    Tolerance,
    linearization_at,
    settle_and_solve,
)
from beamdae.analysis.sensitivities.sensitivity_result import configure_model
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    format_exception,
    require_choice,
    require_count,
    require_finite,
    require_pair,
    require_positive,
    require_progress,
    short_repr,
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
from beamdae.model_functions import Model, require_model_function
from beamdae.results.frequency_response import (
    FrequencyResponse,
    ResponsePoint,
)
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import floquet_multipliers

Array = np.ndarray

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
        Function that returns the period of the loads [s] for a value of the parameter. Defaults to
        the reciprocal of the parameter, for a frequency in Hz.
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
        Largest error of a required value [-], from 1e-6 to 0.1, see `Errors`. The analysis is
        repeated, up to four times, with smaller steps, finer meshes and exact strains until its
        measured errors are small enough; `errors.status` says what was reached.
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
    require_model_function(_NAME, model)
    first, last = require_pair(_NAME, "between", between, "a pair of values of the parameter")
    ends = require_finite(_NAME, "between", first), require_finite(_NAME, "between", last)
    if ends[0] == ends[1]:
        raise BeamdaeError(
            f"{_NAME}: between must be two different values, got {short_repr(between)}."
        )
    require_choice(_NAME, "parameter", parameter, tuple(model.parameters))
    model = configure_model(_NAME, model, parameters, parameter)
    model.complete({parameter: ends[0]})
    method = Radau(_MAX_RTOL) if integrator is None else integrator
    require_integrator(_NAME, method)
    method = adopt_radau(method, _MAX_RTOL)
    period_at = (lambda frequency: 1.0 / frequency) if period is None else period
    begin = require_finite(_NAME, "t_start", t_start)
    first_step = require_positive(_NAME, "step", step)
    max_step = require_positive(_NAME, "max_step", max_step)
    settle = require_count(_NAME, "settle", settle, 0, MAX_SETTLING_PERIODS)
    max_points = require_count(_NAME, "max_points", max_points, least=2)
    require_choice(_NAME, "partial", partial, PARTIAL_RESULTS)
    require_progress(_NAME, progress)
    # By default, the parameter is a frequency in Hz.
    unit = (model.parameter_info[parameter].unit or ("Hz" if period is None else "")).strip("-")

    def follow(model: Model, method: Integrator) -> FrequencyResponse:
        tolerances = Tolerance.for_integrator(_NAME, tolerance, method)
        curve = ResponseCurve(model, parameter, ends, period_at, method, begin, tolerances, start)
        points: list[ResponsePoint] = []
        critical: list[tuple[str, float]] = []
        sizes = settle, first_step, max_step, max_points
        try:
            status = _follow_curve(curve, points, critical, sizes, progress)
        except KeyboardInterrupt:
            acknowledge()
            last = f"at {parameter} = {points[-1].parameter:.6g}" if points else ""
            status = Status("interrupted", f"interrupted {last or 'before the first point'}")
        first = points[0].solution.equations if points else curve.build(0.0)
        headers = tuple(x for y in first.observables for x in y.headers)
        return FrequencyResponse(parameter, tuple(points), status, unit, tuple(critical), headers)

    until = deferred.module("accuracy.until")
    analysis = until.Analysis(
        _NAME,
        follow,
        method,
        start,
        lambda response: response.errors.headers,
        states=lambda response: [
            (x.solution.equations, x.solution.q, None) for x in response.points
        ],
    )
    response = until.reach_accuracy(analysis, model, accuracy, accuracy_columns)
    status = response.status
    if status.kind == "interrupted" and partial == "raise":
        raise Interrupted(status.sentence, response, _NAME)
    if not status.success:
        warn_of_incomplete_result(f"{_NAME}: {status.sentence}.")
    if not warnings_are_ignored():
        warn_of_result(response._list_warnings(includes_model=False)[not status.success :])
    return response


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """Curve of periodic motions as a function of one model parameter.

    Attributes
    ----------
    model, parameter
        Model function, and name of its parameter.
    ends
        Values of the parameter at which the curve begins and ends.
    period
        Function that returns the period [s] for a value of the parameter.
    integrator, t_start, tolerance, start
        See `periodic`; `start` applies to the first motion.
    """

    model: Model
    parameter: str
    ends: tuple[float, float]
    period: Callable[[float], float]
    integrator: Integrator
    t_start: float
    tolerance: Tolerance
    start: Any = None

    def value(self, position: float) -> float:
        """Return the value of the parameter at a position from 0 to 1 of its range."""
        first, last = self.ends
        return last if position == 1.0 else float(first + position * (last - first))

    def describe(self, position: float) -> str:
        """Return the text "parameter = value" for messages."""
        return f"{self.parameter} = {self.value(position):.6g}"

    def build(self, position: float, start: Any = None) -> EquationsOfMotion:
        """Return the equations of the model."""
        mechanism = self.model(**{self.parameter: self.value(position)})
        return build_periodic_equations(_NAME, mechanism, start)

    def map_at(self, position: float, start: Any = None) -> PeriodMap:
        """Return the map over a period."""
        try:
            period = self.period(self.value(position))
        except Exception as error:
            raise BeamdaeError(
                f"{_NAME}: the function period= failed at {self.describe(position)}: "
                f"{format_exception(error)}."
            ) from error
        period = require_positive(_NAME, "period", period)
        equations = self.build(position, start)
        return PeriodMap.from_equations(equations, self.integrator, self.t_start, period)

    def first_motion(self, settle: int) -> Point:
        """Return the first motion.

        Raises
        ------
        CurveError
            If it is not found.
        """
        period_map = self.map_at(0.0, self.start)
        Loads(period_map.equations, self.t_start, period_map.period).require_repeating()
        linear = settle_and_solve(period_map, settle, self.tolerance)
        run = linear.run
        if run.relative_deviation > self.tolerance.accepted:
            raise CurveError(
                f"no periodic motion was found at {self.describe(0.0)}; change start=, increase "
                f"settle=, or {DAMPING_REMEDY}"
            )
        problem = PeriodProblem(self.map_at, self.tolerance, varies=True)
        return problem.complete(Point(problem, run.state, 0.0, linear), np.zeros(0))

    def as_response_point(self, point: Point, rate: float) -> ResponsePoint:
        """Return a motion, at this derivative of the position along the curve, for the result."""
        run = linearization_at(point).run
        forward = rate * (self.ends[1] - self.ends[0]) > 0.0
        period = run.period_map.period
        return ResponsePoint(
            self.value(point.p), period, run.solution, _multipliers(point), forward
        )


def _multipliers(point: Point) -> Array:
    return floquet_multipliers(linearization_at(point).matrix.monodromy)


def _follow_curve(
    curve: ResponseCurve,
    points: list[ResponsePoint],
    critical: list[tuple[str, float]],
    sizes: tuple[int, float, float, int],
    progress: Callable[[ResponsePoint], None] | None = None,
) -> Status:
    """Append the points of the curve to `points`, and return the reason for its end."""
    settle, step, max_step, max_points = sizes

    def append(point: Point, rate: float) -> None:
        points.append(curve.as_response_point(point, rate))
        if progress is not None:
            progress(points[-1])

    try:
        point = curve.first_motion(settle)
    except CurveError as error:
        is_run = isinstance(error, BeamdaeError)
        reason = f"{curve.describe(0.0)}: {_failure_reason(error)}" if is_run else str(error)
        return Status("failed", reason)
    append(point, 1.0)
    largest = max(step, max_step)
    steps = Steps(
        largest, True, 1.0, largest, first=step / largest, smallest=_MIN_STEP_RATIO * step / largest
    )
    segments = follow(point, prescribe_parameter, 1.0, steps, _explain)
    while len(points) < max_points:
        try:
            segment, found = next(segments)
        except StopIteration:
            return Status("ok", "reached the end of the range")
        except CurveError as error:
            reason = _failure_reason(error)
            if not isinstance(error, BeamdaeError):
                reason = f"{reason}; reduce step=, or {DAMPING_REMEDY}"
            return Status("failed", f"{curve.describe(point.p)}: {reason}")
        critical += [(_KINDS[x.kind], curve.value(x.point.p)) for x in found]
        point = segment.end
        append(point, segment.tangent_at(point).p)
        folds = [value for kind, value in critical if kind == _FOLD]
        if point.p < 0.0 and points[-1].forward != points[0].forward:
            return Status(
                "failed",
                f"the curve folds back at {curve.parameter} = {folds[-1]:.6g} and returned to the "
                "start of the range; begin on another branch, with another start= or value of "
                "between=",
            )
    if point.p == 1.0:
        return Status("ok", "reached the end of the range")
    sentence = (
        f"stopped at the maximum of {max_points} points at {curve.describe(point.p)}; "
        "increase max_points"
    )
    return Status("limited", sentence)


def _explain(segment: Segment) -> list[CriticalPoint]:
    return explain_counts(segment, _RESOLUTION)


def _failure_reason(error: Exception) -> str:
    return re.sub("^(periodic|frequency_response): ", "", str(error)).rstrip(".")
