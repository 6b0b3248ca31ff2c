"""What everybody asks of an integrator."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, count, positive
from beamdae.results.solution import Solution

Array = np.ndarray

_LEAST_RTOL = 1e-14

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


class ByTolerance(Integrator):
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
    require_rtol(name, settings.rtol)
    if settings.max_step is not None:
        positive(name, "max_step", settings.max_step)
    require_limits(name, asdict(settings))


def require_rtol(name: str, rtol: Any) -> None:
    """Check a relative tolerance; below what rounding leaves there is nothing to gain."""
    if positive(name, "rtol", rtol) > 0.1:
        raise BeamdaeError(f"{name}: rtol must be at most 0.1, got {rtol:g}.")
    if rtol < _LEAST_RTOL:
        raise BeamdaeError(f"{name}: rtol must be at least {_LEAST_RTOL:g}, got {rtol:g}.")


def require_limits(name: str, settings: Mapping[str, Any]) -> None:
    """Check time_limit and max_steps, where an integrator has them."""
    if settings.get("time_limit") is not None:
        positive(name, "time_limit", settings["time_limit"])
    if settings.get("max_steps") is not None:
        count(name, "max_steps", settings["max_steps"])


def require_integrator(part: str, value: Any) -> Integrator:
    """Return `value` if it is an integrator as `Integrator` describes it."""
    if not isinstance(value, Integrator):
        raise BeamdaeError(
            f"{part}: integrator must be Ida(...), Radau(...), GeneralizedAlpha(...) or another "
            f"Integrator, got {value!r}."
        )
    if not is_dataclass(value):
        raise BeamdaeError(f"{part}: {value.method} must be a dataclass of its settings.")
    name = value.accuracy.name
    if name not in ("rtol", "step") or name not in {field.name for field in fields(value)}:
        raise BeamdaeError(
            f"{part}: the accuracy of {value.method} must be its field 'rtol' or 'step', "
            f"got {name!r}."
        )
    return value
