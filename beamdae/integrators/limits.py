"""Limits that stop a run early: those set by the user, and the detection of stalled runs."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from beamdae.errors import BeamdaeError, call_progress

# Function of the time reached [s]; a returned string stops the run and becomes the reason.
Progress = Callable[[float], str | None]

# Runs that would need more steps are rejected.
MAX_PLANNED_STEPS = 1e8
# Pairs (n, m): the run stalls if, at the average pace of the last n checks, more than m checks
# remain. With 64 steps per check, this means 1e8 remaining steps at the pace of the last 1e4 steps,
# or 1e7 at the pace of the last 1e5 steps. These windows are longer than impacts and other short
# stiff phases. Methods with expensive steps are checked more often.
_STALL_WINDOWS = ((160, 1.6e6), (1600, 1.6e5))
# The motion is checked after this number of steps, and whenever the number has doubled: after half
# a second in most models with beams.
_STEPS_OF_FIRST_MOTION_CHECK = 5000
# The pace has fallen if the last half of the steps covers less than this fraction of the time of
# the first half; it falls to 0.2 while an unstable loop of a stage with leaf springs grows.
_MAX_PACE_RATIO = 0.4
# From this number of periods on, the tolerance is so tight (it falls with the square of the number)
# that Radau takes over 100 steps per period of a free pendulum at rtol = 1e-4.
_MANY_PERIODS = 100.0


_GUESSES = ", possibly because of "
_CONTINUE = "set max_steps to continue anyway"


def omit_guesses(reason: str) -> str:
    """Return a reason to stop without possible causes, because the cause is known."""
    pace, guesses, rest = reason.partition(_GUESSES)
    return f"{pace}; {_CONTINUE}{rest.partition(_CONTINUE)[2]}" if guesses else reason


@dataclass
class MotionCheck:
    """Schedule of the checks of a long run whose motion may have become meaningless.

    Attributes
    ----------
    start, end
        Start and end of the run [s].
    steps
        Number of steps from which on the next check is due.
    begin
        Time of the last check [s].
    more_steps
        Estimated number of steps to the end of the run at the last check.
    has_slowed
        True if the pace has fallen since the check before.
    """

    start: float
    end: float
    steps: int = _STEPS_OF_FIRST_MOTION_CHECK
    begin: float = field(init=False)
    more_steps: float = field(default=0.0, init=False)
    has_slowed: bool = field(default=False, init=False)
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
        pace = (t - self.begin) / (steps - first)
        self.more_steps = (self.end - t) / pace if pace > 0.0 else float("inf")
        mean_before = (self.begin - self.start) / first if first else float("inf")
        self.has_slowed = first > 0 and pace < _MAX_PACE_RATIO * mean_before
        return self.more_steps > steps

    def describe(self, reason: str) -> str:
        """Return the reason to stop, with the number of steps that the rest would take."""
        rest = f"the rest of the run would take about {self.more_steps:.2g} steps; {_CONTINUE}"
        return "; ".join(filter(None, (reason, rest)))


@dataclass
class StallDetector:
    """Detector of runs whose steps have become too short to reach the end.

    Attributes
    ----------
    end
        End of the run [s].
    periods
        Number of periods of the motion for which the tolerance is tightened.
    """

    end: float
    periods: float = 1.0
    _checks: int = field(default=0, init=False)
    _window_starts: dict[int, float] = field(default_factory=dict, init=False)

    def stall_reason(self, t: float, steps: int, steps_per_check: int) -> str | None:
        """Return the reason why a run is stalled at `t` [s] after `steps` steps, or None."""
        if steps % steps_per_check:
            return None
        for checks, max_checks in _STALL_WINDOWS:
            if self._checks % checks == 0:
                begin, self._window_starts[checks] = self._window_starts.get(checks), t
                if begin is not None and (self.end - t) * checks > max_checks * (t - begin):
                    return self._describe_stall(t, (t - begin) / (checks * steps_per_check))
        self._checks += 1
        return None

    def _describe_stall(self, t: float, step: float) -> str:
        causes = (
            "extreme loads, speeds or stiffnesses, or a law that grows without bound or jumps, "
            "such as np.arctan2 at 180 degrees"
        )
        remedies = "check values and units"
        if self.periods > _MANY_PERIODS:
            causes = (
                f"{self.periods:.2g} periods of motion, which tighten the tolerance, or {causes}"
            )
            remedies += ", increase rtol, end the run earlier, use GeneralizedAlpha(step)"
        pace = "steps have shrunk to 0 s, so the run makes no progress"
        # Steps that are repeated from an earlier time make less than none.
        if step > 0.0:
            pace = (
                f"steps have shrunk to {step:.2g} s, so the run would need "
                f"{(self.end - t) / step:.2g} more steps"
            )
        return f"{pace}{_GUESSES}{causes}; {remedies}, or {_CONTINUE}"


class StepDetector(Protocol):
    """Detector of steps that are too short or too many."""

    def stall_reason(self, t: float, steps: int, steps_per_check: int) -> str | None:
        """Return the reason to stop at `t` [s] after `steps` steps, or None."""


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
    stall_detector
        Detector of steps that are too short to reach the end.
    motion_check
        Schedule of the checks of the motion; without it, the motion is not checked.
    """

    progress: Progress | None
    time_limit: float | None
    max_steps: int | None
    begin: float
    stall_detector: StepDetector | None = None
    motion_check: MotionCheck | None = None

    def steps_until_check(self, steps: int, steps_per_check: int) -> int:
        """Return the number of steps, at least one, from step number `steps` to the next check."""
        count = steps_per_check - steps % steps_per_check
        return count if self.max_steps is None else max(min(count, self.max_steps - steps), 1)

    def stop_reason(
        self, t: float, steps: int, steps_per_check: int, find_cause: Callable[[], str]
    ) -> str | None:
        """Return the reason to stop at time `t` [s] after `steps` steps, or None.

        `find_cause` returns a cause of very short steps, or "".

        Raises
        ------
        ProgressError
            If `progress` raises an exception.
        """
        if self.max_steps is not None and steps >= self.max_steps:
            return f"reached max_steps = {self.max_steps}"
        if self.time_limit is not None and clock.perf_counter() - self.begin > self.time_limit:
            return f"reached the time limit of {self.time_limit:g} s"
        if self.stall_detector is not None:
            stall = self.stall_detector.stall_reason(t, steps, steps_per_check)
            if stall:
                cause = find_cause()
                return f"{omit_guesses(stall)}; {cause}" if cause else stall
        if self.progress is None or steps % steps_per_check:
            return None
        answer = call_progress(self.progress, t)
        # Functions that update progress bars may return other objects.
        return answer if isinstance(answer, str) else None


def require_feasible_step(part: str, setting: str, step: float, duration: float) -> None:
    """Reject a step [s] that is too short for a run of this duration [s].

    In the error message, `part` names the integrator and `setting` names the step.

    Raises
    ------
    BeamdaeError
        If the run would take more than MAX_PLANNED_STEPS steps.
    """
    if duration > MAX_PLANNED_STEPS * step:
        raise BeamdaeError(
            f"{part}: {setting} of {step:.3g} s requires {duration / step:.2g} steps "
            f"in {duration:g} s, more than the maximum of {MAX_PLANNED_STEPS:.0e}; use "
            "a longer step or an earlier end time."
        )
