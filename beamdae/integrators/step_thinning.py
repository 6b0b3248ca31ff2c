"""Thinning of long runs to rows at evenly spaced times, within a memory limit.

The rows of all steps of a large model would soon exceed the memory, even if only a few rows are
output. Once the rows of a run exceed `MAX_STORED_BYTES`, its steps are reduced to the rows at the
output times and at equally spaced times between them, which the dense output of all steps gives,
and to the energies and norms of all steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace

import numpy as np

from beamdae.results.trajectory import Interval

Array = np.ndarray

# Limit of the rows of a run. With 1000 output rows, models of 4096 elements keep a few hundred
# further rows, and models of 8 elements 200 000.
MAX_STORED_BYTES = 4e8

_keeps_all: ContextVar[bool] = ContextVar("keeps_all_steps", default=False)


@contextmanager
def keep_all_steps(keeps_all: bool = True) -> Iterator[None]:
    """Within the context, runs of this thread store all steps if `keeps_all` is True."""
    token = _keeps_all.set(keeps_all or _keeps_all.get())
    try:
        yield
    finally:
        _keeps_all.reset(token)


def limit_stored_bytes() -> float:
    """Return the limit of the rows of a run [bytes], infinite in `keep_all_steps`."""
    return np.inf if _keeps_all.get() else MAX_STORED_BYTES


def divide_intervals(times: Array, rows: float) -> tuple[Array, int]:
    """Return at most `rows` times (k,) [s] that contain `times`, and the number of equal parts.

    Each interval between two of `times` is divided into this number of parts, at least one.
    """
    gaps = len(times) - 1
    parts = max(int((rows - 1) / gaps), 1)
    return np.interp(np.arange(parts * gaps + 1) / parts, np.arange(len(times)), times), parts


@dataclass(frozen=True)
class ThinnedRows:
    """Rows that remain of the first part of a segment.

    Attributes
    ----------
    rows, nodes, values
        Stored rows (t, q, v, a, lam), times of all nodes [s], and their energies, powers and norms;
        one array per part.
    window
        Rows before the first row that has not been thinned, for interpolation, and this row.
    first
        Index in the segment of the first row of `window`.
    done
        Index in the segment of the last row that has been thinned, or -1.
    row_count
        Number of rows that have been passed to `extended`.
    """

    rows: tuple[Array, ...] = ()
    nodes: tuple[Array, ...] = ()
    values: tuple[Array, ...] = ()
    window: Array | None = None
    first: int = 0
    done: int = -1
    row_count: int = 0

    def extended(
        self,
        new: Array,
        times: Array,
        rows_per_step: int,
        tail_rows: int,
        to_interval: Callable[[Array], Interval],
        measure: Callable[[Interval], Array],
    ) -> ThinnedRows:
        """Return this object with further rows of the segment, reduced to `times` [s].

        `tail_rows` rows before a step are enough to interpolate within the step. `to_interval`
        returns rows (t, q, v, a, lam) as an interval, and `measure` energies, powers and norms
        (k, 11) of the k nodes of an interval.
        """
        rows = new if self.window is None else np.concatenate([self.window, new])
        row_count = self.row_count + len(new)
        last = (row_count - 1) // rows_per_step * rows_per_step
        if last == self.done:
            return replace(self, window=rows, row_count=row_count)
        is_first, begin, end = self.done < 0, self.done + 1 - self.first, last + 1 - self.first
        interval, added = to_interval(rows[:end]), rows[begin:end]
        after = interval.nodes[max(begin - 1, 0)]
        kept = times[(times > after) & (times <= interval.nodes[-1])]
        dense = np.column_stack([kept, *interval.at(kept, limited=True)])
        first = max((last - tail_rows) // rows_per_step * rows_per_step, self.first)
        return ThinnedRows(
            (*self.rows, np.concatenate([rows[:1], dense]) if is_first else dense),
            (*self.nodes, added[:, 0].copy()),
            (*self.values, measure(to_interval(added))),
            rows[first - self.first :].copy(),
            first,
            last,
            row_count,
        )

    @property
    def stored_bytes(self) -> int:
        """Memory of the stored rows [bytes]."""
        return sum(rows.nbytes for rows in self.rows)

    @property
    def stored(self) -> list[Array]:
        """Stored rows, with the end of the last step."""
        assert self.window is not None
        last = self.window[self.done - self.first : self.done - self.first + 1]
        kept = next(rows for rows in reversed(self.rows) if len(rows))
        return [*self.rows, *([] if kept[-1, 0] == last[0, 0] else [last])]
