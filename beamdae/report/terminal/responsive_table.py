"""Tables that fit a terminal: what matters least is left out, and numbers stay whole."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

from beamdae.report.text import make_printable

# Columns are left out before the first one is cut below this or half the width, and it is never
# cut below the least; no column of sentences is folded below that.
_FIRST, _LEAST_FIRST, _LEAST_SENTENCES = 28, 6, 24
# Blanks between two columns, and at both ends of a row.
_GAP, _EDGES = 2, 2
# What facts are about takes this part of the width at most: half of it.
_TOPICS = 2


def shorten_to_cells(text: str, most: int) -> str:
    """The plain text in at most so many cells of a terminal: a longer one loses its middle."""
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
        Its name; a line break in it stays.
    rank
        Columns with the largest rank are left out first; 0: never.
    sentences
        Whether its texts may be folded; numbers never are.
    """

    header: str
    rank: int = 0
    sentences: bool = False

    @property
    def title(self) -> str:
        """The header on one line."""
        return self.header.replace("\n", " ")


class ResponsiveTable:
    """A table of texts, laid out when it is printed, for the width there is then.

    Parameters
    ----------
    first
        Header of the first column, which is never left out; its texts lose their middles where they
        have to.
    columns
        The others.
    rows
        Their texts, that of the first column first.
    elsewhere
        Where columns that are left out can be read, such as "cases.csv".
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
        """All of it: the headers, each on a line, then the rows."""
        return [[self._first, *(column.title for column in self._columns)], *self._rows]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The table, and a line on the columns that are left out."""
        kept = self._kept(options.max_width)
        room = options.max_width - self._others(kept)
        yield self._table(kept, max(_LEAST_FIRST, min(self._widest(self._first, 0), room)))
        gone = [column.title for column in self._columns if column not in kept]
        if gone:
            wider = " or ".join(filter(None, ("a wider terminal", self._elsewhere)))
            yield Text(f"not shown: {', '.join(gone)}; {wider} shows them", style="dim")

    def _kept(self, width: int) -> list[Column]:
        """The columns there is room for."""
        kept = list(self._columns)
        while self._least(kept, width) > width and any(column.rank for column in kept):
            kept.remove(max(reversed(kept), key=lambda column: column.rank))
        return kept

    def _least(self, columns: Sequence[Column], width: int) -> int:
        """The least these take of a width."""
        first = min(self._widest(self._first, 0), max(_FIRST, width // 2))
        return first + self._others(columns)

    def _others(self, columns: Sequence[Column]) -> int:
        """The least all but the first column take."""
        return _EDGES + sum(_GAP + self._narrowest(column) for column in columns)

    def _narrowest(self, column: Column) -> int:
        natural = self._widest(column.header, self._place(column))
        return min(natural, _LEAST_SENTENCES) if column.sentences else natural

    def _place(self, column: Column) -> int:
        return 1 + self._columns.index(column)

    def _widest(self, header: str, k: int) -> int:
        return max(map(cell_len, [*header.split("\n"), *(row[k] for row in self._rows)]))

    def _table(self, columns: Sequence[Column], first: int) -> Table:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
        table.add_column(Text(shorten_to_cells(self._first, first)), no_wrap=True, width=first)
        for column in columns:
            if column.sentences:
                table.add_column(Text(column.header), overflow="fold")
            else:
                whole = self._narrowest(column)
                table.add_column(
                    Text(column.header), justify="right", no_wrap=True, min_width=whole
                )
        for row in self._rows:
            texts = (row[self._place(column)] for column in columns)
            table.add_row(Text(shorten_to_cells(row[0], first)), *map(Text, texts))
        return table


class FactList:
    """Two columns, laid out when they are printed: what, cut in its middle where it has to be.

    Parameters
    ----------
    title
        A line above them, or "".
    rows
        What there is to say, by topic.
    """

    def __init__(self, title: str, rows: Mapping[str, str]) -> None:
        self._title = make_printable(title)
        self._rows = {make_printable(topic): make_printable(said) for topic, said in rows.items()}

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The rows."""
        if self._title:
            yield Text(self._title, style="bold")
        table = Table(box=None, show_header=False, pad_edge=False)
        most = options.max_width // _TOPICS
        table.add_column(style="dim", no_wrap=True)
        table.add_column(overflow="fold")
        for topic, said in self._rows.items():
            table.add_row(Text(shorten_to_cells(topic, most)), Text(said))
        if self._rows:
            yield table
