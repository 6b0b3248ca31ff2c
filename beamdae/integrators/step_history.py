"""Rows of a run under way."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.memory import available_memory, format_gigabytes
from beamdae.results.trajectory import Interval

Array = np.ndarray

# Rows of a block, or as many as make this many bytes where they are long.
_MAX_BLOCK_ROWS, _MAX_BLOCK_BYTES = 8192, 1e7
# Steps before those in question that the polynomials of these go through, with some to spare.
_TAIL_STEPS = 8
# Times nearer to each other than this share of themselves are one.
_SAME_TIME = 1e-13
# So many bytes are there; to ask takes as long as hundreds of steps.
_UNCHECKED_BYTES = 1e8
# What a result makes of its rows while it is put together, in rows.
_RESULT_COPIES = 2.0


class OutOfMemoryError(MemoryError):
    """There is no memory for more rows; the message says how much they take."""


class StepHistory:
    """Times and states of the accepted steps of an interval, in blocks that grow in number.

    Steps may have stages inside, every one as many.
    """

    def __init__(self, t: float, state: State) -> None:
        self._ends = np.cumsum([1, *(len(x) for x in state)]).tolist()
        self._at_once = int(np.clip(_MAX_BLOCK_BYTES / (8 * self._ends[-1]), 1, _MAX_BLOCK_ROWS))
        self._blocks: list[Array] = []
        # Raised last: an interrupt leaves no row without its values.
        self._count = 0
        self._per_step = 1
        self._is_finite = True
        self._tail_begin = 0
        self._write(np.concatenate(((t,), *state))[None])

    def append(self, t: float, state: State, stages: Sequence[tuple[float, State]] = ()) -> bool:
        """Add a step with the stages inside it; whether they go with it and with those before.

        Raises
        ------
        NoRoomError
            If there is no memory for more of them, and for the result they are made into.
        """
        rows = [np.concatenate(((time,), *of)) for time, of in [*stages, (t, state)]]
        return self.extend(np.array(rows), len(rows))

    def extend(self, rows: Array, per_step: int = 1) -> bool:
        """Add rows (t, q, v, a, lam) of some steps; whether they go with each other and before.

        Raises
        ------
        NoRoomError
            As above.
        """
        if not (rows[0, 0] > self.end and np.all(rows[1:, 0] > rows[:-1, 0])):
            return False
        if self._count > 1 and per_step != self._per_step:
            return False
        self._per_step = per_step
        self._write(rows)
        return True

    def _write(self, rows: Array) -> None:
        # Now, while they are in the caches.
        self._is_finite &= bool(np.isfinite(rows).all())
        written = 0
        while written < len(rows):
            block, row = divmod(self._count + written, self._at_once)
            if block == len(self._blocks):
                self._require_room()
                self._blocks.append(np.empty((self._at_once, self._ends[-1])))
            some = min(len(rows) - written, self._at_once - row)
            self._blocks[block][row : row + some] = rows[written : written + some]
            written += some
        self._count += written

    def _require_room(self) -> None:
        stored = sum(block.nbytes for block in self._blocks)
        if stored > _UNCHECKED_BYTES and available_memory() < _RESULT_COPIES * stored:
            raise OutOfMemoryError(
                f"the {self._count} states stored take {format_gigabytes(stored)}, there is no memory to "
                "store more and make a result of them; take longer steps or fewer elements, or end "
                "the run sooner"
            )

    @property
    def last(self) -> State:
        """The state of the last row."""
        block, row = divmod(self._count - 1, self._at_once)
        return self._state(self._blocks[block][row])

    @property
    def end(self) -> float:
        """The time of the last row [s]."""
        block, row = divmod(self._count - 1, self._at_once)
        return float(self._blocks[block][row, 0])

    @property
    def _used(self) -> list[Array]:
        """The blocks, of the last one what is in use: of large systems that is a small part."""
        starts = range(0, self._count, self._at_once)
        return [
            block[: self._count - start] for block, start in zip(self._blocks, starts, strict=False)
        ]

    @property
    def is_finite(self) -> bool:
        """Whether all of them are numbers."""
        return self._is_finite

    def drop_nonfinite(self) -> bool:
        """Drop steps from the first one on that is not finite; whether there was none."""
        if self._is_finite:
            return True
        finite = np.concatenate([np.isfinite(rows).all(axis=1) for rows in self._used])
        bad = np.flatnonzero(~finite)
        if len(bad):
            self._count = max(int(bad[0]) - 1, 0) // self._per_step * self._per_step + 1
        return len(bad) == 0

    @property
    def count(self) -> int:
        """How many they are."""
        return self._count

    def tail(self, first: int, branch: float) -> tuple[Interval, float] | None:
        """Those from `first` on that are finite, and those their polynomials go through.

        With the time of the one before `first`; None if there are none.
        """
        begin = self._tail_begin = max(first - 1 - _TAIL_STEPS * self._per_step, 0)
        blocks = self._used[begin // self._at_once :]
        rows = np.concatenate(blocks)[begin % self._at_once :]
        bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
        count = int(bad[0]) if len(bad) else len(rows)
        count = (count - 1) // self._per_step * self._per_step + 1
        if count <= first - begin:
            return None
        return self._interval([rows[:count]], branch), float(rows[first - 1 - begin, 0])

    def truncate(self, interval: Interval, t: float) -> None:
        """Drop the steps that go beyond time `t`, and add one that ends there.

        Its rows lie on the polynomials of `interval`, the `tail` of these rows.
        """
        steps, per_step = interval.t, self._per_step
        apart = _SAME_TIME * max(abs(t), steps[-1] - steps[0])
        whole = int(np.searchsorted(steps, t + apart, side="right")) - 1
        self._count = self._tail_begin + whole * per_step + 1
        self._is_finite = True
        if t - steps[whole] > apart:
            nodes = interval.nodes[whole * per_step : (whole + 1) * per_step + 1]
            share = (nodes[1:] - nodes[0]) / (nodes[-1] - nodes[0])
            at = nodes[0] + share * (t - nodes[0])
            at[-1] = t
            self._write(np.column_stack([at, *interval.at(at)]))

    def _state(self, row: Array) -> State:
        return State(*np.split(row[1:], [e - 1 for e in self._ends[1:-1]]))

    def interval(self, branch: float) -> Interval:
        """All of them, of one block as they lie there: to copy them takes as long as short runs."""
        return self._interval(self._used, branch)

    def _interval(self, blocks: Sequence[Array], branch: float) -> Interval:
        t, *state = (
            np.concatenate(parts) if len(parts) > 1 else parts[0]
            for first, last in pairwise([0, *self._ends])
            for parts in [[rows[:, first:last] for rows in blocks]]
        )
        per_step = self._per_step if len(t) > 1 else 1
        return Interval(t[:, 0].copy(), State(*state), branch, per_step)
