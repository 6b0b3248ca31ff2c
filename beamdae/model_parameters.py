"""Units and descriptions of model parameters, and values with units such as "850 mm"."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence, Set
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple, Self

from beamdae.errors import (
    BeamdaeError,
    NumberWithUnit,
    as_real,
    as_text,
    require_sequence,
    short_repr,
    suggest,
    unbox_scalar,
)

# Definitions of units with prefixes by symbol, in other units; base units are their own.
_UNITS = {
    "m": "1 m",
    "s": "1 s",
    "rad": "1 rad",
    "K": "1 K",
    "A": "1 A",
    "ε": "1",
    "strain": "1",
    "g": "0.001 kg",
    "N": "1 kg m/s^2",
    "Nm": "1 N m",
    "J": "1 N m",
    "W": "1 J/s",
    "Pa": "1 N/m^2",
    "Hz": "1 s^-1",
    "V": "1 W/A",
    "bar": "1e5 Pa",
    "Ncm": "0.01 N m",
    "Nmm": "0.001 N m",
    "gn": "9.80665 m/s^2",  # ISO 80000-3
}
_UNITS_WITHOUT_PREFIX = {
    "1": "1",
    "-": "1",
    "sec": "1 s",
    "min": "60 s",
    "h": "3600 s",
    "in": "0.0254 m",
    "ft": "0.3048 m",
    "lb": "0.45359237 kg",
    "lbf": "4.4482216152605 N",
    "kgf": "9.80665 N",
    "psi": "6894.757293168361 Pa",
    "ksi": "6894757.293168361 Pa",
    "kip": "4448.2216152605 N",
    "klbf": "4448.2216152605 N",
    "microstrain": "1e-6",
    "ue": "1e-6",  # as files without Greek letters write microstrain
    "µe": "1e-6",
    "μe": "1e-6",
    "ppm": "1e-6",
    "‰": "0.001",
    "%": "0.01",
}
_PREFIXES = {
    "": "1",
    "G": "1e9",
    "M": "1e6",
    "k": "1e3",
    "c": "1e-2",
    "m": "1e-3",
    "u": "1e-6",
    "µ": "1e-6",  # micro sign
    "μ": "1e-6",  # Greek letter, as many keyboards type it
    "n": "1e-9",
}
# Factor and unit by symbol; numbers have no unit. Factors are exact, but for those of angles.
_SYMBOLS: dict[str, tuple[Fraction | float, str]] = {
    "deg": (math.pi / 180.0, "rad"),
    "°": (math.pi / 180.0, "rad"),
    "rev": (2.0 * math.pi, "rad"),
    "rpm": (math.pi / 30.0, "rad/s"),
}
for _prefix, _size in _PREFIXES.items():
    for _symbol, _definition in (_UNITS if _prefix else _UNITS | _UNITS_WITHOUT_PREFIX).items():
        _number, _, _unit = _definition.partition(" ")
        _SYMBOLS[_prefix + _symbol] = Fraction(_size) * Fraction(_number), _unit
_FACTOR = re.compile(r"([^\W\d]+|°|‰|%|1|-)(?:\^?(-?[1-9]))?")
_PRODUCT = re.compile(r"[ *·⋅.]+|(?<=[^\W\d])-(?=[^\W\d])")
_SUPERSCRIPTS = str.maketrans("²³⁻¹", "23-1")
# Units that readers would take for others: "in" may be a word, and ms^-1 may be m/s.
_MISLEADING = re.compile(r"in\s+[\w°%].*|.*(?<![^\W\d])(?:ms|[^\W\d]?N[cm]?m)\^?-[1-9].*")
_ACCELERATION: Mapping[str, int] = {"m": 1, "s": -2}
_DENSITY: Mapping[str, int] = {"kg": 1, "m": -3}
_INERTIA: Mapping[str, int] = {"kg": 1, "m": 2}
# Spellings of rpm. A frequency per minute is a number of revolutions in practice.
_PER_MINUTE = {"1/min", "/min", "min^-1", "min-1", "r/min", "U/min"}
# The number is the longest one: "2.0" is no "2." with the unit "0".
_VALUE = re.compile(r"((?>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))\s*(\S.*)")
# Header that ends with a unit in brackets or parentheses.
_UNIT_AT_END = re.compile(r"(\S(?:.*\S)?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
_MAX_UNIT_LENGTH = 40

_PROSE = re.compile(r"``?(\w+)``? \[([^\[\]]+)\]")
# A line "radius : float" of a numpydoc section, or "radius [m]: radius of the arc".
_ENTRY = re.compile(r"\s*(\w+(?:, \w+)*)\s*(?:\[[^\[\]]+\]\s*)?:(?:\s|$)")
# A line "radius" of a numpydoc section; the description is indented further.
_BARE_ENTRY = re.compile(r"(\s*)(\w+(?:, \w+)*)\s*")
_IN_BRACKETS = re.compile(r"\[([^\[\]]+)\]")
_SENTENCE_END = re.compile(r"(?<=[.!?])\s+(?=[A-Z`])")


class ModelParameter(NamedTuple):
    """Parameter of a model: its name, default value, unit and description.

    The unit is "" if it is unknown, and "-" for a number without dimension.
    """

    name: str
    default: Any
    unit: str = ""
    description: str = ""


class _DescribedValue:
    """Unit and description of a default value, as a mixin of subclasses of built-in types."""

    unit: str
    description: str

    def __new__(cls, value: Any, unit: str, description: str) -> Self:
        described = super().__new__(cls, value)  # type: ignore[call-arg]
        described.unit, described.description = unit, description
        return described

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (plain_value(self), self.unit, self.description)


class _DescribedFloat(_DescribedValue, float):
    pass


class _DescribedInt(_DescribedValue, int):
    pass


class _DescribedTuple(_DescribedValue, tuple[float, ...]):
    pass


def param(default: float | Sequence[float], unit: str = "-", description: str = "") -> Any:
    """Return a default value with its unit and description, for a model function.

    The result is a number or a tuple of floats: it can be used in every formula. The function
    receives its values in this unit. Parts expect SI units and reject values of parameters with
    other units, such as "deg" or "N/mm", that the function has not converted. Users can write
    values in any unit of the same quantity anyway.

    Parameters
    ----------
    default
        Default value: a finite float or int, whose type is the type of the parameter, or a tuple or
        list of such numbers, such as (0.006, 0.004).
    unit
        Unit of the parameter, such as "m", "N m/rad" or "deg"; "-" for a number without dimension.
    description
        Short description, such as "radius of the arc".

    Returns
    -------
    float, int or tuple
        The number or the tuple of floats, with the attributes `unit` and `description`.

    Raises
    ------
    BeamdaeError
        If an argument has the wrong type, or a number is not finite.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=1.0)
    ... def swing(length=bd.param(0.85, "m", "length of the rope"), mass=2.0):
    ...     mech = bd.Mechanism(gravity=(0.0, -9.81))
    ...     bob = mech.add(bd.PointMass("bob", mass, at=(length, 0.0)))
    ...     mech.add(bd.Distance("rope", mech.ground.at(0.0, 0.0), bob.point))
    ...     return mech
    >>> swing.parameters
    {'length': 0.85, 'mass': 2.0}
    >>> swing.parameter_info["length"].unit
    'm'
    >>> swing.complete({"length": "850 mm"})
    {'length': 0.85, 'mass': 2.0}
    """
    value = plain_value(unbox_scalar(default))
    is_list = is_sequence(value)
    entries = require_sequence("param", "default", value, "numbers") if is_list else [value]
    numbers = [as_real(x) for x in entries]
    if not numbers or any(x is None or not math.isfinite(x) for x in numbers):
        raise BeamdaeError(
            "param: default must be a finite number or a tuple of them, got "
            f"{short_repr(default)}; write defaults of other types without param."
        )
    text, about = as_text(unit), as_text(description)
    if text is None or not text.strip() or not text.isprintable() or len(text) > _MAX_UNIT_LENGTH:
        raise BeamdaeError(
            f"param: unit must be a text such as 'm' or '-', got {short_repr(unit)}."
        )
    if about is None:
        raise BeamdaeError(f"param: description must be a text, got {short_repr(description)}.")
    details = text.strip(), " ".join(about.split())
    if is_list:
        return _DescribedTuple(numbers, *details)
    kind = _DescribedInt if isinstance(value, int) else _DescribedFloat
    return kind(value, *details)


def is_sequence(value: Any) -> bool:
    """Return True for tuples, lists and one-dimensional arrays."""
    try:
        return isinstance(value, (tuple, list)) or bool(getattr(value, "ndim", None) == 1)
    except Exception:
        # Attributes of other objects may raise any error.
        return False


def plain_value(value: Any) -> Any:
    """Return a value of `param` or of a model's arguments as a plain one; others unchanged."""
    if isinstance(value, (_DescribedFloat, NumberWithUnit)):
        return float(value)
    if isinstance(value, _DescribedTuple):
        return tuple(value)
    return int(value) if isinstance(value, _DescribedInt) else value


