"""Check, before any run, that the time laws of loads and drivers repeat after a period."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from beamdae.analysis.periodic.shooting import COMPARED_FRACTIONS, FULL_TURN, find_nearby_root
from beamdae.beams.beam_loads import DistributedForce
from beamdae.errors import BeamdaeError
from beamdae.parts.forces.loads import Force, Moment
from beamdae.parts.joints.drivers import DrivenJoint, Driver
from beamdae.parts.laws import Law
from beamdae.parts.mechanism import Mechanism
from beamdae.symbolic.signals import find_signals
from beamdae.symbolic.statements import SX

# Smaller changes, relative to the largest value, or to 1 rad, are left to the check of the forces
# and constraints along the first run.
_MAX_CHANGE = 1e-3


class _Mismatch(NamedTuple):
    """Largest change of a law after a period.

    Attributes
    ----------
    change
        Change relative to the size of the law.
    name
        Name of the part.
    time
        Time at which it occurs [s].
    difference
        Change, as text.
    periods
        Period close to this one after which the law repeats [s]; empty if unknown.
    full_turn
        Time of a full turn of a driver [s]; None for other laws.
    """

    change: float
    name: str
    time: float
    difference: str
    periods: list[float]
    full_turn: float | None


def require_repeating_laws(mechanism: Mechanism | None, begin: float, period: float) -> None:
    """Reject laws that do not repeat after a period, before the first run, which may take minutes.

    Parameters
    ----------
    mechanism
        The mechanism; None if the model has no parts.
    begin, period
        Start and duration of the period [s].

    Raises
    ------
    BeamdaeError
        If the law of a force, moment, distributed force or driver changes; the message names the
        part, and the period of all laws if it is within 5 % of this one or that of a full turn.
    """
    if mechanism is None:
        return
    mismatch = max(_find_mismatches(mechanism, begin, period), default=None)
    if mismatch is None:
        return

    def repeats(duration: float) -> bool:
        return not any(_find_mismatches(mechanism, begin, duration))

    turn = mismatch.full_turn
    advice = "".join(f", {x:.9g} s" for x in mismatch.periods if repeats(x))
    if not advice and turn is not None and repeats(turn):
        advice = f": a full turn takes {turn:.9g} s, use a multiple of it"
    raise BeamdaeError(
        f"{mismatch.name}: loads or drivers at t = {mismatch.time:.6g} s differ by "
        f"{mismatch.difference} and do not repeat after the period of {period:g} s; set period to "
        f"the period of the loads and drivers{advice}."
    )


def _find_mismatches(mechanism: Mechanism, begin: float, period: float) -> Iterator[_Mismatch]:
    times = begin + period * COMPARED_FRACTIONS
    for name, part in mechanism.parts.items():
        is_load = isinstance(part, (Force, Moment, DistributedForce))
        if not (is_load or isinstance(part, DrivenJoint)):
            continue
        for law in part.laws:
            if find_signals(law(SX.zeros(2))):
                continue  # depends on states, sensors or inputs
            is_angle = isinstance(part, Driver)
            change_after = _change_of_angle if is_angle else _change_of_value
            change = change_after(law, times, period)
            # A load may begin with a transient, which has decayed within the period.
            size = 1.0 if is_angle else _largest_value(law, begin + 2.0 * period)
            k = int(np.argmax(np.abs(change)))
            if abs(change[k]) > _MAX_CHANGE * size:
                time, largest = float(times[k]), abs(float(change[k]))
                roots = find_nearby_root(_scalar(change_after, law, time), period)
                difference, turn = f"{largest / size:.2g} of the largest value", None
                if is_angle:
                    difference = f"{largest:.3g} rad"
                    turn = period * FULL_TURN / abs(law.at(time + period) - law.at(time))
                yield _Mismatch(largest / size, name, time, difference, roots, turn)


def _change_of_value(law: Law, times: np.ndarray, period: float) -> np.ndarray:
    return np.array([law.at(t + period) - law.at(t) for t in times.tolist()])


def _change_of_angle(law: Law, times: np.ndarray, period: float) -> np.ndarray:
    """Return the changes without full turns, and zeros if the law vibrates about a rotation."""
    change = _change_of_value(law, times, period)
    is_uniform = np.ptp(change) <= _MAX_CHANGE
    half = _change_of_value(law, times[:1], 0.5 * period)
    if is_uniform and abs(2.0 * half[0] - change[0]) > _MAX_CHANGE:
        return np.zeros_like(change)
    return np.asarray(change - FULL_TURN * np.round(change / FULL_TURN))


def _largest_value(law: Law, end: float) -> float:
    times = np.concatenate([[0.0], end * COMPARED_FRACTIONS])
    return max(abs(law.at(t)) for t in times.tolist())


def _scalar(
    change_after: Callable[[Law, np.ndarray, float], np.ndarray], law: Law, time: float
) -> Callable[[float], float]:
    return lambda period: float(change_after(law, np.array([time]), period)[0])
