"""Tables that adapt to the width of the terminal: the least important columns are left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

from beamdae.report.text import make_printable

# All widths are in cells of the terminal. Columns are left out before the first column becomes
# narrower than this, or than half the width; afterwards it shrinks to the second width.
_FIRST_COLUMN_WIDTH = 28
_MIN_FIRST_COLUMN_WIDTH = 6
# Sentences are folded to this width, not further.
_MIN_SENTENCE_WIDTH = 24
# Blanks between two columns, and at both ends of a row together.
_COLUMN_GAP = 2
_ROW_MARGIN = 2
# Largest share of the width for the topics of a list of facts.
_MAX_TOPIC_SHARE = 0.5


def shorten_to_cells(text: str, most: int) -> str:
    """Return the printable text; if it is wider than `most` cells, without its middle."""
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
    """A column after the first one.

    Attributes
    ----------
    header
        Name of the column, which may contain line breaks.
    rank
        Columns with the largest rank are left out first, those with rank 0 never.
    sentences
        True if the texts may be folded; numbers are never folded.
    """

    header: str
    rank: int = 0
    sentences: bool = False

    @property
    def title(self) -> str:
        """The header on one line."""
        return self.header.replace("\n", " ")


class ResponsiveTable:
    """A table of texts that is laid out for the width at which it is printed.

    Parameters
    ----------
    first
        Header of the first column, which is always shown; long texts lose their middle.
    columns
        The other columns.
    rows
        Texts of each row, that of the first column first.
    elsewhere
        Where to find columns that are left out, such as "cases.csv".
    """

    def __init__(
        self,
        first: str,
        columns: Sequence[Column],
        rows: Iterable[Sequence[str]],
        elsewhere: str = "",
    ) -> None:
        self._first, self._columns, self._elsewhere = first, list(columns), elsewhere
        self._rows = [[make_printable(text) for text in row] for row in rows]

    @property
    def texts(self) -> list[list[str]]:
        """Headers on one line each, followed by the rows."""
        return [[self._first, *(column.title for column in self._columns)], *self._rows]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table, and a line that names the columns left out."""
        columns = self._choose_columns(options.max_width)
        available = options.max_width - self._min_width_without_first(columns)
        first_width = min(self._content_width(self._first, 0), available)
        yield self._build_table(columns, max(_MIN_FIRST_COLUMN_WIDTH, first_width))
        omitted = [column.title for column in self._columns if column not in columns]
        if omitted:
            remedy = " or ".join(filter(None, ("a wider terminal", self._elsewhere)))
            yield Text(f"not shown: {', '.join(omitted)}; {remedy} shows them", style="dim")

    def _choose_columns(self, width: int) -> list[Column]:
        """Return the columns that fit into a width."""
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
    """Topics and texts in two columns, laid out for the width at which they are printed.

    Parameters
    ----------
    title
        A line above the columns, or "".
    rows
        Texts by topic; long topics lose their middle.
    """

    def __init__(self, title: str, rows: Mapping[str, str]) -> None:
        self._title = make_printable(title)
        self._rows = {make_printable(topic): make_printable(text) for topic, text in rows.items()}

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the title and the columns."""
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
