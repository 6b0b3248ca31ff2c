"""Growing storage for the accepted steps of a run, and its segments between restarts.

Long runs store only some of their steps, see `step_thinning`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from beamdae.equations.equations_of_motion import Configuration, EquationsOfMotion, State
from beamdae.equations.measures import BalanceRows
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.integrators.step_thinning import ThinnedRows, divide_intervals, limit_stored_bytes
from beamdae.memory import available_memory, format_gigabytes
from beamdae.parts.laws import TableRange
from beamdae.results.trajectory import Interval, StepRecord

Array = np.ndarray

_BYTES_PER_NUMBER = 8
# Upper limits of the size of a block.
_MAX_BLOCK_ROWS = 8192
_MAX_BLOCK_BYTES = 1e7
# Upper bound on the number of earlier steps that the interpolation of new rows uses.
_TAIL_STEPS = 8
# Relative difference below which two times are equal.
_SAME_TIME = 1e-13
# Below this size, the available memory is not queried: a query takes as long as hundreds of steps.
_UNCHECKED_BYTES = 1e8
# Number of copies of the rows that exist while the result is assembled.
_RESULT_COPIES = 2.0


class OutOfMemoryError(MemoryError):
    """Raised if no memory is left for more steps; the message states the memory used so far."""


class StepHistory:
    """Rows (t, q, v, a, lam) of one segment, stored in blocks: the start, then accepted steps.

    Samples of controllers do not begin a segment if the method continues; see `append_jump`.

    A step may include rows for its inner stages; their number is the same in every step.
    """

    def __init__(self, t: float, state: State) -> None:
        self._column_ends = np.cumsum([1, *(len(x) for x in state)]).tolist()
        row_bytes = _BYTES_PER_NUMBER * self._column_ends[-1]
        self._block_rows = int(np.clip(_MAX_BLOCK_BYTES / row_bytes, 1, _MAX_BLOCK_ROWS))
        self._blocks: list[Array] = []
        # Increased after the rows are written, so that an interrupt leaves no incomplete row.
        self._count = 0
        self._rows_per_step = 1
        self._is_finite = True
        # Number of rows before and at the end of the last tail, and the tail.
        self._tail: tuple[int, int, Interval] | None = None
        # Rows before this index are no longer needed by `tail` and `truncate`.
        self._released = 0
        # Replaces the first blocks.
        self._thinned: ThinnedRows | None = None
        self._write(np.concatenate(((t,), *state))[None])

    def append(self, t: float, state: State, stages: Sequence[tuple[float, State]] = ()) -> bool:
        """Append a step at `t` [s] with its inner stages; return False if invalid (see `extend`).

        Raises
        ------
        OutOfMemoryError
            If there is no memory for more rows or for results computed from the rows.
        """
        rows = [np.concatenate(((time,), *values)) for time, values in [*stages, (t, state)]]
        return self.extend(np.array(rows), len(rows))

    def extend(self, rows: Array, rows_per_step: int = 1) -> bool:
        """Append rows (t, q, v, a, lam) of several steps; return False if they are invalid.

        Times must ascend from the last stored row, and every step must have the same number of
        rows.

        Raises
        ------
        OutOfMemoryError
            If there is no memory for more rows or for results computed from the rows.
        """
        t = rows[:, 0]
        if not (t[0] > self.end and (t[1:] > t[:-1]).all()):
            return False
        if self._count > 1 and rows_per_step != self._rows_per_step:
            return False
        self._rows_per_step = rows_per_step
        self._write(rows)
        return True

    def append_jump(self, state: State) -> None:
        """Append the state after a jump at the last time, as a step of length zero."""
        self._write(np.tile(np.concatenate(((self.end,), *state)), (self._rows_per_step, 1)))

    def _write(self, rows: Array) -> None:
        # Checked here because the rows are still in the processor cache.
        self._is_finite &= bool(np.isfinite(rows).all())
        count = 0
        while count < len(rows):
            block, row = divmod(self._count + count, self._block_rows)
            if block == len(self._blocks):
                self._require_memory()
                self._blocks.append(np.empty((self._block_rows, self._column_ends[-1])))
            size = min(len(rows) - count, self._block_rows - row)
            self._blocks[block][row : row + size] = rows[count : count + size]
            count += size
        self._count += count

    def _require_memory(self) -> None:
        stored_bytes = sum(block.nbytes for block in self._blocks)
        stored_bytes += self._thinned.stored_bytes if self._thinned else 0
        if stored_bytes > _UNCHECKED_BYTES and available_memory() < _RESULT_COPIES * stored_bytes:
            raise OutOfMemoryError(
                f"the {self._count} stored states take "
                f"{format_gigabytes(stored_bytes)}, and not enough memory is left for more; "
                "use longer steps, fewer elements or an earlier end time"
            )

    @property
    def count(self) -> int:
        """Number of rows, including the start and rows that are no longer stored."""
        return self._count

    @property
    def block_count(self) -> int:
        """Number of blocks that have been allocated."""
        return len(self._blocks)

    @property
    def stored_bytes(self) -> int:
        """Memory of the stored rows [bytes]."""
        thinned = self._thinned.stored_bytes if self._thinned else 0
        return sum(block.nbytes for block in self._filled_blocks) + thinned

    @property
    def row_bytes(self) -> int:
        """Memory of a row [bytes]."""
        return self._blocks[-1].itemsize * self._column_ends[-1]

    def close(self) -> None:
        """Free the unused rows of the last block; no rows can be added afterwards."""
        blocks = self._filled_blocks
        self._blocks = [*blocks[:-1], blocks[-1].copy()]

    def release(self, first: int) -> None:
        """Declare that `tail` will not be called for rows before `first`."""
        self._released = max(first - 1 - _TAIL_STEPS * self._rows_per_step, 0)

    def thin(
        self, times: Array, branch: float, measure: Callable[[Interval], Array], is_final: bool
    ) -> None:
        """Reduce rows to those at `times` [s], see `ThinnedRows`.

        Rows are reduced if they are released or if `is_final` is True. `branch` is a time [s]
        inside the smooth interval.
        """
        if not (self._is_finite or is_final):
            return
        end = self._count if is_final else self._released // self._block_rows * self._block_rows
        tail_rows = _TAIL_STEPS * self._rows_per_step
        # Few whole blocks, which are freed soon, but enough rows for polynomials near the start.
        most = -(-max(tail_rows, self._block_rows) // self._block_rows) * self._block_rows
        while (begin := self._thinned.row_count if self._thinned else 0) < end:
            is_last = is_final and begin + most >= end
            if begin + most > end and not is_last:
                break
            self._thinned = (self._thinned or ThinnedRows()).extended(
                self._rows_from(begin, min(begin + most, end)),
                times,
                self._rows_per_step,
                0 if is_last else tail_rows,
                lambda rows: self._make_interval([rows], branch),
                measure,
            )
            full_blocks = self._thinned.row_count // self._block_rows
            for k in range(
                begin // self._block_rows, len(self._blocks) if is_last else full_blocks
            ):
                self._blocks[k] = np.empty((0, self._column_ends[-1]))

    def _rows_from(self, begin: int, end: int | None = None) -> Array:
        """Return the rows from index `begin` to `end`, none of which has been thinned."""
        end = self._count if end is None else end
        block, row = divmod(begin, self._block_rows)
        blocks = self._filled_blocks[block : -(-end // self._block_rows)]
        return np.concatenate(blocks)[row : row + end - begin]

    @property
    def last_state(self) -> State:
        """State of the last row."""
        row, ends = self._last_row, self._column_ends
        return State(*(row[first:last] for first, last in pairwise(ends)))

    @property
    def end(self) -> float:
        """Time of the last row [s]."""
        return float(self._last_row[0])

    @property
    def _last_row(self) -> Array:
        last, thinned = self._count - 1, self._thinned
        if thinned is not None and thinned.window is not None and last < thinned.row_count:
            return thinned.window[last - thinned.first]
        block, row = divmod(last, self._block_rows)
        return self._blocks[block][row]

    @property
    def is_finite(self) -> bool:
        """True if all values are finite."""
        return self._is_finite

    @property
    def _filled_blocks(self) -> list[Array]:
        """Blocks of rows; the last block is truncated to its filled rows."""
        starts = range(0, self._count, self._block_rows)
        return [
            block[: self._count - start] for block, start in zip(self._blocks, starts, strict=False)
        ]

    def drop_nonfinite(self) -> bool:
        """Drop the first non-finite step and all later steps; return True if no step is dropped."""
        if self._is_finite:
            return True
        begin = 0 if self._thinned is None else self._thinned.row_count
        bad = np.flatnonzero(~np.isfinite(self._rows_from(begin)).all(axis=1))
        if len(bad):
            self._count = self._complete_steps(begin + int(bad[0]))
        return len(bad) == 0

    def _complete_steps(self, count: int) -> int:
        """Return the number of rows of the start and of complete steps in the first `count`."""
        return max(count - 1, 0) // self._rows_per_step * self._rows_per_step + 1

    def tail(self, first: int, branch: float) -> tuple[Interval, float] | None:
        """Return the rows from `first` on, preceded by rows needed for interpolation.

        Also return the time [s] of the row before `first`. The rows end before the first step that
        is not finite. Return None if there is no finite step from `first` on.
        """
        begin = max(first - 1 - _TAIL_STEPS * self._rows_per_step, 0)
        if self._tail is None or self._tail[:2] != (begin, self._count):
            rows = self._rows_from(begin)
            bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
            count = self._complete_steps(int(bad[0]) if len(bad) else len(rows))
            self._tail = begin, self._count, self._make_interval([rows[:count]], branch)
        interval = self._tail[2]
        if len(interval.nodes) <= first - begin:
            return None
        return interval, float(interval.nodes[first - 1 - begin])

    def longest_gap(self, first: int) -> float:
        """Return the longest time [s] between rows from the one before `first` on."""
        return float(np.diff(self._rows_from(first - 1)[:, 0]).max(initial=0.0))

    def truncate(self, t: float, starter: StateEvaluator) -> None:
        """Drop the steps that end after time `t` [s], and make the last step end at `t`.

        `t` is in the interval that `tail` returned last, from which the rows of a last step up to
        `t` are interpolated if no step ends there, see `interpolate_balanced`; `starter` evaluates
        the equations. A jump at `t` is dropped, too: a run that continues there takes the sample
        again.
        """
        assert self._tail is not None
        begin, _, tail = self._tail
        steps, rows_per_step = tail.t, self._rows_per_step
        tolerance = _SAME_TIME * max(abs(t), steps[-1] - steps[0])
        complete = int(np.searchsorted(steps, t - tolerance))
        if not (complete < len(steps) and steps[complete] <= t + tolerance):
            complete -= 1
        first = begin + complete * rows_per_step
        has_rest = t - steps[complete] > tolerance
        step = self._rows_from(first, first + rows_per_step + 1) if has_rest else None
        self._count, self._is_finite, self._tail = first + 1, True, None
        if step is not None:
            nodes = step[:, 0]
            share = (nodes[1:] - nodes[0]) / (nodes[-1] - nodes[0])
            times = nodes[0] + share * (t - nodes[0])
            times[-1] = t
            steps = np.full(len(times), np.ptp(nodes))
            state = interpolate_balanced(tail, times, steps, starter)
            rows = np.column_stack([times, *state])
            # Rounding errors would change the states of laws, which may be numbers of samples.
            is_constant = (step == step[0]).all(axis=0)
            rows[:, is_constant] = step[0, is_constant]
            self._write(rows)

    def interval(self, branch: float) -> Interval:
        """Return all stored rows as an interval; the states of a single block are not copied.

        If rows have been thinned, all rows must have been, and no rows can be added afterwards.
        """
        if self._thinned is None:
            return self._make_interval(self._filled_blocks, branch)
        nodes, values = (np.concatenate(x) for x in (self._thinned.nodes, self._thinned.values))
        record = StepRecord(nodes, values, self._rows_per_step)
        whole = self._make_interval(self._thinned.stored, branch)
        return replace(whole, nodes_per_step=1, record=record)

    def _make_interval(self, blocks: Sequence[Array], branch: float) -> Interval:
        t, *state = (
            np.concatenate(columns) if len(columns) > 1 else columns[0]
            for first, last in pairwise([0, *self._column_ends])
            for columns in [[rows[:, first:last] for rows in blocks]]
        )
        rows_per_step = self._rows_per_step if len(t) > 1 else 1
        return Interval(t[:, 0].copy(), State(*state), branch, rows_per_step)


def interpolate_balanced(
    interval: Interval, times: Array, steps: Array, evaluator: StateEvaluator
) -> State:
    """Return states at times (k,) [s], whose forces without kinks are interpolated.

    Errors of interpolated positions, multiplied by the stiffness, would be errors of forces. One
    iteration of implicit steps of lengths h (k,) [s] from these states removes them:
    (K + C / h + M / h^2) dq is the difference of the forces.
    """
    nodes, weights = interval.force_weights_at(times)
    at_nodes = zip(*(x[nodes] for x in (interval.times, *interval.rows[:2])), strict=True)
    forces = weights @ np.array([evaluator.smooth_force(*x) for x in at_nodes])
    state = interval.at(times, limited=True)
    rows = interval.with_branch(times), state.q, state.v, forces, steps
    for time, q, v, force, h in zip(*rows, strict=True):
        missing = evaluator.equations.without_states(force - evaluator.smooth_force(time, q, v))
        change, _ = evaluator.solve_saddle(time, q, v, missing, 0.0, (1.0, 1.0 / h, 1.0 / h**2))
        q += change
        v += change / h
    return state


@dataclass(frozen=True)
class RunSegment:
    """Steps between two restarts, with the parts that are active during these steps.

    Attributes
    ----------
    history
        The accepted steps, with the multipliers of the active parts.
    branch
        Time [s] inside the smooth interval, which selects the pieces of piecewise laws.
    configuration
        Active parts; None if `EquationsOfMotion.configurations` is None.
    equations
        Equations of the active parts.
    m
        Number of multipliers of all parts.
    """

    history: StepHistory
    branch: float
    configuration: Configuration | None
    equations: EquationsOfMotion
    m: int

    @cached_property
    def ranges(self) -> tuple[TableRange, ...]:
        """Ranges of time outside which laws have no values; events may change laws."""
        mechanism = self.equations.mechanism
        return () if mechanism is None else tuple(x for law in mechanism.laws for x in law.ranges)

    def thin(self, times: Array, is_final: bool = False) -> None:
        """Reduce rows to those at `times` [s], see `StepHistory.thin`."""
        self.history.thin(times, self.branch, self._measure, is_final)

    @cached_property
    def _measure(self) -> Callable[[Interval], Array]:
        balance = BalanceRows(self.equations)
        return lambda interval: balance(interval.times, *interval.rows)

    def interval(self) -> Interval:
        """Return all steps as an interval with the multipliers of all parts."""
        return self._expand(self.history.interval(self.branch))

    def tail(self, first: int) -> tuple[Interval, float] | None:
        """Return `StepHistory.tail` with the multipliers of all parts."""
        tail = self.history.tail(first, self.branch)
        return None if tail is None else (self._expand(tail[0]), tail[1])

    def _expand(self, interval: Interval) -> Interval:
        if self.configuration is None:
            return interval
        rows = interval.rows
        rows = rows._replace(lam=self.configuration.expand_multipliers(rows.lam, self.m))
        return replace(interval, rows=rows, configuration=self.configuration)


class StepThinning:
    """Limit of the rows that a run with these output times [s] stores."""

    def __init__(self, output_times: Array) -> None:
        self._output_times, self._limit = output_times, limit_stored_bytes()
        self._times: Array | None = None
        self._parts = self._finished = self._finished_bytes = 0
        self._checked = (0, 0)

    def enforce(self, segments: Sequence[RunSegment]) -> None:
        """Thin the segments of a run if their rows exceed the limit; the last one may grow."""
        current = segments[-1].history
        state = len(segments), current.block_count
        if state == self._checked:
            return
        self._checked = state
        if self._times is None:
            self._finished_bytes += sum(
                x.history.stored_bytes for x in segments[self._finished : -1]
            )
            self._finished = len(segments) - 1
            if self._finished_bytes + current.stored_bytes <= self._limit:
                return
            rows = self._limit / current.row_bytes
            self._times, self._parts = divide_intervals(self._output_times, rows)
            self._finished = 0
        for segment in segments[self._finished :]:
            segment.thin(self._times, segment is not segments[-1])
        self._finished = len(segments) - 1

    @property
    def report(self) -> dict[str, str]:
        """Entry for `Solution.integrator`; empty if all steps are stored."""
        between = f" and {self._parts - 1} rows between each two" if self._parts > 1 else ""
        return {"stored_steps": f"output rows{between}"} if self._parts else {}

    def finish(self, segments: Sequence[RunSegment]) -> None:
        """Thin all rows of a run that exceeded the limit."""
        if self._times is not None:
            for segment in segments:
                segment.thin(self._times, is_final=True)
