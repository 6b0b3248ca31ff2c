"""Scouts: runs with a loose tolerance that go ahead, to see how far the parts move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from beamdae.integrators.amplitudes import Amplitudes
from beamdae.integrators.limits import Limits, Pace
from beamdae.integrators.run_plan import Route
from beamdae.results.outcome import OF_SCOUT, REACHED_END, Status
from beamdae.results.trajectory import Trajectory

# The tolerance of a scout, how often and how far it goes, in steps and in shares of the time there
# is, and what is much less motion than it was tolerant of.
SCOUTING_RTOL = 1e-2
WHOSE = f"{OF_SCOUT} with rtol = {SCOUTING_RTOL:g}"
_MOST_SCOUTS = 4
_MOST_SCOUTING_STEPS = 20_000
_SCOUTING_TIME = 0.25
_MUCH_LESS = 0.3
# A scout that did not go this share of the way has seen too little.
_LEAST_WAY = 0.2


class Scout(Protocol):
    """A run that goes ahead."""

    def through(self) -> tuple[Trajectory, Status]:
        """Go through."""

    def interrupted(self) -> tuple[Trajectory, Status]:
        """What was reached when the user would not wait."""


R = TypeVar("R", bound=Scout)


def scouted(
    route: Route, scout_on: Callable[[Route, Limits], R], of_run: Limits
) -> tuple[Route, R, Trajectory, Status]:
    """The route with the amplitudes that a scout sees, and its last run.

    It goes again as long as it sees much less motion than it was tolerant of. Progress hears of it,
    so that it may end it, but of no time: the run itself has not begun.
    """
    share = None if of_run.time_limit is None else _SCOUTING_TIME * of_run.time_limit
    start, progress = route.intervals[0][0], of_run.progress
    told = None if progress is None else lambda _: progress(start)
    run: R | None = None
    try:
        for _ in range(_MOST_SCOUTS):
            pace = Pace(route.intervals[-1][1])
            limits = Limits(told, share, _MOST_SCOUTING_STEPS, of_run.begin, pace)
            run = scout_on(route, limits)
            trajectory, status = run.through()
            stopped = status.success and status is not REACHED_END
            if not stopped and trajectory.end - start < _LEAST_WAY * route.duration:
                break
            seen = replace(route, amplitudes=Amplitudes.of(route.equations, trajectory))
            much_less = float(np.min(seen.scales / route.scales)) < _MUCH_LESS
            route = seen
            if not (much_less and status.success):
                break
    except KeyboardInterrupt:
        if run is None:
            raise
        trajectory, status = run.interrupted()
    assert run is not None
    return route, run, trajectory, status
