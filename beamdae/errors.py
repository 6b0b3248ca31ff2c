"""What users are told by: errors, with the checks that raise them, and warnings of results."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from itertools import islice
from numbers import Real
from pathlib import Path
from typing import Any

# No quantity in SI units is as large, and its fourth power is still a number.
_LARGEST = 1e75
_SMALLEST = 1e-75
_LONGEST_SHOWN = 80
# Letters of a path on any system.
_LONGEST_PATH = 4096


class BeamdaeError(ValueError):
    """A mistake in a model, a setting or a command.

    The message is one sentence that names the part, the value and what is allowed.
    """


class BeamdaeWarning(UserWarning):
    """A result that is not to be trusted as it stands.

    The message is one sentence that names the part, the value and what helps.
    """


class KernelWarning(UserWarning):
    """Machine code that cannot be had or kept: runs are slower, their numbers the same to rounding.

    No `BeamdaeWarning`, which commands leave to the tables: it says nothing of a result.
    """


def short_repr(value: Any) -> str:
    """A value as messages have it: on one line, short, without its place in memory."""
    try:
        text = repr(value)
    except Exception:
        # Such as whole numbers of thousands of digits.
        return f"a value of type {type(value).__name__}"
    return _shorten(text)


def format_exception(problem: BaseException) -> str:
    """Type and message of an exception of the user's own code, on one line."""
    return ": ".join(filter(None, (type(problem).__name__, format_message(problem))))


def format_message(problem: BaseException) -> str:
    """The message of an exception of the user's own code, on one line; CasADi's in other words."""
    trace = problem.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is not None and Path(trace.tb_frame.f_code.co_filename).parent.name == "casadi":
        return "shapes or kinds of CasADi expressions do not fit there"
    try:
        return _shorten(str(problem), 200).rstrip(".")
    except Exception:
        # Its own text may fail.
        return ""


def _shorten(text: str, longest: int = _LONGEST_SHOWN) -> str:
    whole = " ".join(re.sub(r" at 0x[0-9a-fA-F]+", "", text[: 10 * longest]).split())
    printable = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in whole)
    return printable if len(printable) <= longest else f"{printable[: longest - 3]}..."


def is_valid_path(text: str) -> bool:
    """Whether a text may be a path on any system: not too long, and free of control characters."""
    return text.isprintable() and len(text) <= _LONGEST_PATH


def as_real(value: Any) -> float | None:
    """Return `value` as a float if it is a real number, perhaps infinite, and None if not.

    Numbers of NumPy, fractions, decimals and arrays without dimensions are numbers; texts, truth
    values, lists of one number and symbols are not.
    """
    value = unbox_scalar(value)
    if isinstance(value, bool) or not isinstance(value, (Real, Decimal)):
        return None
    try:
        return float(value)
    except OverflowError:
        # Of whole numbers and fractions.
        return math.inf
    except ValueError:
        return math.nan


def unbox_scalar(value: Any) -> Any:
    """What an array without dimensions, or a number of NumPy, holds."""
    return value.item() if getattr(value, "ndim", None) == 0 else value


def require_finite(part: str, name: str, value: Any) -> float:
    """Return `value` as a float, or say that it is not a finite number."""
    found = as_real(value)
    if found is None:
        raise BeamdaeError(
            f"{part}: {name} must be a number, got {short_repr(unbox_scalar(value))}."
        )
    if not math.isfinite(found):
        raise BeamdaeError(f"{part}: {name} must be finite, got {short_repr(unbox_scalar(value))}.")
    if abs(found) > _LARGEST:
        raise BeamdaeError(
            f"{part}: {name} must lie within {_LARGEST:g} in absolute value, got {found:g}."
        )
    return found


def require_positive(part: str, name: str, value: Any) -> float:
    """Return `value` as a float > 0."""
    found = require_finite(part, name, value)
    if found <= 0.0:
        raise BeamdaeError(f"{part}: {name} must be positive, got {found:g}.")
    if found < _SMALLEST:
        raise BeamdaeError(f"{part}: {name} must be at least {_SMALLEST:g}, got {found:g}.")
    return found


