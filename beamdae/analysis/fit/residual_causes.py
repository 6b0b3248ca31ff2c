"""Errors of the recording that would explain the residuals of a fit: by linear algebra, no runs.

The runs of the end of a search, or of its first values, predict data with a wrong sign, unit, zero
or time. Changes of all estimates are linear in these predictions, and least squares determine them
together with the error.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from functools import cached_property
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
from beamdae.errors import BeamdaeError, BeamdaeWarning, InputWarning, warn_user
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
# Iterations for scales, which multiply changes of the estimates.
_SCALE_FITS = 6
# Delays are searched among this number, up to this share of the duration in both directions, in
# curves with this number of times; the runs must cover the last share of the late data.
_DELAY_COUNT, _MAX_DELAY_SHARE, _CURVE_TIMES, _MIN_COVERED_SHARE = 200, 0.25, 1000, 0.75
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


class _Prediction(NamedTuple):
    """Predicted values (N,), their changes by estimates (N, k), and their rates (N,)."""

    model: Array
    effects: Array
    rates: Array


class _Comparison:
    """Data in standard deviations beside the predictions of an evaluation.

    `cost` is that of a relative change of an estimate by 1.
    """

    def __init__(self, problem: FitProblem, evaluation: Evaluation, cost: float) -> None:
        self.problem, self.evaluation, self.cost = problem, evaluation, cost
        table = problem.data.table
        self.headers = problem.data.headers
        self.columns = pd.factorize(table[COLUMN])[0]
        self.times = table[TIME].to_numpy()
        self.weights = np.where(evaluation.is_omitted, 0.0, problem.weights)
        self.values = table[VALUE].to_numpy() * self.weights
        estimates = np.append(evaluation.values, evaluation.coefficients)
        self.sizes = np.where(estimates == 0.0, 1.0, np.abs(estimates))
        self.prediction = _Prediction(
            evaluation.residuals + self.values,
            evaluation.jacobian * self.sizes,
            problem.weighted_rates(evaluation),
        )

    def variation(self, rows: Array) -> float:
        """Return the sum of the squared deviations of rows from the mean of their column."""
        columns, values, weights = self.columns[rows], self.values[rows], self.weights[rows]
        means = np.bincount(columns, values * weights) / np.bincount(columns, weights**2)
        return float(np.sum((values - np.nan_to_num(means)[columns] * weights) ** 2))

    def fit(
        self,
        errors: Array,
        rows: Array,
        prediction: _Prediction | None = None,
        values: Array | None = None,
    ) -> tuple[float, Array]:
        """Return the sum of squares that errors with effects (N, j) leave, and their sizes (j,).

        Sizes are 0 for errors that changes of the estimates compensate.
        """
        model, effects, _ = self.prediction if prediction is None else prediction
        values = self.values if values is None else values
        count = len(effects.T)
        effects = np.vstack([effects[rows], self.cost * np.eye(count)])
        errors = np.vstack([errors[rows], np.zeros((count, len(errors.T)))])
        residuals = np.append((model - values)[rows], np.zeros(count))
        directions, singular, _ = np.linalg.svd(effects / column_lengths(effects), False)
        directions = directions[:, singular > MIN_SINGULAR_RATIO]
        own, rest = (x - directions @ (directions.T @ x) for x in (errors, residuals))
        lengths = column_lengths(own)
        if np.any(lengths < _MIN_INDEPENDENT_PART * column_lengths(errors)):
            return float(rest @ rest), np.zeros(len(errors.T))
        sizes = -np.linalg.lstsq(own / lengths, rest, rcond=None)[0]
        rest = rest + own / lengths @ sizes
        return float(rest @ rest), sizes / lengths

    def fit_scales(self, numbers: Sequence[int], rows: Array) -> tuple[float, Array]:
        """Return the sum of squares that scales and offsets of columns leave, and the scales.

        Scales multiply changes of the estimates: the best scales of the present change alternate
        with linear changes of all.
        """
        is_in = (self.columns[:, None] == np.asarray(numbers))[rows]
        any_in, offsets = is_in.any(axis=1), is_in * self.weights[rows, None]
        values, (model, effects, _) = self.values[rows], (x[rows] for x in self.prediction)
        scales, change, left = np.ones(len(numbers)), np.zeros(len(self.sizes)), np.inf
        for _ in range(_SCALE_FITS):
            changed = model + effects @ change
            matrix = np.hstack([is_in * changed[:, None], offsets])
            best = _solve(matrix, values - np.where(any_in, 0.0, changed))
            scales = best[: len(scales)]
            factors = np.where(any_in, is_in @ scales, 1.0)
            residuals = np.where(any_in, 0.0, changed) + matrix @ best - values
            left = float(residuals @ residuals + np.sum((self.cost * change) ** 2))
            whole = np.zeros((len(values) + len(change), len(change) + len(best)))
            whole[: len(values)] = np.hstack([effects * factors[:, None], matrix])
            whole[len(values) :, : len(change)] = self.cost * np.eye(len(change))
            step = _solve(whole, -np.append(residuals, self.cost * change))
            change = change + step[: len(change)]
        return left, scales

    @cached_property
    def _curves(self) -> dict[str, tuple[Array, dict[str, Array]]]:
        """Times of each run, and columns (k, 2 + j): model, rates and effects by header."""
        curves = {}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", BeamdaeWarning)
            for experiment, run in self.evaluation.runs.items():
                t = np.linspace(0.0, run.solution.trajectory.end, _CURVE_TIMES)
                dense = run.at_times(t)
                names = self.problem.names
                columns = {}
                for header in self.headers:
                    if header in dense.solution.columns:
                        curve = dense.solution.columns[header]
                        effects = [dense.sensitivity(header, x).to_numpy() for x in names]
                        columns[header] = np.stack([curve, np.gradient(curve, t), *effects], axis=1)
                curves[experiment] = t, columns
        return curves

    def delayed(self, delay: float, is_late: Array) -> _Prediction:
        """Return the prediction if some rows are late; NaN where the run does not cover them."""
        if not delay:
            return self.prediction
        problem, count = self.problem, len(self.problem.names)
        model, effects, rates = (x.copy() for x in self.prediction)
        shifts = np.zeros(len(self.times))
        scales, offsets = np.ones(len(self.times)), np.zeros(len(self.times))
        for shift, value in zip(
            problem.sensors.shifts, self.evaluation.values[count:], strict=True
        ):
            shifts[shift.rows] = value
        linear = zip(
            (*problem.sensors.scales, *problem.sensors.offsets),
            self.evaluation.coefficients,
            strict=True,
        )
        for sensor, value in linear:
            (offsets if sensor in problem.sensors.offsets else scales)[sensor.rows] = value
        for source, rows in problem.data.rows:
            late = np.arange(rows.start, rows.stop)[is_late[rows]]
            t, columns = self._curves[source.experiment]
            moved = self.times[late] - shifts[late] - delay
            outside = np.where((moved >= 0.0) & (moved <= t[-1]), 0.0, np.nan)
            at = np.clip(np.searchsorted(t, moved) - 1, 0, len(t) - 2)
            share = np.clip((moved - t[at]) / (t[at + 1] - t[at]), 0.0, 1.0)[:, None]
            curves = columns[source.header]
            curves = (1.0 - share) * curves[at] + share * curves[at + 1]
            factors = scales[late] * self.weights[late]
            model[late] = curves[:, 0] * factors + offsets[late] * self.weights[late] + outside
            rates[late] = curves[:, 1] * factors
            effects[late, :count] = curves[:, 2:] * factors[:, None] * self.sizes[:count]
        return _Prediction(model, effects, rates)


def _solve(matrix: Array, target: Array) -> Array:
    """Return the solution of least squares; columns have equal lengths for the rank."""
    lengths = column_lengths(matrix)
    return np.asarray(np.linalg.lstsq(matrix / lengths, target, MIN_SINGULAR_RATIO)[0] / lengths)


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
                if count < _MIN_VALUES_PER_ESTIMATE * len(whole.sizes):
                    break
                square = float(np.sum(end.residuals[rows] ** 2))
                if not is_end:
                    square = min(square, whole.fit(np.zeros((len(rows), 0)), rows)[0])
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
    left, sizes = data.fit((-data.prediction.rates * data.times)[:, None], rows)
    rate = float(sizes[0])
    if rate and abs(rate) <= _MAX_CLOCK_ERROR:
        phrase = (
            f"times that are {100.0 * abs(rate):.2g} % too {'long' if rate > 0.0 else 'short'} "
            "(check the sampling rate, and what determines the frequencies of the model)"
        )
        yield _Cause(left, "clock", phrase)


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
        moved = data.delayed(delay, is_late)
        covered = rows & np.isfinite(moved.model)
        if np.sum(covered) < _MIN_COVERED_SHARE * np.sum(rows):
            ends.append((np.inf, delay))
            continue
        left, sizes = data.fit((-moved.rates * is_late)[:, None], covered, moved)
        left *= variation / (data.variation(covered) or np.inf)
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
    left, sizes = data.fit(is_in * data.prediction.model[:, None], rows)
    if sizes.all() and not any(_is_unit_error(1.0 + x) for x in sizes):
        amounts = [
            f"{100.0 * abs(x):.2g} % too {'large' if x > 0.0 else 'small'}" for x in sizes.tolist()
        ]
        phrase = f"values of {', '.join(names)} that are {', '.join(amounts)}"
        yield _Cause(left, f"scale {names}", f"{phrase} (estimate this with scale={names})")
    left, sizes = data.fit(is_in * data.weights[:, None], rows)
    if sizes.all():
        amounts = [
            format_with_unit(float(f"{x:.2g}"), split_unit(header)[1])
            for x, header in zip(sizes.tolist(), columns, strict=True)
        ]
        phrase = f"a constant error of {', '.join(names)} of {', '.join(amounts)}"
        yield _Cause(left, f"offset {names}", f"{phrase} (estimate this with offset={names})")
    sensors = data.problem.sensors.scales
    if not any(np.any(x.rows & np.isin(data.columns, numbers)) for x in sensors):
        left, scales = data.fit_scales(numbers, rows)
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
