"""What everybody asks of an integrator."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, require_count, require_positive, set_fields, short_repr
from beamdae.results.solution import Solution

Array = np.ndarray

# Bounds of rtol: below them rounding decides, above them nothing is resolved.
_MIN_RTOL, _MAX_RTOL = 1e-14, 0.1

# Told the time reached; a text it answers is the reason to stop there.
Progress = Callable[[float], str | None]


class Accuracy(NamedTuple):
    """The number an integrator is refined by: the name of its field, and its value."""

    name: str
    value: float


class Integrator(ABC):
    """Settings of one method: a frozen dataclass that keeps nothing of a run.

    `accuracy` names one of its fields, "step" or "rtol", and the error of a run falls with that
    number to the power `order`. Studies, references and tables ask for nothing else.
    """

    @property
    def method(self) -> str:
        """Name of the method."""
        return type(self).__name__

    @property
    @abstractmethod
    def accuracy(self) -> Accuracy:
        """Step [s] or relative tolerance, whichever it goes by: ("step", h) or ("rtol", rtol)."""

    @property
    @abstractmethod
    def order(self) -> int:
        """Power of `accuracy` with which the error of a run falls: 1 where that is a tolerance."""

    @property
    def label(self) -> str:
        """Short name for tables."""
        return f"{self.method}({self.accuracy.name}={self.accuracy.value:g})"

    @abstractmethod
    def integrate(
        self, equations: EquationsOfMotion, times: Array, progress: Progress | None = None
    ) -> Solution:
        """Integrate from times[0] to times[-1]; `times` ascend and are the output times [s].

        A run that fails returns what it reached, with the reason as its status.

        Raises
        ------
        BeamdaeError
            If the model has no consistent start.
        """


class AdaptiveIntegrator(Integrator):
    """An integrator that is refined by its field `rtol`."""

    rtol: float

    @property
    def accuracy(self) -> Accuracy:
        """The relative tolerance."""
        return Accuracy("rtol", self.rtol)

    @property
    def order(self) -> int:
        """The error of a run falls with rtol."""
        return 1


def require_tolerance(settings: Any) -> None:
    """Check rtol, max_step, max_steps and time_limit of an integrator with adaptive steps."""
    name = type(settings).__name__
    rtol = require_positive(name, "rtol", settings.rtol)
    if not _MIN_RTOL <= rtol <= _MAX_RTOL:
        raise BeamdaeError(
            f"{name}: rtol must lie between {_MIN_RTOL:g} and {_MAX_RTOL:g}, got {rtol:g}."
        )
    set_fields(settings, rtol=rtol)
    if getattr(settings, "max_step", None) is not None:
        set_fields(settings, max_step=require_positive(name, "max_step", settings.max_step))
    require_limits(settings)


def require_limits(settings: Any) -> None:
    """Check time_limit and max_steps, where an integrator has them."""
    name = type(settings).__name__
    if getattr(settings, "time_limit", None) is not None:
        set_fields(settings, time_limit=require_positive(name, "time_limit", settings.time_limit))
    if getattr(settings, "max_steps", None) is not None:
        set_fields(settings, max_steps=require_count(name, "max_steps", settings.max_steps))


def require_integrator(part: str, value: Any) -> Integrator:
    """Return `value` if it is an integrator as `Integrator` describes it."""
    if not isinstance(value, Integrator):
        raise BeamdaeError(
            f"{part}: integrator must be Ida(...), Radau(...), GeneralizedAlpha(...) or another "
            f"Integrator, got {short_repr(value)}."
        )
    if not is_dataclass(value):
        raise BeamdaeError(f"{part}: {value.method} must be a dataclass of its settings.")
    accuracy = value.accuracy
    if not isinstance(accuracy, Accuracy):
        raise BeamdaeError(
            f"{part}: the accuracy of {value.method} must be an Accuracy of name and value, "
            f"got {short_repr(accuracy)}."
        )
    name = accuracy.name
    own = [field.name for field in fields(value)]
    if not isinstance(name, str) or name not in ("rtol", "step") or name not in own:
        raise BeamdaeError(
            f"{part}: the accuracy of {value.method} must be its field 'rtol' or 'step', "
            f"got {short_repr(name)}."
        )
    return value
