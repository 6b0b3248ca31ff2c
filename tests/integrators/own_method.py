"""A method as users write it, whose steps are exact for constant accelerations."""

from dataclasses import dataclass, field

import beamdae as bd
from beamdae.integrators.integrator import Accuracy, clip_step
from beamdae.results.outcome import Statistics


@dataclass(frozen=True)
class OwnMethod(bd.Integrator):
    """`lengths(k)` replaces the step [s], and `change(t, state, k)` the result of step `k`.

    With `rtol`, the method counts as adaptive.
    """

    step: float = 0.01
    rtol: float | None = None
    lengths: object = None
    change: object = field(default=lambda t, state, k: (t, state))
    max_steps: int | None = None
    time_limit: float | None = None
    order = 1

    @property
    def accuracy(self):
        return Accuracy("rtol", self.rtol) if self.rtol else super().accuracy

    def method_on(self, plan):
        return _Steps(self)


class _Steps:
    steps_per_check, resolved_options, counts = 64, {}, Statistics()

    def __init__(self, settings):
        self.settings, self.k = settings, 0

    def begin(self, start, end, branch, state):
        self.t, self.end, self.state = start, end, state

    def step(self):
        self.k += 1
        settings, remaining = self.settings, self.end - self.t
        h = clip_step(settings.lengths(self.k) if settings.lengths else settings.step, remaining)
        self.t = self.end if h == remaining else self.t + h
        q, v, a, _ = self.state
        self.state = self.state._replace(q=q + h * v + 0.5 * h**2 * a, v=v + h * a)
        return settings.change(self.t, self.state, self.k)
