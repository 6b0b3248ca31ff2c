"""Ranges of numbers in options: FIRST:LAST and START:STOP:COUNT, whose ends may have units."""

from __future__ import annotations

import math

from beamdae.errors import BeamdaeError, require_count

SPACED_FORMS = "START:STOP:COUNT or START:STOP:COUNT:log"
# Values of a range are rounded to this many digits, so that 0.3 is not 0.30000000000000004.
_SIGNIFICANT_DIGITS = 12


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
