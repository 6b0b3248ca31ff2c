"""Texts that terminals, figures and pages can display: printable characters and units."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from typing import Any

SUPERSCRIPTS = str.maketrans("-\N{MINUS SIGN}0123456789", "⁻⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Axes show values of 1e4 and more, and below 1e-2, in multiples of 1000 of their unit. Pages follow
# the same rule, see page/script/data.js.
_SMALL_EXPONENT, _LARGE_EXPONENT = -3, 4  # exponents of ten
_PREFIXES = {-9: "n", -6: "µ", -3: "m", 3: "k", 6: "M", 9: "G"}
_PREFIXED_UNIT = re.compile(r"(Pa|N|J|W|Hz|V|A)(?=$|[ /*·])")
_REDUCED_UNIT = re.compile(r"(m|rad|s)(?=$|[ /*·])")  # no usual prefix enlarges these


def make_printable(text: str) -> str:
    """Return the text on one line, with unprintable characters escaped.

    Tabs, line breaks and other white space become spaces.
    """
    return "".join(map(_escape, text))


def shorten_text(text: str, most: int) -> str:
    """Return the printable text, with its middle replaced by "…" beyond `most` characters."""
    text = make_printable(text)
    if len(text) <= most:
        return text
    remaining = most - 1
    tail = remaining // 2
    return f"{text[: remaining - tail]}…{text[len(text) - tail :]}"


def _escape(character: str) -> str:
    if character.isprintable():
        return character
    return " " if character.isspace() else character.encode("unicode_escape").decode()


def engineering_order(largest: float) -> int:
    """Return the power of ten, a multiple of 3, by which axes up to `largest` divide values."""
    if not 0.0 < largest < math.inf:
        return 0
    exponent = math.floor(math.log10(largest) + 1e-9)
    return 3 * (exponent // 3) if exponent >= _LARGE_EXPONENT or exponent <= _SMALL_EXPONENT else 0


def scale_unit(unit: str, order: int) -> str:
    """Return the unit of values that are divided by ten to the power `order`."""
    is_reduced = order < 0 and _REDUCED_UNIT.match(unit)
    if order in _PREFIXES and (is_reduced or _PREFIXED_UNIT.match(unit)):
        return _PREFIXES[order] + unit
    power = f"10{str(order).translate(SUPERSCRIPTS)}" if order else ""
    return f"{power} {'' if order and unit == '-' else unit}".strip()


def format_json(data: Any, default: Callable[[Any], Any], **layout: Any) -> str:
    """Return data as JSON text, in which numbers that are not finite are null.

    `default` converts other values to those of JSON, and `layout` are arguments of `json.dumps`.
    """
    plain = json.loads(json.dumps(data, default=default), parse_constant=lambda _: None)
    return json.dumps(plain, **layout)
