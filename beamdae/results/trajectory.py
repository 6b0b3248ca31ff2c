"""The steps an integrator took, and what lies between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from beamdae.equations.formulations import State

Array = np.ndarray


@dataclass(frozen=True)
class Interval:
    """Accepted steps between two breakpoints.

    Attributes
    ----------
    t
        Times (k,) of the steps, ascending.
    state
        State rows (k, .) at these times.
    branch
        A time inside the interval; laws choose their piece by it.
    """

    t: Array
    state: State
    branch: float

    @property
    def times(self) -> Array:
        """(t, branch) rows for compiled functions."""
        return _with_branch(self.t, self.branch)

    def at(self, t: Array) -> State:
        """State at times inside the interval.

        Quintic Hermite interpolation of (q, v, a), order 6 in q; cubic spline of lam.
        """
        if len(self.t) == 1:
            return State(*(np.repeat(x[:1], len(t), axis=0) for x in self.state))
        i = np.clip(np.searchsorted(self.t, t, side="left") - 1, 0, len(self.t) - 2)
        h = (self.t[i + 1] - self.t[i])[:, None]
        x = (t[:, None] - self.t[i][:, None]) / h
        q, v, a, lam = self.state
        ends = (q[i], h * v[i], h**2 * a[i], h**2 * a[i + 1], h * v[i + 1], q[i + 1])
        position, velocity, acceleration = (
            sum(np.polyval(np.polyder(c, k), x) * e for c, e in zip(_QUINTIC, ends, strict=True))
            for k in range(3)
        )
        return State(position, velocity / h, acceleration / h**2, interpolate(self.t, lam, t))


# Quintic Hermite polynomials of (q0, v0, a0, a1, v1, q1) on [0, 1], highest power first.
_QUINTIC = (
    (-6.0, 15.0, -10.0, 0.0, 0.0, 1.0),
    (-3.0, 8.0, -6.0, 0.0, 1.0, 0.0),
    (-0.5, 1.5, -1.5, 0.5, 0.0, 0.0),
    (0.5, -1.0, 0.5, 0.0, 0.0, 0.0),
    (-3.0, 7.0, -4.0, 0.0, 0.0, 0.0),
    (6.0, -15.0, 10.0, 0.0, 0.0, 0.0),
)


def interpolate(t: Array, values: Array, at: Array) -> Array:
    """Cubic spline through rows of values; linear where there are fewer than four."""
    if len(t) >= 4:
        return CubicSpline(t, values)(at)
    columns = [np.interp(at, t, column) for column in values.T]
    return np.stack(columns, axis=-1) if columns else np.zeros((len(at), 0))


def accumulate(t: Array, rates: Array) -> Array:
    """Integral of rows of rates from t[0] on, at each t: of a cubic spline, or trapezoids."""
    if len(t) >= 4:
        return CubicSpline(t, rates).antiderivative()(t)
    steps = 0.5 * np.diff(t)[:, None] * (rates[1:] + rates[:-1])
    return np.concatenate([np.zeros((1, rates.shape[1])), np.cumsum(steps, axis=0)])


def _with_branch(t: Array, branch: float | Array) -> Array:
    return np.stack([t, np.broadcast_to(branch, np.shape(t))], axis=-1)


@dataclass(frozen=True)
class Trajectory:
    """All accepted steps of a run."""

    intervals: tuple[Interval, ...]

    @property
    def end(self) -> float:
        """Last time reached."""
        return float(self.intervals[-1].t[-1])

    @property
    def steps(self) -> int:
        """Number of accepted steps."""
        return sum(len(s.t) - 1 for s in self.intervals)

    def which(self, times: Array) -> Array:
        """Index of the interval of each time; a breakpoint belongs to what came before it."""
        starts = np.array([s.t[0] for s in self.intervals])
        return np.clip(np.searchsorted(starts, times, side="left") - 1, 0, None)

    def at(self, times: Array) -> tuple[Array, State]:
        """(t, branch) rows and states at ascending times within the run."""
        which = self.which(times)
        branches = np.array([s.branch for s in self.intervals])[which]
        parts = [s.at(times[which == k]) for k, s in enumerate(self.intervals)]
        state = State(*(np.concatenate(x) for x in zip(*parts, strict=True)))
        return _with_branch(times, branches), state
