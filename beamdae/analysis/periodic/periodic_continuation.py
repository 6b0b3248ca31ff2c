"""Pseudo arc length continuation of periodic motions: one point of a curve after the other."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from beamdae.analysis.periodic.periodic_solution import (
    MOST_SETTLING,
    RTOL,
    TOLERANCE,
    build_periodic_equations,
    settle_motion,
    solve_shooting,
)
from beamdae.analysis.periodic.shooting import IncompleteRunError, PeriodMap, ShootingResult
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    format_exception,
    require_choice,
    require_count,
    require_finite,
    require_pair,
    require_positive,
    short_repr,
)
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.model_functions import Model
from beamdae.results.frequency_response import FrequencyResponse, ResponsePoint
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import floquet_multipliers

Array = np.ndarray

# Iterations of Newton's method, and the largest change in one.
_MOST_ITERATIONS, _MOST_CHANGED = 8, 0.3
# Step of differences by the parameter, over its range.
_DIFFERENCE = 1e-5
_SLOW = "Newton's method does not converge"
_SHARP = "the curve turns too sharply for the steps"
# Cosine of the angle by which it may turn in a step.
_TURNED = 0.8


@dataclass(frozen=True, eq=False)
class CurvePoint:
    """A periodic motion on the curve.

    Attributes
    ----------
    shot
        One period of it.
    value, period
        Of the parameter, and its period [s].
    direction
        Of the curve there: of (q, v), and of the parameter over its range.
    orientation
        Sign of the determinant that the derivatives of what a period misses, and the direction
        below them, have: all along a curve it is the same.
    iterations
        Of Newton's method.
    """

    shot: ShootingResult
    value: float
    period: float
    direction: Array
    orientation: float = 0.0
    iterations: int = 0

    @property
    def state(self) -> Array:
        """(q, v) at the start of the period."""
        first = self.shot.solution.trajectory.intervals[0].state
        return np.concatenate([first.q[0], first.v[0]])


@dataclass(frozen=True, eq=False)
class ResponseCurve:
    """The periodic motions of a family of mechanisms.

    Attributes
    ----------
    model, parameter
        The family, and what tells its members from each other.
    ends
        Where the curve begins, and the value at which it ends.
    period
        Period [s] of each member.
    integrator, begin, tolerance
        See `periodic`.
    """

    model: Model
    parameter: str
    ends: tuple[float, float]
    period: Callable[[float], float]
    integrator: Integrator
    begin: float
    tolerance: float

    def told(self, value: float) -> str:
        """A value of the parameter, in words."""
        return f"{self.parameter} = {value:.6g}"

    @property
    def _range(self) -> float:
        return self.ends[1] - self.ends[0]

    def _flow(self, value: float) -> PeriodMap:
        """One of the mechanisms."""
        try:
            period = self.period(value)
        except Exception as problem:
            raise BeamdaeError(
                f"frequency_response: period must be a function of {self.parameter}, it failed, "
                f"{format_exception(problem)}."
            ) from problem
        period = require_positive("frequency_response", "period", period)
        equations = build_periodic_equations(
            "frequency_response", self.model(**{self.parameter: value})
        )
        return PeriodMap.of(equations, self.integrator, self.begin, period)

    def first(self, settle: int) -> tuple[CurvePoint | None, str]:
        """The motion at the beginning of the range; None if there is none, and why."""
        value = self.ends[0]
        flow = self._flow(value)
        try:
            shot, iterations = solve_shooting(flow, *settle_motion(flow, settle), self.tolerance)
            if shot.off > self.tolerance:
                return None, (
                    f"no periodic motion was found at {self.told(value)}; give the model another "
                    "start, or settle= more periods"
                )
            ahead = np.append(np.zeros(len(shot.scales)), 1.0)
            begun = CurvePoint(shot, value, flow.period, ahead, iterations=iterations)
            return _orient_curve(begun, self._by_parameter(begun)), ""
        except IncompleteRunError as problem:
            return None, f"{self.told(value)}: {_failure_reason(problem)}"

    def after(self, point: CurvePoint, size: float) -> tuple[CurvePoint | None, str]:
        """The next point of the curve, so far away; None if it is not found, and why."""
        value = point.value + size * point.direction[-1] * self._range
        state = point.state + size * point.direction[:-1]
        by_parameter: Array | None = None
        try:
            for iteration in range(_MOST_ITERATIONS + 1):
                flow = self._flow(value)
                n = flow.equations.n
                shot = ShootingResult.of(flow, *flow.consistent(state[:n], state[n:]))
                before = point.direction, point.orientation
                now = CurvePoint(shot, value, flow.period, *before, iteration)
                if shot.off <= self.tolerance:
                    found = _orient_curve(now, self._by_parameter(now))
                    return (found, "") if _is_smooth(point, found) else (None, _SHARP)
                if by_parameter is None:
                    by_parameter = self._by_parameter(now)
                change = self._correction(now, by_parameter)
                # No more than a part of the motion as a whole, or of the range.
                change /= max(1.0, float(np.max(np.abs(change))) / _MOST_CHANGED)
                state = np.concatenate(shot.moved(change[:-1]))
                value += change[-1] * self._range
        except (BeamdaeError, la.LinAlgError) as problem:
            return None, _failure_reason(problem)
        return None, _SLOW

    def _correction(self, now: CurvePoint, by_parameter: Array) -> Array:
        """Newton's step across the direction of the curve: in free motions, and the parameter."""
        shot, along = now.shot, _reduce_direction(now.shot, now.direction)
        matrix = _extended_jacobian(shot, by_parameter)
        return np.linalg.solve(np.vstack([matrix, along]), np.append(-shot.missed, 0.0))

    def _by_parameter(self, now: CurvePoint) -> Array:
        """What the period misses, differentiated by the parameter over its range."""
        shot, flow = now.shot, self._flow(now.value + _DIFFERENCE * self._range)
        n = flow.equations.n
        solution = flow.run(*flow.consistent(now.state[:n], now.state[n:]), shot.scales[:n])
        missed = (shot.free / shot.scales[:, None] ** 2).T @ flow.missed(solution)
        return (missed - shot.missed) / _DIFFERENCE


