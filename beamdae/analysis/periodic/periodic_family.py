"""Pseudo arc length continuation of periodic motions: one point of a curve after the other."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from beamdae.analysis.periodic.periodic import converged, equations_of, settled
from beamdae.analysis.periodic.shooting import Flow, Shot, UnfinishedError
from beamdae.errors import BeamdaeError, format_exception, require_positive
from beamdae.integrators import Integrator
from beamdae.model_functions import Model

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
class Traced:
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

    shot: Shot
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
class Curve:
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

    def _flow(self, value: float) -> Flow:
        """One of the mechanisms."""
        try:
            period = self.period(value)
        except Exception as problem:
            raise BeamdaeError(
                f"frequency_response: period must be a function of {self.parameter}, it failed, "
                f"{format_exception(problem)}."
            ) from problem
        period = require_positive("frequency_response", "period", period)
        equations = equations_of("frequency_response", self.model(**{self.parameter: value}))
        return Flow.of(equations, self.integrator, self.begin, period)

    def first(self, settle: int) -> tuple[Traced | None, str]:
        """The motion at the beginning of the range; None if there is none, and why."""
        value = self.ends[0]
        flow = self._flow(value)
        try:
            shot, iterations = converged(flow, *settled(flow, settle), self.tolerance)
            if shot.off > self.tolerance:
                return None, (
                    f"no periodic motion was found at {self.told(value)}; give the model another "
                    "start, or settle= more periods"
                )
            ahead = np.append(np.zeros(len(shot.scales)), 1.0)
            begun = Traced(shot, value, flow.period, ahead, iterations=iterations)
            return _directed(begun, self._by_parameter(begun)), ""
        except UnfinishedError as problem:
            return None, f"{self.told(value)}: {_reason(problem)}"

    def after(self, point: Traced, size: float) -> tuple[Traced | None, str]:
        """The next point of the curve, so far away; None if it is not found, and why."""
        value = point.value + size * point.direction[-1] * self._range
        state = point.state + size * point.direction[:-1]
        by_parameter: Array | None = None
        try:
            for iteration in range(_MOST_ITERATIONS + 1):
                flow = self._flow(value)
                n = flow.equations.n
                shot = Shot.of(flow, *flow.consistent(state[:n], state[n:]))
                before = point.direction, point.orientation
                now = Traced(shot, value, flow.period, *before, iteration)
                if shot.off <= self.tolerance:
                    found = _directed(now, self._by_parameter(now))
                    return (found, "") if _follows(point, found) else (None, _SHARP)
                if by_parameter is None:
                    by_parameter = self._by_parameter(now)
                change = self._correction(now, by_parameter)
                # No more than a part of the motion as a whole, or of the range.
                change /= max(1.0, float(np.max(np.abs(change))) / _MOST_CHANGED)
                state = np.concatenate(shot.moved(change[:-1]))
                value += change[-1] * self._range
        except (BeamdaeError, la.LinAlgError) as problem:
            return None, _reason(problem)
        return None, _SLOW

    def _correction(self, now: Traced, by_parameter: Array) -> Array:
        """Newton's step across the direction of the curve: in free motions, and the parameter."""
        shot, along = now.shot, _in_free(now.shot, now.direction)
        matrix = _augmented(shot, by_parameter)
        return np.linalg.solve(np.vstack([matrix, along]), np.append(-shot.missed, 0.0))

    def _by_parameter(self, now: Traced) -> Array:
        """What the period misses, differentiated by the parameter over its range."""
        shot, flow = now.shot, self._flow(now.value + _DIFFERENCE * self._range)
        n = flow.equations.n
        solution = flow.run(*flow.consistent(now.state[:n], now.state[n:]), shot.scales[:n])
        missed = (shot.free / shot.scales[:, None] ** 2).T @ flow.missed(solution)
        return (missed - shot.missed) / _DIFFERENCE


def _reason(problem: Exception) -> str:
    return re.sub("^(periodic|frequency_response): ", "", str(problem)).rstrip(".")


def _directed(now: Traced, by_parameter: Array) -> Traced:
    """The point with the direction of the curve there, in its orientation.

    Of the first point, which has none, the direction is that of its own.
    """
    shot = now.shot
    matrix = _augmented(shot, by_parameter)
    along = la.svd(matrix)[2][-1]
    orientation = float(np.linalg.slogdet(np.vstack([matrix, along]))[0])
    if now.orientation:
        along = along * (now.orientation * orientation)
    elif along @ _in_free(shot, now.direction) < 0.0:
        along, orientation = -along, -orientation
    direction = np.append(shot.free @ along[:-1], along[-1])
    return replace(now, direction=direction, orientation=now.orientation or orientation)


def _follows(point: Traced, after: Traced) -> bool:
    """Whether the curve goes on about in the direction it had."""
    ways = [_in_free(after.shot, x.direction) for x in (point, after)]
    cosine = ways[0] @ ways[1] / np.prod(np.linalg.norm(ways, axis=1))
    return bool(cosine >= _TURNED)


def _augmented(shot: Shot, by_parameter: Array) -> Array:
    """What the period misses, differentiated by free motions and the parameter, (k, k + 1)."""
    return np.column_stack([shot.carried - np.eye(len(shot.missed)), by_parameter])


def _in_free(shot: Shot, direction: Array) -> Array:
    """A direction in terms of the free motions of a shot, and of the parameter."""
    own = (shot.free / shot.scales[:, None] ** 2).T @ direction[:-1]
    return np.append(own, direction[-1])