def require_non_negative(part: str, name: str, value: Any) -> float:
    """Return `value` as a float >= 0."""
    found = require_finite(part, name, value)
    if found < 0.0:
        raise BeamdaeError(f"{part}: {name} must not be negative, got {found:g}.")
    return found


def require_count(part: str, name: str, value: Any, least: int = 1, most: int | None = None) -> int:
    """Return `value` as a whole number >= `least`, and <= `most` if that is given."""
    found = require_finite(part, name, value)
    if found != int(found) or found < least:
        raise BeamdaeError(
            f"{part}: {name} must be a whole number of at least {least}, "
            f"got {short_repr(unbox_scalar(value))}."
        )
    if most is not None and found > most:
        raise BeamdaeError(f"{part}: {name} must be at most {most}, got {found:g}.")
    return int(found)


def require_sequence(part: str, name: str, value: Any, what: str) -> list[Any]:
    """Return the entries of a list, a tuple or an array, `what` says of what; sets have no order.

    Texts, and whatever can be gone through only once, are no lists.
    """
    listed = isinstance(value, Sequence) and not isinstance(value, (str, bytes, bytearray))
    dimensions = getattr(value, "ndim", 0)
    if not listed and not (isinstance(dimensions, int) and dimensions > 0):
        raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.")
    return list(value)


def require_iterable(
    part: str, name: str, value: Any, what: str, most: int | None = None
) -> list[Any]:
    """Return what comes of going through `value` once, at most so many of it."""
    try:
        return list(islice(value, most))
    except Exception:  # Such as symbols, which are iterable in name alone.
        raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.") from None


def require_pair(part: str, name: str, value: Any, what: str = "a pair (x, y)") -> tuple[Any, Any]:
    """Return `value` as a pair, whatever of."""
    found = require_sequence(part, name, value, what)
    if len(found) != 2:
        raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.")
    return found[0], found[1]


def require_point(part: str, name: str, value: Any) -> tuple[float, float]:
    """Return `value` as a finite pair (x, y)."""
    x, y = require_pair(part, name, value)
    return require_finite(part, f"{name} x", x), require_finite(part, f"{name} y", y)


def require_choice(part: str, name: str, value: Any, allowed: Sequence[Any]) -> Any:
    """Return `value` if it is one of `allowed`."""
    value = unbox_scalar(value)
    if not any(type(value) is type(a) and value == a for a in allowed):
        names = ", ".join(repr(a) for a in allowed)
        raise BeamdaeError(
            f"{part}: {name} must be one of {names}, got {short_repr(value)}{suggest(value, allowed)}."
        )
    return value


def suggest(value: Any, allowed: Iterable[Any]) -> str:
    """A hint ' (did you mean ...?)' with the nearest allowed name, or nothing."""
    wanted = value[:_LONGEST_SHOWN] if isinstance(value, str) else short_repr(value)
    found = difflib.get_close_matches(wanted, [str(a) for a in allowed], n=1, cutoff=0.5)
    return f" (did you mean {found[0]!r}?)" if found else ""


def set_fields(instance: Any, **checked: Any) -> None:
    """Set fields of a frozen dataclass to their checked values: plain floats, tuples and texts."""
    for name, value in checked.items():
        object.__setattr__(instance, name, value)


_MAX_NAME_LENGTH = 100


def require_name(kind: str, name: Any) -> str:
    """Return `name` if it can name a part, a coordinate or an observable.

    Names become column headers of tables, as "name.x [m]".
    """
    if not isinstance(name, str) or not name.strip():
        raise BeamdaeError(f"{kind}: the name must be a non-empty text, got {short_repr(name)}.")
    # Spreadsheets read a cell that begins with one of these signs as a formula.
    if name[0] in "=+-@" or name != name.strip() or set(name) & set("[]"):
        raise BeamdaeError(
            f"{kind}: a name must not begin with =, +, - or @, hold brackets or begin or end with "
            f"a space, got {short_repr(name)}."
        )
    if len(name) > _MAX_NAME_LENGTH or not name.isprintable():
        raise BeamdaeError(
            f"{kind}: a name must be a text of at most {_MAX_NAME_LENGTH} letters without line breaks "
            f"and other control characters, got {short_repr(name)}."
        )
    return str(name)
