"""Texts of users as screens, pictures and pages can show them."""

from __future__ import annotations


def make_printable(text: str) -> str:
    """The text on one line, with what no screen shows (control characters, ...) as its code."""
    return "".join(map(_shown, text))


def shorten_text(text: str, most: int) -> str:
    """The plain text in at most so many letters: of a longer one the middle is left out."""
    text = make_printable(text)
    if len(text) <= most:
        return text
    kept = most - 1
    return f"{text[: kept - kept // 2]}…{text[len(text) - kept // 2 :]}"


def _shown(letter: str) -> str:
    if letter.isprintable():
        return letter
    return " " if letter.isspace() else letter.encode("unicode_escape").decode()
