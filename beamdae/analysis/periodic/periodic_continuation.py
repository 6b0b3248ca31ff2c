"""Pseudo-arc-length continuation of periodic motions past folds: `bd.frequency_response`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la

from beamdae import deferred
from beamdae.analysis.periodic.law_periods import require_repeating_laws
from beamdae.analysis.periodic.monodromy import LinearizationError
from beamdae.analysis.periodic.shooting import (
    MAX_SETTLING_PERIODS,
    IncompleteRunError,
    PeriodMap,
    PeriodRun,
    Tolerance,
    build_periodic_equations,
    equalize_deformations,
    settle_and_solve,
    solve_shooting,
)
from beamdae.analysis.sensitivities.sensitivity_result import configure_model
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
from beamdae.results.frequency_response import FrequencyResponse, ResponsePoint
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import floquet_multipliers

Array = np.ndarray

_NAME = "frequency_response"
# Maximum number of iterations of the corrector, and largest permitted correction, relative to the
# amplitudes and the range of the parameter.
_MAX_ITERATIONS = 8
_MAX_CHANGE = 0.3
# The Jacobian is computed again if an iteration leaves more than this fraction of the deviation.
_MAX_CONTRACTION = 0.3
# Parts of the monodromy matrix below this fraction of its norm are neglected. Multipliers of stable
# motions may exceed 1 by ten times as much.
_RANK_TOLERANCE = 1e-4
# Largest step of finite differences with respect to the parameter, relative to its range, and
# largest relative change of the period. Tangents have errors of the step, and of the errors of
# runs, about 1e-9, over the step. The distance d of a multiplier from 1 amplifies both by 1 / d; it
# is as small as 2 pi times the damping ratio.
_DIFFERENCE_STEP = 2e-5
# Largest relative tolerance of the runs; with larger ones, their errors dominate the tangents.
_MAX_RTOL = 1e-8
# Settings of the integrator that Radau adopts in its place.
_LIMITS = ("max_step", "max_steps", "time_limit")
# Smallest permitted cosine of the angle between the tangents at both ends of a step.
_MIN_COSINE = 0.8
# Angle [rad] at which steps aim; a turn by more than 0.64 is rejected.
_TARGET_ANGLE = 0.4
_TINY = 1e-300  # avoids a division by zero
# The step grows if the corrector takes at most the first number of iterations, and shrinks if it
# takes at least the second.
_MAX_ITERATIONS_TO_GROW = 4
_MIN_ITERATIONS_TO_SHRINK = 6
_GROWTH_FACTOR = 1.5
_CUT_FACTOR = 0.5
# Smallest permitted step, relative to the first step.
_MIN_STEP_RATIO = 1e-3
_LINEAR_REMEDY = "or, for small motions, use bd.linearize(...).frequency_response"
_NOT_CONVERGED = f"Newton's method does not converge; reduce step= {_LINEAR_REMEDY}"
_SHARP_TURN = f"the curve turns too sharply for the steps; reduce step= {_LINEAR_REMEDY}"
_REVERSAL = f"the parameter reverses where the curve has no fold; reduce step= {_LINEAR_REMEDY}"
# Largest distance of the moduli of multipliers of undamped vibrations from 1, by errors of runs and
# of multipliers close to a resonance; a damping ratio of 0.1 % has 6e-3 at the first resonance.
_UNDAMPED_MARGIN = 1e-3
# Vibrations are damped if their multipliers decay by more than this in a period, on average.
_MIN_DECAY = 1e-5
_MIN_UNDAMPED = 2  # multipliers of a vibration; a fold has one that is 1


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
    method = _choose_method(method)
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
        sizes = settle, first_step, max_step, max_points
        try:
            status = _follow_curve(curve, points, *sizes, progress)
        except KeyboardInterrupt:
            acknowledge()
            last = f"at {curve.describe(points[-1].parameter)}" if points else ""
            status = Status("interrupted", f"interrupted {last or 'before the first point'}")
        headers = tuple(points[0].solution.columns) if points else curve.list_headers()
        return FrequencyResponse(parameter, tuple(points), status, unit, headers)

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


def _choose_method(integrator: Integrator) -> Integrator:
    """Return the integrator of the runs: accurate Radau in place of other adaptive steps."""
    name, value = integrator.accuracy
    if name != "rtol":
        return integrator
    rtol = min(value, _MAX_RTOL)
    if isinstance(integrator, Radau):
        return replace(integrator, rtol=rtol)
    limits: dict[str, Any] = {name: getattr(integrator, name, None) for name in _LIMITS}
    return Radau(rtol, **limits)


def _follow_curve(
    curve: ResponseCurve,
    points: list[ResponsePoint],
    settle: int,
    first_step: float,
    max_step: float,
    max_points: int,
    progress: Callable[[ResponsePoint], None] | None = None,
) -> Status:
    """Append the points of the curve to `points`, and return the reason for its end."""

    def append(point: CurvePoint) -> None:
        points.append(point.as_response_point(sign))
        if progress is not None:
            progress(points[-1])

    step, (first, last) = first_step, curve.ends
    sign = 1.0 if last > first else -1.0
    previous: CurvePoint | None = None
    point, reason = curve.first_point(settle)
    if point is None:
        return Status("failed", reason)
    append(point)
    while len(points) < max_points:
        next_point, reason = curve.next_point(previous, point, step)
        if next_point is None:
            step *= _CUT_FACTOR
            if step < _MIN_STEP_RATIO * first_step:
                if reason in (_NOT_CONVERGED, _SHARP_TURN, _REVERSAL):
                    reason = _explain_failure(reason, points[-1].multipliers, points[-1].period)
                return Status("failed", f"{curve.describe(point.value)}: {reason}")
            continue
        if sign * (next_point.value - last) > 0.0:
            next_point = curve.end_point(point, next_point)
        previous, point = point, next_point
        append(point)
        if sign * (point.value - last) >= 0.0:
            return Status("ok", "reached the end of the range")
        is_reversed = points[-1].forward != points[0].forward
        if sign * (point.value - first) < 0.0 and is_reversed:
            return Status("failed", _describe_return(curve, points))
        if point.iterations <= _MAX_ITERATIONS_TO_GROW:
            angle = np.arccos(min(curve.smallest_cosine(previous, point), 1.0))
            growth = min(_GROWTH_FACTOR, _TARGET_ANGLE / max(angle, _TINY))
            step = min(step * growth, max_step)
        elif point.iterations >= _MIN_ITERATIONS_TO_SHRINK:
            step *= _CUT_FACTOR
    sentence = (
        f"stopped at the maximum of {max_points} points at {curve.describe(point.value)}; "
        "increase max_points"
    )
    return Status("limited", sentence)


def _explain_failure(reason: str, multipliers: Array, period: float) -> str:
    """Return the reason why no motion is found, with missing damping as its likely cause."""
    moduli = np.abs(multipliers)
    moduli = moduli[np.abs(moduli - 1.0) <= _UNDAMPED_MARGIN]
    if len(moduli) < _MIN_UNDAMPED:
        return reason
    decay = -float(np.mean(np.log(moduli)))
    modulus, amount = "1", "damping, such as damping= of the sections,"
    cause = "are undamped", "amplitudes at resonances are infinite"
    if decay > _MIN_DECAY:
        # In a period of the loads, vibrations with their frequency decay by 2 pi times the ratio.
        modulus, ratio = f"{1.0 - decay:.6g}", decay / (2.0 * np.pi)
        required = _UNDAMPED_MARGIN / (2.0 * np.pi)
        cause = (
            f"have a damping ratio of only {100.0 * ratio:.2g} %",
            "errors of runs are amplified at resonances",
        )
        amount = (
            f"damping to a ratio above {100.0 * required:.2g} %, such as damping= of the sections "
            f"above {required * period / np.pi:.1g} s,"
        )
    return (
        f"{reason.partition(';')[0]}, probably because vibrations {cause[0]} ({len(moduli)} "
        f"multipliers have the modulus {modulus}) and {cause[1]}; add {amount} {_LINEAR_REMEDY}"
    )


def _describe_return(curve: ResponseCurve, points: list[ResponsePoint]) -> str:
    folds = FrequencyResponse(curve.parameter, tuple(points), Status("ok", "")).folds
    return (
        f"the curve folds back at {curve.describe(folds[-1])} and returned to the start of the "
        "range; begin on another branch, with another start= or value of between="
    )


@dataclass(frozen=True, eq=False)
class CurvePoint:
    """Periodic motion on a response curve.

    Attributes
    ----------
    run
        One period of the motion.
    monodromy
        Its monodromy matrix, in terms of the basis of `run`.
    by_parameter
        Derivative of the deviation with respect to the parameter relative to its range, in terms of
        the basis of `run`, (k,).
    value
        Value of the parameter.
    shift
        Derivative of the consistent state (2 n,) with respect to the parameter relative to its
        range: drivers move with the parameter. Its part in terms of the basis of `run` is zero.
    direction
        Tangent of the curve in (q, v) and in the parameter relative to its range, (2 n + 1,).
    orientation
        Sign of the determinant of the extended Jacobian with the tangent as its last row; it is
        constant along a curve, and 0 if not yet computed.
    iterations
        Number of iterations that led to the motion.
    """

    run: PeriodRun
    monodromy: Array
    by_parameter: Array
    value: float
    shift: Array
    direction: Array
    orientation: float = 0.0
    iterations: int = 0

    @property
    def jacobian(self) -> Array:
        """Jacobian of the deviation with respect to the state and the parameter, (k, k + 1).

        The state is expressed in terms of the basis of `run`.
        """
        return np.column_stack([self.monodromy - np.eye(len(self.monodromy)), self.by_parameter])

    def reduce(self, direction: Array) -> Array:
        """Return a direction (2 n + 1,) in terms of the basis of `run` and the parameter."""
        return np.append(self.run.projection @ direction[:-1], direction[-1])

    def scale(self, direction: Array) -> Array:
        """Return a direction (2 n + 1,) relative to the amplitudes, not by energy.

        The states contribute their root mean square to its norm, so that steps hardly depend on the
        number of elements. Deformations of a beam are measured relative to the largest scale of its
        deformations with the same unit. Relative to the far smaller amplitudes of axial
        deformations, errors of the integrator would dominate the norm; by energy, the axial
        displacements of bent beams would dominate the angles between tangents.
        """
        scales = equalize_deformations(self.run.solution.equations, self.run.scales.reshape(2, -1))
        states = direction[:-1] / (scales.ravel() * np.sqrt(scales.size))
        return np.append(states, direction[-1])

    def length(self, direction: Array) -> float:
        """Return the norm of a direction (2 n + 1,) relative to the amplitudes."""
        return float(np.linalg.norm(self.scale(direction)))

    def as_response_point(self, sign: float) -> ResponsePoint:
        """Convert to a point of the result; `sign` is 1 for an ascending range, -1 otherwise."""
        multipliers = floquet_multipliers(self.monodromy)
        forward = sign * self.direction[-1] > 0.0
        period = self.run.period_map.period
        return ResponsePoint(self.value, period, self.run.solution, multipliers, forward)


@dataclass(frozen=True, eq=False)
class _CurveJacobian:
    """Jacobian of the deviation, and the tangent to which corrections are orthogonal.

    Attributes
    ----------
    run
        The run in terms of whose basis all attributes are expressed.
    matrix
        See `CurvePoint.jacobian`.
    tangent
        Tangent of the curve, (k + 1,).
    persistent
        Disturbances (2 n, r) that persist over the period.
    """

    run: PeriodRun
    matrix: Array
    tangent: Array
    persistent: Array

    @classmethod
    def at_point(cls, point: CurvePoint) -> _CurveJacobian:
        """Return the Jacobian at a point of the curve."""
        persistent = point.run.persistent_disturbances(point.monodromy)
        return cls(point.run, point.jacobian, point.reduce(point.direction), persistent)

    def renew(self, run: PeriodRun, by_parameter: Array) -> _CurveJacobian:
        """Return the Jacobian at a run with this derivative (2 n,) by the parameter."""
        state = run.projection @ (self.run.basis @ self.tangent[:-1])
        reduced = run.projection @ by_parameter
        monodromy = run.resolved_monodromy(reduced, tolerance=_RANK_TOLERANCE)
        matrix = np.column_stack([monodromy - np.eye(len(monodromy)), reduced])
        tangent = np.append(state, self.tangent[-1])
        return _CurveJacobian(run, matrix, tangent, run.persistent_disturbances(monodromy))

    def update(self, last: PeriodRun, run: PeriodRun, change_of_value: float) -> _CurveJacobian:
        """Return the Jacobian that predicts the change of the deviation between two runs."""
        before, after = (x.period_map.deviation(x.solution) for x in (last, run))
        shift = np.append(self.run.projection @ (run.state - last.state), change_of_value)
        error = self.run.projection @ (after - before) - self.matrix @ shift
        return replace(self, matrix=self.matrix + np.outer(error, shift) / (shift @ shift))

    def correct(self, run: PeriodRun) -> tuple[Array, float]:
        """Return the corrections of (q, v), (2 n,), and of the relative parameter."""
        deviation = self.run.projection @ run.period_map.deviation(run.solution)
        matrix = np.vstack([self.matrix, self.tangent])
        correction = np.linalg.solve(matrix, np.append(-deviation, 0.0))
        return self.run.basis @ correction[:-1], float(correction[-1])


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

    def describe(self, value: float) -> str:
        """Return the text "parameter = value" for messages."""
        return f"{self.parameter} = {value:.6g}"

    def list_headers(self) -> tuple[str, ...]:
        """Return the headers of the observed columns."""
        equations = build_periodic_equations(_NAME, self.model(**{self.parameter: self.ends[0]}))
        return tuple(header for x in equations.observables for header in x.headers)

    @property
    def _range(self) -> float:
        return self.ends[1] - self.ends[0]

    def _period(self, value: float) -> float:
        """Return the period [s] for a value of the parameter."""
        try:
            period = self.period(value)
        except Exception as error:
            raise BeamdaeError(
                f"{_NAME}: the function period= failed at {self.describe(value)}: "
                f"{format_exception(error)}."
            ) from error
        return require_positive(_NAME, "period", period)

    def _period_map(self, value: float, start: Any = None) -> PeriodMap:
        period = self._period(value)
        equations = build_periodic_equations(_NAME, self.model(**{self.parameter: value}), start)
        return PeriodMap.from_equations(equations, self.integrator, self.t_start, period)

    def first_point(self, settle: int) -> tuple[CurvePoint | None, str]:
        """Return the first point of the curve and "", or None and the reason for the failure."""
        value = self.ends[0]
        period_map = self._period_map(value, self.start)
        require_repeating_laws(period_map.equations.mechanism, self.t_start, period_map.period)
        try:
            run, iterations = settle_and_solve(period_map, settle, self.tolerance)
            if run.relative_deviation > self.tolerance.accepted:
                reason = (
                    f"no periodic motion was found at {self.describe(value)}; change "
                    f"start=, increase settle= {_LINEAR_REMEDY}"
                )
                multipliers = floquet_multipliers(run.resolved_monodromy())
                return None, _explain_failure(reason, multipliers, period_map.period)
            return self._complete_point(run, value, None, iterations), ""
        except (IncompleteRunError, LinearizationError) as error:
            return None, f"{self.describe(value)}: {_failure_reason(error)}"

    def next_point(
        self, previous: CurvePoint | None, point: CurvePoint, step: float
    ) -> tuple[CurvePoint | None, str]:
        """Return the next point on the curve and "", or None and the reason for the failure.

        `step` is the length of the step along the curve from `point`, which follows `previous`. The
        corrections are orthogonal to the tangent at `point`. They start from the Jacobian at
        `point` and improve it by the deviations of the runs (Broyden, Math. Comp. 19 (1965) 577).
        Where it does not suffice, because the phases of free vibrations at the end of a period
        change with the period, the variational equations are solved once more.
        """
        state, value = self._predict(previous, point, step)
        jacobian = _CurveJacobian.at_point(point)
        last, last_value, is_new = point.run, point.value, False
        try:
            for iteration in range(_MAX_ITERATIONS + 1):
                period_map = self._period_map(value)
                q, v = period_map.make_consistent(*np.split(state, 2))
                run = PeriodRun.from_state(
                    period_map, q, v, jacobian.persistent, point.run.amplitudes
                )
                contraction = run.relative_deviation / last.relative_deviation
                if iteration == 0:
                    contraction = np.inf
                elif self.tolerance.is_exhausted(
                    min(run.relative_deviation, last.relative_deviation), contraction
                ):
                    # A new matrix would not improve this motion.
                    if contraction > 1.0:
                        run, value = last, last_value
                    return self._accept_step(run, value, point, iteration)
                elif contraction > _MAX_CONTRACTION:
                    if contraction > 1.0:
                        if is_new:
                            return None, _NOT_CONVERGED
                        run, value = last, last_value
                    _, by_parameter = self._differentiate_by_parameter(run, value)
                    jacobian, is_new = jacobian.renew(run, by_parameter), True
                else:
                    change_of_value = (value - last_value) / self._range
                    jacobian, is_new = jacobian.update(last, run, change_of_value), False
                last, last_value = run, value
                change, change_of_value = jacobian.correct(run)
                largest = max(run.relative_size(change), abs(change_of_value))
                if self.tolerance.is_met(run.relative_deviation, largest, contraction):
                    return self._accept_step(run, value, point, iteration)
                factor = max(1.0, largest / _MAX_CHANGE)
                state = run.state + change / factor
                value += change_of_value * self._range / factor
        except (BeamdaeError, la.LinAlgError) as error:
            return None, _failure_reason(error)
        return None, _NOT_CONVERGED

    def _accept_step(
        self, run: PeriodRun, value: float, point: CurvePoint, iterations: int
    ) -> tuple[CurvePoint | None, str]:
        """Return the next point on the curve and "", or None and the reason to reject the step."""
        next_point = self._complete_point(run, value, point, iterations)
        reason = self._step_failure(point, next_point)
        return (None, reason) if reason else (next_point, "")

    def end_point(self, point: CurvePoint, beyond: CurvePoint) -> CurvePoint:
        """Return the point at the end of the range between two points.

        Return `beyond` if the search from the state interpolated between both fails.
        """
        end = self.ends[1]
        share = (end - point.value) / (beyond.value - point.value)
        state = point.run.state + share * (beyond.run.state - point.run.state)
        try:
            period_map = self._period_map(end)
            q, v = period_map.make_consistent(*np.split(state, 2))
            run, iterations = solve_shooting(
                period_map, q, v, self.tolerance, amplitudes=point.run.amplitudes
            )
            if run.relative_deviation > self.tolerance.accepted:
                return beyond
            last = self._complete_point(run, end, point, iterations)
        except (BeamdaeError, la.LinAlgError):
            return beyond
        return beyond if self._step_failure(point, last) else last

    def _predict(
        self, previous: CurvePoint | None, point: CurvePoint, step: float
    ) -> tuple[Array, float]:
        """Return the state (2 n,) and the parameter at the predicted next point.

        The curve is extrapolated by the cubic polynomial through the last two points with their
        tangents, or along the tangent at the first point.
        """
        change = step * point.direction
        if previous is not None:
            secant = self._secant(previous, point)
            length = point.length(secant)
            mean_slope = secant / length
            first_slope = previous.direction / point.length(previous.direction)
            # Newton's form of the polynomial, with the ends of the last step as double nodes.
            x = step / length
            second = point.direction - mean_slope
            third = point.direction - 2.0 * mean_slope + first_slope
            change = change + step * x * (second + (1.0 + x) * third)
        return point.run.state + change[:-1], point.value + float(change[-1]) * self._range

    def _step_failure(self, point: CurvePoint, next_point: CurvePoint) -> str:
        """Return the reason to reject a step along the curve, or "".

        On both sides of a fold, the tangents have opposite signs with respect to the parameter.
        Anywhere else, the parameter must change in their direction.
        """
        secant = self._secant(point, next_point)
        slopes = point.direction[-1], next_point.direction[-1]
        is_fold = slopes[0] * slopes[1] <= 0.0
        is_noise = abs(secant[-1]) <= self.tolerance.target
        if secant[-1] * slopes[0] < 0.0 and not (is_fold or is_noise):
            return _REVERSAL
        is_sharp = self.smallest_cosine(point, next_point) < _MIN_COSINE
        return _SHARP_TURN if is_sharp else ""

    def smallest_cosine(self, point: CurvePoint, next_point: CurvePoint) -> float:
        """Return the smallest cosine of the angles between the secant and the tangents at its ends.

        These include the angle between both tangents.
        """
        secant = self._secant(point, next_point)
        directions = np.array(
            [next_point.scale(x) for x in (point.direction, secant, next_point.direction)]
        )
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        return float(np.min(directions @ directions.T))

    def _secant(self, point: CurvePoint, next_point: CurvePoint) -> Array:
        """Return the change (2 n + 1,) of (q, v) and of the relative parameter between points."""
        change_of_value = (next_point.value - point.value) / self._range
        return np.append(next_point.run.state - point.run.state, change_of_value)

    def _complete_point(
        self, run: PeriodRun, value: float, last: CurvePoint | None, iterations: int
    ) -> CurvePoint:
        """Return the point of a periodic motion, with its monodromy matrix and tangent.

        `last` is the point before it along the curve, None for the first point.
        """
        ahead, orientation = np.append(np.zeros(len(run.scales)), 1.0), 0.0
        if last is not None:
            ahead, orientation = last.direction, last.orientation
        shift, by_parameter = self._differentiate_by_parameter(run, value)
        reduced_shift, by_parameter = run.projection @ shift, run.projection @ by_parameter
        monodromy = run.resolved_monodromy(by_parameter, reduced_shift, tolerance=_RANK_TOLERANCE)
        # Without the part of the shift that the basis contains, the derivative is the one at a
        # constant state in terms of the basis.
        shift = shift - run.basis @ reduced_shift
        by_parameter = by_parameter - (monodromy @ reduced_shift - reduced_shift)
        return _orient_curve(
            CurvePoint(run, monodromy, by_parameter, value, shift, ahead, orientation, iterations)
        )

    def _differentiate_by_parameter(self, run: PeriodRun, value: float) -> tuple[Array, Array]:
        """Return the derivatives (2 n,) of the consistent state and of the deviation.

        Both are derivatives with respect to the parameter, multiplied by its range. They are
        differences to a point toward the middle of the range, because the model may not exist
        beyond its ends.
        """
        step = _DIFFERENCE_STEP if value - self.ends[0] < 0.5 * self._range else -_DIFFERENCE_STEP
        stretch = self._period(value + step * self._range) / run.period_map.period - 1.0
        step *= min(1.0, _DIFFERENCE_STEP / max(abs(stretch), _DIFFERENCE_STEP))
        period_map = self._period_map(value + step * self._range)
        q, v = period_map.make_consistent(*np.split(run.state, 2))
        # With the same amplitudes, the errors of both runs are similar.
        solution = period_map.run(q, v, run.solution.equations.scales)
        first = solution.trajectory.intervals[0].state
        state = np.concatenate([first.q[0], first.v[0]])
        deviation = period_map.deviation(solution)
        change = deviation - run.period_map.deviation(run.solution)
        return (state - run.state) / step, change / step


def _failure_reason(error: Exception) -> str:
    return re.sub("^(periodic|frequency_response): ", "", str(error)).rstrip(".")


def _orient_curve(point: CurvePoint) -> CurvePoint:
    """Return the point with the tangent of the curve, oriented along the curve.

    The first point has no orientation yet; its tangent follows the preliminary direction.
    """
    matrix = point.jacobian
    tangent = la.svd(matrix)[2][-1]
    orientation = float(np.linalg.slogdet(np.vstack([matrix, tangent]))[0])
    if point.orientation:
        tangent = tangent * (point.orientation * orientation)
    elif tangent @ point.reduce(point.direction) < 0.0:
        tangent, orientation = -tangent, -orientation
    state_direction = point.run.basis @ tangent[:-1] + point.shift * tangent[-1]
    direction = np.append(state_direction, tangent[-1])
    direction /= point.length(direction)
    return replace(point, direction=direction, orientation=point.orientation or orientation)
