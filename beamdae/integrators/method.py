"""What a drive asks of a method, and how methods give up and fit their steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.results.outcome import Statistics

Array = np.ndarray

STEP_TOO_SMALL = "the step became too small to advance time; check laws, or loosen rtol"
# What a step gives: its end, and the stages inside it where a method has them.
StepResult = tuple[float, State] | tuple[float, State, Sequence[tuple[float, State]]]


class Method(Protocol):
    """What a drive asks of a method; one object a run.

    It has `step`, or `advance` where it takes many at once.
    """

    @property
    def resolved_options(self) -> dict[str, Any]:
        """What "auto" and tolerances came to, by name."""

    @property
    def counts(self) -> Statistics:
        """Calls and rejected steps so far."""

    @property
    def steps_per_check(self) -> int:
        """After how many steps progress is told."""

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin a smooth interval at a consistent state."""


class StepMethod(Method, Protocol):
    """A method that is asked for one step after the other."""

    def step(self) -> StepResult:
        """Time and state after one more step, at most at the end of the interval.

        A method with stages may add (time, state) of those inside the step, in the order of time
        and always as many: output between steps and the energy ledger then use them, see
        `Interval`.

        Raises
        ------
        StepError
            If there is none.
        """


class LoopMethod(Method, Protocol):
    """A method that takes many steps at once.

    Attributes
    ----------
    rows_per_step
        1, and the number of stages inside a step.
    """

    rows_per_step: int

    def advance(self, most: int) -> Array:
        """Rows (t, q, v, a, lam) of one to `most` more steps, up to the end of the interval.

        Raises
        ------
        StepError
            If there is not one.
        """


class StepError(ArithmeticError):
    """A method cannot go on; the message says why, and what to do.

    `residual` is that of a first-order form where it was given up, if there is one.
    """

    def __init__(self, message: str, residual: Array | None = None) -> None:
        super().__init__(message)
        self.residual = residual


# The last step of an interval ends on its end if it comes this near.
_LAST_STEP_MARGIN = 1.0 - 1e-9


def clip_step(step: float, left: float) -> float:
    """The step to try where so much is left of an interval [s]: its last two are equal."""
    return left if step >= _LAST_STEP_MARGIN * left else min(step, 0.5 * left)