def _failure_reason(problem: Exception) -> str:
    return re.sub("^(periodic|frequency_response): ", "", str(problem)).rstrip(".")


def _orient_curve(now: CurvePoint, by_parameter: Array) -> CurvePoint:
    """The point with the direction of the curve there, in its orientation.

    Of the first point, which has none, the direction is that of its own.
    """
    shot = now.shot
    matrix = _extended_jacobian(shot, by_parameter)
    along = la.svd(matrix)[2][-1]
    orientation = float(np.linalg.slogdet(np.vstack([matrix, along]))[0])
    if now.orientation:
        along = along * (now.orientation * orientation)
    elif along @ _reduce_direction(shot, now.direction) < 0.0:
        along, orientation = -along, -orientation
    direction = np.append(shot.free @ along[:-1], along[-1])
    return replace(now, direction=direction, orientation=now.orientation or orientation)


def _is_smooth(point: CurvePoint, after: CurvePoint) -> bool:
    """Whether the curve goes on about in the direction it had."""
    ways = [_reduce_direction(after.shot, x.direction) for x in (point, after)]
    cosine = ways[0] @ ways[1] / np.prod(np.linalg.norm(ways, axis=1))
    return bool(cosine >= _TURNED)


def _extended_jacobian(shot: ShootingResult, by_parameter: Array) -> Array:
    """What the period misses, differentiated by free motions and the parameter, (k, k + 1)."""
    return np.column_stack([shot.carried - np.eye(len(shot.missed)), by_parameter])


def _reduce_direction(shot: ShootingResult, direction: Array) -> Array:
    """A direction in terms of the free motions of a shot, and of the parameter."""
    own = (shot.free / shot.scales[:, None] ** 2).T @ direction[:-1]
    return np.append(own, direction[-1])


# Iterations of Newton's method up to which steps get longer, and from which on they get shorter; by
# how much, and how short they may be over the first.
_FEW, _MANY = 3, 5
_LONGER, _SHORTER, _LEAST_STEP = 1.5, 0.5, 1e-3


