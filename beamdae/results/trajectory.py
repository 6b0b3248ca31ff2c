"""The steps an integrator took, and what lies between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.equations.assembly.configurations import Configuration
from beamdae.equations.equations_of_motion import State
from beamdae.errors import BeamdaeError, require_finite

Array = np.ndarray

# Degrees of the polynomials through steps: of q and v, and of what may jump from step to step. With
# 4 rows between the steps of BDF up to order 5 are as good as the steps; a vibration from step to
# step grows to 2.2 times what it is there, with 3 to 1.6 times, with 5 to 3.1 times.
_SMOOTH, _ROUGH = 4, 3


@dataclass(frozen=True)
class Interval:
    """Accepted steps between two breakpoints, and the dense output between them.

    Between two steps values lie on the Lagrange polynomial through those at the end of the step
    and at the steps before it, as in a multistep method (Hairer, Norsett & Wanner, Solving ODEs I,
    1993, section III.6), of degree 4 for q and v and 3 for a and lam. Where a method has stages it
    is the one through the start of the step, the stages and the end, as in collocation (Hairer &
    Wanner, Solving ODEs II, 1996, section IV.8); there q is the integral of v, one degree higher,
    moved linearly onto q at the end. Derivatives are not used: h v and h^2 a hold h and h^2 times
    the amplitudes of modes too fast for the step, and what stiff sections make of them is out of
    all proportion to the forces at the steps.

    An interval begins with a state consistent with the laws, which fast modes have yet to answer:
    polynomials leave it out from the second node on.

    Attributes
    ----------
    nodes
        Times (k,) of the steps, and of the stages inside each if there are any, ascending.
    rows
        State rows (k, .) at these times.
    branch
        A time inside the interval; laws choose their piece by it.
    per_step
        Nodes a step, its end among them.
    configuration
        What was active of a mechanism whose parts are switched.
    """

    nodes: Array
    rows: State
    branch: float
    per_step: int = 1
    configuration: Configuration | None = None

    @cached_property
    def t(self) -> Array:
        """Times of the steps."""
        return self.nodes[:: self.per_step]

    @cached_property
    def state(self) -> State:
        """State rows at the steps."""
        return State(*(x[:: self.per_step] for x in self.rows))

    @property
    def times(self) -> Array:
        """(t, branch) rows of the nodes for compiled functions."""
        return _with_branch(self.nodes, self.branch)

    def at(self, t: Array) -> State:
        """State at times inside the interval."""
        q, v, a, lam = self.rows
        node = _before(self.nodes, t)
        smooth, rough = self._polynomials(t, node, _SMOOTH), self._polynomials(t, node, _ROUGH)
        position = smooth @ q if self.per_step == 1 else self._integrated(q, v, t)
        return State(position, smooth @ v, rough @ a, rough @ lam)

    def smooth(self, values: Array, t: Array) -> Array:
        """Values at times inside the interval of what is as smooth as q, from rows at the nodes."""
        return self._polynomials(t, _before(self.nodes, t), _SMOOTH) @ values

    def sums(self, rates: Array) -> Array:
        """Integrals from the start of the interval to its steps, of rows of rates at the nodes.

        Of the same polynomials, degree 3 through steps. Through the stages of Radau IIA that is its
        own quadrature, (16 - sqrt 6)/36, (16 + sqrt 6)/36, 1/9: the weight of the start is 0.
        """
        sums = np.zeros((len(self.t), rates.shape[1]))
        np.cumsum(self._since_step(rates, self.t[1:]), axis=0, out=sums[1:])
        return sums

    def integrals(self, rates: Array, t: Array, sums: Array) -> Array:
        """The same to times inside the interval, from the `sums` to its steps."""
        return sums[_before(self.t, t)] + self._since_step(rates, t)

    def _since_step(self, rates: Array, t: Array) -> Array:
        """Integrals from the start of the step around each time on."""
        step = _before(self.t, t)
        node, start = step * self.per_step, self.t[step]
        half = 0.5 * (t - start)
        found = np.zeros((len(t), rates.shape[1]))
        # Exact for the degree of the polynomials.
        degree = max(self.per_step, _ROUGH)
        for x, weight in zip(*np.polynomial.legendre.leggauss(degree // 2 + 1), strict=True):
            at = start + (1.0 + x) * half
            found += (weight * half)[:, None] * (self._polynomials(at, node, _ROUGH) @ rates)
        return found

    def _integrated(self, q: Array, v: Array, t: Array) -> Array:
        """Integrals of v from step to step, moved onto q."""
        step = _before(self.t, t)
        ends = q[:: self.per_step]
        missed = np.diff(ends, axis=0) - self._since_step(v, self.t[1:])
        x = ((t - self.t[step]) / (self.t[step + 1] - self.t[step]))[:, None]
        return ends[step] + self._since_step(v, t) + x * missed[step]

    def _polynomials(self, t: Array, node: Array, degree: int) -> sp.csr_array:
        """Lagrange polynomials at times past each `node`: their weights of rows at the nodes."""
        last = len(self.nodes) - 1
        degree = min(degree if self.per_step == 1 else self.per_step, last)
        end = (node // self.per_step + 1) * self.per_step
        least = np.minimum(node, 1)
        first = np.minimum(np.maximum(end - degree, least), last - degree)
        through = first + np.arange(degree + 1)[:, None]
        x = self.nodes[through]
        weights = np.ones_like(x)
        for k, j in np.ndindex(degree + 1, degree + 1):
            if j != k:
                weights[k] *= (t - x[j]) / (x[k] - x[j])
        ends = np.arange(len(t) + 1) * (degree + 1)
        shape = (len(t), len(self.nodes))
        return sp.csr_array((weights.T.ravel(), through.T.ravel(), ends), shape=shape)


def _before(nodes: Array, t: Array) -> Array:
    """Index of the node before each time; a node belongs to what came before it."""
    return np.clip(np.searchsorted(nodes, t, side="left") - 1, 0, max(len(nodes) - 2, 0))


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


class Instant(NamedTuple):
    """Where a run was at a time, see `Solution.at`.

    Attributes
    ----------
    time
        (t, branch): the time [s], and one inside the smooth interval it belongs to.
    state
        Coordinates, velocities, accelerations and multipliers.
    configuration
        What was active of a mechanism whose parts are switched.
    """

    time: Array
    state: State
    configuration: Configuration | None = None

    @property
    def t(self) -> float:
        """The time [s]."""
        return float(self.time[0])

    @classmethod
    def of(cls, trajectory: Trajectory, t: float) -> Instant:
        """Of a run at a time [s] within it."""
        first = float(trajectory.intervals[0].t[0])
        t = require_finite("Solution.at", "t", t)
        if not first <= t <= trajectory.end:
            raise BeamdaeError(
                f"Solution.at: t must lie within the run, {first:g} to {trajectory.end:g} s, "
                f"got {t:g}."
            )
        times = np.array([t])
        rows, state = trajectory.at(times)
        interval = trajectory.intervals[int(trajectory.which(times)[0])]
        return cls(rows[0], State(*(x[0] for x in state)), interval.configuration)
