"""Vibrations of beams as the cause of many short steps, for the status of runs that stop early."""

from __future__ import annotations

import numpy as np

from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import list_first
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_MAX_NAMES = 3
_STEPS = 4096  # at the end of the run, which are examined
# Steps that follow a vibration take 5 to 60 a period; those of BDF of order 2 take 220.
_MIN_TURNS = 20
# Periods in the rest of the run; with fewer, the vibration may be the motion of interest.
_MIN_PERIODS = 1000.0
# Smaller velocities than this share of the largest one of the same unit may be rounding errors.
_MIN_SHARE = 1e-2
# Share of the amplitude that is left in the second half; with less, steps will grow.
_MIN_REMAINING_SHARE = 0.5


def describe_followed_vibration(
    equations: EquationsOfMotion, trajectory: Trajectory, end: float, advice: str = ""
) -> str:
    """Return a sentence about beams whose lasting vibrations the last steps follow, or "".

    The run should have reached `end` [s]. The period is measured by the turning points of the
    velocities of the beam's nodes. `advice` follows the sentence.
    """
    last = trajectory.intervals[-1]
    t, v = last.t[-_STEPS:], last.state.v[-_STEPS:]
    if len(t) <= _MIN_TURNS:
        return ""
    periods = {}
    for beam in beams_of(equations.mechanism):
        part = equations.coordinates_of_part(beam.name)
        rows = slice(part.rigid.stop, part.rows.stop)
        units = np.array([x.unit for x in equations.coordinates[rows]])
        turns = _count_turns(v[:, rows], units)
        if turns >= _MIN_TURNS and (end - t[-1]) * turns > 2.0 * _MIN_PERIODS * (t[-1] - t[0]):
            periods[beam.name] = 2.0 * (t[-1] - t[0]) / turns
    if not periods:
        return ""
    names = list_first(sorted(periods), _MAX_NAMES)
    return (
        f"the steps follow vibrations of {names} with a period of {min(periods.values()):.2g} s, "
        f"which hardly decay; set damping= of the sections{advice}, or use start='equilibrium' if "
        "the start causes the vibrations"
    )


def _count_turns(v: Array, units: Array) -> int:
    """Return the largest number of turning points of lasting vibrations in the columns of `v`."""
    sizes = np.ptp(v, axis=0)
    early, late = (np.ptp(half, axis=0) for half in np.array_split(v, 2))
    counts = np.count_nonzero(np.diff(np.signbit(np.diff(v, axis=0)), axis=0), axis=0)
    largest = np.array([np.max(sizes[units == x]) for x in units])
    lasts = (sizes > _MIN_SHARE * largest) & (late > _MIN_REMAINING_SHARE * early)
    return max(counts[lasts].tolist(), default=0)
