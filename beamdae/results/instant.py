"""One moment of a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamdae.equations.assembly.configurations import Configuration
from beamdae.equations.formulations.first_order import State
from beamdae.errors import BeamdaeError, require_finite
from beamdae.results.trajectory import Trajectory

Array = np.ndarray


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
