"""Check that loads and drivers repeat after a period, before any run."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import formulate_first_order
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
# Loads are constant if they are periodic with these fractions of a period.
_TEST_PERIODS = (0.29, 0.618)
# Loads that do not change within a period must not change later. They are compared after these
# numbers of periods; the last one is 1100 s for a period of 1e-9 s. Rounding of later times would
# change the phase of loads by more than 1e-4 periods.
_LATER_PERIODS = 2.0 ** np.arange(1.0, 41.0)
# Relative changes and multiples of a period after which loads do not repeat, to propose one after
# which they do; iterations, and relative step of the differences, with which it is located.
_PROPOSED_CHANGES, _PROPOSED_MULTIPLES = np.linspace(-0.2, 0.2, 801), np.arange(2.0, 7.0)
_PROPOSAL_ITERATIONS, _PROPOSAL_STEP = 12, 1e-7
_MAX_TRIALS = 10  # of near periods
_TINY = 1e-300  # avoids a division by zero


class Loads:
    """Residuals of the equations of motion with loads and drivers, for one state at all times.

    Parameters
    ----------
    equations
        The equations of motion.
    begin, period
        Start and duration of the period [s].
    """

    def __init__(self, equations: EquationsOfMotion, begin: float, period: float) -> None:
        e = self.equations = equations
        self.begin, self.period = begin, period
        self._form = formulate_first_order(e, "ggl")
        step = _DISPLACEMENT * e.position_scales * np.cos(np.arange(e.n) ** 2.0)
        state = State(e.q0 + step, e.v0 + step / period, np.zeros(e.n), np.zeros(e.m))
        self._state = self._form.pack(state)

    def _at(self, times: Array) -> Array:
        return np.array([self._form.residual(np.full(2, t), *self._state).copy() for t in times])

    @cached_property
    def _now(self) -> Array:
        return self._at(self.begin + self.period * _FRACTIONS)

    @cached_property
    def _sizes(self) -> Array:
        """Natural sizes: the range of forces, with transients since t = 0 that have decayed."""
        forces = slice(self.equations.n, 2 * self.equations.n)
        end = self.begin + 2.0 * self.period
        values = np.vstack([self._now, self._at(end * np.append(0.0, _FRACTIONS))])[:, forces]
        ranges = np.ptp(values, axis=0) + _ROUNDING * np.max(np.abs(values), initial=0.0)
        sizes = np.full(self._form.size, min(1.0, self.equations.length))
        sizes[forces] = np.max(ranges, initial=0.0)
        return np.maximum(sizes, np.finfo(float).tiny)

    def _changes_after(self, period: float) -> Array:
        """Return the changes after a period relative to their sizes, (times, rows)."""
        changes = self._at(self.begin + self.period * _FRACTIONS + period) - self._now
        angles = 2 * self.equations.n + np.flatnonzero(self.equations.constraint_is_angle)
        changes[:, angles] -= FULL_TURN * np.round(changes[:, angles] / FULL_TURN)
        return np.asarray(changes / self._sizes)

    @cached_property
    def _changes(self) -> Array:
        """Changes after the period, or later for loads that do not change within it."""
        changes, now = np.abs(self._changes_after(self.period)), self._now
        later = self._at(self.begin + self.period * (_FRACTIONS[0] + _LATER_PERIODS))
        is_constant = np.ptp(now, axis=0) <= _TOLERANCE * self._sizes
        later = np.abs(later - now[0]).max(axis=0) / self._sizes
        changes[0] = np.where(is_constant, np.fmax(changes[0], later), changes[0])
        return changes

    @property
    def repeat(self) -> bool:
        """True if loads and drivers repeat after the period."""
        return bool(np.max(self._changes) <= _TOLERANCE)

    @property
    def are_constant(self) -> bool:
        """True if loads and drivers do not depend on time."""
        changes = [self._changes_after(x * self.period) for x in _TEST_PERIODS]
        return self.repeat and bool(np.max(np.abs(changes)) <= _TOLERANCE)

    def require_constant(self) -> None:
        """Reject loads and drivers that depend on time."""
        if not self.are_constant:
            raise BeamdaeError(
                "periodic: loads or drivers depend on time; pass their period with period=."
            )

    def require_repeating(self) -> None:
        """Reject loads and drivers that differ one period later.

        Raises
        ------
        BeamdaeError
            If one is not periodic; the message names the driver or the coordinate on which loads
            act, and a period near the given one.
        """
        e, changes = self.equations, self._changes
        k, row = map(int, np.unravel_index(np.argmax(changes), changes.shape))
        ratio = float(changes[k, row])
        if ratio <= _TOLERANCE:
            return
        name = self._form.names[row].removeprefix("velocity of ").removeprefix("correction of ")
        difference = f"{ratio:.2g} of the range of the loads"
        if row >= 2 * e.n:
            unit = "rad" if np.tile(e.constraint_is_angle, 2)[row - 2 * e.n] else "m"
            rate = "/s" * (row >= 2 * e.n + e.m)
            difference = f"{ratio * self._sizes[row]:.3g} {unit}{rate}"
            part = e.mechanism.parts.get(name.rpartition(".")[0]) if e.mechanism else None
            name = part.name if part else name
        near = self._find_near()
        proposal = f", such as {near:.9g} s" if near else ""
        raise BeamdaeError(
            f"{name}: loads or drivers at t = {self.begin + self.period * _FRACTIONS[k]:.6g} s "
            f"differ by {difference} and do not repeat after the period of {self.period:g} s; set "
            f"period to the period of the loads and drivers{proposal}."
        )

    def _find_near(self) -> float | None:
        """Return the nearest period after which loads repeat, a multiple, or None."""
        periods = self.period * (1.0 + _PROPOSED_CHANGES)
        values = np.array([np.max(np.abs(self._changes_after(x))) for x in periods])
        (minima,) = np.nonzero((values[1:-1] < values[:-2]) & (values[1:-1] <= values[2:]))
        near = sorted(periods[1 + minima].tolist(), key=lambda x: abs(x - self.period))
        for period in (*near[:_MAX_TRIALS], *(self.period * _PROPOSED_MULTIPLES).tolist()):
            # Gauss-Newton, because changes are linear close to the period.
            for _ in range(_PROPOSAL_ITERATIONS):
                before, step = self._changes_after(period), _PROPOSAL_STEP * period
                slope = (self._changes_after(period + step) - before) / step
                period -= float(np.sum(slope * before) / max(np.sum(slope * slope), _TINY))
            # All loads repeat after no time at all.
            is_searched = period > periods[0]
            if is_searched and np.max(np.abs(self._changes_after(period))) <= _TOLERANCE:
                return period
        return None
