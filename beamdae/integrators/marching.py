"""From breakpoint to breakpoint: stop, make the state consistent with the new laws, go on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from beamdae.equations import EquationsOfMotion
from beamdae.errors import BeamdaeError
from beamdae.formulations import State
from beamdae.initial import Starter
from beamdae.solution import Status
from beamdae.trajectory import Segment, Trajectory

Array = np.ndarray
Interval = tuple[float, float]

# Restarts correct the drift of a run; more than this, relative to the scale of a coordinate, is a
# law that jumps.
_JUMP = 1e-3
Run = Callable[[float, float, float, State], tuple[Segment, Status]]


@dataclass(frozen=True)
class Plan:
    """The smooth intervals of a run, and its consistent start."""

    starter: Starter
    intervals: tuple[Interval, ...]
    state: State

    @property
    def time(self) -> Array:
        """(t, phase) of the start."""
        return np.array([self.intervals[0][0], _phase(self.intervals[0])])

    def march(self, run: Run) -> tuple[Trajectory, Status]:
        """Run `run(start, end, phase, state)` over the intervals, until one fails."""
        done: list[Segment] = []
        state, status = self.state, Status(True, "reached the end")
        for start, end in self.intervals:
            phase = _phase((start, end))
            if done:
                try:
                    restarted = self.starter.state(np.array([start, phase]), state.q, state.v)
                except BeamdaeError as problem:
                    status = Status(False, f"no consistent restart at t = {start:g} s: {problem}")
                    break
                moved = np.abs(restarted.q - state.q) / self.starter.equations.position_scales
                if np.max(moved) > _JUMP:
                    reason = f"a law makes positions jump at t = {start:g} s"
                    status = Status(False, f"stopped at t = {start:g} s: {reason}")
                    break
                state = restarted
            segment, status = run(start, end, phase, state)
            done.append(segment)
            state = State(*(x[-1] for x in segment.state))
            if not status.success:
                break
        return Trajectory(tuple(done)), status


def plan(equations: EquationsOfMotion, times: Array) -> Plan:
    """The intervals between the breakpoints inside the run, and its consistent start.

    Raises
    ------
    BeamdaeError
        If the model has no consistent start.
    """
    start, end = float(times[0]), float(times[-1])
    inner = [b for b in equations.breakpoints if start < b < end]
    intervals = tuple(zip([start, *inner], [*inner, end], strict=True))
    starter = Starter(equations)
    first = np.array([start, _phase(intervals[0])])
    return Plan(starter, intervals, starter.state(first, equations.q0, equations.v0))


def reached(times: Array, trajectory: Trajectory) -> Array:
    """The output times a run got to."""
    return times[times <= trajectory.end * (1.0 + 1e-12)]


def _phase(interval: Interval) -> float:
    return 0.5 * (interval[0] + interval[1])
