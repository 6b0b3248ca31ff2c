"""Base classes of integrators, and checks of their settings."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae import deferred
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    format_distinct,
    plain_text,
    require_count,
    require_positive,
    set_fields,
    short_repr,
)
from beamdae.integrators.limits import Progress
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    from beamdae.integrators.method import Method
    from beamdae.integrators.run_plan import RunPlan

Array = np.ndarray

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
        solution: Solution = drive(self, equations, times, self.method_on, progress)
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
    """Check and convert the fields `rtol` and, if set, `max_step`, `max_steps` and `time_limit`.

    Raises
    ------
    BeamdaeError
        If a value is invalid.
    """
    name = type(settings).__name__
    rtol = require_positive(name, "rtol", settings.rtol)
    if not _MIN_RTOL <= rtol <= _MAX_RTOL:
        least, most, given = format_distinct(_MIN_RTOL, _MAX_RTOL, rtol)
        raise BeamdaeError(f"{name}: rtol must lie between {least} and {most}, got {given}.")
    set_fields(settings, rtol=rtol)
    if getattr(settings, "max_step", None) is not None:
        set_fields(settings, max_step=require_positive(name, "max_step", settings.max_step))
    require_limits(settings)


def require_limits(settings: Any) -> None:
    """Check and convert the optional fields `time_limit` [s] and `max_steps` of an integrator.

    Raises
    ------
    BeamdaeError
        If a value is invalid.
    """
    name = type(settings).__name__
    if getattr(settings, "time_limit", None) is not None:
        set_fields(settings, time_limit=require_positive(name, "time_limit", settings.time_limit))
    if getattr(settings, "max_steps", None) is not None:
        set_fields(settings, max_steps=require_count(name, "max_steps", settings.max_steps))


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