def frequency_response(
    model: Model,
    parameter: str,
    between: tuple[float, float],
    period: Callable[[float], float] | None = None,
    integrator: Integrator | None = None,
    step: float = 0.02,
    longest_step: float = 0.1,
    settle: int = 20,
    tolerance: float = TOLERANCE,
    most_points: int = 400,
    begin: float = 0.0,
) -> FrequencyResponse:
    """Follow the periodic motion of a model over the frequency of its loads, or another parameter.

    Pseudo arc length continuation (Keller 1977) of single shooting, see `periodic`: the curve goes
    on where the parameter turns around (folds), on to motions that are not stable.

    Parameters
    ----------
    model
        A model function; each motion is one of `model(**{parameter: value})`.
    parameter
        The name of one of its parameters, a number.
    between
        Where the curve begins, and the value at which it ends; also downwards.
    period
        Period [s] of the loads as a function of the parameter; default its reciprocal, that of a
        frequency in Hz.
    integrator
        Default Radau(1e-8).
    step, longest_step
        First and longest step of the curve, over the range of the parameter.
    settle
        Periods run before the first motion.
    tolerance
        By how much a period may miss its start, over how far coordinates move.
    most_points
        How many motions at most.
    begin
        Time [s] at which periods begin.

    Returns
    -------
    FrequencyResponse
        Also where the curve ends before its range does, or where no motion is found to begin with:
        `status` says why, and a warning.
    """
    name = "frequency_response"
    if not isinstance(model, Model):
        raise BeamdaeError(f"{name}: model must be a model function, got {short_repr(model)}.")
    first, last = require_pair(name, "between", between, "a pair of values of the parameter")
    ends = require_finite(name, "between", first), require_finite(name, "between", last)
    if ends[0] == ends[1]:
        raise BeamdaeError(
            f"{name}: between must be two values that differ, got {short_repr(between)}."
        )
    require_choice(name, "parameter", parameter, tuple(model.parameters))
    model.complete({parameter: ends[0]})
    method = Radau(RTOL) if integrator is None else integrator
    require_integrator(name, method)
    curve = ResponseCurve(
        model,
        parameter,
        ends,
        _default_period if period is None else period,
        method,
        require_finite(name, "begin", begin),
        require_positive(name, "tolerance", tolerance),
    )
    steps = (
        require_positive(name, "step", step),
        require_positive(name, "longest_step", longest_step),
    )
    settle = require_count(name, "settle", settle, 0, MOST_SETTLING)
    most = require_count(name, "most_points", most_points, least=2)
    points, status = _follow_curve(curve, settle, steps, most)
    if not status.success:
        warnings.warn(f"{name}: {status.sentence}.", BeamdaeWarning, stacklevel=2)
    return FrequencyResponse(parameter, points, status)


def _default_period(frequency: float) -> float:
    return 1.0 / frequency


def _follow_curve(
    curve: ResponseCurve, settle: int, steps: tuple[float, float], most: int
) -> tuple[tuple[ResponsePoint, ...], Status]:
    """The points, and how the curve ended."""
    size, (first, last) = steps[0], curve.ends
    way = 1.0 if last > first else -1.0
    point, why = curve.first(settle)
    if point is None:
        return (), Status("failed", why)
    found = [_response_point(point, way)]
    while len(found) < most:
        after, why = curve.after(point, size)
        if after is None:
            size *= _SHORTER
            if size < _LEAST_STEP * steps[0]:
                return tuple(found), Status("failed", f"{curve.told(point.value)}: {why}")
            continue
        point = after
        found.append(_response_point(point, way))
        if way * (point.value - last) >= 0.0:
            return tuple(found), Status("ok", "reached the end of the range")
        if way * (point.value - first) < 0.0:
            return tuple(found), Status("ok", "came back to where the range begins")
        if point.iterations <= _FEW:
            size = min(size * _LONGER, steps[1])
        elif point.iterations >= _MANY:
            size *= _SHORTER
    return tuple(found), Status("limited", f"{curve.told(point.value)}: {most} points were made")


def _response_point(point: CurvePoint, way: float) -> ResponsePoint:
    multipliers = floquet_multipliers(point.shot.carried)
    forward = way * point.direction[-1] > 0.0
    return ResponsePoint(point.value, point.period, point.shot.solution, multipliers, forward)
