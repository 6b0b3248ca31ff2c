"""Rules for the content of result files: types, ranges and lengths, and shapes of arrays.

A rule is a function that does nothing if a value is allowed, and raises `FieldError` otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError, require_finite, short_repr, suggest

Array = np.ndarray
Rule = Callable[[Any], None]

MAX_TEXT = 1_000_000  # characters of a text, such as the warnings of a long run
MAX_INTEGER = 2**63 - 1  # larger integers fit into no array
_MAX_QUOTED = 100  # characters of a text that are passed to `short_repr`
# Control characters would be executed by a terminal; line breaks and tabs are part of messages.
_CONTROL_CHARACTERS = {k: None for k in (*range(32), *range(127, 160)) if chr(k) not in "\n\r\t"}


class FieldError(Exception):
    """Raised for a field with a value that is not allowed.

    Attributes
    ----------
    problem
        Violation of the rule, such as "is missing".
    fields
        Names of the field and of the objects that contain it, from the innermost to the outermost;
        empty if the content as a whole violates the rule.
    """

    def __init__(self, problem: str, *fields: str) -> None:
        super().__init__(problem)
        self.problem = problem
        self.fields = list(fields)

    def __str__(self) -> str:
        path = ".".join(short_repr(name)[1:-1] for name in reversed(self.fields))
        return f"{path or 'the content'} {self.problem}"


def describe(value: Any) -> str:
    """Return a short description of a JSON value; large values are not formatted as a whole."""
    if isinstance(value, dict):
        return f"an object with {len(value)} entries"
    if isinstance(value, (list, tuple)):
        return f"a list with {len(value)} entries"
    return short_repr(value[:_MAX_QUOTED] if isinstance(value, str) else value)


def wrong_value(allowed: str, value: Any) -> FieldError:
    """Return the error for a value; `allowed` completes the sentence "FIELD must be ..."."""
    return FieldError(f"must be {allowed}, got {describe(value)}")


def number(
    least: float = -math.inf, most: float = math.inf, finite: bool = True, optional: bool = False
) -> Rule:
    """Return the rule for a number from `least` to `most`.

    `finite` excludes inf and NaN, and `optional` allows None.
    """
    bounds = " and ".join(
        [f"of at least {least:g}"] * (least > -math.inf) + [f"at most {most:g}"] * (most < math.inf)
    )
    allowed = " ".join(
        filter(None, ["a", "finite" * finite, "number", bounds, "or null" * optional])
    )

    def check(value: Any) -> None:
        if type(value) is float:
            if (least <= value <= most and (not finite or math.isfinite(value))) or (
                value != value and not finite
            ):
                return
        elif (type(value) is int and abs(value) <= MAX_INTEGER and least <= value <= most) or (
            optional and value is None
        ):
            return
        raise wrong_value(allowed, value)

    return check


def start_value(value: Any) -> None:
    """Require a number that is allowed as an initial condition, see `require_finite`."""
    number()(value)
    try:
        require_finite("", "", value)
    except BeamdaeError:
        raise wrong_value("a number that is allowed as an initial condition", value) from None


def integer(least: int = -MAX_INTEGER, most: int = MAX_INTEGER) -> Rule:
    """Return the rule for a whole number from `least` to `most`."""
    allowed = f"a whole number from {least} to {most}"
    if most == MAX_INTEGER:
        allowed = f"a whole number of at least {least}"

    def check(value: Any) -> None:
        if not (type(value) is int and least <= value <= most):
            raise wrong_value(allowed, value)

    return check


def flag(value: Any) -> None:
    """Require true or false."""
    if type(value) is not bool:
        raise wrong_value("true or false", value)


def text(value: Any) -> None:
    """Require a string of at most 1e6 characters.

    Line breaks and tabs are the only control characters allowed.
    """
    if type(value) is not str or len(value) > MAX_TEXT:
        raise wrong_value(f"a text of at most {MAX_TEXT} characters", value)
    if not value.isprintable() and len(value.translate(_CONTROL_CHARACTERS)) < len(value):
        raise wrong_value("a text without control characters", value)


def column_name(value: Any) -> None:
    """Require a printable string, such as the header of a column."""
    text(value)
    if not value.isprintable():
        raise wrong_value("a printable text", value)


def choice(*choices: Any) -> Rule:
    """Return the rule for a value that equals one of `choices` in type and value."""
    allowed = f"one of {', '.join(map(repr, choices))}" if len(choices) > 1 else repr(choices[0])

    def check(value: Any) -> None:
        if not any(type(value) is type(x) and value == x for x in choices):
            raise FieldError(f"must be {allowed}, got {describe(value)}{_hint(value, choices)}")

    return check


def _hint(value: Any, choices: Iterable[Any]) -> str:
    return suggest(value[:_MAX_QUOTED], choices) if isinstance(value, str) else ""


def optional(rule: Rule) -> Rule:
    """Return the rule that allows None and the values that `rule` allows."""

    def check(value: Any) -> None:
        if value is not None:
            rule(value)

    return check


def anything(value: Any) -> None:
    """Allow every JSON value: the entry is only displayed or copied."""


def scalar(value: Any) -> None:
    """Require a number, true, false, null or a string."""
    if type(value) is str:
        text(value)
    elif type(value) is int:
        integer()(value)
    elif not (value is None or type(value) in (bool, float)):
        raise wrong_value("a number, a text, true, false or null", value)


def sequence(rule: Rule, lengths: Iterable[int] | None = None) -> Rule:
    """Return the rule for a list whose entries obey `rule`.

    The length of the list must be one of `lengths`, unless `lengths` is None.
    """
    allowed_lengths = None if lengths is None else tuple(dict.fromkeys(lengths))

    def check(value: Any) -> None:
        if type(value) is not list:
            raise wrong_value("a list", value)
        if allowed_lengths is not None and len(value) not in allowed_lengths:
            counts = " or ".join(map(str, allowed_lengths))
            raise wrong_value(f"a list with {counts} entries", value)
        for k, entry in enumerate(value):
            try:
                rule(entry)
            except FieldError as problem:
                problem.fields.append(str(k))
                raise

    return check


def numbers(lengths: Iterable[int] | None = None, gaps: bool = False) -> Rule:
    """Return a fast rule for a list of finite numbers; `gaps` allows None among the numbers.

    For `lengths`, see `sequence`.
    """
    slow = sequence(number(optional=gaps), lengths)
    allowed_lengths = None if lengths is None else set(lengths)
    types = {float, type(None)} if gaps else {float}

    def check(value: Any) -> None:
        is_plain = (
            type(value) is list
            and (allowed_lengths is None or len(value) in allowed_lengths)
            and set(map(type, value)) <= types
        )
        # Neither None nor zero.
        if not (is_plain and all(map(math.isfinite, filter(None, value)))):
            slow(value)

    return check


def mapping(rule: Rule) -> Rule:
    """Return the rule for an object with any names, whose values obey `rule`."""

    def check(value: Any) -> None:
        if type(value) is not dict:
            raise wrong_value("an object", value)
        for name, entry in value.items():
            try:
                text(name)
                rule(entry)
            except FieldError as problem:
                problem.fields.append(name[:_MAX_QUOTED])
                raise

    return check


def record(
    required: Mapping[str, Rule],
    optional_fields: Mapping[str, Rule] | None = None,
    others: bool = False,
) -> Rule:
    """Return the rule for an object with the given fields; `others` allows further fields."""
    rules = {**required, **(optional_fields or {})}

    def check(value: Any) -> None:
        if type(value) is not dict:
            raise wrong_value("an object", value)
        for name in required:
            if name not in value:
                raise FieldError("is missing", name)
        for name, entry in value.items():
            if name not in rules and not others:
                raise FieldError(f"is not a field of this file, only {', '.join(rules)}", name)
            try:
                rules.get(name, anything)(entry)
            except FieldError as problem:
                problem.fields.append(name)
                raise

    return check


@dataclass(frozen=True)
class ArrayRule:
    """Rule for an array in an archive.

    Attributes
    ----------
    shape
        Sizes: numbers, or names of sizes that several arrays share.
    kind
        Kind of the numbers: "f" for 8-byte floats, "i" for 4- or 8-byte integers, "u" for bytes.
    finite
        True if floats must be finite.
    """

    shape: tuple[str | int, ...]
    kind: str = "f"
    finite: bool = True

    def check_header(self, name: str, header: ArrayHeader, sizes: dict[str, int]) -> None:
        """Check type and shape; named sizes that are not in `sizes` are added to it."""
        types = {"f": (8,), "i": (4, 8), "u": (1,)}[self.kind]
        if header.dtype.kind != self.kind or header.dtype.itemsize not in types:
            raise FieldError(
                f"must be an array of {_KIND_NAMES[self.kind]}, got {short_repr(header.dtype)}",
                name,
            )
        expected = tuple(sizes.get(x, x) if isinstance(x, str) else x for x in self.shape)
        matches = len(header.shape) == len(expected) and all(
            isinstance(x, str) or x == size for x, size in zip(expected, header.shape, strict=True)
        )
        if not matches:
            shape = ", ".join(str(x) for x in expected)
            raise FieldError(f"must have the shape ({shape}), got {header.shape}", name)
        named = zip(expected, header.shape, strict=True)
        sizes.update({x: size for x, size in named if isinstance(x, str)})

    def check_values(self, name: str, array: Array) -> None:
        """Check that the values are finite, if required."""
        if self.finite and self.kind == "f" and not np.isfinite(array).all():
            raise FieldError("must contain only finite numbers, got inf or nan", name)


_KIND_NAMES = {"f": "8-byte floats", "i": "integers", "u": "bytes"}


@dataclass(frozen=True)
class ArrayHeader:
    """Shape, type, order and size of an array in an archive, read before the array.

    Attributes
    ----------
    shape, dtype
        Shape and type.
    is_fortran
        True if the first index varies fastest.
    size
        Size of the header itself [bytes].
    """

    shape: tuple[int, ...]
    dtype: np.dtype
    is_fortran: bool
    size: int

    @property
    def array_bytes(self) -> int:
        """Size of the array [bytes]."""
        return math.prod(self.shape) * self.dtype.itemsize


def require_ascending(name: str, values: Array) -> None:
    """Require that values ascend strictly."""
    if not (np.diff(values) > 0.0).all():
        raise FieldError("must ascend", name)


def require_equal(name: str, value: Any, other: str, expected: Any) -> None:
    """Require that two fields agree; `other` is the name of the field with the expected value."""
    if value != expected:
        raise FieldError(f"must equal {other}, {describe(expected)}, got {describe(value)}", name)
