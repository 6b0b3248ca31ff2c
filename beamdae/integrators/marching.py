"""From breakpoint to breakpoint: stop, make the state consistent with the new laws, go on."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from beamdae.equations.consistent_start import Starter
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State
from beamdae.errors import BeamdaeError, count, positive
from beamdae.results.solution import Status
from beamdae.results.trajectory import Segment, Trajectory

Array = np.ndarray
Interval = tuple[float, float]

# Told the time reached; what it answers, if anything, is the reason to stop there.
Progress = Callable[[float], str | None]
Run = Callable[[float, float, float, State], tuple[Segment, Status]]


@dataclass(frozen=True)
class Watch:
    """Tells progress and ends a run whose time is up; looked at every `interval` steps."""

    progress: Progress | None
    time_limit: float | None
    begin: float
    interval: ClassVar[int] = 64

    def __call__(self, t: float) -> str | None:
        """Why the run has to stop at time `t` [s], or None."""
        if self.progress is not None and (reason := self.progress(float(t))):
            return f"{reason}, stopped at t = {t:.6g} s"
        if self.time_limit is not None and clock.perf_counter() - self.begin > self.time_limit:
            return f"time limit of {self.time_limit:g} s, stopped at t = {t:.6g} s"
        return None


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
                    time = np.array([start, phase])
                    self.starter.require_continuous(done[-1].phase, time, state.q)
                    state = self.starter.state(time, state.q, state.v)
                except BeamdaeError as problem:
                    status = Status(False, f"no consistent restart at t = {start:g} s: {problem}")
                    break
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


def longest_step(equations: EquationsOfMotion, duration: float) -> float:
    """Longest step [s] unless another is set: no step passes over what the laws do.

    A twentieth of the run, and a quarter of the time scale of the laws.
    """
    scale = equations.time_scale
    return duration / 20.0 if scale is None else min(duration / 20.0, scale / 4.0)


def require_tolerance(settings: Any) -> None:
    """Check rtol, max_step, max_steps and time_limit of an integrator with adaptive steps."""
    name = type(settings).__name__
    positive(name, "rtol", settings.rtol)
    if settings.rtol > 0.1:
        raise BeamdaeError(f"{name}: rtol must be at most 0.1, got {settings.rtol:g}.")
    for limit in ("max_step", "time_limit"):
        if getattr(settings, limit) is not None:
            positive(name, limit, getattr(settings, limit))
    if settings.max_steps is not None:
        count(name, "max_steps", settings.max_steps)


def reached(times: Array, trajectory: Trajectory) -> Array:
    """The output times a run got to."""
    return times[times <= trajectory.end * (1.0 + 1e-12)]


def _phase(interval: Interval) -> float:
    return 0.5 * (interval[0] + interval[1])
