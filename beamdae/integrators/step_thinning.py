"""Thinning of long runs to output rows and every n-th step, within a memory limit.

The rows of all steps of a large model would soon exceed the memory, even if only a few rows are
output. Once the rows of a run exceed `MAX_STORED_BYTES`, its earlier steps are reduced to the rows
at the output times, which the dense output of all steps gives, to every n-th step, and to the
energies and norms of all steps. The number n doubles each time the limit is exceeded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from beamdae.memory import release_freed_memory
from beamdae.results.trajectory import Interval

Array = np.ndarray

# Limit of the rows of a run. With 1000 output rows, models of 4096 elements keep a few hundred
# steps, and models of 8 elements 200 000 steps.
MAX_STORED_BYTES = 4e8
# Output rows are always stored: rows may exceed the limit up to this multiple of the output rows.
_MAX_RATIO_TO_OUTPUT = 1.05
# Index of rows that are not ends of steps.
_OUTPUT = -1
# Steps are dropped if an output row is closer than this fraction of the distance between the kept
# steps: polynomials through rows at very small distances amplify vibrations between the steps.
_MIN_DISTANCE = 0.5
# Blocks of rows, of up to 10 MB, after which the memory of thinned rows is returned to the system:
# rows that are kept lie between freed ones, which the C library would retain.
_BLOCKS_PER_RELEASE = 2

_keeps_all: ContextVar[bool] = ContextVar("keeps_all_steps", default=False)


@contextmanager
def keep_all_steps(keeps_all: bool = True) -> Iterator[None]:
    """Within the context, runs of this thread store all steps if `keeps_all` is True."""
    token = _keeps_all.set(keeps_all or _keeps_all.get())
    try:
        yield
    finally:
        _keeps_all.reset(token)


# Returns energies, powers and norms (k, 11) of the k nodes of an interval.
Measure = Callable[[Interval], Array]
# Returns rows (t, q, v, a, lam) as an interval.
ToInterval = Callable[[Array], Interval]


@dataclass(frozen=True)
class ThinnedRows:
    """Rows that remain of the first part of a segment.

    Attributes
    ----------
    rows, steps
        Stored rows (t, q, v, a, lam), and the index of the step that ends at each row, -1 for
        output rows; one array per part.
    nodes, values
        Times of all nodes [s], and their energies, powers and norms; one array per part.
    window
        Rows before the first row that has not been thinned, for interpolation, and this row.
    first
        Index in the segment of the first row of `window`.
    done
        Index in the segment of the last row that has been thinned, or -1.
    row_count
        Number of rows that have been passed to `extended`.
    output_count
        Number of stored output rows.
    """

    rows: tuple[Array, ...] = ()
    steps: tuple[Array, ...] = ()
    nodes: tuple[Array, ...] = ()
    values: tuple[Array, ...] = ()
    window: Array | None = None
    first: int = 0
    done: int = -1
    row_count: int = 0
    output_count: int = 0

    def extended(
        self,
        new: Array,
        stride: int,
        rows_per_step: int,
        tail_rows: int,
        output_times: Array,
        to_interval: ToInterval,
        measure: Measure,
    ) -> ThinnedRows:
        """Return this object with further rows of the segment, reduced to every `stride`-th step.

        `tail_rows` rows before a step are enough to interpolate within the step.
        """
        rows = new if self.window is None else np.concatenate([self.window, new])
        row_count = self.row_count + len(new)
        last = (row_count - 1) // rows_per_step * rows_per_step
        if last == self.done:
            return replace(self, window=rows, row_count=row_count)
        interval = to_interval(rows[: last - self.first + 1])
        begin = self.done + 1 - self.first
        t = interval.nodes[max(begin - 1, 0) :: rows_per_step][[0, -1]]
        inside = (output_times > t[0]) & (output_times <= t[1])
        outputs = output_times[inside]
        values = measure(to_interval(rows[begin : last - self.first + 1]))
        steps = np.arange(self.done + 1, last + 1)
        is_end = steps % rows_per_step == 0
        ends = begin + np.flatnonzero(is_end)
        times = np.concatenate([outputs, rows[ends, 0]])
        indices = np.concatenate([np.full(len(outputs), _OUTPUT), steps[is_end] // rows_per_step])
        order = np.argsort(times, kind="stable")
        selection = order[_is_kept(times[order], indices[order], stride)]
        # Only the rows that are kept are copied: they take most of the memory of a long run.
        is_output = selection < len(outputs)
        kept_rows = np.empty((len(selection), rows.shape[1]))
        output_rows = np.column_stack([outputs, *interval.at(outputs, limited=True)])
        kept_rows[is_output] = output_rows[selection[is_output]]
        kept_rows[~is_output] = rows[ends[selection[~is_output] - len(outputs)]]
        first = max((last - tail_rows) // rows_per_step * rows_per_step, self.first)
        return ThinnedRows(
            (*self.rows, kept_rows),
            (*self.steps, indices[selection]),
            (*self.nodes, rows[begin : last - self.first + 1, 0].copy()),
            (*self.values, values),
            rows[first - self.first :].copy(),
            first,
            last,
            row_count,
            self.output_count + len(outputs),
        )

    def reduced(self, stride: int) -> ThinnedRows:
        """Return this object with every `stride`-th step."""
        masks = [_is_kept(x[:, 0], s, stride) for x, s in zip(self.rows, self.steps, strict=True)]
        return replace(
            self,
            rows=tuple(x[k] for x, k in zip(self.rows, masks, strict=True)),
            steps=tuple(x[k] for x, k in zip(self.steps, masks, strict=True)),
        )

    @property
    def stored_bytes(self) -> int:
        """Memory of the stored rows [bytes]."""
        return sum(rows.nbytes for rows in self.rows)

    @property
    def output_bytes(self) -> int:
        """Memory of the stored output rows [bytes]."""
        return self.output_count * self.rows[0][:1].nbytes if self.rows else 0

    def result(self, stride: int) -> tuple[list[Array], Array, Array]:
        """Return the parts of the stored rows with the last step, and all nodes and values."""
        assert self.window is not None
        t = np.concatenate([rows[:, 0] for rows in self.rows])
        # Neighbors in different parts have not been compared.
        is_kept = _is_kept(t, np.concatenate(self.steps), stride)
        ends = np.cumsum([len(rows) for rows in self.rows])[:-1]
        parts = [
            rows if k.all() else rows[k]
            for rows, k in zip(self.rows, np.split(is_kept, ends), strict=True)
        ]
        last = self.window[self.done - self.first : self.done - self.first + 1]
        if not (is_kept[-1] and t[-1] == last[0, 0]):
            parts.append(last)
        return parts, np.concatenate(self.nodes), np.concatenate(self.values)


def _is_kept(t: Array, steps: Array, stride: int) -> Array:
    """Return the mask of output rows and of every `stride`-th step, if not close to outputs.

    `t` are ascending times (k,) [s], and `steps` the indices of the steps, -1 for output rows.
    """
    is_kept = steps == _OUTPUT
    outputs, candidates = t[is_kept], np.flatnonzero(~is_kept & (steps % stride == 0))
    if not len(candidates):
        return is_kept
    at = t[candidates]
    gap = np.gradient(at) if len(at) > 1 else np.full(len(at), t[-1] - t[0])
    padded = np.concatenate([[-np.inf], outputs, [np.inf]])
    after = np.searchsorted(padded, at)
    distance = np.minimum(padded[after] - at, at - padded[after - 1])
    is_kept[candidates] = (distance >= _MIN_DISTANCE * gap) | (steps[candidates] == 0)
    return is_kept


class _Segment(Protocol):
    """Part of a run whose rows can be thinned, see `step_history.RunSegment`."""

    @property
    def stored_bytes(self) -> int:
        """Memory of the stored rows [bytes]."""

    @property
    def output_bytes(self) -> int:
        """Memory of the stored output rows [bytes]."""

    @property
    def count(self) -> int:
        """Number of rows, including rows that are no longer stored."""

    @property
    def block_count(self) -> int:
        """Number of blocks of rows that have been allocated."""

    def thin(self, stride: int, output_times: Array, is_final: bool = False) -> None:
        """Thin the rows that are no longer needed; all rows if `is_final` is True."""


@dataclass
class StepThinning:
    """Limit of the rows that a run stores.

    Attributes
    ----------
    output_times
        Output times of the run [s].
    limit
        Limit of the stored rows [bytes]; None to store all rows. Output rows may exceed it.
    stride
        Number n of steps of which one is stored; 0 as long as all rows are stored.
    """

    output_times: Array
    limit: float | None = field(
        default_factory=lambda: None if _keeps_all.get() else MAX_STORED_BYTES
    )
    stride: int = 0
    _finished: int = 0
    _finished_bytes: int = 0
    _checked: tuple[int, int] = (0, 0)
    _unreleased_blocks: int = 0

    def enforce(self, segments: Sequence[_Segment]) -> None:
        """Thin the segments of a run if their rows exceed the limit; the last one may grow."""
        current = segments[-1]
        state = len(segments), current.block_count
        if self.limit is None or state == self._checked:
            return
        segment_count, block_count = self._checked
        # The first block of a segment is not counted: segments may be short.
        self._unreleased_blocks += state[1] - (block_count if state[0] == segment_count else 1)
        self._checked = state
        if self.stride:
            for segment in segments[self._finished :]:
                segment.thin(self.stride, self.output_times, segment is not current)
        finished = segments[self._finished : -1]
        self._finished_bytes += sum(segment.stored_bytes for segment in finished)
        self._finished = len(segments) - 1
        stride = self.stride
        # With n above the number of steps, only output rows are left.
        while self._exceeds_limit(segments) and self.stride <= max(x.count for x in segments):
            self.stride = max(2 * self.stride, 1)
            for segment in segments:
                segment.thin(self.stride, self.output_times, segment is not current)
            self._finished_bytes = sum(segment.stored_bytes for segment in segments[:-1])
        is_due = self.stride and self._unreleased_blocks >= _BLOCKS_PER_RELEASE
        if self.stride > stride or is_due:
            self._unreleased_blocks = 0
            release_freed_memory()

    def _exceeds_limit(self, segments: Sequence[_Segment]) -> bool:
        assert self.limit is not None
        size = self._finished_bytes + segments[-1].stored_bytes
        if size <= self.limit:
            return False
        output_bytes = sum(segment.output_bytes for segment in segments)
        return size > _MAX_RATIO_TO_OUTPUT * output_bytes

    @property
    def report(self) -> dict[str, str]:
        """Entry for `Solution.integrator`; empty if all steps are stored."""
        if not self.stride:
            return {}
        return {"stored_steps": f"output rows and one of {self.stride} steps"}

    def finish(self, segments: Sequence[_Segment]) -> None:
        """Thin all rows of a run that exceeded the limit."""
        for segment in segments if self.stride else ():
            segment.thin(self.stride, self.output_times, True)
