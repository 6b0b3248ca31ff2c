"""Check that loads and drivers repeat after a period, before any run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.state_evaluator import StateEvaluator, plan_motion
from beamdae.errors import BeamdaeError

Array = np.ndarray

FULL_TURN = 2.0 * np.pi
# Loads are periodic if, after a period, forces change by less than this fraction of their range,
# and constraints by less than this fraction of the size of the mechanism or of 1 rad. Both are
# compared at these fractions of a period. Multiples of the golden ratio keep harmonics from having
# the same phase at all of them, as the 12th has after each twelfth of a period.
_TOLERANCE = 1e-6
_FRACTIONS = np.sort(np.arange(1.0, 12.0) * (np.sqrt(1.25) - 0.5) % 1.0)
# Rounding errors of constant forces, relative to the range that they would need to be changes.
_ROUNDING = 1e-7
# Displacement and speed of the state for which they are compared, relative to the size of the
# mechanism and to one period: loads may be proportional to either.
_DISPLACEMENT = 1e-3
# Loads are constant if they are periodic with these fractions of a period, and repeat.
_TEST_PERIODS = (0.29, 0.618)
# Numbers of periods after which loads that do not change within a period are compared: later, the
# rounding of times would change their phase by more than 1e-4 periods.
_LATER_PERIODS = 2.0 ** np.arange(1.0, 41.0)


@dataclass(frozen=True)
class Loads:
    """Loads and drivers at all times, in the forces and constraints of one state.

    Attributes
    ----------
    equations
        The equations of motion.
    begin, period
        Start and duration of the period [s].
    """

    equations: EquationsOfMotion
    begin: float
    period: float

    @property
    def _times(self) -> Array:
        return self.begin + self.period * _FRACTIONS

    @cached_property
    def _evaluator(self) -> StateEvaluator:
        return StateEvaluator(self.equations)

    def _at(self, times: Array) -> Array:
        """Return the forces, the constraints and their rates (times, n + 2 m)."""
        e = self.equations
        step = _DISPLACEMENT * e.position_scales * np.cos(np.arange(e.n) ** 2.0)
        state, size = (e.q0 + step, e.v0 + step / self.period, None, None), e.n + 3 * e.m
        rows = (self._evaluator.evaluate(plan_motion, np.full(2, t), state, size) for t in times)
        return np.array([row[: e.n + 2 * e.m] for row in rows])

    @cached_property
    def _now(self) -> Array:
        return self._at(self._times)

    @cached_property
    def _sizes(self) -> Array:
        """Natural sizes: the range of all forces, and the size of the mechanism or 1 rad."""
        e, forces = self.equations, self._now[:, : self.equations.n]
        ranges = np.ptp(forces, axis=0) + _ROUNDING * np.max(np.abs(forces), initial=0.0)
        largest = np.full(e.n, np.max(ranges, initial=np.finfo(float).tiny))
        return np.append(largest, np.full(2 * e.m, min(1.0, e.length)))

    def _changes_after(self, period: float) -> Array:
        """Return the changes after a period relative to their sizes, (times, n + 2 m)."""
        changes = self._at(self._times + period) - self._now
        angles = self.equations.n + np.flatnonzero(self.equations.constraint_is_angle)
        changes[:, angles] -= FULL_TURN * np.round(changes[:, angles] / FULL_TURN)
        return np.abs(changes / self._sizes)

    @cached_property
    def _changes(self) -> Array:
        """Changes after the period, or later for loads that do not change within it."""
        changes, now = self._changes_after(self.period), self._now
        later = np.abs(self._at(self._times[0] + self.period * _LATER_PERIODS) - now[0])
        is_constant = np.ptp(now, axis=0) <= _TOLERANCE * self._sizes
        latest = np.fmax(changes[0], np.max(later, axis=0) / self._sizes)
        changes[0] = np.where(is_constant, latest, changes[0])
        return changes

    @property
    def repeat(self) -> bool:
        """True if loads and drivers repeat after the period."""
        return bool(np.max(self._changes) <= _TOLERANCE)

    @cached_property
    def varying(self) -> str:
        """Name of a driver, or a coordinate on which loads act, that depends on time; or ""."""
        others = (self._changes_after(x * self.period) for x in _TEST_PERIODS)
        largest = np.max(np.vstack([self._changes, *others]), axis=0)
        return self._name(int(np.argmax(largest))) if np.max(largest) > _TOLERANCE else ""

    def require_constant(self) -> None:
        """Reject loads and drivers that depend on time.

        Raises
        ------
        BeamdaeError
            If one does; the message names the driver or the coordinate on which loads act.
        """
        if self.varying:
            raise BeamdaeError(
                f"{self.varying}: loads or drivers depend on time; pass their period with period=."
            )

    def require_repeating(self) -> None:
        """Reject loads and drivers that differ one period later.

        Raises
        ------
        BeamdaeError
            If one is not periodic; the message names the driver or the coordinate on which loads
            act.
        """
        if self.repeat:
            return
        e, changes = self.equations, self._changes
        k, row = map(int, np.unravel_index(np.argmax(changes), changes.shape))
        difference = f"{changes[k, row]:.2g} times their range"
        if row >= e.n:
            unit = "rad" if np.tile(e.constraint_is_angle, 2)[row - e.n] else "m"
            rate = "/s" * (row >= e.n + e.m)
            difference = f"{changes[k, row] * self._sizes[row]:.3g} {unit}{rate}"
        raise BeamdaeError(
            f"{self._name(row)}: loads or drivers do not repeat after the period of "
            f"{self.period:g} s, they differ by {difference} at t = {self._times[k]:.6g} s; pass "
            "their period with period=, or t_start= from which on they repeat."
        )

    def _name(self, row: int) -> str:
        """Return the driver of a row, or the coordinate on which loads act."""
        e = self.equations
        if row < e.n:
            return e.q_names[row]
        name = e.lam_names[(row - e.n) % e.m]
        return name if e.mechanism is None else name.rpartition(".")[0]
