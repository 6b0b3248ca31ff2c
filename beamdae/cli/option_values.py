"""Values of options: numbers with units, ranges, names, assignments and bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import typer

from beamdae.errors import BeamdaeError, require_count, short_repr, suggest
from beamdae.report.option_names import form_of_option

if TYPE_CHECKING:
    from beamdae.model_functions import Model

SPACED_FORMS = "START:STOP:COUNT or START:STOP:COUNT:log"
# Values of a range are rounded to this many digits, so that 0.3 is not 0.30000000000000004.
_SIGNIFICANT_DIGITS = 12


def parse_number(text: str, unit: str) -> float:
    """Return the number of an option such as "3000rpm" in a unit; without its unit, as it is.

    Raises
    ------
    typer.BadParameter
        If the text is not a number, or its unit is unknown or measures another quantity.
    """
    from beamdae import model_parameters

    try:
        value = model_parameters.parse_number("", "", text, unit)
    except BeamdaeError as problem:
        raise as_bad_parameter(text, problem) from None
    if value is None:
        raise typer.BadParameter(
            f"{short_repr(text)} is not a number in {unit}, with or without a unit."
        )
    return value


def parse_named_number(
    option: str, name: str, text: str, find_units: Callable[[], Mapping[str, str]]
) -> float:
    """Return the number of an option NAME=VALUE; one with a unit is converted to that of `name`.

    Parameters
    ----------
    find_units
        Function that returns the units by name; called for values with units only. The analysis
        rejects other names.

    Raises
    ------
    BeamdaeError
        If the text is not a number, or its unit is unknown or measures another quantity.
    """
    try:
        return float(text)
    except ValueError:
        pass
    from beamdae import model_parameters

    call = f"{option} {name}={text}" if name else f"{option} {text}"
    unit, quantity = find_units().get(name), model_parameters.parse_quantity(text)
    if unit is None and quantity is not None:
        return quantity[0]
    try:
        value = model_parameters.parse_number("", "", text, unit or "-")
    except BeamdaeError as problem:
        raise BeamdaeError(f"{call}: {_reason(problem)}") from None
    if value is None:
        raise BeamdaeError(f"{call}: the value must be a number, with or without a unit.")
    return value


def as_bad_parameter(text: str, problem: BeamdaeError) -> typer.BadParameter:
    """Return the error of an option for an error of its value, without the names of arguments."""
    return typer.BadParameter(f"{short_repr(text)}: {_reason(problem)}")


def _reason(problem: BeamdaeError) -> str:
    """Return the message of an error without the names of the call and its argument."""
    return str(problem).rpartition(": ")[2]


def parse_seconds(text: str) -> float:
    """Return the number of an option such as "20ms" in seconds; see `parse_number`."""
    return parse_number(text, "s")


def parse_accuracy(text: str) -> float:
    """Return the accuracy given by --accuracy as a fraction: 0.01 for "1%" or "0.01".

    Raises
    ------
    typer.BadParameter
        If the text is not a number with or without a percent sign.
    """
    number = text.strip()
    try:
        return 0.01 * float(number[:-1]) if number.endswith("%") else float(number)
    except ValueError:
        problem = f"must be a number such as 1% or 0.01, got {short_repr(text)}."
        raise typer.BadParameter(problem) from None


def parse_ends(
    option: str, name: str, text: str, unit: str, form: str = "FIRST:LAST"
) -> tuple[float, float]:
    """Return the ends of a range FIRST:LAST in `unit`; messages name the `form`.

    Raises
    ------
    BeamdaeError
        If the text has another form, a unit is unknown or measures another quantity, or one end
        has a unit and the other, neither zero nor infinite, has none: 10:3000rpm may mean 10 rad/s
        or 10 rpm.
    """
    from beamdae.model_parameters import parse_number

    parts = text.split(":")
    match [parse_number(option, name, x, unit) for x in parts]:
        case [float(first), float(last)]:
            pass
        case _:
            raise BeamdaeError(f"{option} {name}={text}: the values must have the form {form}.")
    depend_on_unit = all(x != 0.0 and math.isfinite(x) for x in (first, last))
    if _is_plain(parts[0]) != _is_plain(parts[1]) and depend_on_unit:
        raise BeamdaeError(
            f"{option} {name}={text}: one end has a unit and the other has none; give both a unit."
        )
    return first, last


def parse_spaced_values(
    option: str, name: str, text: str, unit: str, counts: tuple[int, int], forms: str
) -> list[float]:
    """Return the values of START:STOP:COUNT or, with equal ratios, START:STOP:COUNT:log.

    Parameters
    ----------
    counts
        Smallest and largest COUNT.
    forms
        Permitted forms of the text, for messages.

    Raises
    ------
    BeamdaeError
        As `parse_ends`, or if COUNT is missing or not permitted, or the ends are
        equal (with several values) or not positive (with :log).
    """
    import numpy as np

    call = f"{option} {name}={text}"
    parts = text.split(":")
    is_geometric = parts[3:] == ["log"]
    ends = parse_ends(option, name, ":".join(parts[:2]), unit, forms)
    try:
        count = float(parts[2]) if len(parts) == 3 + is_geometric else math.nan
    except ValueError:
        count = math.nan
    if not np.isfinite([*ends, count]).all():
        raise BeamdaeError(f"{call}: the values must have the form {forms}.")
    n_values = require_count(call, "COUNT", count, *counts)
    if is_geometric and min(ends) <= 0.0:
        raise BeamdaeError(f"{call}: both ends must be positive for :log.")
    if n_values > 1 and ends[0] == ends[1]:
        raise BeamdaeError(f"{call}: the ends of a range of {n_values} values must differ.")
    values = np.geomspace(*ends, n_values) if is_geometric else np.linspace(*ends, n_values)
    return [float(f"{value:.{_SIGNIFICANT_DIGITS}g}") for value in values]


def _is_plain(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def split_names(texts: str | Sequence[str] | None) -> list[str]:
    """Return the names in the values of an option, which are separated by commas."""
    values = [texts] if isinstance(texts, str) else texts or ()
    return [x.strip() for text in values for x in text.split(",") if x.strip()]


def parse_assignments(settings: list[str] | None, option: str = "--set") -> dict[str, str]:
    """Return the values of a repeated option NAME=VALUE by name.

    Raises
    ------
    BeamdaeError
        If an entry does not have this form, or two have the same name.
    """
    values: dict[str, str] = {}
    for setting in settings or []:
        key, equals, value = (part.strip() for part in setting.partition("="))
        if not equals or not key:
            raise BeamdaeError(
                f"{option} {setting}: the setting must have the form {form_of_option(option)}."
            )
        if key in values:
            raise BeamdaeError(
                f"{option} {setting}: {key} already has the value {values[key]}; omit one of them."
            )
        values[key] = value
    return values


def parse_bounds(model: Model, settings: list[str] | None) -> dict[str, tuple[float, float]]:
    """Return the bounds of --bounds NAME=LOW:HIGH by name, in the units of the parameters.

    Raises
    ------
    BeamdaeError
        If an entry does not have this form, the parameter is unknown, or a unit is unknown or
        measures another quantity.
    """
    bounds = {}
    for name, text in parse_assignments(settings, "--bounds").items():
        info = model.parameter_info.get(name)
        if info is None:
            names = list(model.parameter_info)
            raise BeamdaeError(
                f"--bounds {name}={text}: {model.name} has no parameter {name}"
                f"{suggest(name, names)}; its parameters are {', '.join(names)}."
            )
        low, _, high = text.partition(":")
        closed = f"{low or '-inf'}:{high or 'inf'}" if ":" in text else text
        form = "LOW:HIGH, LOW: or :HIGH, numbers with or without units"
        bounds[name] = parse_ends("--bounds", name, closed, info.unit, form)
    return bounds
