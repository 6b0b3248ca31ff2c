"""The books of a run: energies, works, and how well it kept its promises."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from beamdae.equations import measures
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_TINY = np.finfo(float).tiny
# Energies below are those of rounding: of forces over the size of the mechanism, and of energies.
_BY_FORCES, _BY_ENERGIES = 1e-8, 1e-11


@dataclass(frozen=True)
class Quality:
    """How well a run keeps its promises, over all its steps.

    Attributes
    ----------
    max_residual
        Largest |F + G^T lam| relative to the largest constraint, applied or elastic force.
    max_position_drift, max_velocity_drift
        Largest |g| [m or rad] and |g_dot| [m/s or rad/s].
    energy_imbalance
        Largest |energy - work of loads - work of drivers + dissipated - start| relative to the
        largest energy turned over; at rest to 1e-8 of the forces over the size of the mechanism.
    """

    max_residual: float
    max_position_drift: float
    max_velocity_drift: float
    energy_imbalance: float


class Imbalance(NamedTuple):
    """What adds up to nothing in a perfect run, over all steps.

    Attributes
    ----------
    off
        By how much it does not.
    scale
        What that is small against: the energy turned over, or the largest force.
    largest
        The largest of the terms.
    """

    off: float
    scale: float
    largest: float

    @property
    def share(self) -> float:
        """How much it is off by, relative to its scale."""
        return self.off / max(self.scale, _TINY)


@dataclass(frozen=True, eq=False)
class EnergyLedger:
    """Energies and works over all steps of a run.

    Attributes
    ----------
    length
        Size of the mechanism [m].
    energies, powers, norms
        By interval: rows at its nodes, see `measures.balance`.
    works
        By interval: the works until each of its steps [J].
    """

    trajectory: Trajectory
    length: float
    energies: tuple[Array, ...]
    powers: tuple[Array, ...]
    norms: tuple[Array, ...]
    works: tuple[Array, ...]

    @classmethod
    def of(cls, equations: EquationsOfMotion, trajectory: Trajectory) -> EnergyLedger:
        """Keep the books of a run."""
        keepers: dict[int, measures.BalanceRows] = {}
        rows: list[tuple[Array, ...]] = []
        works: list[Array] = []
        work, before = np.zeros(3), None
        for interval in trajectory.intervals:
            active, state = interval.configuration, interval.rows
            own = equations if active is None else active.equations
            if active is not None:
                state = state._replace(lam=active.select_multipliers(state.lam))
            if id(own) not in keepers:
                keepers[id(own)] = measures.balance_rows(own)
            function = keepers[id(own)]
            values = np.split(function(interval.times, *state), [3, 6], axis=1)
            energies, powers, norms = map(np.ascontiguousarray, values)
            if rows:
                jump = energies[0] - rows[-1][0][-1]
                if active is before:
                    # A law whose rate jumps at a breakpoint changes the velocities at once.
                    work = work + np.array([0.0, jump[0], 0.0])
                else:
                    # So do events: impacts, and joints that are switched on; springs that are
                    # switched off take along what they have stored.
                    work = work - np.array([0.0, 0.0, jump.sum()])
            before = active
            rows.append((energies, powers, norms))
            works.append(work + interval.sums(powers))
            work = works[-1][-1]
        all_energies, all_powers, all_norms = zip(*rows, strict=True)
        books = (all_energies, all_powers, all_norms, tuple(works))
        return cls(trajectory, equations.length, *books)

    def at(self, times: Array) -> Array:
        """Energies, works and what the books are off by [J] at ascending times of the run.

        Columns as in `measures.LEDGER_COLUMNS`.
        """
        which = self.trajectory.which(times)
        books = np.concatenate(
            [self._books(k, times[which == k]) for k in range(len(self.trajectory.intervals))]
        )
        start = np.append(self.energies[0][0], np.zeros(3))
        return np.column_stack([books, _imbalance(books, start)])

    def _books(self, k: int, times: Array) -> Array:
        """Energies and works at times inside an interval, (3 + 3) columns.

        Energies and powers lie on the polynomials of the dense output.
        """
        interval = self.trajectory.intervals[k]
        works = interval.integrals(self.powers[k], times, self.works[k])
        return np.hstack([interval.smooth(self.energies[k], times), works])

    @cached_property
    def energy(self) -> Imbalance:
        """Energy - work of loads - work of drivers + dissipated - start, at all steps [J]."""
        books = np.hstack([self._at_steps(self.energies), np.concatenate(self.works)])
        turnover = max(
            np.max(books[:, :2].sum(axis=1)), np.max(np.abs(books[:, 3:])), np.ptp(books[:, 2])
        )
        off, largest = (float(np.max(np.abs(x))) for x in (_imbalance(books, books[0]), books))
        rounding = _BY_FORCES * self.force.scale * self.length + _BY_ENERGIES * largest
        return Imbalance(off, max(float(turnover), rounding), largest)

    @cached_property
    def _norms(self) -> Array:
        """Norms at all steps, see `measures.balance`."""
        return self._at_steps(self.norms)

    def _at_steps(self, values: tuple[Array, ...]) -> Array:
        """Of values at the nodes those at the steps."""
        intervals = self.trajectory.intervals
        return np.concatenate([x[:: i.per_step] for x, i in zip(values, intervals, strict=True)])

    @property
    def force(self) -> Imbalance:
        """F + G^T lam, beside the largest constraint, applied or elastic force, at all steps."""
        residual, reaction, force, _, _ = map(float, np.max(self._norms, axis=0))
        scale = max(reaction, force)
        return Imbalance(residual, scale, scale)

    def time_off(self, residual: float) -> float:
        """Share of the run over which F + G^T lam is larger than `residual`, or no number."""
        lasting = [np.diff(i.t, prepend=i.t[0]) for i in self.trajectory.intervals]
        off = ~(self._norms[:, 0] <= residual)
        duration = self.trajectory.end - self.trajectory.intervals[0].t[0]
        return float(np.concatenate(lasting) @ off) / max(duration, _TINY)

    @property
    def quality(self) -> Quality:
        """Largest residual, drift and energy imbalance."""
        position, velocity = map(float, np.max(self._norms[:, 3:], axis=0))
        return Quality(self.force.share, position, velocity, self.energy.share)


def _imbalance(books: Array, start: Array) -> Array:
    signs = np.array([1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
    return (books[:, :6] - start[:6]) @ signs
