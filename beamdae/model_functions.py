"""Model functions: keyword defaults are the parameters, calling them builds a mechanism."""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from beamdae.errors import BeamdaeError, nearest, positive


@dataclass(frozen=True)
class Model:
    """A function with named parameters that builds a mechanism (or a constrained system).

    Attributes
    ----------
    build
        The decorated function.
    t_end
        Default end time [s].
    parameters
        Defaults by name; their types are the types of the parameters.
    """

    build: Callable[..., Any]
    t_end: float
    parameters: dict[str, Any]

    @property
    def name(self) -> str:
        """Name of the function."""
        return self.build.__name__

    @property
    def summary(self) -> str:
        """First line of the docstring of the function, or of its module."""
        of_file = inspect.unwrap(self.build).__globals__.get("__doc__")
        lines = (self.build.__doc__ or of_file or "").strip().splitlines()
        return lines[0] if lines else ""

    def __call__(self, **values: Any) -> Any:
        """Build the mechanism, with `values` in place of the defaults."""
        return self.build(**self.complete(values))

    def complete(self, values: dict[str, Any]) -> dict[str, Any]:
        """All parameters, checked: `values` over the defaults.

        Raises
        ------
        BeamdaeError
            On an unknown name or a value of the wrong type.
        """
        for name in values:
            if name not in self.parameters:
                allowed = ", ".join(self.parameters) or "none"
                raise BeamdaeError(
                    f"{self.name}: no parameter {name!r}{nearest(name, self.parameters)}, "
                    f"the parameters are {allowed}."
                )
        checked = {name: self._typed(name, value) for name, value in values.items()}
        return self.parameters | checked

    def _typed(self, name: str, value: Any) -> Any:
        kind = type(self.parameters[name])
        if hasattr(value, "item") and getattr(value, "ndim", None) == 0:
            value = value.item()
        if isinstance(value, str) and kind is not str:
            value = self._parsed(name, value, kind)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if kind is int and isinstance(value, float) and value.is_integer():
            value = int(value)
        if kind is not type(None) and not isinstance(value, kind):
            raise BeamdaeError(
                f"{self.name}: {name} must be of type {kind.__name__}, got {value!r}."
            )
        if isinstance(value, float) and not math.isfinite(value):
            raise BeamdaeError(f"{self.name}: {name} must be finite, got {value}.")
        return value

    def _parsed(self, name: str, text: str, kind: type) -> Any:
        if kind is bool:
            if text.lower() in ("true", "false"):
                return text.lower() == "true"
            raise BeamdaeError(f"{self.name}: {name} must be true or false, got {text!r}.")
        if kind is type(None):
            return text
        try:
            return ast.literal_eval(text) if kind in (tuple, list, dict) else kind(text)
        except (TypeError, ValueError, SyntaxError):
            raise BeamdaeError(
                f"{self.name}: {name} must be of type {kind.__name__}, got {text!r}."
            ) from None


def model(*, t_end: float) -> Callable[[Callable[..., Any]], Model]:
    """Decorate a function that builds a mechanism; `t_end` is its default end time [s].

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=1.0)
    ... def swing(mass=2.0):
    ...     mech = bd.Mechanism(gravity=(0.0, -9.81))
    ...     mech.add(bd.PointMass("bob", mass, at=(1.0, 0.0)))
    ...     return mech
    >>> swing.parameters
    {'mass': 2.0}
    """
    positive("model", "t_end", t_end)

    def decorate(function: Callable[..., Any]) -> Model:
        parameters = {}
        for parameter in inspect.signature(function).parameters.values():
            if parameter.default is parameter.empty:
                raise BeamdaeError(
                    f"{function.__name__}: the parameter {parameter.name!r} needs a default value."
                )
            parameters[parameter.name] = parameter.default
        return Model(function, float(t_end), parameters)

    return decorate
