"""Limits that stop a run before its end: set by the user, or because it would never get there."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, field

from beamdae.errors import BeamdaeError
from beamdae.integrators.integrator import Progress

# A run that is known to take more steps is rejected.
MAX_PLANNED_STEPS = 1e8
# (checks since a reference time, remaining checks at the pace since then): a run stalls if more
# remain. At 64 steps a check that is 1e8 remaining steps at the pace of 1e4 steps, or 1e7 at the
# pace of 1e5 steps: an impact or another short stiff phase is over by then. Methods whose steps
# cost more are checked more often.
_STALL_WINDOWS = ((160, 1.6e6), (1600, 1.6e5))


@dataclass
class StallDetector:
    """Detects runs whose steps have become too short to reach the end.

    Attributes
    ----------
    end
        End of the run [s].
    """

    end: float
    _checks: int = field(default=0, init=False)
    _window_starts: dict[int, float] = field(default_factory=dict, init=False)

    def stall_reason(self, t: float, steps: int, steps_per_check: int) -> str | None:
        """Return why a run at time `t` [s] after `steps` steps stalls, or None."""
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
        remaining = (self.end - t) / step if step > 0.0 else float("inf")
        return (
            f"no end in sight, steps of {step:.2g} s have become so short that {remaining:.2g} "
            "more are needed, as under a load, a speed or a stiffness out of all proportion, or a "
            "law that grows without bound; check these and their units, end the run sooner, or set "
            "max_steps to continue anyway"
        )


@dataclass
class RunLimits:
    """Limits of one run; None means no limit.

    Attributes
    ----------
    progress
        Called with the time reached [s]; a string it returns is the reason to stop.
    time_limit
        Wall time since `begin` [s].
    max_steps
        Number of accepted steps.
    begin
        Value of `time.perf_counter` at the start of the run [s].
    stall_detector
        Detects steps too short to reach the end.
    """

    progress: Progress | None
    time_limit: float | None
    max_steps: int | None
    begin: float
    stall_detector: StallDetector | None = None

    def steps_until_check(self, steps: int, steps_per_check: int) -> int:
        """Return how many steps may follow before the next check, at least one."""
        count = steps_per_check - steps % steps_per_check
        return count if self.max_steps is None else max(min(count, self.max_steps - steps), 1)

    def stop_reason(self, t: float, steps: int, steps_per_check: int) -> str | None:
        """Return why the run has to stop at time `t` [s] after `steps` steps, or None."""
        if self.max_steps is not None and steps >= self.max_steps:
            return f"max_steps = {self.max_steps} taken"
        if self.time_limit is not None and clock.perf_counter() - self.begin > self.time_limit:
            return f"time limit of {self.time_limit:g} s"
        if self.stall_detector is not None:
            stall = self.stall_detector.stall_reason(t, steps, steps_per_check)
            if stall:
                return stall
        if self.progress is None or steps % steps_per_check:
            return None
        # Progress bars may return other objects.
        answer = self.progress(t)
        return answer if isinstance(answer, str) else None


def require_feasible_step(part: str, setting: str, step: float, duration: float) -> None:
    """Reject a step [s] so short that a run of this duration [s] would never end.

    `setting` says in the message which step it is.

    Raises
    ------
    BeamdaeError
        If there would be more than MAX_PLANNED_STEPS steps.
    """
    if duration > MAX_PLANNED_STEPS * step:
        raise BeamdaeError(
            f"{part}: {setting} of {step:.3g} s makes {duration / step:.2g} steps in "
            f"{duration:g} s, more than {MAX_PLANNED_STEPS:.0e}; take a longer step, or end the "
            "run sooner."
        )
