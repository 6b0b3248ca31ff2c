"""Steps of the generalized-alpha family that adapt to an estimate of their error."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from beamdae.equations.formulations import State
from beamdae.errors import BeamdaeError
from beamdae.integrators.alpha_step import Motion, Stepper
from beamdae.integrators.drive import StepError, fitted
from beamdae.integrators.modified_newton import NewtonError
from beamdae.results.solution import Statistics

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


class PatientStepSize:
    """The step: kept while it serves, so that its factors are.

    Attributes
    ----------
    next
        Step to try [s].
    """

    def __init__(self, first: float, largest: float) -> None:
        self.next = min(first, largest)
        self._largest = largest
        self._forget()

    def _forget(self) -> None:
        self._seen, self._worst = 0, 0.0

    def accept(self, h: float, error: float) -> None:
        """Hear of the error of a step over its tolerance; grows the step now and then."""
        self._seen += 1
        self._worst = max(self._worst, error)
        if self._seen < _PATIENCE:
            return
        growth = min(_possible(self._worst), _MOST_GROWTH)
        if growth >= _LEAST_GROWTH:
            self.next = min(h * growth, self._largest)
        self._forget()

    def reject(self, h: float, error: float | None) -> float:
        """Shrink the step after one with too large an error, or with none; returns the new one."""
        shrinkage = _FAILED_SHRINKAGE
        if error is not None:
            shrinkage = max(min(_possible(error), _LEAST_SHRINKAGE), _MOST_SHRINKAGE)
        self.next = h * shrinkage
        self._forget()
        return self.next


def _possible(error: float) -> float:
    """The factor by which a step may change that makes an error of h^3."""
    return _SAFETY * max(error, 1e-9) ** (-1.0 / 3.0)


@dataclass
class AdaptiveSteps:
    """Steps that keep the estimated error of each below `tolerance`.

    They begin with `first` in every interval and stay between a billionth of the run and `largest`.
    """

    stepper: Stepper
    cured: bool
    first: float
    largest: float
    duration: float
    tolerance: float
    _rejected: int = field(default=0, init=False)
    steps_between_looks: ClassVar[int] = 64

    @property
    def resolved(self) -> dict[str, Any]:
        """The tolerance of a step."""
        return {"local_tolerance": self.tolerance}

    @property
    def counts(self) -> Statistics:
        """What it cost."""
        return replace(self.stepper.counts, rejected_steps=self._rejected)

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin a smooth interval."""
        self._t, self._end, self._branch, self._start = start, end, branch, state
        self._size = PatientStepSize(self.first, self.largest)
        self._motion: Motion | None = None

    def step(self) -> tuple[float, State]:
        """One step that passes the error test."""
        reason = ""
        while True:
            remaining = self._end - self._t
            h = fitted(self._size.next, remaining)
            t = self._end if h == remaining else self._t + h
            error = None
            try:
                after, error = self._attempt(t, h)
            except NewtonError as problem:
                reason = problem.reason
            except BeamdaeError as problem:
                raise StepError(str(problem)) from problem
            if error is not None:
                if error <= 1.0:
                    break
                reason = "the error test failed"
            self._rejected += 1
            # Of states beyond all numbers the step is none either.
            if not self._size.reject(h, error) >= _SMALLEST * self.duration:
                raise StepError(
                    f"{reason} even with a step of {h:.2g} s; "
                    "check laws and start values, or loosen rtol"
                )
        self._size.accept(h, error)
        self._t, self._motion = t, after
        return t, after.state

    def _attempt(self, t: float, h: float) -> tuple[Motion, float]:
        """Motion after a step to t, and its error over the tolerance."""
        time = np.array([self._t, self._branch])
        before = (
            self.stepper.start(time, self._start, h, self.cured)
            if self._motion is None
            else self.stepper.resume(time, self._motion, h)
        )
        after = self.stepper.advance(np.array([t, self._branch]), before)
        return after, self.stepper.error(before, after) / self.tolerance
