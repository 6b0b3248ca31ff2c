"""Tables that adapt to the width of the terminal by omitting the least important columns."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

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
_MIN_SENTENCE_WIDTH = 24  # columns of sentences are not folded to less than this
_MIN_BROKEN_HEADER = 8  # headers with fewer characters have one line
_COLUMN_GAP = 2  # between two columns
_ROW_MARGIN = 2  # at both ends of a row together
_MAX_TOPIC_SHARE = 0.5  # maximum width of the topics, relative to the terminal width
_SPACE = re.compile(r" (?!\d+ \[|[^\[]*\])")  # neither inside a unit nor before a number with one


def shorten_to_cells(text: str, most: int) -> str:
    """Return the printable text, with its middle replaced by "…" if wider than `most` cells."""
    text = make_printable(text)
    if cell_len(text) <= most:
        return text
    head = set_cell_size(text, most // 2).rstrip()
    tail = set_cell_size(text[::-1], max(most - 1 - cell_len(head), 0)).rstrip()[::-1]
    return f"{head}…{tail}"


@dataclass(frozen=True)
class Column:
    """Column of a `ResponsiveTable`, other than the first.

    Attributes
    ----------
    title
        Name of the column.
    rank
        Columns with the largest rank are omitted first. Columns with rank 0 are never omitted.
    sentences
        True if the texts of the column may be folded.
    """

    title: str
    rank: int = 0
    sentences: bool = False

    @property
    def header(self) -> str:
        """The name, on the two lines that are narrowest."""
        breaks = [x.start() for x in _SPACE.finditer(self.title)]
        if len(self.title) < _MIN_BROKEN_HEADER or not breaks or self.sentences:
            return self.title
        k = min(breaks, key=lambda k: max(k, len(self.title) - k))
        return f"{self.title[:k]}\n{self.title[k + 1 :]}"


@dataclass(frozen=True)
class ResponsiveTable:
    """Table of texts whose layout adapts to the terminal width.

    Attributes
    ----------
    first
        Header of the first column, which is always shown. Long texts in this column are
        shortened in the middle.
    columns
        The other columns.
    rows
        Texts of each row, beginning with the first column.
    elsewhere
        Source that contains the omitted columns, such as "cases.csv".
    never_shown
        Names of data that the table omits at any width, but `elsewhere` contains.
    """

    first: str
    columns: Sequence[Column]
    rows: Iterable[Sequence[str]]
    elsewhere: str = ""
    never_shown: Sequence[str] = field(default=())

    def __post_init__(self) -> None:
        rows = [[make_printable(text) for text in row] for row in self.rows]
        object.__setattr__(self, "rows", rows)

    def omitting(self, names: Sequence[str]) -> ResponsiveTable:
        """Return the table with names of data that it omits at any width."""
        return replace(self, never_shown=names)

    @property
    def texts(self) -> list[list[str]]:
        """Table as lists of texts: the headers, followed by the rows."""
        return [[self.first, *(column.title for column in self.columns)], *map(list, self.rows)]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table and, if columns are omitted, a line with their names."""
        cells = dict(zip((None, *self.columns), zip(*self.texts, strict=True), strict=True))
        widths = {
            column: max(map(cell_len, [*(column.header if column else "").split("\n"), *texts[1:]]))
            for column, texts in cells.items()
        }
        widths[None] = max(widths[None], cell_len(self.first))
        for column in self.columns:
            if column.sentences:
                widths[column] = min(widths[column], _MIN_SENTENCE_WIDTH)
        shown = list(self.columns)

        def remaining() -> int:
            """Return the width that these columns leave to the first one."""
            others = sum(_COLUMN_GAP + widths[column] for column in shown)
            return options.max_width - _ROW_MARGIN - others

        preferred = min(widths[None], max(_FIRST_COLUMN_WIDTH, options.max_width // 2))
        while remaining() < preferred and any(column.rank for column in shown):
            shown.remove(max(reversed(shown), key=lambda column: column.rank))
        first_width = max(_MIN_FIRST_COLUMN_WIDTH, min(widths[None], remaining()))
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
        name = Text(shorten_to_cells(self.first, first_width))
        table.add_column(name, no_wrap=True, width=first_width)
        for column in shown:
            if column.sentences:
                table.add_column(Text(column.header), overflow="fold")
            else:
                width = widths[column]
                table.add_column(
                    Text(column.header), justify="right", no_wrap=True, min_width=width
                )
        for k, (label, *_) in enumerate(self.rows):
            row = (Text(cells[column][k + 1]) for column in shown)
            table.add_row(Text(shorten_to_cells(label, first_width)), *row)
        yield table
        omitted = [column.title for column in self.columns if column not in shown]
        remedy = " or ".join(filter(None, ("a wider terminal", self.elsewhere)))
        for names, where in ((omitted, remedy), (self.never_shown, self.elsewhere)):
            if names:
                texts = ", ".join(map(make_printable, names))
                yield Text(f"not shown: {texts}; {where} shows them", style="dim")


class FactList:
    """Two-column list of topics and texts whose layout adapts to the terminal width.

    Parameters
    ----------
    title
        Line above the list, or "" for no title.
    rows
        Texts by topic. Long topics are shortened in the middle.
    """

    def __init__(self, title: str, rows: Mapping[str, str]) -> None:
        self._title = make_printable(title)
        self._rows = {make_printable(topic): make_printable(text) for topic, text in rows.items()}

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        if self._title:
            yield Text(self._title, style="bold")
        table = Table(box=None, show_header=False, pad_edge=False)
        topic_width = int(_MAX_TOPIC_SHARE * options.max_width)
        table.add_column(style="dim", no_wrap=True)
        table.add_column(overflow="fold")
        for topic, text in self._rows.items():
            table.add_row(Text(shorten_to_cells(topic, topic_width)), Text(text))
        if self._rows:
            yield table
