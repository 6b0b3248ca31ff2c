"""Extremes of parts of a run between output rows: vibrations after reversals, impacts and events.

Extremes of the whole run do not show them if a larger one, such as the first after the start, is at
an output row.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from beamdae.errors import list_first
from beamdae.results.coarse_rows import is_practical_step
from beamdae.results.columns import format_apart, remove_unit

Array = np.ndarray

_MIN_ROWS = 100  # of a run with parts, ten per part
_PARTS = 10
# Smaller misses of a part, relative to half the range of the column in the run, have no warning.
# Rows miss up to 5 % of the amplitude of a vibration with 10 rows per period, 10 % with 7, 13 %
# with 6 and 29 % with 4; see `coarse_rows` for vibrations during the whole run.
MIN_MISS_OF_PART = 0.1
# With the recommended step, rows miss the peak by at most this share of half the range, ...
_MAX_REMAINING_MISS = 0.02
# ... found by times around the peak with these distances, relative to that of the rows.
_DISTANCES = 0.8 ** np.arange(50)
_MAX_NAMES = 3  # of further columns in a warning


class MissedPart(NamedTuple):
    """Largest or smallest value of a column in a part of the run, which the output rows miss.

    Attributes
    ----------
    begin, end
        First and last output time of the part [s].
    sign
        1 if the value is the largest one, -1 if it is the smallest one.
    value, row_value
        Extreme at the steps and the rows, and at the rows only, in the unit of the column.
    """

    begin: float
    end: float
    sign: int
    value: float
    row_value: float

    @property
    def miss(self) -> float:
        """Difference of the extreme from the rows, in the unit of the column."""
        return abs(self.value - self.row_value)


class PartExtremes:
    """Extremes of columns at steps and output rows in tenths of a run.

    Steps before the second row are omitted: they contain waves of a sudden start, such as 0.2 of
    half the range of the force in the clamp of a beam with a mass that slides.
    """

    def __init__(self, row_times: Array, rows: Array) -> None:
        """Begin with the output rows (k, n) at the times (k,) [s]."""
        parts = _PARTS if len(row_times) >= _MIN_ROWS else 0
        edges = np.linspace(0, len(row_times) - 1, parts + 1).astype(int)
        self._times = row_times[edges]
        self._first_time = row_times[min(1, len(row_times) - 1)]
        first, last = edges[:-1], rows[edges[1:]]
        self._signed = {}
        for sign in (-1, 1) if parts else ():
            largest = np.maximum.reduceat(sign * rows, first, axis=0)
            largest = np.maximum(largest, sign * last)
            self._signed[sign] = largest, largest.copy()

    def extend(self, times: Array, columns: Array) -> None:
        """Add ascending steps (j,) with the columns (j, n)."""
        begin = int(np.searchsorted(times, self._first_time))
        times, columns = times[begin:], columns[begin:]
        if not self._signed or not len(times):
            return
        part_of_step = np.searchsorted(self._times[1:-1], times, side="right")
        first = np.flatnonzero(np.diff(part_of_step, prepend=-1))
        parts = part_of_step[first]
        for sign, reduce in ((-1, np.minimum), (1, np.maximum)):
            _, largest = self._signed[sign]
            of_steps = sign * reduce.reduceat(columns, first, axis=0)
            largest[parts] = np.maximum(largest[parts], of_steps)

    def finish(self, n_columns: int) -> list[tuple[MissedPart, ...]]:
        """Return the largest miss of each side of each column, without small ones."""
        missed: list[tuple[MissedPart, ...]] = [()] * n_columns
        if not self._signed:
            return missed
        # Columns may be infinite or not a number at some times.
        with np.errstate(invalid="ignore"):
            half_range = 0.5 * sum(np.max(x, axis=0) for _, x in self._signed.values())
            for sign, (of_rows, largest) in self._signed.items():
                misses = largest - of_rows
                is_missed = np.max(misses, axis=0) > MIN_MISS_OF_PART * half_range
                for k in np.flatnonzero(is_missed).tolist():
                    part = int(np.argmax(misses[:, k]))
                    begin, end = self._times[part : part + 2].tolist()
                    values = sign * float(largest[part, k]), sign * float(of_rows[part, k])
                    missed[k] += (MissedPart(begin, end, sign, *values),)
        return missed


def missed_part_warnings(
    missed: Mapping[str, MissedPart],
    half_ranges: Mapping[str, float],
    row_times: Array,
    step_times: Array,
    observe_at: Callable[[Array], Mapping[str, Array]],
) -> Iterator[str]:
    """Yield a warning about parts of a run whose extremes the output rows miss.

    Parameters
    ----------
    missed
        Missed parts by header.
    half_ranges
        Half the ranges of these columns in the run, by header.
    row_times, step_times
        Ascending times of the output rows and of the steps [s].
    observe_at
        Function that returns the observed columns (k,) at ascending times [s], by header.
    """
    if not missed:
        return
    nodes = np.unique(np.concatenate([row_times, step_times]))
    peak_times, widths = {}, {}
    for header, part in missed.items():
        begin = max(part.begin, float(row_times[1]))  # see `PartExtremes`
        times = nodes[(nodes >= begin) & (nodes <= part.end)]
        time = float(times[np.argmax(part.sign * observe_at(times)[header])])
        peak_times[header] = time
        following = int(np.clip(np.searchsorted(row_times, time), 1, len(row_times) - 1))
        distance = float(row_times[following] - row_times[following - 1])
        limit = part.sign * part.value - _MAX_REMAINING_MISS * half_ranges[header]
        width = _measure_width(header, part.sign, time, limit, distance, nodes, observe_at)
        widths[header] = width
    first, *others = sorted(missed, key=lambda x: -missed[x].miss / half_ranges[x])
    part = missed[first]
    value, row_value = format_apart(first, part.value, part.row_value)
    side = "largest" if part.sign > 0 else "smallest"
    names = [
        "{} ({}, rows {})".format(
            remove_unit(x), *format_apart(x, missed[x].value, missed[x].row_value)
        )
        for x in others
    ]
    also = f", and extremes of {list_first(names, _MAX_NAMES)} in parts of the run" if names else ""
    duration = float(row_times[-1] - row_times[0])
    practical = [x for x in widths.values() if is_practical_step(x, duration)]
    if not is_practical_step(widths[first], duration):
        remedy = "use this value, because the peak is too short for output rows"
    else:
        remedy = f"use output_step={_round_down(min(practical)):.0e}"
    yield (
        f"{remove_unit(first)}: between t = {part.begin:.4g} and {part.end:.4g} s, the output rows "
        f"miss its {side} value, {value} at t = {peak_times[first]:.6g} s, and reach only "
        f"{row_value}{also}; {remedy}."
    )


def _measure_width(
    header: str,
    sign: int,
    time: float,
    limit: float,
    distance: float,
    nodes: Array,
    observe_at: Callable[[Array], Mapping[str, Array]],
) -> float:
    """Return the duration [s] around a peak in which `sign` times the column exceeds a limit.

    At least one of rows with this distance is in it.
    """
    distances = distance * _DISTANCES
    around = np.concatenate([time - distances, time + distances[::-1]])
    values = sign * observe_at(np.clip(around, nodes[0], nodes[-1]))[header]
    exceeds = values > limit
    width = 0.0
    for side in (exceeds[: len(distances)][::-1], exceeds[len(distances) :]):
        count = len(side) if side.all() else int(np.argmin(side))
        width += float(distances[-count]) if count else 0.0
    return max(width, float(distances[-1]))


def _round_down(step: float) -> float:
    """Return the largest number with one digit up to a step."""
    power = 10.0 ** math.floor(math.log10(step))
    return math.floor(step / power) * power
