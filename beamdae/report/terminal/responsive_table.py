"""Tables and lists for the terminal; column widths and omitted columns depend on its width."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

from rich import box
from rich.cells import cell_len, set_cell_size
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

from beamdae.report.text import make_printable

# All widths are in terminal cells. Columns are omitted before the first column becomes narrower
# than the larger of this and half the terminal width; after that, it shrinks to its minimum.
_FIRST_COLUMN_WIDTH = 28
_MIN_FIRST_COLUMN_WIDTH = 6
_MIN_SENTENCE_WIDTH = 20  # columns of sentences are not folded to less than this
_MIN_BROKEN_HEADER = 8  # headers with fewer characters have one line
_COLUMN_GAP = 2  # between two columns
_ROW_MARGIN = 2  # at both ends of a row together
_MAX_TOPIC_SHARE = 0.5  # maximum width of the topics, relative to the terminal width
_SPACE = re.compile(r" (?!\d+ \[|[^\[]*\])")  # neither inside a unit nor before a number with one
_UNIT_SPACE = re.compile(r" (?=\[|[^\[]*\])")  # before a unit or inside one


def shorten_to_cells(text: str, most: int) -> str:
    """Return the printable text, with its middle replaced by "…" if wider than `most` cells."""
    text = make_printable(text)
    if cell_len(text) <= most:
        return text
    head = set_cell_size(text, most // 2).rstrip()
    tail = set_cell_size(text[::-1], max(most - 1 - cell_len(head), 0)).rstrip()[::-1]
    return f"{head}…{tail}"


def _wrap_words(text: str, width: int) -> str:
    """Return the printable text with line breaks neither inside a unit nor before one."""
    joined = _UNIT_SPACE.sub("\N{NO-BREAK SPACE}", make_printable(text))
    lines = textwrap.wrap(joined, max(width, 1), break_on_hyphens=False)
    return "\n".join(lines).replace("\N{NO-BREAK SPACE}", " ")


def _break_header(header: str) -> str:
    """Return the header on the two lines that are narrowest."""
    breaks = [x.start() for x in _SPACE.finditer(header)]
    if len(header) < _MIN_BROKEN_HEADER or not breaks:
        return header
    k = min(breaks, key=lambda k: max(k, len(header) - k))
    return f"{header[:k]}\n{header[k + 1 :]}"


@dataclass(frozen=True)
class ResponsiveTable:
    """Table of texts whose layout adapts to the terminal width.

    The first column is always shown. Of the others, which contain numbers or sentences, those that
    do not fit are omitted from the right, and a line below the table names them.

    Attributes
    ----------
    headers, rows
        Texts of the headers and of the cells.
    source
        What shows omitted columns, such as a file.
    """

    headers: Sequence[str]
    rows: Sequence[Sequence[str]]
    source: str = ""

    @property
    def texts(self) -> list[list[str]]:
        """Table as lists of texts: the headers, followed by the rows."""
        return [list(map(make_printable, row)) for row in (self.headers, *self.rows)]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table and, if columns are omitted, a line with their names."""
        columns = list(zip(*self.texts, strict=True))
        folded = [k > 0 and any(" " in x for x in cells[1:]) for k, cells in enumerate(columns)]
        headers = [
            x if folds else _break_header(x) for (x, *_), folds in zip(columns, folded, strict=True)
        ]
        widths = [
            max(map(cell_len, [*header.split("\n"), *cells]))
            for header, (_, *cells) in zip(headers, columns, strict=True)
        ]
        widths[0] = max(widths[0], cell_len(columns[0][0]))
        least = [
            _COLUMN_GAP + (min(width, _MIN_SENTENCE_WIDTH) if folds else width)
            for width, folds in zip(widths, folded, strict=True)
        ]
        available = options.max_width - _ROW_MARGIN
        preferred = min(widths[0], max(_FIRST_COLUMN_WIDTH, options.max_width // 2))
        ends = accumulate(least[1:], initial=preferred)
        count = max(sum(end <= available for end in ends), min(2, len(columns)))
        first_width = max(_MIN_FIRST_COLUMN_WIDTH, min(widths[0], available - sum(least[1:count])))
        used = first_width + sum(_COLUMN_GAP + width for width in widths[1:count])
        is_wrapped = any(folded[:count]) and used > available
        padding = (0, 1, 0, 0)
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=padding, show_lines=is_wrapped)
        name = Text(shorten_to_cells(columns[0][0], first_width))
        table.add_column(name, no_wrap=True, width=first_width)
        for header, width, folds in list(zip(headers, widths, folded, strict=True))[1:count]:
            if folds:
                table.add_column(Text(header), overflow="fold")
            else:
                table.add_column(Text(header), justify="right", no_wrap=True, min_width=width)
        for label, *cells in zip(*(cells[1:] for cells in columns[:count]), strict=True):
            table.add_row(Text(shorten_to_cells(label, first_width)), *map(Text, cells))
        yield table
        if omitted := ", ".join(cells[0] for cells in columns[count:]):
            remedy = " or ".join(filter(None, ("a wider terminal", self.source)))
            yield Text(f"not shown: {omitted}; {remedy} shows them", style="dim")


@dataclass(frozen=True)
class FactList:
    """Two-column list of topics and texts whose layout adapts to the terminal width."""

    facts: Mapping[str, str]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        most = int(_MAX_TOPIC_SHARE * options.max_width)
        topics = [_wrap_words(topic, most) for topic in self.facts]
        used = max(map(cell_len, "\n".join(topics).split("\n"))) + _COLUMN_GAP
        table = Table(box=None, show_header=False, pad_edge=False)
        table.add_column(style="dim", no_wrap=True)
        table.add_column(overflow="fold")
        for topic, text in zip(topics, self.facts.values(), strict=True):
            table.add_row(Text(topic), Text(_wrap_words(text, options.max_width - used)))
        if self.facts:
            yield table
