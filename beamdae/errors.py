"""What users are told by: errors, with the checks that raise them, and warnings of results."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from typing import Any


class BeamdaeError(ValueError):
    """A mistake in a model, a setting or a command.

    The message is one sentence that names the part, the value and what is allowed.
    """


class BeamdaeWarning(UserWarning):
    """A result that is not to be trusted as it stands.

    The message is one sentence that names the part, the value and what helps.
    """


class KernelWarning(UserWarning):
    """Kernels that cannot be compiled or kept: runs are slower, their numbers are the same.

    No `BeamdaeWarning`, which commands leave to the tables: it says nothing of a result.
    """


def finite(part: str, name: str, value: Any) -> float:
    """Return `value` as a float, or say that it is not a finite number."""
    if isinstance(value, (bool, str)):
        raise BeamdaeError(f"{part}: {name} must be a number, got {value!r}.")
    if not isinstance(value, (int, float)):
        try:
            value = float(value)
        except (TypeError, ValueError):
            raise BeamdaeError(f"{part}: {name} must be a number, got {value!r}.") from None
    if not math.isfinite(value):
        raise BeamdaeError(f"{part}: {name} must be finite, got {value}.")
    return float(value)


def positive(part: str, name: str, value: Any) -> float:
    """Return `value` as a float > 0."""
    number = finite(part, name, value)
    if number <= 0.0:
        raise BeamdaeError(f"{part}: {name} must be positive, got {number:g}.")
    return number


def non_negative(part: str, name: str, value: Any) -> float:
    """Return `value` as a float >= 0."""
    number = finite(part, name, value)
    if number < 0.0:
        raise BeamdaeError(f"{part}: {name} must not be negative, got {number:g}.")
    return number


def count(part: str, name: str, value: Any, least: int = 1) -> int:
    """Return `value` as a whole number >= `least`."""
    number = finite(part, name, value)
    if number != int(number) or number < least:
        raise BeamdaeError(
            f"{part}: {name} must be a whole number of at least {least}, got {value!r}."
        )
    return int(number)


def point(part: str, name: str, value: Any) -> tuple[float, float]:
    """Return `value` as a finite pair (x, y)."""
    try:
        x, y = value
    except (TypeError, ValueError):
        raise BeamdaeError(f"{part}: {name} must be a pair (x, y), got {value!r}.") from None
    return finite(part, f"{name} x", x), finite(part, f"{name} y", y)


def one_of(part: str, name: str, value: Any, allowed: Sequence[Any]) -> Any:
    """Return `value` if it is one of `allowed`."""
    if not any(type(value) is type(a) and value == a for a in allowed):
        names = ", ".join(repr(a) for a in allowed)
        raise BeamdaeError(
            f"{part}: {name} must be one of {names}, got {value!r}{nearest(value, allowed)}."
        )
    return value


def nearest(value: Any, allowed: Iterable[Any]) -> str:
    """A hint ' (did you mean ...?)' with the nearest allowed name, or nothing."""
    found = difflib.get_close_matches(str(value), [str(a) for a in allowed], n=1, cutoff=0.5)
    return f" (did you mean {found[0]!r}?)" if found else ""