def describe_parameters(
    docstring: str, parameters: Mapping[str, Any], defaults: Mapping[str, Any]
) -> dict[str, ModelParameter]:
    """Return the parameters of a model function with their units and descriptions.

    Parameters
    ----------
    docstring
        Docstring of the function, see `read_docstring`.
    parameters
        Values by name.
    defaults
        Defaults in the signature of the function by name; those of `param` precede the docstring.
    """
    documented = read_docstring(docstring, tuple(parameters))
    described = {}
    for name, value in parameters.items():
        unit, description = documented.get(name, ("", ""))
        default = defaults.get(name)
        if isinstance(default, _DescribedValue):
            unit, description = default.unit, default.description or description
        described[name] = ModelParameter(name, value, unit, description)
    return described


@lru_cache(maxsize=256)
def read_docstring(docstring: str, names: tuple[str, ...]) -> Mapping[str, tuple[str, str]]:
    """Return the unit and the description of each parameter in a docstring, by name.

    A unit follows the name in the text, as in "`length` [m]", or is in the description of an entry,
    as in "radius : float" followed by "Radius of the arc [m]." Text in brackets that is not a unit
    is ignored, and so are different units of one parameter. The description is that of the entry or
    the first sentence that mentions the parameter; either is "" if missing.
    """
    documented = _read_entries(docstring, names)
    text = " ".join(docstring.split())
    units: dict[str, set[str]] = {name: set() for name in names}
    for name, unit in _PROSE.findall(text):
        if name in units and _is_unit(unit.strip()):
            units[name].add(unit.strip())
    sentences = _SENTENCE_END.split(text)
    for name in names:
        unit, description = documented.get(name, ("", ""))
        units[name] |= {unit} - {""}
        unit = units[name].pop() if len(units[name]) == 1 else ""
        mentions = (x for x in sentences if f"`{name}`" in x)
        description = description or next(mentions, "")
        if unit or description:
            documented[name] = unit, description
    return documented


