"""Names that tell runs apart, for readers and for file systems."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable

# File systems have room for 255 bytes, paths for less than one likes.
_MAX_NAME_BYTES = 120
# Letters and digits of any script, and what no file system or shell minds.
_INVALID_CHARACTERS = re.compile(r"[^\w=.+]+")


def number_duplicates(names: Iterable[str]) -> list[str]:
    """The names, with a number to those that have been there before."""
    return _number_names(names, "{} ({})", str)


def create_file_names(cases: Iterable[tuple[str, str]]) -> list[str]:
    """Names of files, without suffix, by model with parameters and integrator of each case.

    In file systems that do not tell capitals from small letters as well.
    """
    return _number_names((_create_file_name(*names) for names in cases), "{}-{}", str.casefold)


def _number_names(names: Iterable[str], form: str, seen_as: Callable[[str], str]) -> list[str]:
    found: dict[str, str] = {}
    # The last number of each name: of many that are the same each would count from one on.
    last: dict[str, int] = {}
    for name in names:
        number, new = last.get(seen_as(name), 1), name
        while seen_as(new) in found:
            number += 1
            new = form.format(name, number)
        last[seen_as(name)] = number
        found[seen_as(new)] = new
    return list(found.values())


def _create_file_name(group: str, label: str) -> str:
    method = _shorten(_replace_invalid(label), _MAX_NAME_BYTES // 2)
    return f"{_shorten(_replace_invalid(group), _MAX_NAME_BYTES - len(method.encode()))}-{method}"


def _replace_invalid(text: str) -> str:
    return _INVALID_CHARACTERS.sub("-", unicodedata.normalize("NFC", text)).strip("-.")


def _shorten(text: str, most: int) -> str:
    """The text in so many bytes: of a long one both ends, for what differs may be in either."""
    whole = text.encode()
    if len(whole) <= most:
        return text
    half = (most - 2) // 2
    ends = whole[:half], whole[-half:]
    return "--".join(end.decode(errors="ignore").strip("-.") for end in ends)
