"""Range of a parameter of a model, over which a curve is followed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from beamdae.analysis.sensitivities.sensitivity_result import change_defaults
from beamdae.errors import (
    BeamdaeError,
    as_real,
    as_text,
    require_finite,
    require_pair,
    short_repr,
    suggest,
)
from beamdae.model_functions import Model, require_model_function


@dataclass(frozen=True, eq=False)
class ParameterRange:
    """Range of a numeric parameter of a model; shares of it run from 0 to 1.

    Attributes
    ----------
    model, name
        Model function, and name of its parameter.
    first, last
        Values of the parameter at which curves begin and end.
    """

    model: Model
    name: str
    first: float
    last: float

    @classmethod
    def of(
        cls,
        caller: str,
        model: Any,
        by: tuple[str, Any],
        values: tuple[str, Any],
        parameters: Any,
    ) -> ParameterRange:
        """Return the range, given pairs of argument and value for its parameter and its ends.

        `parameters` are values of other parameters, or None.

        Raises
        ------
        BeamdaeError
            If an argument is invalid.
        """
        require_model_function(caller, model)
        argument, name = by
        numbers = [key for key, value in model.parameters.items() if as_real(value) is not None]
        if as_text(name) not in numbers:
            raise BeamdaeError(
                f"{caller}: {argument} names {short_repr(name)}, which is not a numeric parameter "
                f"of {model.name}{suggest(name, numbers)}; use one of its parameters "
                f"({', '.join(numbers) or 'none'})."
            )
        argument, pair = values
        ends = require_pair(caller, argument, pair, "(first, last) value of the parameter")
        first, last = (require_finite(caller, argument, x) for x in ends)
        if first == last:
            raise BeamdaeError(
                f"{caller}: {argument} must be two different values, got {short_repr(pair)}."
            )
        model = change_defaults(caller, model, parameters)
        if parameters is not None and name in parameters:
            raise BeamdaeError(
                f"{caller}: parameters contains {name!r}, the parameter to follow; omit it."
            )
        return cls(model, name, first, last)

    def value(self, share: float) -> float:
        """Return the value of the parameter at a share of the range."""
        return self.last if share == 1.0 else (1.0 - share) * self.first + share * self.last

    def describe(self, share: float) -> str:
        """Return the text "parameter = value" for messages."""
        return f"{self.name} = {self.value(share):.6g}"

    def build(self, share: float) -> Any:
        """Return the mechanism at a share of the range."""
        return self.model(**{self.name: self.value(share)})
