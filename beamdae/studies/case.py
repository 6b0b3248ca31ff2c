"""A case of a study: a model, its parameters, an integrator."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import product
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np

from beamdae.errors import BeamdaeError
from beamdae.integrators import GeneralizedAlpha, Ida, Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.model_functions import Model
from beamdae.results.files import versions
from beamdae.results.solution import Solution
from beamdae.simulation import simulate
from beamdae.studies.sources import own_texts


@dataclass(frozen=True)
class Case:
    """One run of a study.

    Parameters
    ----------
    model
        A model function.
    parameters
        Values in place of its defaults.
    integrator
        Ida(...), GeneralizedAlpha(...), Radau(...) or any other `Integrator`.
    """

    model: Model
    parameters: Mapping[str, Any] = field(default_factory=dict)
    integrator: Integrator = field(default_factory=Ida)

    def __post_init__(self) -> None:
        require_integrator("Case", self.integrator)

    @property
    def changed(self) -> dict[str, Any]:
        """Settings of the integrator that differ from their defaults."""
        chosen = {f.name: (getattr(self.integrator, f.name), f.default) for f in self._settings}
        return {name: value for name, (value, default) in chosen.items() if value != default}

    @property
    def _settings(self) -> list[Any]:
        # A limit of time changes nothing of the numbers.
        return [f for f in fields(self.integrator) if f.name != "time_limit"]  # type: ignore[arg-type]

    @property
    def label(self) -> str:
        """The integrator's label with whatever else differs from its defaults."""
        label = self.integrator.label
        more = [f"{k}={v}" for k, v in self.changed.items() if f"{k}=" not in label]
        return ", ".join([label.removesuffix(")"), *more]) + ")" if more else label

    @property
    def series(self) -> str:
        """The label with the name of step or tolerance alone: runs that make one curve."""
        refined = self.integrator.accuracy.name
        kept = [f"{k}={v}" for k, v in self.changed.items() if k != refined]
        return f"{self.integrator.method}({', '.join([refined, *kept])})"

    @property
    def group(self) -> str:
        """Model and parameters: cases that differ in their integrator alone share a reference."""
        values = ", ".join(f"{k}={v}" for k, v in self.parameters.items())
        return f"{self.model.name}({values})" if values else self.model.name

    def configured(self) -> Model:
        """The model with the parameters of the case as its defaults."""
        return replace(self.model, parameters=self.model.complete(dict(self.parameters)))

    def solve(
        self, t_end: float | None = None, output_step: float | None = None, progress: Any = None
    ) -> Solution:
        """Run it; see `simulate`."""
        return simulate(self.configured(), self.integrator, t_end, output_step, progress)

    def mechanism(self) -> str:
        """Hash of what the equations of motion depend on: source, model, parameters, versions."""
        parameters = self.model.complete(dict(self.parameters))
        return _digest([_source(self.model), self.model.name, parameters, versions()])

    def fingerprint(self, t_end: float, output_step: float) -> str:
        """Hash of all the result depends on."""
        settings = asdict(self.integrator)  # type: ignore[call-overload]
        code = _class_source(type(self.integrator))
        return _digest([self.mechanism(), code, settings, t_end, output_step])


def _digest(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, default=_identified)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def _identified(value: Any) -> Any:
    """What JSON cannot say of a value, so that different values are told apart."""
    if isinstance(value, np.ndarray):
        return [str(value.dtype), value.shape, hashlib.sha256(value.tobytes()).hexdigest()]
    if isinstance(value, np.generic):
        return value.item()
    return [type(value).__name__, hashlib.sha256(cloudpickle.dumps(value)).hexdigest()]


def _source(model: Model) -> list[Any]:
    """What a model's function is: the texts of the user's own files it may depend on.

    With the values it is closed over, and itself where it stands in no file.
    """
    function = inspect.unwrap(model.build)
    file = function.__code__.co_filename
    texts = own_texts(file)
    if not Path(file).is_file():
        texts.append(hashlib.sha256(cloudpickle.dumps(function)).hexdigest())
    return [texts, dict(inspect.getclosurevars(function).nonlocals)]


def _class_source(kind: type[Integrator]) -> list[Any]:
    """Name of a class, and the texts of the user's own files it may depend on."""
    file = inspect.unwrap(kind.integrate).__code__.co_filename
    return [kind.__module__, kind.__qualname__, own_texts(file)]


def default_integrators() -> tuple[Integrator, ...]:
    """The integrators a model is compared with unless others are named."""
    return (
        Ida(rtol=1e-4),
        Ida(rtol=1e-6),
        Radau(rtol=1e-4),
        GeneralizedAlpha(step=1e-3),
        GeneralizedAlpha(step=5e-4),
    )


def grid(**lists: Iterable[Any]) -> list[dict[str, Any]]:
    """All combinations of parameter values, the last name varying fastest.

    Examples
    --------
    >>> grid(elements=[4, 8], strain=["linear"])
    [{'elements': 4, 'strain': 'linear'}, {'elements': 8, 'strain': 'linear'}]
    """
    for name, values in lists.items():
        if isinstance(values, str) or not isinstance(values, Iterable):
            raise BeamdaeError(f"grid: {name} must be a list of values, got {values!r}.")
    return [dict(zip(lists, values, strict=True)) for values in product(*lists.values())]
