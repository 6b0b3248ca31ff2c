"""Models as functions of single numbers: floats, and the entries of lists of floats."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from beamdae.analysis.sensitivities.sensitivity_result import select_parameters
from beamdae.model_functions import Model


@dataclass(frozen=True)
class FlatModel:
    """Model as a function of single numbers: floats, and the entries of lists of floats.

    Attributes
    ----------
    whole
        Model function with the values of its parameters.
    entries
        Name of the parameter and index of the entry, None for a float, by name of the number, such
        as "E" and "thickness[3]".
    """

    whole: Model
    entries: Mapping[str, tuple[str, int | None]]

    @property
    def name(self) -> str:
        """Name of the model function."""
        return self.whole.name

    @property
    def build(self) -> Callable[..., Any]:
        """The function behind the model function."""
        return self.whole.build

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the numbers."""
        values = self.whole.parameters
        return {
            name: float(values[key] if k is None else values[key][k])
            for name, (key, k) in self.entries.items()
        }

    def unflatten(self, numbers: Iterable[Any]) -> dict[str, Any]:
        """Return numbers by name of the parameter; a tuple for each list."""
        result: dict[str, Any] = {}
        for (key, k), number in zip(self.entries.values(), numbers, strict=True):
            result[key] = number if k is None else (*result.get(key, ()), number)
        return result

    def __call__(self, **values: float) -> Any:
        """Return the mechanism for other values of some of the numbers."""
        return self.whole(**self.change(values))

    def change(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return all parameters of the model for other values of some of the numbers."""
        parameters = dict(self.whole.parameters)
        for name, value in values.items():
            key, k = self.entries[name]
            if k is None:
                parameters[key] = value
            else:
                numbers = list(parameters[key])
                numbers[k] = value
                parameters[key] = type(parameters[key])(numbers)
        return parameters


def flatten_model(caller: str, model: Any, by: Any, parameters: Any) -> FlatModel:
    """Return the model as a function of the numbers in the parameters named in `by`.

    `caller` is the calling function, for messages.
    """
    names, model = select_parameters(caller, model, by, parameters, allows_lists=True)
    entries: dict[str, tuple[str, int | None]] = {}
    for name in names:
        if isinstance(model.parameters[name], float):
            entries[name] = (name, None)
        else:
            entries |= {f"{name}[{k}]": (name, k) for k in range(len(model.parameters[name]))}
    return FlatModel(model, entries)
