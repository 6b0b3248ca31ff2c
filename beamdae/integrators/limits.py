"""What ends a run before its end: limits somebody set, and steps that would never get there."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, field

from beamdae.errors import BeamdaeError
from beamdae.integrators.integrator import Progress

# Steps no run is begun with, where it is known beforehand that it would take more.
MOST_STEPS = 1e8
# (looks at a run, looks it would still take at the pace it had between them) from which on it is
# given up. With 64 steps between looks that is a hundred million steps still to go as seen over ten
# thousand, or ten million over a hundred thousand: an impact or another short stiff phase is over
# by then. Methods whose steps cost more are looked at more often.
_PACES = ((160, 1.6e6), (1600, 1.6e5))


@dataclass
class Pace:
    """How fast a run gets on, as seen over the last looks at it.

    Attributes
    ----------
    end
        Where the run goes to [s].
    """

    end: float
    _looks: int = field(default=0, init=False)
    _since: dict[int, float] = field(default_factory=dict, init=False)

    def stall(self, t: float, steps: int, between_looks: int) -> str | None:
        """Why there is no point in going on from time `t` [s], after so many steps, or None."""
        if steps % between_looks:
            return None
        for looks, most in _PACES:
            if self._looks % looks == 0:
                since, self._since[looks] = self._since.get(looks), t
                if since is not None and (self.end - t) * looks > most * (t - since):
                    return self._sentence(t, (t - since) / (looks * between_looks))
        self._looks += 1
        return None

    def _sentence(self, t: float, step: float) -> str:
        left = (self.end - t) / step if step > 0.0 else float("inf")
        return (
            f"no end in sight, steps of {step:.2g} s have become so short that {left:.2g} more "
            "would have to follow, as under a load, a speed or a stiffness out of all proportion, "
            "or a law that grows without bound; check these and their units, end the run sooner, "
            "or set max_steps to go on all the same"
        )


@dataclass
class Limits:
    """What ends a run before its end; None: nothing of the kind."""

    progress: Progress | None
    time_limit: float | None
    max_steps: int | None
    begin: float
    pace: Pace | None = None

    def steps_left(self, steps: int, between_looks: int) -> int:
        """How many steps may be taken after so many until somebody has to look, at least one."""
        left = between_looks - steps % between_looks
        return left if self.max_steps is None else max(min(left, self.max_steps - steps), 1)

    def reason(self, t: float, steps: int, between_looks: int) -> str | None:
        """Why the run has to stop at time `t` [s] after so many steps, or None."""
        if self.max_steps is not None and steps >= self.max_steps:
            return f"max_steps = {self.max_steps} taken"
        if self.time_limit is not None and clock.perf_counter() - self.begin > self.time_limit:
            return f"time limit of {self.time_limit:g} s"
        if self.pace is not None and (stall := self.pace.stall(t, steps, between_looks)):
            return stall
        if self.progress is None or steps % between_looks:
            return None
        # Bars answer with whatever they please.
        answer = self.progress(t)
        return answer if isinstance(answer, str) else None


def require_few(part: str, why: str, step: float, duration: float) -> None:
    """Refuse steps [s] of which a run of this duration [s] would take too many.

    `why` says what they are, such as a setting.

    Raises
    ------
    BeamdaeError
        If there would be more than MOST_STEPS.
    """
    if duration > MOST_STEPS * step:
        raise BeamdaeError(
            f"{part}: {why} of {step:.3g} s makes {duration / step:.2g} steps in {duration:g} s, "
            f"at most {MOST_STEPS:.0e} are begun; take a longer one, or end the run sooner."
        )
