"""What the options of a command ask for: a model with its parameters, an integrator."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae.cli.options import INTEGRATORS, assignments
from beamdae.cli.output import record
from beamdae.errors import BeamdaeError, require_choice

if TYPE_CHECKING:
    from beamdae.model_functions import Model


def configured(path: Path, name: str | None, settings: list[str] | None) -> Model:
    """The model of a file with the values of --set as its defaults."""
    from beamdae.cli.model_files.model_file import load_model

    model = load_model(path, name)
    model = replace(model, parameters=model.complete(assignments(settings)))
    record(lambda: {"model": {"name": model.name, "parameters": model.parameters}})
    return model


def integrator_of(command: str, name: str, options: dict[str, Any]) -> Any:
    """The integrator of a name, with those of the options that are given."""
    from beamdae.integrators import Auto, GeneralizedAlpha, Ida, Radau

    kinds: dict[str, Any] = dict(
        zip(INTEGRATORS, (Auto, Ida, Radau, GeneralizedAlpha), strict=True)
    )
    kind = kinds[require_choice(command, "--integrator", name, tuple(kinds))]
    given = {option: value for option, value in options.items() if value is not None}
    for option in given:
        if option not in _settings(kind):
            flag = option.replace("_", "-")
            have = [other for other, kind in kinds.items() if option in _settings(kind)]
            raise BeamdaeError(
                f"{command}: --{flag} is no option of --integrator {name}, but of "
                f"{' and '.join(have)}."
            )
    return kind(**given)


def _settings(kind: Any) -> set[str]:
    return {field.name for field in fields(kind)}
