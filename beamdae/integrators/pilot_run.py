"""Pilot runs, which measure the amplitudes of the motion with a loose tolerance."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace

import numpy as np

from beamdae.integrators.limits import RunLimits
from beamdae.integrators.run_plan import Amplitudes, RunPlan
from beamdae.results.outcome import PILOT_RUN_SUFFIX, REACHED_END, Status
from beamdae.results.trajectory import Trajectory

# Relative tolerance of a pilot run.
PILOT_RTOL = 1e-2
PILOT_LABEL = f"{PILOT_RUN_SUFFIX} with rtol = {PILOT_RTOL:g}"
_MAX_PILOT_RUNS = 4
_MAX_PILOT_STEPS = 20_000
# Fraction of the time limit that all pilot runs together may use.
_PILOT_TIME_SHARE = 0.25
# A pilot run is repeated if an amplitude is below this fraction of the scale that it used. Above,
# its error is at most about 10 % of the amplitude. A second pilot run of the models in `models/`
# changed scales by up to 16 % and rates by up to 21 %, even if this ratio was 0.015.
_REPEAT_RATIO = 0.1
# A pilot run that covers less than this fraction of the run is discarded, unless an event ended it.
_MIN_COVERAGE = 0.2
# Its rate is used nevertheless if it contains more than this number of periods. The position of a
# slow motion that has just begun changes little, which makes the rate of its vibrations too large.
_MIN_PARTIAL_PERIODS = 3.0

_similar_motion: ContextVar[Trajectory | None] = ContextVar("similar_motion", default=None)


@contextmanager
def reuse_motion(motion: Trajectory | None) -> Iterator[None]:
    """Within the context, runs have the amplitudes of a similar motion instead of pilot runs.

    The positions and velocities of `motion` are those of the equations of these runs.
    """
    token = _similar_motion.set(motion)
    try:
        yield
    finally:
        _similar_motion.reset(token)


def adopt_amplitudes(plan: RunPlan) -> RunPlan:
    """Return the plan with the amplitudes of `reuse_motion`, or unchanged outside its context."""
    motion = _similar_motion.get()
    if motion is None:
        return plan
    return replace(plan, amplitudes=Amplitudes.from_trajectory(plan.equations, motion))


def run_pilot(
    plan: RunPlan,
    execute: Callable[[RunPlan, RunLimits], tuple[Trajectory, Status]],
    limits: RunLimits,
) -> RunPlan:
    """Measure the amplitudes of the motion by up to four pilot runs; return the plan with them.

    A completed pilot run is repeated if the amplitude of a part is below 0.1 times the amplitude
    that the pilot run assumed for this part. During pilot runs, `limits.progress` is called with
    the start time. If no pilot run is long enough, the plan has no amplitudes.

    Parameters
    ----------
    plan, limits
        Plan and limits of the main run.
    execute
        Function that executes a pilot run for a plan and limits.
    """
    time_limit = None if limits.time_limit is None else _PILOT_TIME_SHARE * limits.time_limit
    start, progress = plan.intervals[0][0], limits.progress
    pilot_progress = None if progress is None else lambda _: progress(start)
    pilot_limits = RunLimits(pilot_progress, time_limit, _MAX_PILOT_STEPS, limits.begin)
    for _ in range(_MAX_PILOT_RUNS):
        trajectory, status = execute(plan, pilot_limits)
        previous = {} if plan.amplitudes is None else plan.amplitudes.by_part
        measured = Amplitudes.from_trajectory(plan.equations, trajectory)
        ended_by_event = status.success and status is not REACHED_END
        covered = trajectory.end - start
        if not (ended_by_event or covered >= _MIN_COVERAGE * plan.duration):
            # The rate is that at the beginning of the run, if the motion repeats.
            repeats = measured.rate * covered > 2.0 * np.pi * _MIN_PARTIAL_PERIODS
            if plan.amplitudes is None and repeats:
                plan = replace(plan, partial_rate=measured.rate)
            break
        plan, by_part = replace(plan, amplitudes=measured), measured.by_part
        ratio = min(x / previous.get(name, 1.0) for name, x in by_part.items())
        if not (ratio < _REPEAT_RATIO and status.success):
            break
    return plan
