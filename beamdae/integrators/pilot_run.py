"""Scouts: runs with a loose tolerance that go ahead, to see how far the parts move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from beamdae.integrators.amplitudes import Amplitudes
from beamdae.integrators.limits import Limits, StallDetector
from beamdae.integrators.run_plan import RunPlan
from beamdae.results.outcome import PILOT_RUN_SUFFIX, REACHED_END, Status
from beamdae.results.trajectory import Trajectory

# The tolerance of a scout, how often and how far it goes, in steps and in shares of the time there
# is, and what is much less motion than it was tolerant of.
PILOT_RTOL = 1e-2
PILOT_LABEL = f"{PILOT_RUN_SUFFIX} with rtol = {PILOT_RTOL:g}"
_MAX_PILOT_RUNS = 4
_MAX_PILOT_STEPS = 20_000
_PILOT_TIME_SHARE = 0.25
_MUCH_LESS_MOTION = 0.3
# A scout that did not go this share of the way has seen too little.
_MIN_PILOT_SHARE = 0.2


class PilotRun(Protocol):
    """A run that goes ahead."""

    def execute(self) -> tuple[Trajectory, Status]:
        """Go through."""

    def report_interrupt(self) -> tuple[Trajectory, Status]:
        """What was reached when the user would not wait."""


R = TypeVar("R", bound=PilotRun)


def run_pilot(
    plan: RunPlan, scout_on: Callable[[RunPlan, Limits], R], of_run: Limits
) -> tuple[RunPlan, R, Trajectory, Status]:
    """The route with the amplitudes that a scout sees, and its last run.

    It goes again as long as it sees much less motion than it was tolerant of. Progress hears of it,
    so that it may end it, but of no time: the run itself has not begun.
    """
    share = None if of_run.time_limit is None else _PILOT_TIME_SHARE * of_run.time_limit
    start, progress = plan.intervals[0][0], of_run.progress
    told = None if progress is None else lambda _: progress(start)
    run: R | None = None
    try:
        for _ in range(_MAX_PILOT_RUNS):
            pace = StallDetector(plan.intervals[-1][1])
            limits = Limits(told, share, _MAX_PILOT_STEPS, of_run.begin, pace)
            run = scout_on(plan, limits)
            trajectory, status = run.execute()
            stopped = status.success and status is not REACHED_END
            if not stopped and trajectory.end - start < _MIN_PILOT_SHARE * plan.duration:
                break
            seen = replace(plan, amplitudes=Amplitudes.of(plan.equations, trajectory))
            much_less = float(np.min(seen.scales / plan.scales)) < _MUCH_LESS_MOTION
            plan = seen
            if not (much_less and status.success):
                break
    except KeyboardInterrupt:
        if run is None:
            raise
        trajectory, status = run.report_interrupt()
    assert run is not None
    return plan, run, trajectory, status
