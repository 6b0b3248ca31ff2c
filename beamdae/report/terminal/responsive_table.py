"""Tables that adapt to the width of the terminal by omitting the least important columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

from beamdae.report.text import make_printable

# All widths are in terminal cells. Columns are omitted before the first column becomes narrower
# than the larger of this and half the terminal width; after that, it shrinks to its minimum.
_FIRST_COLUMN_WIDTH = 28
_MIN_FIRST_COLUMN_WIDTH = 6
_MIN_SENTENCE_WIDTH = 24  # columns of sentences are not folded to less than this
_COLUMN_GAP = 2  # between two columns
_ROW_MARGIN = 2  # at both ends of a row together
_MAX_TOPIC_SHARE = 0.5  # maximum width of the topics, relative to the terminal width


def shorten_to_cells(text: str, most: int) -> str:
    """Return the printable text, with its middle replaced by "…" if wider than `most` cells."""
    text = make_printable(text)
    if cell_len(text) <= most:
        return text
    head, tail = text[: (len(text) + 1) // 2], text[(len(text) + 1) // 2 :]
    while cell_len(head) + 1 + cell_len(tail) > most:
        head, tail = (head[:-1], tail) if cell_len(head) > cell_len(tail) else (head, tail[1:])
        if not (head or tail):
            break
    return f"{head}…{tail}"


@dataclass(frozen=True)
class Column:
    """Column of a `ResponsiveTable`, other than the first.

    Attributes
    ----------
    header
        Name of the column; it may contain line breaks.
    rank
        Columns with the largest rank are omitted first. Columns with rank 0 are never omitted.
    sentences
        True if the texts of the column may be folded.
    """

    header: str
    rank: int = 0
    sentences: bool = False

    @property
    def title(self) -> str:
        """The header on one line."""
        return self.header.replace("\n", " ")


class ResponsiveTable:
    """Table of texts whose layout adapts to the terminal width.

    Parameters
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

    def __init__(
        self,
        first: str,
        columns: Sequence[Column],
        rows: Iterable[Sequence[str]],
        elsewhere: str = "",
        never_shown: Sequence[str] = (),
    ) -> None:
        self._never_shown = list(map(make_printable, never_shown))
        self._first, self._columns, self._elsewhere = first, list(columns), elsewhere
        self._rows = [[make_printable(text) for text in row] for row in rows]

    @property
    def texts(self) -> list[list[str]]:
        """Table as lists of texts: the headers, followed by the rows."""
        return [[self._first, *(column.title for column in self._columns)], *self._rows]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table and, if columns are omitted, a line with their names."""
        columns = self._choose_columns(options.max_width)
        available = options.max_width - self._min_width_without_first(columns)
        first_width = min(self._content_width(self._first, 0), available)
        yield self._build_table(columns, max(_MIN_FIRST_COLUMN_WIDTH, first_width))
        omitted = [column.title for column in self._columns if column not in columns]
        if omitted:
            remedy = " or ".join(filter(None, ("a wider terminal", self._elsewhere)))
            yield Text(f"not shown: {', '.join(omitted)}; {remedy} shows them", style="dim")
        if self._never_shown:
            names = ", ".join(self._never_shown)
            yield Text(f"not shown: {names}; {self._elsewhere} shows them", style="dim")

    def _choose_columns(self, width: int) -> list[Column]:
        first = min(self._content_width(self._first, 0), max(_FIRST_COLUMN_WIDTH, width // 2))
        columns = list(self._columns)
        while first + self._min_width_without_first(columns) > width:
            if not any(column.rank for column in columns):
                break
            columns.remove(max(reversed(columns), key=lambda column: column.rank))
        return columns

    def _min_width_without_first(self, columns: Sequence[Column]) -> int:
        return _ROW_MARGIN + sum(_COLUMN_GAP + self._min_width(column) for column in columns)

    def _min_width(self, column: Column) -> int:
        width = self._content_width(column.header, self._index(column))
        return min(width, _MIN_SENTENCE_WIDTH) if column.sentences else width

    def _index(self, column: Column) -> int:
        return 1 + self._columns.index(column)

    def _content_width(self, header: str, k: int) -> int:
        return max(map(cell_len, [*header.split("\n"), *(row[k] for row in self._rows)]))

    def _build_table(self, columns: Sequence[Column], first_width: int) -> Table:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
        first = Text(shorten_to_cells(self._first, first_width))
        table.add_column(first, no_wrap=True, width=first_width)
        for column in columns:
            header = Text(column.header)
            if column.sentences:
                table.add_column(header, overflow="fold")
            else:
                width = self._min_width(column)
                table.add_column(header, justify="right", no_wrap=True, min_width=width)
        for row in self._rows:
            texts = (row[self._index(column)] for column in columns)
            table.add_row(Text(shorten_to_cells(row[0], first_width)), *map(Text, texts))
        return table


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
