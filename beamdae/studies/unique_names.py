"""Unique labels of cases, and unique file names made from them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable

from beamdae.model_functions import MAX_NAME_BYTES

# All characters but letters, digits, underscores, =, . and +, which have no special meaning in file
# systems and shells.
_INVALID_CHARACTERS = re.compile(r"[^\w=.+]+")


def number_duplicates(names: Iterable[str]) -> list[str]:
    """Return the names; a number is appended to repeated names, as in "name (2)"."""
    return _number_names(names, "{} ({})", str)


def create_file_names(cases: Iterable[tuple[str, str]]) -> list[str]:
    """Return unique file names without suffix for (group, label) pairs of cases.

    The names never differ only in upper and lower case, which some file systems ignore.
    """
    return _number_names((_create_file_name(*names) for names in cases), "{}-{}", str.casefold)


def _number_names(
    names: Iterable[str], template: str, comparison_key: Callable[[str], str]
) -> list[str]:
    unique: dict[str, str] = {}
    # Continuing from the last number of a name makes the time linear in the number of names.
    last_numbers: dict[str, int] = {}
    for name in names:
        number, candidate = last_numbers.get(comparison_key(name), 1), name
        while comparison_key(candidate) in unique:
            number += 1
            candidate = template.format(name, number)
        last_numbers[comparison_key(name)] = number
        unique[comparison_key(candidate)] = candidate
    return list(unique.values())


def _create_file_name(group: str, label: str) -> str:
    method = _shorten(_replace_invalid(label), MAX_NAME_BYTES // 2)
    return f"{_shorten(_replace_invalid(group), MAX_NAME_BYTES - len(method.encode()))}-{method}"


def _replace_invalid(text: str) -> str:
    return _INVALID_CHARACTERS.sub("-", unicodedata.normalize("NFC", text)).strip("-.")


def _shorten(text: str, max_bytes: int) -> str:
    """Shorten a long text to its two ends, because names may differ at either end."""
    encoded = text.encode()
    if len(encoded) <= max_bytes:
        return text
    half = (max_bytes - 2) // 2
    ends = encoded[:half], encoded[-half:]
    return "--".join(end.decode(errors="ignore").strip("-.") for end in ends)
