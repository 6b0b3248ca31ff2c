"""Tables that fit a terminal: what matters least is left out, and what stays stays whole."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

from beamdae.report.letters import plain

# The first column is not folded below this or half the width, nor one of sentences below that.
_LEAST_FIRST, _LEAST_SENTENCES = 28, 24
# Blanks between two columns, and at both ends of a row.
_GAP, _EDGES = 2, 2


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


class FittedTable:
    """A table of texts, laid out when it is printed, for the width there is then.

    Parameters
    ----------
    first
        Header of the first column, which is folded if it has to be and never left out.
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
        self._rows = [[plain(text) for text in row] for row in rows]

    @property
    def texts(self) -> list[list[str]]:
        """All of it: the headers, each on a line, then the rows."""
        return [[self._first, *(column.title for column in self._columns)], *self._rows]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """The table, and a line on the columns that are left out."""
        kept = self._kept(options.max_width)
        yield self._table(kept)
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
        first = min(self._widest(self._first, 0), max(_LEAST_FIRST, width // 2))
        return _EDGES + first + sum(_GAP + self._narrowest(column) for column in columns)

    def _narrowest(self, column: Column) -> int:
        natural = self._widest(column.header, self._place(column))
        return min(natural, _LEAST_SENTENCES) if column.sentences else natural

    def _place(self, column: Column) -> int:
        return 1 + self._columns.index(column)

    def _widest(self, header: str, k: int) -> int:
        return max(map(cell_len, [*header.split("\n"), *(row[k] for row in self._rows)]))

    def _table(self, columns: Sequence[Column]) -> Table:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
        table.add_column(Text(self._first), overflow="fold")
        for column in columns:
            if column.sentences:
                table.add_column(Text(column.header), overflow="fold")
            else:
                whole = self._narrowest(column)
                table.add_column(
                    Text(column.header), justify="right", no_wrap=True, min_width=whole
                )
        for row in self._rows:
            table.add_row(Text(row[0]), *(Text(row[self._place(column)]) for column in columns))
        return table
