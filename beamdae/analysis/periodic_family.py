"""Pseudo arc length continuation of periodic motions: one point of a curve after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from beamdae.analysis.periodic import converged, equations_of, settled
from beamdae.analysis.shooting import Flow, Shot
from beamdae.errors import BeamdaeError, positive, told
from beamdae.integrators import Integrator
from beamdae.model_functions import Model

Array = np.ndarray

_MOST_ITERATIONS = 8
# Step of differences by the parameter, over its range.
_DIFFERENCE = 1e-5
_SLOW = "Newton's method does not converge"


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
    iterations
        Of Newton's method.
    """

    shot: Shot
    value: float
    period: float
    direction: Array
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
                f"{told(problem)}."
            ) from problem
        period = positive("frequency_response", "period", period)
        equations = equations_of(self.model(**{self.parameter: value}))
        return Flow.of(equations, self.integrator, self.begin, period)

    def first(self, settle: int) -> Traced:
        """The motion at the beginning of the range.

        Raises
        ------
        BeamdaeError
            If none is found.
        """
        value = self.ends[0]
        flow = self._flow(value)
        shot, iterations = converged(flow, *settled(flow, settle), self.tolerance)
        if shot.off > self.tolerance:
            raise BeamdaeError(
                f"frequency_response: no periodic motion was found at {self.told(value)}; give the "
                "model another start, or settle= more periods."
            )
        ahead = np.append(np.zeros(len(shot.scales)), 1.0)
        begun = Traced(shot, value, flow.period, ahead, iterations)
        return self._directed(begun, self._by_parameter(begun), ahead)

    def after(self, point: Traced, size: float) -> tuple[Traced | None, str]:
        """The next point of the curve, so far away; None if it is not found, and why."""
        value = point.value + size * point.direction[-1] * self._range
        state = point.state + size * point.direction[:-1]
        by_parameter: Array | None = None
        try:
            for iteration in range(_MOST_ITERATIONS + 1):
                flow = self._flow(value)
                n = flow.equations.n
                shot = Shot.of(flow, *flow.consistent(state[:n], state[n:]), None)
                now = Traced(shot, value, flow.period, point.direction, iteration)
                if by_parameter is None:
                    by_parameter = self._by_parameter(now)
                if shot.off <= self.tolerance:
                    return self._directed(now, by_parameter, point.direction), ""
                change = self._correction(now, by_parameter)
                # No more than what the motion is as a whole.
                change /= max(1.0, float(np.max(np.abs(change))))
                state = np.concatenate(shot.moved(change[:-1]))
                value += change[-1] * self._range
        except (BeamdaeError, la.LinAlgError) as problem:
            return None, str(problem).rstrip(".")
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
        if not solution.status.success:
            raise BeamdaeError(f"a run was not finished, {solution.status.sentence}.")
        missed = (shot.free / shot.scales[:, None] ** 2).T @ flow.missed(solution)
        return (missed - shot.missed) / _DIFFERENCE

    def _directed(self, now: Traced, by_parameter: Array, before: Array) -> Traced:
        """The point with the direction of the curve there, going on as `before`."""
        shot = now.shot
        along = la.svd(_augmented(shot, by_parameter))[2][-1]
        along *= np.sign(along @ _in_free(shot, before)) or 1.0
        direction = np.append(shot.free @ along[:-1], along[-1])
        return Traced(shot, now.value, now.period, direction, now.iterations)


def _augmented(shot: Shot, by_parameter: Array) -> Array:
    """What the period misses, differentiated by free motions and the parameter, (k, k + 1)."""
    return np.column_stack([shot.carried - np.eye(len(shot.missed)), by_parameter])


def _in_free(shot: Shot, direction: Array) -> Array:
    """A direction in terms of the free motions of a shot, and of the parameter."""
    own = (shot.free / shot.scales[:, None] ** 2).T @ direction[:-1]
    return np.append(own, direction[-1])
