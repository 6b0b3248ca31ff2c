"""Integrators: base classes of their settings, and the methods that take their steps."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np

from beamdae import deferred
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    optional,
    plain_text,
    require_between,
    require_count,
    require_positive,
    short_repr,
)
from beamdae.integrators.limits import Progress
from beamdae.integrators.step_history import StepHistory
from beamdae.results.outcome import Statistics
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    from beamdae.integrators.run_plan import RunPlan

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


# Default of adaptive integrators: deflections within 1 %, or 0.3 % with material damping.
DEFAULT_RTOL = 1e-4
# Rounding errors exceed smaller tolerances.
_MIN_RTOL = 1e-14
# Larger tolerances do not resolve the motion.
_MAX_RTOL = 0.1


class Accuracy(NamedTuple):
    """Setting that controls the accuracy: its name, "step" or "rtol", and its value."""

    name: str
    value: float


class Integrator(ABC):
    """Base class of the settings of integration methods.

    A subclass is a frozen dataclass of settings without run state. It defines `order` and
    `method_on`, and `accuracy` unless the accuracy is controlled by a field `step`. Override
    `integrate` for runs that `drive` does not supply.
    """

    @property
    def method(self) -> str:
        """Name of the method, for reports."""
        return type(self).__name__

    @property
    def accuracy(self) -> Accuracy:
        """Step [s] or relative tolerance: Accuracy("step", h) or Accuracy("rtol", rtol).

        The name is that of a field of the settings. Defaults to the field `step`.
        """
        step = getattr(self, "step", None)
        if step is None:
            raise BeamdaeError(
                f"{self.method}: the settings have no step; add a field `step` [s], or define the "
                "property `accuracy`."
            )
        return Accuracy("step", step)

    @property
    @abstractmethod
    def order(self) -> int:
        """Order p: errors of positions and velocities are proportional to step^p or rtol^p."""

    @property
    def label(self) -> str:
        """Name of the method with its step or rtol, for tables."""
        return f"{self.method}({self.accuracy.name}={self.accuracy.value:g})"

    @property
    def pilot(self) -> Integrator | None:
        """Integrator with the tolerance PILOT_RTOL for pilot runs; None (default) for none."""
        return None

    def method_on(self, plan: RunPlan) -> Method:
        """Return the object that takes the steps of a run.

        Parameters
        ----------
        plan
            Equations, duration, start and scales of the run.

        Returns
        -------
        Method
            A `StepMethod`, with one step per call, or a `LoopMethod`.
        """
        raise BeamdaeError(f"{self.method}: this integrator takes no steps; define `method_on`.")

    def integrate(
        self, equations: EquationsOfMotion, times: Array, progress: Progress | None = None
    ) -> Solution:
        """Integrate the equations over the output times and return the solution.

        By default, `drive` runs the method of `method_on`.

        Parameters
        ----------
        equations
            Equations of motion.
        times
            Ascending output times [s]; the run covers the range from the first to the last.
        progress
            Function called with the time reached [s]. If it returns a string, the run stops; the
            string becomes the reason.

        Returns
        -------
        Solution
            Motion at the output times. If the run stops early, the solution ends there and its
            status gives the reason.

        Raises
        ------
        BeamdaeError
            If the run cannot begin, for example because the model has no consistent start.
        Interrupted
            If Ctrl-C ends the run; with the solution as partial result. Integrators that do not use
            `drive` may return a solution with the status "interrupted" instead.
        """
        drive = deferred.module("integrators.drive").drive
        solution: Solution = drive(self, equations, times, progress)
        return solution


class AdaptiveIntegrator(Integrator):
    """Integrator with adaptive steps, controlled by its field `rtol`."""

    rtol: float

    @property
    def accuracy(self) -> Accuracy:
        """Relative tolerance: Accuracy("rtol", rtol)."""
        return Accuracy("rtol", self.rtol)

    @property
    def order(self) -> int:
        """1, because the errors of positions and velocities are proportional to rtol."""
        return 1


def require_tolerance(settings: Any) -> None:
    """Check and convert the field `rtol`, and those of `require_limits`.

    Raises
    ------
    BeamdaeError
        If a value is invalid.
    """
    convert_fields(settings, rtol=partial(require_between, least=_MIN_RTOL, most=_MAX_RTOL))
    require_limits(settings)


def require_limits(settings: Any) -> None:
    """Check and convert the optional fields `max_step`, `time_limit` [s] and `max_steps`.

    Raises
    ------
    BeamdaeError
        If a value is invalid.
    """
    converters = {
        "max_step": require_positive,
        "time_limit": require_positive,
        "max_steps": require_count,
    }
    own = {name: optional(x) for name, x in converters.items() if hasattr(settings, name)}
    convert_fields(settings, **own)


def require_integrator(part: str, value: Any) -> Integrator:
    """Return `value` if it is a valid `Integrator`.

    Raises
    ------
    BeamdaeError
        If `value` is not a valid integrator; the message begins with `part`.
    """
    if not isinstance(value, Integrator):
        raise BeamdaeError(
            f"{part}: integrator must be Ida(...), Radau(...), GeneralizedAlpha(...) or another "
            f"Integrator, got {short_repr(value)}."
        )
    if not is_dataclass(value):
        raise BeamdaeError(
            f"{part}: {value.method} must be a dataclass whose fields are the settings."
        )
    accuracy = value.accuracy
    if not isinstance(accuracy, Accuracy):
        raise BeamdaeError(
            f"{part}: the accuracy of {value.method} must be an Accuracy(name, value), "
            f"got {short_repr(accuracy)}."
        )
    name = plain_text(accuracy.name)
    field_names = [field.name for field in fields(value)]
    if not isinstance(name, str) or name not in ("rtol", "step") or name not in field_names:
        raise BeamdaeError(
            f"{part}: the accuracy of {value.method} must be named 'rtol' or 'step' "
            f"after one of its fields, got {short_repr(name)}."
        )
    return value
