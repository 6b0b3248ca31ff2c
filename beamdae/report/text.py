"""Conversion of arbitrary text to a form that terminals, figures and pages can display."""

from __future__ import annotations


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
