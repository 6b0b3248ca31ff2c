"""Shooting: Newton's method on the state that a period carries to itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from beamdae.analysis.periodic.monodromy import VariationalEquations
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError
from beamdae.integrators import Integrator
from beamdae.integrators.amplitudes import Amplitudes
from beamdae.integrators.redundant_constraints import remove_redundant
from beamdae.results.solution import Solution

Array = np.ndarray

_ROWS = 201
_TURN = 2.0 * np.pi
# Over the largest force, and over the size of the mechanism or a radian: what does not come back to
# it after a period does not repeat; it is looked at so many times.
_REPEATS, _LOOKED_AT = 1e-6, 11


class IncompleteRunError(BeamdaeError):
    """A run that did not reach the end of the periods, `solution`."""

    def __init__(self, what: str, solution: Solution) -> None:
        super().__init__(f"periodic: {what} was not finished, {solution.status.sentence}.")
        self.solution = solution


@dataclass(frozen=True)
class PeriodMap:
    """One period of a mechanism, from any state on.

    Attributes
    ----------
    equations
        Without redundant constraints.
    integrator
        What integrates them.
    begin, period
        Where periods begin, and how long they are [s].
    """

    equations: EquationsOfMotion
    integrator: Integrator
    begin: float
    period: float

    @classmethod
    def of(
        cls, equations: EquationsOfMotion, integrator: Integrator, begin: float, period: float
    ) -> PeriodMap:
        """Without constraints that are redundant."""
        by = remove_redundant(equations, begin)
        own = equations if by is None else by.equations
        return cls(own, integrator, begin, period)

    def run(self, q: Array, v: Array, scales: Array | None = None, periods: int = 1) -> Solution:
        """A run over so many periods; `scales` are how far the coordinates move, if it is known.

        Raises
        ------
        UnfinishedError
            If it does not reach their end.
        """
        equations = replace(self.equations, q0=q, v0=v, scales=scales)
        times = self.begin + self.period * np.linspace(0.0, periods, periods * (_ROWS - 1) + 1)
        solution = self.integrator.integrate(equations, times)
        if not solution.status.success or solution.trajectory.end < times[-1]:
            what = "the run over a period" if periods == 1 else "the run to settle"
            raise IncompleteRunError(what, solution)
        return solution

    def consistent(self, q: Array, v: Array) -> tuple[Array, Array]:
        """The state nearest to it that the joints allow at the beginning of a period."""
        inner = [b for b in self.equations.breakpoints if b > self.begin]
        time = np.array([self.begin, 0.5 * (self.begin + min([self.begin + 1.0, *inner]))])
        found = ConsistencySolver(self.equations).state(time, q, v)
        return found.q, found.v

    def require_repeating(self, solution: Solution) -> None:
        """Refuse loads and drivers that do not come back after a period.

        Raises
        ------
        BeamdaeError
            Naming the coordinate or the joint.
        """
        e = self.equations
        form = formulate_first_order(e, "ggl")
        interval = solution.trajectory.intervals[0]
        times = np.linspace(interval.t[0], interval.t[-1], _LOOKED_AT + 2)[1:-1]
        state = interval.at(times)
        later = np.zeros(form.size)
        later[: e.n] = self.turns(solution)
        off, forces = np.zeros((_LOOKED_AT, form.size)), 0.0
        for k, t in enumerate(times.tolist()):
            y, yp = form.pack(State(*(x[k] for x in state)))
            now, then = np.array([t, interval.branch]), np.full(2, t + self.period)
            off[k] = np.abs(form.residual(then, y + later, yp) - form.residual(now, y, yp))
            still = form.residual(now, y, np.zeros_like(yp))
            forces = max(forces, float(np.max(np.abs(still[e.n : 2 * e.n]))))
        sizes = np.full(form.size, min(1.0, e.length))
        sizes[e.n : 2 * e.n] = forces
        row, worst = map(int, np.unravel_index(np.argmax(off - _REPEATS * sizes), off.shape))
        if off[row, worst] > _REPEATS * sizes[worst]:
            # Forces are the rows of velocities.
            name = form.names[worst].removeprefix("velocity of ")
            raise BeamdaeError(
                f"{name}: what acts on it at t = {times[row]:.6g} s is not the same a period of "
                f"{self.period:g} s later, give the period of loads and drivers."
            )

    def turns(self, solution: Solution) -> Array:
        """Whole turns that angles make in a period, (n,)."""
        angles = np.array([c.unit == "rad" for c in self.equations.coordinates])
        last = solution.trajectory.intervals[-1].state.q[-1]
        first = solution.trajectory.intervals[0].state.q[0]
        return np.where(angles, _TURN * np.round((last - first) / _TURN), 0.0)

    def missed(self, solution: Solution) -> Array:
        """By how much a period misses the state it began with, (2 n,)."""
        first, last = (
            np.concatenate([x.q[k], x.v[k]])
            for x, k in (
                (solution.trajectory.intervals[0].state, 0),
                (solution.trajectory.intervals[-1].state, -1),
            )
        )
        missed = last - first
        missed[: self.equations.n] -= self.turns(solution)
        return missed

    def scales(self, solution: Solution) -> Array:
        """How far coordinates move in a run; of turning ones, no more than a radian."""
        found = Amplitudes.from_trajectory(solution.equations, solution.trajectory).scales
        return np.minimum(found, self.equations.position_scales)

    def state_scales(self, scales: Array) -> Array:
        """The same of (q, v), (2 n,)."""
        return np.concatenate([scales, scales * (_TURN / self.period)])


class ShootingResult(NamedTuple):
    """A period that was run, and what becomes of its disturbances.

    Attributes
    ----------
    solution
        The period.
    free
        Disturbances of its start that the joints allow, (2 n, k), orthonormal over `scales`.
    scales
        Natural sizes of (q, v), (2 n,).
    carried
        What becomes of them, in terms of `free` (k, k): the monodromy matrix.
    missed
        By how much it misses its start, in terms of `free` (k,).
    off
        The largest of it over natural sizes.
    """

    solution: Solution
    free: Array
    scales: Array
    carried: Array
    missed: Array
    off: float

    @classmethod
    def of(cls, flow: PeriodMap, q: Array, v: Array) -> ShootingResult:
        """Run a period from a state on; see `PeriodMap.run`."""
        solution = flow.run(q, v)
        sizes = flow.state_scales(flow.scales(solution))
        linear = VariationalEquations(flow.equations)
        free = linear.free_motions(solution.trajectory, sizes)
        into = (free / sizes[:, None] ** 2).T
        missed = flow.missed(solution)
        carried = into @ linear.carried(solution.trajectory, free)
        return cls(
            solution, free, sizes, carried, into @ missed, float(np.max(np.abs(missed / sizes)))
        )

    def moved(self, by: Array) -> tuple[Array, Array]:
        """Its start, moved by so much of the free motions, before joints are closed."""
        first = self.solution.trajectory.intervals[0].state
        n = first.q.shape[1]
        change = self.free @ by
        return first.q[0] + change[:n], first.v[0] + change[n:]
