"""Protocols through which `drive` begins intervals and requests steps from methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, cast

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.integrators.step_history import StepHistory
from beamdae.results.outcome import Statistics

Array = np.ndarray

# Failure reasons shared by several methods.
STEP_TOO_SMALL = (
    "the step became too small to advance time; check laws, or loosen rtol if steps are adaptive"
)
RESIDUAL_NOT_FINITE = "the residual is not finite; check laws and start values"
MATRIX_SINGULAR = "the matrix is singular or not finite; check masses and joints"

_PAST_END = "past the end of the interval; a method must stop at this end"
_UNORDERED_STAGES = (
    "the stages of a step must ascend in time, and each step must have the same number of stages"
)

# Number of steps between two checks of limits; methods with more expensive steps use fewer.
STEPS_PER_CHECK = 64
# Fixed steps cannot stall, and each call of a compiled loop takes as long as ten short steps.
FIXED_STEPS_PER_CHECK = 256
# Limit of the memory of the rows that a compiled loop fills [bytes], so that they are still in the
# processor cache when they are stored, and least number of rows.
_MAX_ROW_BYTES = 2 * 2**20
_MIN_ROWS = 8
# After a failure, the residual is evaluated this far ahead, relative to the rest of the interval,
# because steps shrink to zero before a time after which the residual is not finite.
PROBE_SHARE = 1e-6

# Time [s] and state at the end of a step, followed by the inner stages of methods that have them.
StepResult = tuple[float, State] | tuple[float, State, Sequence[tuple[float, State]]]

# A step of at least this fraction of the rest of an interval ends at the end of the interval.
_LAST_STEP_MARGIN = 1.0 - 1e-9
# Rounding tolerance of the number of equal steps in an interval.
_STEP_COUNT_ROUNDING = 1e-6


class Method(Protocol):
    """Integration method for one run: a `StepMethod` or a `LoopMethod`."""

    @property
    def resolved_options(self) -> dict[str, Any]:
        """Entries for `Solution.integrator`, such as values chosen for "auto" and tolerances."""

    @property
    def counts(self) -> Statistics:
        """Numbers of function calls, factorizations, rejected steps and failures so far."""

    @property
    def steps_per_check(self) -> int:
        """Number of steps between two checks of limits, which include calls of `progress`."""

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin the smooth interval from `start` to `end` [s] at a consistent state.

        `branch` is a time [s] inside the interval, which selects the pieces of piecewise laws.
        """


class ResumableMethod(Protocol):
    """Method that also continues beyond the samples of controllers without a restart."""

    def resume(self, start: float, end: float, q: Array) -> State | None:
        """Continue an interval from its end `start` to `end` [s] after held inputs have jumped.

        Positions and velocities are continuous: `q` differs from the coordinates of the last step
        only in held inputs. Return the state after the jump; None if the method must begin a new
        interval, for example because it has been truncated or because the step changes.
        """


class StepMethod(Method, Protocol):
    """Method that returns one step per call."""

    def step(self) -> StepResult:
        """Take one step, at most to the end of the interval; return the new time [s] and state.

        An optional third value lists (time, state) of the inner stages in ascending order of time.
        The number of stages must be the same in every step. Output between steps and the energy
        balance use the stages; see `Interval`.

        Raises
        ------
        StepError
            If no step is possible.
        """


class LoopMethod(Method, Protocol):
    """Method that returns several steps per call.

    Attributes
    ----------
    rows_per_step
        Number of rows returned per step: 1 plus the number of inner stages.
    """

    rows_per_step: int

    def advance(self, most: int) -> Array:
        """Take 1 to `most` steps within the interval; return their rows (t, q, v, a, lam).

        Each step has `rows_per_step` rows, in ascending order of time.

        Raises
        ------
        StepError
            If no step is possible.
        """


class StepError(ArithmeticError):
    """Raised if a method cannot continue; the message gives the reason.

    Attributes
    ----------
    step
        Length of the step that failed [s]; 0 for methods that shorten their steps.
    """

    def __init__(self, message: str, step: float = 0.0) -> None:
        super().__init__(message)
        self.step = step


def allocate_rows(size: int, steps_per_check: int = STEPS_PER_CHECK) -> Array:
    """Return rows of `size` numbers that a compiled loop fills between two checks of limits."""
    rows = _MAX_ROW_BYTES // (np.dtype(float).itemsize * size)
    return np.zeros((min(max(rows, _MIN_ROWS), steps_per_check), size))


def clip_step(step: float, remaining: float) -> float:
    """Return the next step [s], so that the last step is not much shorter than those before it.

    If `step` covers `remaining`, this is `remaining`; otherwise `step`, but at most half of
    `remaining`.
    """
    return remaining if step >= _LAST_STEP_MARGIN * remaining else min(step, 0.5 * remaining)


def count_equal_steps(duration: float, step: float) -> int:
    """Return the smallest number of equal steps of at most `step` [s] that fill `duration` [s]."""
    return max(int(np.ceil(duration / step - _STEP_COUNT_ROUNDING)), 1)


def take_steps(method: Method, history: StepHistory, most: int, end: float) -> int:
    """Append up to `most` steps, none beyond `end` [s]; return the number of steps.

    Raises
    ------
    StepError
        If the method cannot continue, or if it returns steps whose times do not ascend, that pass
        `end`, or that differ in their number of stages.
    """
    if not hasattr(method, "advance"):
        t, state, *stages = cast("StepMethod", method).step()
        _require_progress(history, t, end)
        if not history.append(t, state, *stages):
            raise StepError(_UNORDERED_STAGES)
        return 1
    loop = cast("LoopMethod", method)
    rows = loop.advance(most)
    _require_progress(history, rows[-1, 0], end)
    if not history.extend(rows, loop.rows_per_step):
        raise StepError(STEP_TOO_SMALL)
    return len(rows) // loop.rows_per_step


def _require_progress(history: StepHistory, t: float, end: float) -> None:
    if t <= history.end:
        raise StepError(STEP_TOO_SMALL)
    if not t <= end:
        raise StepError(f"a step ended at t = {t:g} s, {_PAST_END}")
