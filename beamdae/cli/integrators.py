"""Integrators by the options of commands."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from beamdae.errors import BeamdaeError, one_of


def integrator_of(name: str, options: dict[str, Any]) -> Any:
    """The integrator of a name with the options that were given, others being None.

    Raises
    ------
    BeamdaeError
        If there is none of the name, or it does not know an option.
    """
    from beamdae.integrators import Auto, GeneralizedAlpha, Ida, Radau

    kinds: dict[str, Any] = {
        "auto": Auto,
        "ida": Ida,
        "radau": Radau,
        "generalized-alpha": GeneralizedAlpha,
    }
    kind = kinds[one_of("run", "--integrator", name, tuple(kinds))]
    given = {option: value for option, value in options.items() if value is not None}
    for option in given:
        if option not in _settings(kind):
            flag = option.replace("_", "-")
            have = [other for other, kind in kinds.items() if option in _settings(kind)]
            raise BeamdaeError(
                f"run: --{flag} is no option of --integrator {name}, but of {' and '.join(have)}."
            )
    return kind(**given)


def _settings(kind: Any) -> set[str]:
    return {field.name for field in fields(kind)}