def _is_unit(text: str) -> bool:
    # "[1]" is a citation.
    return text != "1" and parse_unit(text) is not None


def _read_entries(docstring: str, names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return the unit and description of each entry of a section "Parameters" or "Args"."""
    entries: dict[str, tuple[str, str]] = {}
    current: tuple[str, ...] = ()
    lines: list[str] = []

    def close() -> None:
        text = " ".join(" ".join(lines).split())
        units = [x.strip() for x in _IN_BRACKETS.findall(text)]
        unit = next((x for x in units if _is_unit(x)), "")
        colon = text.partition(":")[2].strip()
        # "radius : float" is followed by the description, "radius [m]: the radius" contains it.
        description = " ".join(" ".join(lines[1:]).split()) or colon
        entries.update(dict.fromkeys(current, (unit, description)))

    all_lines = [*docstring.splitlines(), ""]
    for line, below in zip(all_lines, [*all_lines[1:], ""], strict=True):
        match = _ENTRY.match(line)
        entry = tuple(match[1].split(", ")) if match else _find_bare_entry(line, below)
        if entry and set(entry) <= set(names):
            close()
            current, lines = entry, [line]
        elif not line.strip():
            close()
            current, lines = (), []
        elif current:
            lines.append(line)
    return entries


def _find_bare_entry(line: str, below: str) -> tuple[str, ...]:
    match = _BARE_ENTRY.fullmatch(line)
    is_entry = match and below.startswith(f"{match[1]} ") and below.strip()
    return tuple(match[2].split(", ")) if match and is_entry else ()


@lru_cache(maxsize=256)
def parse_unit(unit: str) -> tuple[Fraction | float, dict[str, int]] | None:
    """Return the factor to base units and the exponents of the base units; None if unknown.

    The base units are m, kg, s, rad, K and A. A product is written with spaces, `*`, `·`, `.` or
    `-`, and a quotient with `/`, as in "N m/rad"; each factor may have a prefix from n to G and an
    integer exponent. Numbers per minute are speeds of rotation. Units with several usual meanings,
    such as in-lb, kg/cm^2 and ms^-1, are unknown.
    """
    if len(unit) > _MAX_UNIT_LENGTH:
        return None
    unit = unit.translate(_SUPERSCRIPTS).replace("**", "^")
    if _MISLEADING.fullmatch(unit):
        return None
    if unit in _PER_MINUTE:
        unit = "rpm"
    factor: Fraction | float = Fraction(1)
    exponents: dict[str, int] = {}
    symbols = set()
    numerator, *denominators = unit.split("/")
    for sign, product in [(1, numerator), *((-1, x) for x in denominators)]:
        factors = product.strip()
        if factors.startswith("(") and factors.endswith(")"):
            factors = factors[1:-1]
        # Other parentheses are in no factor, so that units such as N/(m/s) are unknown.
        for text in _PRODUCT.split(factors):
            match = _FACTOR.fullmatch(text)
            symbol = None if match is None else _parse_symbol(match[1])
            if match is None or symbol is None:
                return None
            symbols.add(match[1])
            power = sign * int(match[2] or 1)
            factor = factor * symbol[0] ** power
            for base, exponent in symbol[1].items():
                exponents[base] = exponents.get(base, 0) + power * exponent
    exponents = {base: exponent for base, exponent in exponents.items() if exponent}
    return None if _is_weight(symbols, exponents) else (factor, exponents)


def _is_weight(symbols: Set[str], exponents: Mapping[str, int]) -> bool:
    """Return True if a unit of mass usually means a force, as in in-lb and kg/cm^2."""
    if exponents in (_DENSITY, _INERTIA):
        return False
    if "lb" in symbols:
        return not symbols.isdisjoint({"in", "ft"})
    is_metric = "kg" in symbols and not symbols.isdisjoint({"mm", "cm"})
    return is_metric and exponents.keys() == {"kg", "m"}


def _parse_symbol(text: str) -> tuple[Fraction | float, Mapping[str, int]] | None:
    if text not in _SYMBOLS:
        return None
    factor, unit = _SYMBOLS[text]
    if unit in ("", text):
        return factor, {unit: 1} if unit else {}
    parsed = parse_unit(unit)
    return parsed and (factor * parsed[0], parsed[1])


def conversion_factor(unit: str, target: str) -> Fraction | float | None:
    """Return the factor from one unit to another; None if they do not measure the same quantity.

    The unit g is the standard gravity if the other unit is that of an acceleration.
    """
    source, destination = parse_unit(unit), parse_unit(target)
    if destination is not None and unit in ("g", "mg") and destination[1] == _ACCELERATION:
        source = parse_unit(f"{unit}n")
    if source is None or destination is None or source[1] != destination[1]:
        return None
    return source[0] / destination[0]


def suggest_unit(unit: str, target: str = "") -> str:
    """Return the hint " (did you mean 'kN'?)" for an unknown unit such as "kn", or "" if none.

    With a `target`, only units of the same quantity are suggested.
    """
    spellings = _spellings()
    symbols = spellings.get(unit.casefold()) or [x for same in spellings.values() for x in same]
    if parse_unit(target) is not None:
        symbols = [x for x in symbols if conversion_factor(x, target) is not None]
    if unit.casefold() not in spellings:
        return suggest(unit, symbols)
    return f" (did you mean {' or '.join(map(repr, symbols))}?)" if symbols else ""


@lru_cache(maxsize=1)
def _spellings() -> dict[str, list[str]]:
    """Return the usual symbols with and without a prefix by their lower-case spelling."""
    spellings: dict[str, list[str]] = {}
    for symbol in _SYMBOLS:
        # Of units that differ in upper and lower case only, all are listed.
        spellings.setdefault(symbol.casefold(), []).append(symbol)
    return spellings


def split_unit(header: str) -> tuple[str, str]:
    """Return name and unit of a column header 'name [unit]'; the unit is '' if there is none."""
    name, bracket, unit = header.removesuffix("]").rpartition(" [")
    return (name, unit) if bracket and name and header.endswith("]") else (header, "")


_UNITS_OF_TIMES = ("h", "min")


def _resembles_unit(text: str) -> bool:
    """Return True for an unknown unit such as KN or lb/in; single letters are names."""
    words = re.findall(r"[^\W\d]+", text)
    known = (word.casefold() in _spellings() for word in words)
    return any(len(word) > 1 for word in words) and all(known)


def standardize_header(header: str) -> str:
    """Return a header of measured data, such as 't (ms)' or 't[ms]', in the form 't [ms]'.

    Text in parentheses is part of the name unless it is a unit or resembles one, such as "KN"; "h"
    and "min" are units of times only, because the latter often means a minimum.
    """
    # Spreadsheets write no-break spaces.
    text = header.replace("\xa0", " ").strip()
    match = _UNIT_AT_END.fullmatch(text)
    if match is None:
        return text
    name, in_brackets, in_parentheses = match.groups()
    unit = (in_parentheses if in_brackets is None else in_brackets).strip()
    is_unit = bool(unit) if in_brackets is not None else _is_unit(unit) or _resembles_unit(unit)
    is_time = name.casefold() in ("t", "time")
    if in_parentheses is not None and unit in _UNITS_OF_TIMES and not is_time:
        return text
    return f"{name} [{unit}]" if is_unit else text


def parse_value(part: str, name: str, text: str, unit: str) -> float | None:
    """Return the number of a text such as "850 mm" in the unit of the parameter.

    None if the text is not a number followed by a unit, or neither unit is known.

    Raises
    ------
    BeamdaeError
        If the parameter has no unit, or the unit of the text is unknown or measures another
        quantity.
    """
    match = _VALUE.fullmatch(text.strip())
    if match is None:
        return None
    number, symbol = match[1], match[2].strip()
    call = f"{part}: {name}={text}"
    source, target = parse_unit(symbol), parse_unit(unit)
    if not unit and source is None:
        return None
    if re.match(r",\d", symbol):
        raise BeamdaeError(
            f"{call}: the number contains a comma; write a decimal point, and no separators of "
            "thousands."
        )
    if not unit:
        raise BeamdaeError(
            f"{call}: the model states no unit of this parameter; give the number alone, or add "
            "the unit to the docstring of the model function."
        )
    ratio = Fraction(1) if symbol == unit else conversion_factor(symbol, unit)
    if ratio is None:
        problem = "is unknown" if source is None else "measures another quantity"
        if source is not None and target is None:
            problem = f"cannot be converted to {unit}"
        advice = "the number alone" if unit == "-" else f"the value in {unit}"
        hint = suggest_unit(symbol, unit) if source is None else ""
        raise BeamdaeError(f"{call}: the unit {symbol} {problem}{hint}; give {advice}.")
    value = float(number)
    if not math.isfinite(value) or value == 0.0:
        return value
    try:
        # The exact product: 850 mm are the float 0.85.
        return float(Fraction(number) * ratio) if isinstance(ratio, Fraction) else value * ratio
    except OverflowError:
        return math.copysign(math.inf, value)


def parse_number(part: str, name: str, text: str, unit: str) -> float | None:
    """Return the number of a text as `parse_value`, or without a unit as it is."""
    try:
        return float(text)
    except ValueError:
        return parse_value(part, name, text, unit)


def convert_text(part: str, name: str, value: Any, unit: str) -> Any:
    """Return a text such as "850 mm" or "850" as a number in the unit of the parameter `name`.

    Other values are returned unchanged. See `parse_value` for errors.
    """
    text = as_text(value)
    number = None if text is None else parse_number(part, name, text, unit)
    return value if number is None else number


def parse_quantity(text: str) -> tuple[float, str] | None:
    """Return a text such as "100 MPa" as a number in SI units and its unit, or None.

    The unit of a number without a unit is "".
    """
    try:
        return float(text), ""
    except ValueError:
        match = _VALUE.fullmatch(text.strip())
    unit = "" if match is None else match[2].strip()
    parsed = parse_unit(unit)
    if match is None or parsed is None:
        return None
    factor = parsed[0]
    exact = Fraction(match[1]) * factor if isinstance(factor, Fraction) else None
    try:
        return float(match[1]) * float(factor) if exact is None else float(exact), unit
    except OverflowError:
        return None


def format_with_unit(value: Any, unit: str) -> str:
    """Return a value and its unit as text; numbers have six significant digits."""
    text = f"{value:.6g}" if type(value) is float else str(value)
    return text if unit in ("", "-") else f"{text} {unit}"
