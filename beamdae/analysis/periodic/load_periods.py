"""Check that loads and drivers repeat after a period, before any run."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.errors import BeamdaeError
from beamdae.parts.joints.drivers import Driver

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
        self._times = begin + period * _FRACTIONS

    def _at(self, times: Array) -> Array:
        return np.array([self._form.residual(np.full(2, t), *self._state).copy() for t in times])

    def _remove_turns(self, change: Array) -> Array:
        angles = 2 * self.equations.n + np.flatnonzero(self.equations.constraint_is_angle)
        change[:, angles] -= FULL_TURN * np.round(change[:, angles] / FULL_TURN)
        return change

    @cached_property
    def _sizes(self) -> Array:
        """Natural sizes: the range of forces, with transients since t = 0 that have decayed."""
        forces = slice(self.equations.n, 2 * self.equations.n)
        end = self.begin + 2.0 * self.period
        values = self._at(np.concatenate([self._times, end * np.append(0.0, _FRACTIONS)]))[
            :, forces
        ]
        ranges = np.ptp(values, axis=0) + _ROUNDING * np.max(np.abs(values), initial=0.0)
        sizes = np.full(self._form.size, min(1.0, self.equations.length))
        sizes[forces] = np.max(ranges, initial=0.0)
        return sizes

    def _find_mismatch(self, period: float) -> tuple[int, int, float]:
        """Return time and row of the largest change after a period, relative to its size."""
        times = self.begin + period * _FRACTIONS
        now = self._at(times)
        changes = np.abs(self._remove_turns(self._at(times + period) - now))
        # In a period that is far too short, varying loads do not change noticeably.
        later = np.abs(self._at(times[0] + _LATER_PERIODS * period) - now[0]).max(axis=0)
        is_constant = np.ptp(now, axis=0) <= _TOLERANCE * self._sizes
        changes[0] = np.where(is_constant, np.fmax(changes[0], later), changes[0])
        ratios = changes / np.maximum(self._sizes, np.finfo(float).tiny)
        k, row = map(int, np.unravel_index(np.argmax(ratios), ratios.shape))
        return k, row, float(ratios[k, row])

    def repeat_after(self, period: float) -> bool:
        """Return True if all loads repeat after a period."""
        return self._find_mismatch(period)[2] <= _TOLERANCE

    @property
    def are_constant(self) -> bool:
        """True if loads and drivers do not depend on time."""
        return all(self.repeat_after(x * self.period) for x in _TEST_PERIODS)

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
            act, and the period of a full turn.
        """
        e, (k, row, ratio) = self.equations, self._find_mismatch(self.period)
        if ratio <= _TOLERANCE:
            return
        name = self._form.names[row].removeprefix("velocity of ").removeprefix("correction of ")
        time, advice = float(self._times[k]), ""
        is_constraint, is_rate = row >= 2 * e.n, row >= 2 * e.n + e.m
        difference = f"{ratio:.2g} of the range of the loads"
        if is_constraint:
            unit = "rad" if np.tile(e.constraint_is_angle, 2)[row - 2 * e.n] else "m"
            difference = f"{ratio * self._sizes[row]:.3g} {unit}{'/s' * is_rate}"
            part = e.mechanism.parts.get(name.rpartition(".")[0]) if e.mechanism else None
            name = part.name if part else name
            drifts = self._at(self._times + self.period) - self._at(self._times)
            rate = abs(float(np.mean(drifts[:, row]))) / self.period
            if isinstance(part, Driver) and rate > _TOLERANCE / self.period:
                advice = (
                    f": a full turn takes {FULL_TURN / rate:.9g} s, use a multiple of it; for "
                    "small vibrations about the rotation, use bd.linearize(..., "
                    f"about=bd.rotation({rate:.6g})) and its frequency_response"
                )
        raise BeamdaeError(
            f"{name}: loads or drivers at t = {time:.6g} s differ by {difference} and do not "
            f"repeat after the period of {self.period:g} s; set period to the period of the loads "
            f"and drivers{advice}."
        )
