"""Names that tell runs apart, for readers and for file systems."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

# File systems have room for 255 bytes, paths for less than one likes.
_LONGEST = 120
# Letters and digits of any script, and what no file system or shell minds.
_ODD = re.compile(r"[^\w=.+]+")


def distinct(names: Iterable[str], form: str = "{} ({})") -> list[str]:
    """The names, with a number to those that have been there before, in whatever case."""
    found: dict[str, str] = {}
    for name in names:
        number, new = 1, name
        while new.casefold() in found:
            number += 1
            new = form.format(name, number)
        found[new.casefold()] = new
    return list(found.values())


def file_names(cases: Iterable[tuple[str, str]]) -> list[str]:
    """Names of files, without suffix, by model with parameters and integrator of each case."""
    return distinct([_file_name(*names) for names in cases], "{}-{}")


def _file_name(group: str, label: str) -> str:
    method = _cut(_plain(label), _LONGEST // 2)
    return f"{_cut(_plain(group), _LONGEST - len(method.encode()))}-{method}"


def _plain(text: str) -> str:
    return _ODD.sub("-", unicodedata.normalize("NFC", text)).strip("-.")


def _cut(text: str, most: int) -> str:
    """As much of it as fits into so many bytes."""
    return text.encode()[:most].decode(errors="ignore").rstrip("-.")
