"""Peaks of forces between output rows, found at the steps of the integrator."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.measures import ObservedRows
from beamdae.errors import list_first, name_with_others
from beamdae.results.columns import (
    UNITS_OF_TRANSLATIONS,
    ColumnDict,
    Header,
    drift_limits,
    format_apart,
    largest_of_kind,
    mark_accompanying_rates,
    mark_constant_columns,
    mark_minor_rates,
    mark_resting_columns,
    mark_vanishing_columns,
    remove_unit,
)
from beamdae.results.missed_parts import (
    MIN_MISS_OF_PART,
    MissedPart,
    PartExtremes,
)
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray

# Units of positions, velocities and works, which abrupt forces change gradually.
_GRADUAL_UNITS = ("m", "rad", "m/s", "rad/s", "J")
_UNITS_OF_ACCELERATIONS = ("m/s^2", "rad/s^2")
UNITS_OF_MOTIONS = ("m", "rad", "m/s", "rad/s", *_UNITS_OF_ACCELERATIONS)
_ROUNDING_OF_STRAINS = 1e-12
_MAX_MISSED_SHARE = 0.01  # of the range of a column
# Smaller misses, relative to values that do not depend on an origin, have no warning.
_MIN_SHARE_OF_VALUE = 1e-3
_UNITS_WITH_ORIGIN = ("m", "rad")
# Larger limits, relative to half the range, for rates that accompany the positions of a point.
_MIN_MISS_OF_RATE, _MIN_MISS_OF_RATE_IN_PART = 0.1, 0.3
_MIN_ROWS = 3  # runs with fewer rows are not curves
# Units of stresses and forces, to which damping contributes in proportion to strain rates.
_UNITS_WITH_DAMPING = ("Pa", "N", "N m")
# Duration after an impact with the largest effect of this contribution, relative to the damping.
# The stress beside a mass that a beam of 8 to 64 elements carries peaks after 0.002 to 0.08.
_DURATION_OF_JUMP = 0.1
# After one retardation time, this contribution has decayed: by 98 % in a latch between two panels
# of 2 to 32 elements, whose axial force, of the change of the structure, has decayed by 2 to 4 %.
# The decay is relative to the difference from the rows, and to half the range.
_MIN_DECAY, _MIN_DECAY_OF_RANGE = 0.5, 0.05
_MAX_ROWS_AT_ONCE = 2048
_MIN_KNOWN_SHARE = 0.5  # of the steps that are output rows and need not be evaluated again
_MAX_NAMES = 3  # of further columns in a warning


@dataclass(frozen=True)
class StepExtremes:
    """Extremes of an observed column, their times [s], and its root mean square.

    All of them include the steps and the output rows. `missed_parts` are extremes of tenths of the
    run that the output rows miss by more than 10 % of half the range. `tuple(extremes)` returns
    (min, min_time, max, max_time, rms).
    """

    min: float
    min_time: float
    max: float
    max_time: float
    rms: float
    missed_parts: tuple[MissedPart, ...] = ()

    def __iter__(self) -> Iterator[float]:
        return iter((self.min, self.min_time, self.max, self.max_time, self.rms))

    @property
    def half_range(self) -> float:
        """Half the difference of the extremes, in the unit of the column."""
        return 0.5 * (self.max - self.min)


def select_large_columns(
    headers: Sequence[str],
    extremes: Mapping[str, StepExtremes],
    length: float,
    min_share: float,
) -> dict[str, float]:
    """Return half the ranges of columns above a share of the largest one of their kind, by header.

    See `largest_of_kind` for kinds and the `length` [m] of the mechanism.
    """
    half_ranges = np.array([extremes[x].half_range for x in headers])
    is_small = half_ranges <= min_share * largest_of_kind(headers, half_ranges, length)
    items = zip(headers, half_ranges.tolist(), is_small, strict=True)
    return {header: half_range for header, half_range, small in items if not small}


@dataclass(frozen=True)
class MissedPeak:
    """Peak of a column that is missing in the output rows.

    Attributes
    ----------
    column
        Header of the column.
    time
        Time of the peak [s].
    side
        "smallest" or "largest".
    value, row_value
        The peak, and the smallest or largest value of the rows, in the unit of the column.
    half_range
        Half the range of the column, including the steps.
    largest_half_range
        The largest one of the columns of the same kind, see `largest_of_kind`.
    """

    column: str
    time: float
    side: str
    value: float
    row_value: float
    half_range: float
    largest_half_range: float

    @property
    def error(self) -> float:
        """Difference of the peak from the rows relative to half the range [-]."""
        return abs(self.value - self.row_value) / self.half_range

    @property
    def importance(self) -> float:
        """Difference relative to the largest half range of this kind of columns [-]."""
        return abs(self.value - self.row_value) / self.largest_half_range

    @property
    def is_visible(self) -> bool:
        """True if peak and rows differ as numbers, not only relative to the range of the column."""
        has_origin = Header.of(self.column).unit in _UNITS_WITH_ORIGIN
        miss = abs(self.value - self.row_value)
        return has_origin or miss > _MIN_SHARE_OF_VALUE * abs(self.value)

    @property
    def description(self) -> str:
        """Column, peak and time; the beginning of a sentence."""
        value, row_value = format_apart(self.column, self.value, self.row_value)
        return (
            f"{remove_unit(self.column)}: the output rows miss its {self.side} value, {value} at "
            f"t = {self.time:.6g} s, and reach only {row_value}"
        )

    @property
    def comparison(self) -> str:
        """Column, peak and value of the rows in brackets."""
        value, row_value = format_apart(self.column, self.value, self.row_value)
        return f"{remove_unit(self.column)} ({value}, rows {row_value})"


def measure_step_extremes(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    row_times: Array,
    observed: Callable[[], Mapping[str, Array]],
) -> ColumnDict:
    """Return the extremes of the observed columns over the steps and the output rows.

    Columns that are not finite at a step are omitted, and so are accelerations in models with beams
    and without abrupt forces: at the steps after a sudden load, they contain transients of the
    beams that are not resolved.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    row_times
        Times (k,) of the output rows [s].
    observed
        Function that returns the observed columns (k,) at these times, by header.
    """
    headers = equations.observed_headers
    if not headers:
        return ColumnDict()
    has_transients = bool(beams_of(equations.mechanism)) and not may_have_short_peaks(equations)
    omitted_units = _UNITS_OF_ACCELERATIONS if has_transients else ()
    begin, end = row_times[0], row_times[-1]
    rows_of_table = np.column_stack([row_times, *observed().values()])
    squares = _SquareIntegral(rows_of_table)
    parts = PartExtremes(row_times, rows_of_table[:, 1:])
    extremes: tuple[Array, Array] | None = None
    intervals_of_rows = trajectory.interval_index(row_times)
    for number, interval in enumerate(trajectory.intervals):
        if interval.t[0] == interval.t[-1] and begin < end:
            continue  # between simultaneous events, where states have no duration
        evaluate = ObservedRows(equations.with_loads_of(interval.configuration))
        known = _select_known_steps(interval, rows_of_table[intervals_of_rows == number])
        rows = interval.times[:: interval.nodes_per_step]
        first = int(np.searchsorted(rows[:, 0], begin, side="left"))
        last = int(np.searchsorted(rows[:, 0], end, side="right"))
        for k in range(first, last, _MAX_ROWS_AT_ONCE):
            block = slice(k, min(k + _MAX_ROWS_AT_ONCE, last))
            columns = _evaluate_steps(evaluate, rows[block], interval, block, known)
            # The columns of all steps may exceed the memory.
            squares.extend(rows[block, 0], columns)
            parts.extend(rows[block, 0], columns)
            of_block = _find_extremes(rows[block, 0], columns)
            if extremes is not None:
                pairs = zip(extremes, of_block, strict=True)
                of_block = _find_extremes(*(np.concatenate(pair) for pair in pairs))
            extremes = of_block
    if extremes is None:
        return ColumnDict()
    # Rows between steps may exceed both; rows that are not finite are no extremes.
    numbers = rows_of_table[:, 1:]
    numbers = np.where(np.isfinite(numbers), numbers, extremes[1][0])
    of_rows = _find_extremes(row_times, numbers)
    pairs = zip(extremes, of_rows, strict=True)
    times, values = _find_extremes(*(np.concatenate(pair) for pair in pairs))
    return ColumnDict(
        {
            header: StepExtremes(low, low_time, high, high_time, *others)
            for header, (low, high), (low_time, high_time), *others in zip(
                headers,
                values.T.tolist(),
                times.T.tolist(),
                squares.finish().tolist(),
                parts.finish(len(headers)),
                strict=True,
            )
            if Header.of(header).unit not in omitted_units and np.isfinite([low, high]).all()
        }
    )


class _KnownSteps(NamedTuple):
    """Steps of an interval that are output rows: their ascending indices, and columns (k, n)."""

    steps: Array
    columns: Array


def _select_known_steps(interval: Interval, rows: Array) -> _KnownSteps:
    """Return the steps among the output rows (t, columns) of an interval."""
    steps = interval.find_steps(rows[:, 0])
    # A selection copies the states of the other steps, which pays off if they are few.
    if steps is None or len(steps) < _MIN_KNOWN_SHARE * len(interval.t):
        return _KnownSteps(np.zeros(0, int), rows[:0, 1:])
    return _KnownSteps(steps, rows[:, 1:])


def _evaluate_steps(
    evaluate: Callable[..., Array],
    times: Array,
    interval: Interval,
    block: slice,
    known: _KnownSteps,
) -> Array:
    """Return the columns at a block of steps, without evaluating the known ones again."""
    here = slice(*np.searchsorted(known.steps, [block.start, block.stop]))
    is_new = np.ones(len(times), bool)
    is_new[known.steps[here] - block.start] = False
    state = [x[block] for x in interval.state]
    if is_new.all():
        return evaluate(times, *state)
    columns = np.empty((len(times), known.columns.shape[1]))
    columns[~is_new] = known.columns[here]
    if is_new.any():
        columns[is_new] = evaluate(times[is_new], *(x[is_new] for x in state))
    return columns


class _SquareIntegral:
    """Integral of the squares of columns over steps and output rows by the trapezoidal rule."""

    def __init__(self, rows: Array) -> None:
        """Begin at the first of the output rows (t, columns), (k, 1 + n)."""
        self._rows, self._next = rows, 1
        self._last, self._sum = rows[:1], np.zeros(rows.shape[1] - 1)

    def extend(self, times: Array, columns: Array) -> None:
        """Add ascending steps with the columns (k, n), and the rows between them."""
        following = int(np.searchsorted(self._rows[:, 0], times[-1], side="right"))
        rows = self._rows[self._next : max(following, self._next)]
        steps = np.column_stack([times, columns])
        self._add(np.concatenate([rows, steps]))
        self._next = max(following, self._next)

    def _add(self, nodes: Array) -> None:
        order = np.argsort(nodes[:, 0], kind="stable")
        nodes = np.concatenate([self._last, nodes[order]])
        # Columns may be infinite or not a number at some steps.
        with np.errstate(invalid="ignore", over="ignore"):
            squares = nodes[:, 1:] ** 2
            self._sum += 0.5 * np.diff(nodes[:, 0]) @ (squares[1:] + squares[:-1])
        self._last = nodes[-1:]

    def finish(self) -> Array:
        """Add the remaining rows; return root mean squares (n,) from the first to the last row."""
        self._add(self._rows[self._next :])
        self._next = len(self._rows)
        duration = self._rows[-1, 0] - self._rows[0, 0]
        return np.sqrt(self._sum / duration) if duration > 0.0 else np.abs(self._rows[0, 1:])


def may_have_short_peaks(equations: EquationsOfMotion) -> bool:
    """Return True if forces may peak between rows: contacts, formulas of the user, and friction.

    Formulas count even if they are smooth.
    """
    mechanism = equations.mechanism
    if mechanism is not None and any(x.gaps for x in mechanism.parts.values()):
        return True
    kernels = (term.kernel for term in equations.forces)
    return any(not kernel.reused or kernel.local.n_multipliers for kernel in kernels)


def _find_extremes(times: Array, columns: Array) -> tuple[Array, Array]:
    """Return times and values of the extremes of each column, smallest first, (2, k) each.

    An extreme of a column with values that are not finite is one of them. `times` has shape (rows,)
    or (rows, k), and `columns` (rows, k).
    """
    rows = np.stack([np.argmin(columns, axis=0), np.argmax(columns, axis=0)])
    t = np.broadcast_to(times.reshape(len(columns), -1), columns.shape)
    return np.take_along_axis(t, rows, 0), np.take_along_axis(columns, rows, 0)


def find_missed_peaks(
    observed: Mapping[str, Array],
    extremes: Mapping[str, StepExtremes],
    length: float,
    rtol: float = 0.0,
    find_drift: Callable[[], tuple[float, float]] = lambda: (0.0, 0.0),
    magnitudes: Collection[str] = (),
) -> ColumnDict:
    """Return the missed peak of each column whose largest or smallest value the rows miss.

    Differences of at most 1 % of the range of the column are not considered, and neither are
    columns that vary by errors only.

    Parameters
    ----------
    observed
        Observed columns (k,) by header.
    extremes
        Extremes at the steps, see `measure_step_extremes`.
    length
        Length of the mechanism [m].
    rtol
        Tolerance of the run; 0 for fixed steps.
    find_drift
        Function that returns the drift of the constraints in positions [m] and velocities [m/s].
    magnitudes
        Headers of magnitudes, of which only the largest value matters.
    """
    columns = np.array([observed[x] for x in extremes])
    is_finite = np.isfinite(columns).all(axis=1) if extremes else np.zeros(0, bool)
    names = [name for name, finite in zip(extremes, is_finite.tolist(), strict=True) if finite]
    if not names:
        return ColumnDict()
    rows = np.stack([np.min(columns[is_finite], axis=1), np.max(columns[is_finite], axis=1)])
    steps = np.array([[extremes[x].min, extremes[x].max] for x in names]).T
    low, high = np.minimum(rows[0], steps[0]), np.maximum(rows[1], steps[1])
    half_range, values = 0.5 * (high - low), np.stack([low, high])
    is_at_rest = mark_noise(names, values, half_range, length, rtol)
    misses = np.stack([rows[0] - low, high - rows[1]])
    misses[0, [name in magnitudes for name in names]] = 0.0
    is_missed = (misses > 2.0 * _MAX_MISSED_SHARE * half_range).any(axis=0) & ~is_at_rest
    if is_missed.any():
        is_missed &= half_range > drift_limits(names, length, *find_drift())
    largest = largest_of_kind(names, half_range, length)
    peaks: dict[str, MissedPeak] = {}
    for k in np.flatnonzero(is_missed):
        column, side = names[k], int(np.argmax(misses[:, k]))
        extreme = extremes[column]
        peaks[column] = MissedPeak(
            column,
            time=(extreme.min_time, extreme.max_time)[side],
            side=("smallest", "largest")[side],
            value=float(steps[side, k]),
            row_value=float(rows[side, k]),
            half_range=float(half_range[k]),
            largest_half_range=float(largest[k]),
        )
    return ColumnDict(peaks)


def mark_noise(
    names: Sequence[str], values: Array, half_range: Array, length: float, rtol: float
) -> Array:
    """Return the mask of columns that vary by errors only, with the values (2, n) as extremes."""
    is_noise = mark_resting_columns(names, values, half_range, length)
    is_noise |= mark_vanishing_columns(names, half_range, length, values)
    is_noise |= mark_constant_columns(names, values, half_range, length, rtol)
    units = [Header.of(name).unit for name in names]
    is_noise |= (np.array(units) == "-") & (half_range <= _ROUNDING_OF_STRAINS)
    return np.asarray(is_noise)


def find_missed_parts(
    peaks: Mapping[str, MissedPeak],
    observed: Mapping[str, Array],
    extremes: Mapping[str, StepExtremes],
    length: float,
    rtol: float,
    find_drift: Callable[[], tuple[float, float]],
    magnitudes: Collection[str],
) -> ColumnDict:
    """Return the part of the run, by column, whose extreme the rows miss by the most.

    Columns that vary by errors only are omitted, and so are those whose extreme of the whole run is
    missed by as much, according to the `peaks` of `find_missed_peaks`, which has the other
    parameters.
    """
    names = [name for name in extremes if np.isfinite(observed[name]).all()]
    missed = {}
    for name in names:
        signs = (1,) if name in magnitudes else (-1, 1)
        parts = [x for x in extremes[name].missed_parts if x.sign in signs]
        if parts:
            missed[name] = max(parts, key=lambda x: x.miss)
    if not missed:
        return ColumnDict()
    values = np.array([[extremes[x].min, extremes[x].max] for x in names]).T
    half_range = 0.5 * (values[1] - values[0])
    is_noise = mark_noise(names, values, half_range, length, rtol)
    is_noise |= mark_minor_rates(names, half_range, length)
    misses = np.array([missed[name].miss if name in missed else 0.0 for name in names])
    is_noise |= mark_accompanying_rates(names) & (misses < _MIN_MISS_OF_RATE_IN_PART * half_range)
    is_missed = np.array([name in missed for name in names]) & ~is_noise
    if not is_missed.any():
        return ColumnDict()
    is_missed &= half_range > drift_limits(names, length, *find_drift())
    known = {name for name, peak in peaks.items() if peak.error > MIN_MISS_OF_PART}
    selected = (name for name, x in zip(names, is_missed.tolist(), strict=True) if x)
    return ColumnDict({name: missed[name] for name in selected if name not in known})


def list_unknown_peaks(equations: EquationsOfMotion, trajectory: Trajectory) -> list[str]:
    """Return the columns with unknown peaks between rows, because steps have not been stored."""
    if trajectory.stores_all_steps or not may_have_short_peaks(equations):
        return []
    headers = equations.observed_headers
    return [remove_unit(x) for x in headers if Header.of(x).unit not in _GRADUAL_UNITS]


class DampingPeak(NamedTuple):
    """Peak by the damping of a section at a jump of velocities.

    Attributes
    ----------
    peak
        The peak, which the output rows miss.
    later_time, later_value
        End of the retardation time after the peak [s], and the value there, without this damping.
    """

    peak: MissedPeak
    later_time: float
    later_value: float


def select_peaks_of_damping(
    peaks: Mapping[str, MissedPeak],
    jump_times: Sequence[float],
    damping: float,
    end: float,
    observe_at: Callable[[Array], Mapping[str, Array]],
) -> list[DampingPeak]:
    """Return the peaks of stresses and forces that damping causes at jumps of velocities.

    At a jump, the velocity of one node changes, and those of its neighbors do not: strain rates,
    and the stresses and forces by damping, depend on the length of the element. They decay within
    the retardation time; other forces after a jump last longer.

    Parameters
    ----------
    peaks
        Missed peaks of the run, by header.
    jump_times
        Times of jumps of velocities [s].
    damping
        Largest retardation time of a section [s].
    end
        End of the run [s].
    observe_at
        Function that returns the observed columns (k,) at ascending times [s], by header.
    """
    times = np.asarray(jump_times)
    of_damping = []
    for peak in peaks.values():
        is_at_jump = bool(np.any(np.abs(peak.time - times) < _DURATION_OF_JUMP * damping))
        if Header.of(peak.column).unit not in _UNITS_WITH_DAMPING or not is_at_jump:
            continue
        later = min(peak.time + damping, end)
        value = float(observe_at(np.array([later]))[peak.column][0])
        decay = abs(peak.value - value)
        is_large = decay > _MIN_DECAY_OF_RANGE * peak.half_range
        if is_large and decay > _MIN_DECAY * abs(peak.value - peak.row_value):
            of_damping.append(DampingPeak(peak, later, value))
    return of_damping


def damping_peak_warnings(peaks: Sequence[DampingPeak], has_impacts: bool) -> Iterator[str]:
    """Yield a warning about the peaks of `select_peaks_of_damping`, which depend on the mesh.

    `has_impacts` is True if events with bd.impact cause jumps, False if only activated joints do.
    """
    if not peaks:
        return
    worst, *others = sorted(peaks, key=lambda x: -x.peak.importance)
    peak = worst.peak
    value, row_value = format_apart(peak.column, peak.value, peak.row_value)
    columns = name_with_others(
        remove_unit(peak.column), [remove_unit(x.peak.column) for x in others]
    )
    usable = f"the rows ({row_value})"
    sign = -1.0 if peak.side == "smallest" else 1.0
    if sign * (worst.later_value - peak.row_value) > 2.0 * _MAX_MISSED_SHARE * abs(
        worst.later_value
    ):
        # The rows miss the peak without the damping, too.
        unit = Header.of(peak.column).unit
        usable = (
            f"the value after it ({worst.later_value:.4g} {unit} at t = {worst.later_time:.6g} s)"
        )
    contact = ", or a bd.Contact in place of bd.impact" if has_impacts else ""
    yield (
        f"{columns}: the {peak.side} value, {value} at t = {peak.time:.6g} s, is that of the "
        "damping of the section at a jump of the velocities, which decays within the retardation "
        f"time and may depend on the number of elements; use {usable}{contact}."
    )


def remove_minor_peaks(
    peaks: Mapping[str, MissedPeak], extremes: Mapping[str, StepExtremes], length: float
) -> dict[str, MissedPeak]:
    """Return the peaks without those of `mark_minor_rates`.

    Peaks of `mark_accompanying_rates` remain if the rows miss them by 10 % of half the range.
    """
    half_ranges = np.array([x.half_range for x in extremes.values()])
    is_minor = mark_minor_rates(list(extremes), half_ranges, length)
    errors = np.array([peaks[x].error if x in peaks else 0.0 for x in extremes])
    is_minor |= mark_accompanying_rates(extremes) & (errors < _MIN_MISS_OF_RATE)
    minor = {header for header, x in zip(extremes, is_minor.tolist(), strict=True) if x}
    return {header: peak for header, peak in peaks.items() if header not in minor}


def missed_peak_warnings(
    peaks: Mapping[str, MissedPeak],
    n_rows: int,
    unknown: Sequence[str] = (),
) -> Iterator[str]:
    """Yield one warning about the missed peaks of a run, with values of the worst of each kind.

    Peaks of columns that are small compared with others of their kind come last. Peaks that differ
    from the rows by less than a thousandth of their value are omitted. All peaks are omitted if the
    `n_rows` of the run are only its start and its end. `unknown` are the columns of
    `list_unknown_peaks`.
    """
    visible = [peak for peak in peaks.values() if peak.is_visible and n_rows >= _MIN_ROWS]
    remedy = "read these values from step_extremes, or reduce output_step="
    if unknown:
        remedy = (
            "this long run stores only some of its steps, so larger peaks between the output rows "
            "are unknown; set keep_steps=True, or reduce output_step= or the end time"
        )
    if not visible:
        if unknown:
            yield f"{list_first(unknown, _MAX_NAMES)}: {remedy}."
        return
    ordered = sorted(visible, key=lambda peak: -peak.importance)
    of_kinds: dict[str, MissedPeak] = {}
    for peak in ordered:
        unit = Header.of(peak.column).unit
        kind, _ = UNITS_OF_TRANSLATIONS.get(unit, (unit, 0))
        of_kinds.setdefault(kind, peak)
    worst, *others = dict.fromkeys([*of_kinds.values(), *ordered])
    kinds = len(of_kinds) - 1
    names = [
        peak.comparison if k < kinds else remove_unit(peak.column) for k, peak in enumerate(others)
    ]
    also = f", also in {list_first(names, max(_MAX_NAMES, kinds))}" if others else ""
    yield f"{worst.description}{also}; {remedy}."
