"""Errors of the recording that would explain the residuals of a fit: by linear algebra, no runs.

The runs of the end of a search, or of its first values, predict data with a wrong sign, unit, zero
or time. Changes of all estimates are linear in these predictions, and least squares determine them
together with the error.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from beamdae.analysis.fit.data import COLUMN, VALUE
from beamdae.analysis.fit.problem import (
    MIN_SINGULAR_RATIO,
    Evaluation,
    FitProblem,
    column_lengths,
    varies,
)
from beamdae.analysis.fit.variables import Scaling
from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, InputWarning, warn_user
from beamdae.model_parameters import conversion_factor, format_with_unit, split_unit
from beamdae.results.columns import remove_unit

Array = np.ndarray

# Share of the squares of the residuals, without those of the noise of a given sigma, that an error
# explains if it is named. A wrong frequency, whose errors grow linearly over time, is a delay for
# 0.75 of them.
_MIN_SHARE = 0.85
# Errors that leave sums of squares that differ by less, in variances of what the best one leaves,
# explain the residuals alike: 3 standard deviations. Predictions from the first values are alike
# up to this ratio.
_MAX_DIFFERENCE, _MAX_RATIO = 10.0, 10.0
# Smaller parts of an effect that other estimates do not compensate are not assessed.
_MIN_INDEPENDENT_PART = 0.1
# Larger errors of a sampling rate are not named; 48 kHz instead of 44.1 kHz are 9 %.
_MAX_CLOCK_ERROR = 0.1
# Scales within this factor of 1 are errors of calibrations, others of signs or units.
_MIN_FACTOR = 1.8
# First parts of the data that first values may predict in phase, as shares of the time, and the
# cost of a relative change of an estimate by 1, as a share of the deviation of the data.
_SHARES, _COST_OF_CHANGES = (1.0, 0.5, 0.25, 0.125), 0.1
# Share of the variation of a part that an error leaves if it is named, and values of a part.
_MAX_LEFT_SHARE, _MIN_VALUES_PER_ESTIMATE = 0.05, 3
# Delays are searched among this number, up to this share of the duration in both directions; the
# data must cover the last share of the rows at these times.
_DELAY_COUNT, _MAX_DELAY_SHARE, _MIN_COVERED_SHARE = 200, 0.25, 0.75
# Ratio of the ranges of a column in the first run and in the data from which a fit warns, and from
# which it does not search if no parameter explains it.
_MAX_RANGE_RATIO, _MAX_SEARCHED_RATIO = 100.0, 300.0
# A model is about proportional to a power of a parameter, of at least the first number, if its
# derivative has at least this squared correlation with the model.
_MIN_EXPONENT, _MIN_SHAPE = 0.5, 0.9
# Unit, factor and names of units that are mistaken for each other; "" means any unit.
_MISTAKEN_UNITS = (
    ("m/s^2", 9.80665, "g and m/s^2"),
    ("m", 10.0, "cm and mm"),
    ("m", 25.4, "inches and mm"),
    ("rad", 180.0 / np.pi, "degrees and radians"),
    ("m", 100.0, "m and cm"),
    ("", 1e3, "a unit and its thousandth"),
    ("", 1e6, "a unit and its millionth"),
)
_UNIT_TOLERANCE = 0.05


class _Cause(NamedTuple):
    """Error of the recording: the sum of squares that it leaves, and a phrase with the remedy."""

    left: float
    kind: str
    phrase: str


class _Comparison:
    """Data in standard deviations beside the predictions of an evaluation.

    `cost` is that of a relative change of an estimate by 1. `model` are the predicted values (N,),
    `effects` their changes by estimates (N, k), and `rates` their rates (N,).
    """

    def __init__(self, problem: FitProblem, evaluation: Evaluation, cost: float) -> None:
        self.problem, self.cost = problem, cost
        table = problem.data.table
        self.headers = problem.data.headers
        self.columns = pd.factorize(table[COLUMN])[0]
        self.times = table[TIME].to_numpy()
        self.weights = np.where(evaluation.is_omitted, 0.0, problem.weights)
        self.values = table[VALUE].to_numpy() * self.weights
        estimates = np.append(evaluation.values, evaluation.coefficients)
        sizes = np.where(estimates == 0.0, 1.0, np.abs(estimates))
        self.model = evaluation.residuals + self.values
        self.effects = evaluation.jacobian * sizes
        self.rates = problem.weighted_rates(evaluation)

    def variation(self, rows: Array) -> float:
        """Return the sum of the squared deviations of rows from the mean of their column."""
        columns, values, weights = self.columns[rows], self.values[rows], self.weights[rows]
        means = np.bincount(columns, values * weights) / np.bincount(columns, weights**2)
        return float(np.sum((values - np.nan_to_num(means)[columns] * weights) ** 2))

    def fit(self, errors: Array, rows: Array, values: Array | None = None) -> tuple[Array, Array]:
        """Return the residuals that errors with effects (N, j) leave, and their sizes (j,).

        The residuals are those of the rows (n,), then the costs of the changes of the estimates.
        Sizes are 0 for errors that these changes compensate.
        """
        count = len(self.effects.T)
        effects = np.vstack([self.effects[rows], self.cost * np.eye(count)])
        errors = np.vstack([errors[rows], np.zeros((count, len(errors.T)))])
        values = self.values if values is None else values
        residuals = np.append((self.model - values)[rows], np.zeros(count))
        directions, singular, _ = np.linalg.svd(effects / column_lengths(effects), False)
        directions = directions[:, singular > MIN_SINGULAR_RATIO]
        own, rest = (x - directions @ (directions.T @ x) for x in (errors, residuals))
        lengths = column_lengths(own)
        if np.any(lengths < _MIN_INDEPENDENT_PART * column_lengths(errors)):
            return rest, np.zeros(len(errors.T))
        sizes = -np.linalg.lstsq(own / lengths, rest, rcond=None)[0]
        return rest + own / lengths @ sizes, sizes / lengths

    def fit_scales(
        self, numbers: Sequence[int], rows: Array, has_offsets: bool
    ) -> tuple[float, Array]:
        """Return the sum of squares that scales of columns leave, and the scales.

        The data over their scale are linear in the reciprocal scale.
        """
        is_in = self.columns[:, None] == np.asarray(numbers)
        errors = is_in * -self.values[:, None]
        if has_offsets:
            errors = np.hstack([errors, is_in * self.weights[:, None]])
        rest, sizes = self.fit(errors, rows)
        scales = 1.0 / (1.0 + sizes[: len(numbers)])
        factors = np.where(is_in.any(axis=1), is_in @ scales, 1.0)[rows]
        rest[: len(factors)] *= factors
        return float(rest @ rest), scales

    def advanced(self, delay: float, is_late: Array) -> Array:
        """Return the values (N,) in which some rows are earlier; NaN beyond the end of the data."""
        values = self.values.copy()
        for _, rows in self.problem.data.rows:
            late = np.arange(rows.start, rows.stop)[is_late[rows]]
            if len(late):
                times, recorded = self.times[rows], self.values[rows] / self.weights[rows]
                moved = np.interp(times[late - rows.start] + delay, times, recorded, np.nan, np.nan)
                values[late] = moved * self.weights[late]
        return values


def suggest_causes(problem: FitProblem, end: Evaluation, first: Evaluation | None) -> str:
    """Return the beginning of a remedy that names errors which explain the residuals, or "".

    All that explain them alike are named: only another measurement distinguishes these. The
    predictions are those of the end, then those of the first values for first parts of the data.
    """
    with np.errstate(all="ignore"):
        for evaluation in (end, first):
            if evaluation is None:
                continue
            is_end = evaluation is end
            cost = 0.0 if is_end else _COST_OF_CHANGES * np.sqrt(problem.data.variation)
            whole = _Comparison(problem, evaluation, cost)
            explained: list[tuple[float, list[_Cause]]] = []
            for share in (1.0,) if is_end else _SHARES:
                rows = whole.times <= share * whole.times.max()
                count = int(np.sum(rows))
                if count < _MIN_VALUES_PER_ESTIMATE * len(whole.effects.T):
                    break
                square = float(np.sum(end.residuals[rows] ** 2))
                if not is_end:
                    rest = whole.fit(np.zeros((len(rows), 0)), rows)[0]
                    square = min(square, float(rest @ rest))
                # At least the noise is left.
                least = min(float(problem.data.is_sigma_known) * count, square)
                limit = least + (1.0 - _MIN_SHARE) * (square - least)
                limit = min(limit, least + _MAX_LEFT_SHARE * whole.variation(rows))
                if causes := _choose(whole, rows, limit, not is_end):
                    best = max(min(x.left for x in causes), np.finfo(float).eps * square)
                    alike = _MAX_DIFFERENCE / count if is_end else _MAX_RATIO
                    causes = [x for x in causes if x.left <= (1.0 + alike) * best]
                    explained.append((float(np.sqrt(square / best)), causes))
            if explained:
                # Vibrations of a short part determine signs, those of a long one delays.
                ratio, causes = max(explained, key=lambda x: x[0])
                named = {x.kind: x.phrase for x in [*causes, *explained[0][1]]}
                return (
                    f"{' or '.join(named.values())} would reduce the residuals by a factor of "
                    f"about {ratio:.2g}; otherwise, "
                )
    return ""


def _choose(data: _Comparison, rows: Array, limit: float, has_long_delays: bool) -> list[_Cause]:
    """Return the errors that leave at most a sum of squares.

    Errors of all columns are considered if no error of one column, and none of the times, does.
    """
    every = [k for k in range(len(data.headers)) if varies(data.values[data.columns == k])]
    causes = list(_errors_of_times(data, rows, limit, has_long_delays)) if every else []
    causes += [cause for k in every for cause in _errors_of_values(data, [k], rows)]
    chosen = [x for x in causes if x.left <= limit]
    if not chosen and len(every) > 1:
        chosen = [x for x in _errors_of_values(data, every, rows) if x.left <= limit]
    return chosen


def _errors_of_times(
    data: _Comparison, rows: Array, limit: float, has_long_delays: bool
) -> Iterator[_Cause]:
    """Yield delays of all data and of each of several columns, and a wrong sampling rate."""
    delays = np.zeros(1)
    if has_long_delays:
        largest = _MAX_DELAY_SHARE * float(data.times[rows].max())
        delays = np.linspace(-largest, largest, _DELAY_COUNT + 1)
    first = float(data.times.min())
    groups = {"": np.ones(len(rows), bool)}
    if len(data.headers) > 1:
        groups |= {remove_unit(x): data.columns == k for k, x in enumerate(data.headers)}
    for name, is_late in groups.items():
        left, delay = _find_delay(data, rows, is_late, limit, delays)
        if delay:
            # The default bounds of shift= are the first time of the data on both sides.
            omit = f"omit data before {2.0 * delay:.2g} s and " if delay > first else ""
            shift, values = f"shift=[{name!r}]" if name else "shift=", f"values of {name}"
            phrase = (
                f"{values if name else 'data'} that are {'late' if delay > 0.0 else 'early'} by "
                f"about {abs(delay):.2g} s ({omit}estimate an error of the times with {shift})"
            )
            yield _Cause(left, f"delay {name}", phrase)
    rest, sizes = data.fit((-data.rates * data.times)[:, None], rows)
    rate = float(sizes[0])
    if rate and abs(rate) <= _MAX_CLOCK_ERROR:
        phrase = (
            f"times that are {100.0 * abs(rate):.2g} % too {'long' if rate > 0.0 else 'short'} "
            "(check the sampling rate, and what determines the frequencies of the model)"
        )
        yield _Cause(float(rest @ rest), "clock", phrase)


def _find_delay(
    data: _Comparison, rows: Array, is_late: Array, limit: float, delays: Array
) -> tuple[float, float]:
    """Return the sum of squares that a delay of some rows leaves, and the delay.

    It is the smallest of those that leave at most the limit and less than those beside them, or the
    best one: vibrations determine delays up to whole periods.
    """
    variation = data.variation(rows)
    ends = []
    for delay in delays.tolist():
        moved = data.advanced(delay, is_late) if delay else data.values
        covered = rows & np.isfinite(moved)
        if np.sum(covered) < _MIN_COVERED_SHARE * np.sum(rows):
            ends.append((np.inf, delay))
            continue
        rest, sizes = data.fit((-data.rates * is_late)[:, None], covered, moved)
        left = float(rest @ rest) * variation / (data.variation(covered) or np.inf)
        ends.append((left, delay + float(sizes[0])))
    outside = [(np.inf, 0.0)]
    minima = [
        y
        for x, y, z in zip(outside + ends, ends, ends[1:] + outside, strict=False)
        if y[0] <= min(x[0], z[0], limit)
    ]
    return min(minima, key=lambda x: abs(x[1]), default=min(ends))


def _errors_of_values(data: _Comparison, numbers: Sequence[int], rows: Array) -> Iterator[_Cause]:
    """Yield wrong signs, units, calibrations and zeros of columns."""
    columns = [data.headers[k] for k in numbers]
    names = [remove_unit(x) for x in columns]
    is_in = data.columns[:, None] == np.asarray(numbers)
    left, scales = data.fit_scales(numbers, rows, has_offsets=False)
    if np.all(scales != 1.0) and not any(map(_is_unit_error, scales)):
        amounts = [
            f"{100.0 * abs(x - 1.0):.2g} % too {'large' if x > 1.0 else 'small'}"
            for x in scales.tolist()
        ]
        phrase = f"values of {', '.join(names)} that are {', '.join(amounts)}"
        yield _Cause(left, f"scale {names}", f"{phrase} (estimate this with scale={names})")
    rest, sizes = data.fit(is_in * data.weights[:, None], rows)
    if sizes.all():
        amounts = [
            format_with_unit(float(f"{x:.2g}"), split_unit(header)[1])
            for x, header in zip(sizes.tolist(), columns, strict=True)
        ]
        phrase = f"a constant error of {', '.join(names)} of {', '.join(amounts)}"
        phrase = f"{phrase} (estimate this with offset={names})"
        yield _Cause(float(rest @ rest), f"offset {names}", phrase)
    sensors = data.problem.sensors.scales
    if not any(np.any(x.rows & np.isin(data.columns, numbers)) for x in sensors):
        left, scales = data.fit_scales(numbers, rows, has_offsets=True)
        if any(map(_is_unit_error, scales)):
            yield _Cause(left, f"unit {names}", _describe_scales(data.problem, columns, scales))


def _is_unit_error(scale: float) -> bool:
    """Return True if a scale is too far from 1 to be that of a calibration."""
    return not 1.0 / _MIN_FACTOR <= scale <= _MIN_FACTOR


def _describe_scales(problem: FitProblem, columns: Sequence[str], scales: Array) -> str:
    """Return a phrase on scales of columns: signs, or a unit."""
    wrong = [k for k, x in enumerate(scales) if _is_unit_error(x)]
    worst = max(wrong, key=lambda k: abs(np.log(abs(scales[k]))))
    scale, header = float(scales[worst]), columns[worst]
    names = [remove_unit(columns[k]) for k in wrong]
    remedy = f"scale={names} and offset={names}"
    named = f"data of {', '.join(names)}"
    if scale < 0.0 and not _is_unit_error(-scale):
        return (
            f"{named} that are mirrored (scale {scale:.3g}; reverse their sign, or estimate it "
            f"with {remedy})"
        )
    source = next(x for x in problem.data.sources if x.header == header)
    return (
        f"{named} that are scaled (scale {scale:.3g}{_guess_units(header, scale)}; check the "
        f"calibration and the unit in the header {source.name_in_data!r}, or "
        f"estimate the factor with {remedy})"
    )


def _guess_units(header: str, scale: float) -> str:
    """Return ", as between inches and mm" if such units of a column have this ratio, or ""."""
    unit = split_unit(header)[1]
    for like, ratio, names in _MISTAKEN_UNITS:
        is_near = abs(abs(np.log(abs(scale))) - np.log(ratio)) < _UNIT_TOLERANCE
        if is_near and (not like or not unit or conversion_factor(unit, like) is not None):
            return f", as between {names}"
    return ""


def check_ranges(problem: FitProblem, scaling: Scaling, first: Evaluation) -> None:
    """Compare the ranges of the columns in the first run and in the data.

    Columns with an unknown scale are not compared, nor data that may be noise about a constant.

    Raises
    ------
    BeamdaeError
        If the ranges of a column differ by a factor above 300 that no parameter explains.

    Warns
    -----
    BeamdaeWarning
        If they differ by a factor above 100.
    """
    model = problem.recorded_values(first)
    all_values = problem.data.table[VALUE].to_numpy()
    for source, rows in problem.data.rows:
        values, header = all_values[rows], source.header
        is_scaled = any(sensor.rows[rows.start] for sensor in problem.sensors.scales)
        if is_scaled or not varies(values):
            continue
        low, high = sorted(ranges := [float(np.ptp(x)) for x in (model[rows], values)])
        if high <= _MAX_RANGE_RATIO * low:
            continue
        unit = split_unit(header)[1]
        texts = [format_with_unit(float(f"{x:.3g}"), unit) for x in ranges]
        sentence = (
            f"fit: {source.label} has a range of {texts[0]} in the first run and of "
            f"{texts[1]} in the data"
        )
        if (
            high < _MAX_SEARCHED_RATIO * low
            or low == 0.0
            or _has_scaling_parameter(problem, first, rows)
            or _bounds_permit(scaling, first, high / low)
        ):
            advice = "check start=, loads, units and first values"
            warn_user(f"{sentence}; {advice}.", InputWarning, merges=False)
            continue
        raise BeamdaeError(
            f"{sentence}, and no change of {', '.join(problem.names)} explains this factor of "
            f"{high / low:.2g}; check the unit in the header "
            f"{source.name_in_data!r}, start=, loads and first values, or "
            f"estimate the factor with scale=[{remove_unit(header)!r}]."
        )


def _has_scaling_parameter(problem: FitProblem, first: Evaluation, rows: slice) -> bool:
    """Return True if a change of a parameter may scale the model.

    It may if its value is zero, or if the model is about proportional to a power of it.
    """
    # The values of delays, which follow those of parameters, do not scale it.
    count = len(problem.names)
    values, jacobian = first.values[:count], first.projected_jacobian[rows, :count]
    is_zero = (values == 0.0) & np.any(jacobian, axis=0)
    model = (problem.recorded_values(first) * problem.weights)[rows]
    changes = jacobian * values
    model, changes = model - model.mean(), changes - changes.mean(axis=0)
    size, work = float(model @ model), model @ changes
    is_power = (abs(work) > _MIN_EXPONENT * size) & (
        work**2 > _MIN_SHAPE * size * np.sum(changes**2, axis=0)
    )
    return bool(np.any(is_zero | is_power))


def _bounds_permit(scaling: Scaling, first: Evaluation, ratio: float) -> bool:
    """Return True if the bounds of a parameter permit a change by a ratio."""
    values, (lower, upper) = first.values, scaling.bounds
    is_between = (lower > 0.0) & np.isfinite(upper)
    return bool(np.any(is_between & ((upper >= ratio * values) | (lower * ratio <= values))))
