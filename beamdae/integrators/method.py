"""The protocol of a method: how `drive` begins intervals and requests steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.results.outcome import Statistics

Array = np.ndarray

# Reasons of failures that several methods share.
STEP_TOO_SMALL = "the step became too small to advance time; check laws, or loosen rtol"
RESIDUAL_NOT_FINITE = "the residual is not finite; check laws and start values"
MATRIX_SINGULAR = "the matrix is singular or not finite; check masses and joints"

# Steps of a compiled loop between two checks of limits.
STEPS_PER_CHECK = 64
# After a failure the residual is evaluated this far ahead, relative to the rest of the interval:
# steps shrink to nothing before a time from which on the residual is not finite.
PROBE_SHARE = 1e-6

# Time and state at the end of a step, and those of its inner stages if the method has any.
StepResult = tuple[float, State] | tuple[float, State, Sequence[tuple[float, State]]]

# A step that covers the rest of an interval up to this share is stretched to its end.
_LAST_STEP_MARGIN = 1.0 - 1e-9
# An interval is divided into one step less if that makes them longer by less than this share.
_STEP_COUNT_ROUNDING = 1e-6


class Method(Protocol):
    """A method made for one run; it has `step`, or `advance` if it takes many steps at once."""

    @property
    def resolved_options(self) -> dict[str, Any]:
        """Values chosen for settings that were "auto", and derived tolerances, by name."""

    @property
    def counts(self) -> Statistics:
        """Calls, factorizations and rejected steps so far."""

    @property
    def steps_per_check(self) -> int:
        """Number of steps between two checks of limits and calls of progress."""

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin a smooth interval [s] at a consistent state.

        Laws choose their piece by `branch`, a time inside the interval.
        """


class StepMethod(Method, Protocol):
    """A method that takes one step at a time."""

    def step(self) -> StepResult:
        """Take one step, at most to the end of the interval, and return its time and state.

        A third value may list (time, state) of the inner stages of the step, in the order of time,
        the same number in every step. Output between steps and the energy ledger use them; see
        `Interval`.

        Raises
        ------
        StepError
            If no step is possible.
        """


class LoopMethod(Method, Protocol):
    """A method that takes many steps at once.

    Attributes
    ----------
    rows_per_step
        1 plus the number of inner stages of a step that are returned.
    """

    rows_per_step: int

    def advance(self, most: int) -> Array:
        """Return rows (t, q, v, a, lam) of one to `most` steps, up to the end of the interval.

        Raises
        ------
        StepError
            If no step is possible.
        """


class StepError(ArithmeticError):
    """Raised by a method that cannot continue; the message says why, and what to do.

    Attributes
    ----------
    residual
        Residual of a first-order form where the method gave up, if there is one.
    """

    def __init__(self, message: str, residual: Array | None = None) -> None:
        super().__init__(message)
        self.residual = residual


def clip_step(step: float, remaining: float) -> float:
    """Return the next step [s] if `remaining` is left of an interval: its last two are equal."""
    return remaining if step >= _LAST_STEP_MARGIN * remaining else min(step, 0.5 * remaining)


def count_equal_steps(duration: float, step: float) -> int:
    """Return into how many equal steps of at most `step` [s] an interval is divided."""
    return max(int(np.ceil(duration / step - _STEP_COUNT_ROUNDING)), 1)
