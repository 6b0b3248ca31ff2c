"""The books of a run: energies, works, and how well it kept its promises."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from beamdae.equations import measures
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.results.trajectory import Trajectory, accumulate, interpolate

Array = np.ndarray

_TINY = np.finfo(float).tiny


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
        largest energy turned over.
    """

    max_residual: float
    max_position_drift: float
    max_velocity_drift: float
    energy_imbalance: float


@dataclass(frozen=True, eq=False)
class EnergyLedger:
    """Energies and works over all steps of a run.

    Attributes
    ----------
    values
        By interval: rows of (3) energies, (3) powers, and norms, see `measures.balance`.
    works
        By interval: rows of the integrals of the powers from the start on [J].
    """

    trajectory: Trajectory
    values: tuple[Array, ...]
    works: tuple[Array, ...]

    @classmethod
    def of(cls, equations: EquationsOfMotion, trajectory: Trajectory) -> EnergyLedger:
        """Keep the books of a run."""
        function = measures.balance(equations)
        rows: list[Array] = []
        works: list[Array] = []
        start = np.zeros(3)
        for interval in trajectory.intervals:
            state = interval.state
            values = function(interval.times, *state[:3], equations.p, state.lam)
            if rows:
                # A law whose rate jumps at a breakpoint changes the velocities at once.
                start = start + np.array([0.0, values[0, 0] - rows[-1][-1, 0], 0.0])
            work = start + accumulate(interval.t, values[:, 3:6])
            start = work[-1]
            rows.append(values)
            works.append(work)
        return cls(trajectory, tuple(rows), tuple(works))

    def at(self, times: Array) -> pd.DataFrame:
        """Energies, works and what the books are off by [J] at ascending times of the run."""
        which = self.trajectory.which(times)
        # By interval: at a breakpoint powers jump, and a spline through the kink would ring.
        books = np.concatenate(
            [
                interpolate(interval.t, np.hstack([row[:, :3], work]), times[which == k])
                for k, (interval, row, work) in enumerate(
                    zip(self.trajectory.intervals, self.values, self.works, strict=True)
                )
            ]
        )
        start = np.append(self.values[0][0, :3], np.zeros(3))
        rows = np.column_stack([books, _imbalance(books, start)])
        return pd.DataFrame(rows, columns=list(measures.LEDGER_COLUMNS))

    @property
    def quality(self) -> Quality:
        """Largest residual, drift and energy imbalance."""
        values, work = np.concatenate(self.values), np.concatenate(self.works)
        residual, reaction, force, position, velocity = np.max(values[:, 6:], axis=0)
        books = np.hstack([values[:, :3], work])
        turnover = max(
            np.max(values[:, :2].sum(axis=1)), np.max(np.abs(work)), np.ptp(values[:, 2])
        )
        return Quality(
            float(residual / max(reaction, force, _TINY)),
            float(position),
            float(velocity),
            float(np.max(np.abs(_imbalance(books, books[0]))) / max(turnover, _TINY)),
        )


def _imbalance(books: Array, start: Array) -> Array:
    signs = np.array([1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
    return (books[:, :6] - start[:6]) @ signs
