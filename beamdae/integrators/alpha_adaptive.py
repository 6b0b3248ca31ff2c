"""Steps of the generalized-alpha family that adapt to an estimate of their error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.formulations import State
from beamdae.errors import BeamdaeError
from beamdae.integrators.alpha_step import Motion, Stepper
from beamdae.integrators.marching import Watch
from beamdae.integrators.modified_newton import NewtonError
from beamdae.results.solution import Status
from beamdae.results.trajectory import Segment

Array = np.ndarray

# Local tolerance over rtol^(3/2). The largest error over a run stays below 100 rtol with it, and
# below 50 rtol in the cases of validation/tolerances.
_CALIBRATION = 4.0
# Smallest step over the length of the run.
_SMALLEST = 1e-9

# A step grows if all of so many steps say that it may, by _LEAST_GROWTH to _MOST_GROWTH: new
# factors cost more than a few steps, and the jerk of a vibration passes zero.
_PATIENCE = 8
_LEAST_GROWTH, _MOST_GROWTH = 1.2, 2.0
_LEAST_SHRINKAGE, _MOST_SHRINKAGE = 0.9, 0.2
# Where Newton's iteration fails nothing is known of the error.
_FAILED_SHRINKAGE = 0.5
_SAFETY = 0.8


def local_tolerance(rtol: float) -> float:
    """Tolerance of the error of one step that keeps the error of a whole run near `rtol`.

    A step makes an error of h^3 and a run one of h^2: the latter is proportional to `rtol` if the
    former is to rtol^(3/2), as in `ErrorControl.tolerance`.
    """
    return _CALIBRATION * rtol**1.5


class StepSize:
    """The step: kept while it serves, so that its factors are."""

    def __init__(self, first: float, largest: float) -> None:
        self._h = min(first, largest)
        self._largest = largest
        self._forget()

    def _forget(self) -> None:
        self._seen, self._worst = 0, 0.0

    def fitted(self, remaining: float) -> float:
        """The step to try; the last two before the end of an interval are equal."""
        if remaining <= self._h * (1.0 + 1e-9):
            return remaining
        return min(self._h, 0.5 * remaining)

    def accept(self, h: float, error: float) -> None:
        """Hear of the error of a step over its tolerance; grows the step now and then."""
        self._seen += 1
        self._worst = max(self._worst, error)
        if self._seen < _PATIENCE:
            return
        growth = min(_possible(self._worst), _MOST_GROWTH)
        if growth >= _LEAST_GROWTH:
            self._h = min(h * growth, self._largest)
        self._forget()

    def reject(self, h: float, error: float | None) -> float:
        """Shrink the step after one with too large an error, or with none; returns the new one."""
        shrinkage = _FAILED_SHRINKAGE
        if error is not None:
            shrinkage = max(min(_possible(error), _LEAST_SHRINKAGE), _MOST_SHRINKAGE)
        self._h = h * shrinkage
        self._forget()
        return self._h


def _possible(error: float) -> float:
    """The factor by which a step may change that makes an error of h^3."""
    return _SAFETY * max(error, 1e-9) ** (-1.0 / 3.0)


@dataclass
class AdaptiveRun:
    """Segments with steps that keep the estimated error of each below `tolerance`.

    Steps begin with `first` in every segment and stay between a billionth of the run and
    `largest`.
    """

    stepper: Stepper
    cured: bool
    first: float
    largest: float
    duration: float
    tolerance: float
    max_steps: int | None
    watch: Watch
    taken: int = 0
    rejected: int = 0

    def __call__(
        self, start: float, end: float, phase: float, state: State
    ) -> tuple[Segment, Status]:
        """Steps from `start` to `end`, and why no more."""
        t, rows = [start], [state]
        try:
            stop = self._march(t, rows, end, phase)
        except KeyboardInterrupt:
            stop = f"interrupted at t = {t[-1]:.6g} s"
        states = State(*(np.array(x) for x in zip(*rows, strict=True)))
        return Segment(np.array(t), states, phase), Status(stop is None, stop or "reached the end")

    def _march(self, t: list[float], rows: list[State], end: float, phase: float) -> str | None:
        """Append steps up to the end; returns why no more."""
        size = StepSize(self.first, self.largest)
        motion: Motion | None = None
        while t[-1] < end:
            now, remaining = t[-1], end - t[-1]
            if self.taken == self.max_steps:
                return f"max_steps = {self.taken} taken, stopped at t = {now:.6g} s"
            h = size.fitted(remaining)
            time = np.array([now, phase])
            error, reason = None, "the error test failed"
            try:
                before = (
                    self.stepper.start(time, rows[0], h, self.cured)
                    if motion is None
                    else self.stepper.resume(time, motion, h)
                )
                time[0] = end if h == remaining else now + h
                after = self.stepper.advance(time, before)
                error = self.stepper.error(before, after) / self.tolerance
            except NewtonError as problem:
                reason = problem.reason
            except BeamdaeError as problem:
                return f"stopped at t = {now:.6g} s: {problem}"
            if error is None or not error <= 1.0:
                self.rejected += 1
                if size.reject(h, error) < _SMALLEST * self.duration:
                    return (
                        f"stopped at t = {now:.6g} s: {reason} even with a step of {h:.2g} s; "
                        "check laws and start values, or loosen rtol"
                    )
                continue
            size.accept(h, error)
            motion = after
            t.append(float(time[0]))
            rows.append(after.state)
            self.taken += 1
            if self.taken % self.watch.interval == 0 and (stop := self.watch(t[-1])):
                return stop
        return None
