"""Output rows against steps: extremes and vibrations that the rows do not show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from beamdae.errors import list_first
from beamdae.results.columns import (
    LIMIT,
    ColumnDict,
    Header,
    format_apart,
    largest_of_kind,
    remove_unit,
)
from beamdae.results.noise import constant_limits, mark_noise
from beamdae.results.run_data import RunData
from beamdae.results.step_extremes import may_have_short_peaks

Array = np.ndarray

_MIN_ROWS = 3  # runs with fewer rows are not curves
_MIN_SHARE = 1e-3  # of the largest half range of columns of this kind; smaller ones do not matter
# Units of positions, velocities and works, which abrupt forces change gradually.
_GRADUAL_UNITS = ("m", "rad", "m/s", "rad/s", "J")
_MAX_NAMES = 3  # of further columns


@dataclass(frozen=True)
class MissedPeak:
    """Value of a column between output rows that these miss.

    Attributes
    ----------
    column
        Header of the column.
    time
        Time of the value [s].
    side
        "smallest" or "largest".
    value, row_value
        The value, and the nearest one of the rows, in the unit of the column.
    half_range
        Half the range of the column, including the steps.
    error
        Larger one of the difference of the extremes, relative to half the range, and of the root
        mean square of the distance from the neighboring rows, relative to the deviation [-].
    importance
        Difference of the values relative to the largest half range of the columns of this kind [-].
    is_extreme
        True if the value is the extreme of the run, otherwise that of a vibration.
    """

    column: str
    time: float
    side: str
    value: float
    row_value: float
    half_range: float
    error: float
    importance: float
    is_extreme: bool


def find_missed_peaks(run: RunData) -> ColumnDict:
    """Return the largest miss of each column that the rows do not show within 4 %, by header.

    The rows of a column show neither an extreme nor a vibration between them if the extreme of the
    steps exceeds that of the rows by 4 % of half the range, or the steps are outside the range of
    the two neighboring rows by a root mean square of 4 % of the deviation of the column. Columns
    that vary by errors only, or are small beside others of the same kind, are omitted, and so are
    lower extremes of magnitudes.
    """
    e, steps = run.equations, run._step_measures
    if run._is_at_rest or not run.columns:
        return ColumnDict()
    headers, rows = e.observed_headers, np.array(list(run.columns.values()))
    at_rows = np.stack([rows.min(axis=1), rows.max(axis=1)])
    half_range = 0.5 * (steps.values[1] - steps.values[0])
    misses = np.stack([at_rows[0] - steps.values[0], steps.values[1] - at_rows[1]])
    misses[0, np.isin(headers, run._magnitudes)] = 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        of_extremes = np.max(misses, axis=0) / half_range
        errors = np.fmax(of_extremes, steps.excess / steps.deviation)
    is_missed = (errors > LIMIT) & np.isin(headers, list(run.step_extremes))
    largest = largest_of_kind(headers, half_range, e.length)
    is_missed &= half_range > _MIN_SHARE * largest
    rtol = run.integrator.get("rtol") or 0.0
    is_missed &= half_range > constant_limits(headers, steps.values, e.length, rtol)
    if is_missed.any():
        in_doubt = np.where(is_missed, half_range, 0.0)
        is_missed &= ~mark_noise(run, steps.values, half_range, in_doubt)
    peaks = {}
    for k in np.flatnonzero(is_missed).tolist():
        is_extreme, side = bool(of_extremes[k] > LIMIT), int(misses[1, k] > misses[0, k])
        place = steps.times[side, k], steps.values[side, k], at_rows[side, k]
        if not is_extreme:
            place = steps.excess_times[k], steps.excess_values[k], steps.excess_rows[k]
        time, value, row_value = map(float, place)
        peaks[headers[k]] = MissedPeak(
            headers[k],
            time,
            "largest" if value > row_value else "smallest",
            value,
            row_value,
            half_range=float(half_range[k]),
            error=float(errors[k]),
            importance=abs(value - row_value) / float(largest[k]),
            is_extreme=is_extreme,
        )
    return ColumnDict(peaks)


def coarse_row_warnings(run: RunData) -> Iterator[str]:
    """Yield one warning about what the rows of a run do not show.

    The column whose miss is largest, relative to the largest half range of its kind, comes first.
    Of long runs that store only some of their steps, peaks are unknown where forces may be short.
    """
    e = run.equations
    peaks = list(run.missed_peaks.values()) if len(run.t) >= _MIN_ROWS else []
    unknown = []
    if not run.trajectory.stores_all_steps and may_have_short_peaks(e):
        units = {header: Header.of(header).unit for header in e.observed_headers}
        unknown = [remove_unit(x) for x, unit in units.items() if unit not in _GRADUAL_UNITS]
    if unknown:
        remedy = (
            "this long run stores only some of its steps, so larger peaks between the output rows "
            "are unknown; reduce output_step= or the end time, or use "
            "bd.simulate(..., keep_steps=True)"
        )
    else:
        remedy = "tables of extremes and step_extremes include these values; curves show them with "
        remedy += "a smaller output_step"
    if unknown and not peaks:
        yield f"{list_first(unknown, _MAX_NAMES)}: {remedy}."
    if not peaks:
        return
    worst, *others = sorted(peaks, key=lambda x: -x.importance)
    value, row_value = format_apart(worst.column, worst.value, worst.row_value)
    names = list_first([remove_unit(x.column) for x in others], _MAX_NAMES)
    missed, reach = f"its {worst.side} value", "and reach only"
    if not worst.is_extreme:
        missed, reach = "values between them", "where they reach only"
    yield (
        f"{remove_unit(worst.column)}: the output rows miss {missed}, {value} at "
        f"t = {worst.time:.6g} s, {reach} {row_value}{f', also in {names}' if names else ''}; "
        f"{remedy}."
    )
