"""Limits that stop a run early: those set by the user, and the detection of stalled runs."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass, field

from beamdae.errors import call_progress

# Function of the time reached [s]; a returned string stops the run and becomes the reason.
Progress = Callable[[float], str | None]

# A run stops if more steps than this remain, ...
_MAX_REMAINING_STEPS = 1e7
# ... from this number of steps on. Before, the limit is inversely proportional to the number of
# steps, because impacts and other short stiff phases end. Methods whose steps cost more have
# proportionally smaller numbers.
_STEPS_OF_LASTING_PACE = 1e5
# The motion is checked after this number of steps, and whenever the number has doubled: after half
# a second in most models with beams.
_STEPS_OF_FIRST_MOTION_CHECK = 5000
# The pace is steady if it has grown by less than this factor; it doubles while vibrations decay.
_STEADY_PACE_RATIO = 1.1
# Lasting vibration that the steps of the current run follow, or "", for progress displays.
followed_vibration: ContextVar[str] = ContextVar("followed_vibration", default="")

_CONTINUE = "set max_steps to continue anyway"


@dataclass
class PaceCheck:
    """Schedule of the checks of a long run, whose steps may be too short to reach the end.

    Attributes
    ----------
    start, end
        Start and end of the run [s].
    relative_limit
        Limits on the number of steps, relative to those of a method with inexpensive steps.
    steps
        Number of steps from which on the next check is due.
    begin
        Time of the last check [s].
    pace
        Mean step [s] between the last two checks.
    more_steps
        Estimated number of steps to the end of the run at the last check.
    is_steady
        True if the pace has not grown since the check before.
    """

    start: float
    end: float
    relative_limit: float = 1.0
    steps: int = _STEPS_OF_FIRST_MOTION_CHECK
    begin: float = field(init=False)
    pace: float = field(default=0.0, init=False)
    more_steps: float = field(default=0.0, init=False)
    is_steady: bool = field(default=False, init=False)
    _last: tuple[float, int] = field(init=False)

    def __post_init__(self) -> None:
        self.begin = self.start
        self._last = self.start, 0

    def is_due(self, t: float, steps: int) -> bool:
        """Return True at `t` [s] if more than half of the steps of a long run seem to remain."""
        if steps < self.steps:
            return False
        self.steps = 2 * steps
        (self.begin, first), self._last = self._last, (t, steps)
        self.pace = (t - self.begin) / (steps - first)
        # Steps that are repeated from an earlier time make less than none.
        self.more_steps = (self.end - t) / self.pace if self.pace > 0.0 else float("inf")
        mean_before = (self.begin - self.start) / first if first else float("inf")
        self.is_steady = first > 0 and self.pace <= _STEADY_PACE_RATIO * mean_before
        return self.more_steps > steps

    @property
    def exceeds_limit(self) -> bool:
        """True if too many steps remain at a steady pace."""
        return self.is_steady and self.more_steps > self.relative_limit * _MAX_REMAINING_STEPS

    @property
    def is_stalled(self) -> bool:
        """True if so many steps remain that the run stops even if the pace may change."""
        lasting = self.relative_limit * _STEPS_OF_LASTING_PACE / self._last[1]
        most = self.relative_limit * _MAX_REMAINING_STEPS * max(lasting, 1.0)
        return self.more_steps > most and (self.is_steady or lasting < 1.0)

    def describe_motion(self, reason: str) -> str:
        """Return the reason to stop, with the number of steps that the rest would take."""
        return (
            f"{reason}; the rest of the run would take about {self.more_steps:.2g} steps; "
            f"{_CONTINUE}"
        )

    def describe_stall(self, cause: str = "") -> str:
        """Return the reason to stop a stalled run, with its cause if it is known."""
        pace = "steps have shrunk to 0 s, so the run makes no progress"
        if self.pace > 0.0:
            pace = (
                f"steps have shrunk to {self.pace:.2g} s, at which the run would need "
                f"{self.more_steps:.2g} more steps"
            )
        return f"{pace}; {cause or 'check values and units, or increase rtol'}; {_CONTINUE}"


@dataclass
class RunLimits:
    """Limits of one run; a limit of None is not enforced.

    Attributes
    ----------
    progress
        Function called with the time reached [s]. If it returns a string, the run stops; the string
        becomes the reason.
    time_limit
        Maximum wall time [s] since `begin`.
    max_steps
        Maximum number of accepted steps.
    begin
        Value of `time.perf_counter()` [s] at the start of the run.
    pace_check
        Schedule of the checks of motion and pace; without it, they are not checked.
    """

    progress: Progress | None
    time_limit: float | None
    max_steps: int | None
    begin: float
    pace_check: PaceCheck | None = None

    def steps_until_check(self, steps: int, steps_per_check: int) -> int:
        """Return the number of steps, at least one, from step number `steps` to the next check."""
        count = steps_per_check - steps % steps_per_check
        return count if self.max_steps is None else max(min(count, self.max_steps - steps), 1)

    def stop_reason(self, t: float, steps: int, steps_per_check: int) -> str:
        """Return the reason to stop at time `t` [s] after `steps` steps, or "".

        Raises
        ------
        ProgressError
            If `progress` raises an exception.
        """
        if self.max_steps is not None and steps >= self.max_steps:
            return f"reached max_steps = {self.max_steps}"
        if self.time_limit is not None and clock.perf_counter() - self.begin > self.time_limit:
            return f"reached the time limit of {self.time_limit:g} s"
        if self.progress is None or steps % steps_per_check:
            return ""
        answer = call_progress(self.progress, t)
        # Functions that update progress bars may return other objects.
        return answer if isinstance(answer, str) else ""
