"""Errors of the recording that would explain the residuals of a fit: by linear algebra, no runs.

The runs of the end of a search, or of its first values, predict data with a wrong sign, unit, zero
or time. Changes of all estimates are linear in these predictions, and least squares determine them
together with the error.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import pandas as pd

from beamdae.analysis.fit.data import COLUMN, VALUE
from beamdae.analysis.fit.problem import (
    MIN_SINGULAR_RATIO,
    Evaluation,
    FitProblem,
    column_lengths,
    is_noise,
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
_MAX_ITERATIONS = 6
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


# Function of a delay [s] that returns model, effects of parameters, and rates of late data.
_Shift = Callable[[float], tuple[Array, ...]]


@dataclass(frozen=True, eq=False)
class _Cause:
    """Error of the recording: the sum of squares that it leaves, and a phrase with the remedy."""

    left: float
    kind: str
    phrase: str


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Data as an evaluation predicts them, in standard deviations.

    Attributes
    ----------
    model
        Predicted values (n,).
    effects
        Effects (n, k) of relative changes of the estimates.
    values
        Measured values (n,).
    rates
        Time derivatives (n,) of the predicted values.
    times
        Times (n,) of the data.
    columns
        Number of the column (n,) of each value.
    weights
        Reciprocal standard deviations (n,).
    cost
        Cost of a relative change of 1.
    shift
        Function of a delay [s] that returns model, effects of parameters, and rates of late data,
        NaN outside the run; None if delays are small.
    """

    model: Array
    effects: Array
    values: Array
    rates: Array
    times: Array
    columns: Array
    weights: Array
    cost: float
    shift: _Shift | None = None

    def select(self, rows: Array) -> _Prediction:
        """Return the prediction of some rows."""
        names = ("model", "effects", "values", "rates", "times", "columns", "weights")
        parts: dict[str, Any] = {x: getattr(self, x)[rows] for x in names}
        shift = self.shift and partial(_shift_rows, self.shift, rows)
        return replace(self, shift=shift, **parts)

    def delayed(self, delay: float, is_late: Array) -> tuple[_Prediction, Array]:
        """Return the prediction of late rows, and which are late, of those that the run covers."""
        assert self.shift is not None
        model, effects, rates = self.shift(delay)
        effects = np.hstack([effects, self.effects[:, len(effects.T) :]])
        pairs = ((model, self.model), (effects, self.effects), (rates, self.rates))
        parts = [np.where(is_late if x.ndim == 1 else is_late[:, None], x, y) for x, y in pairs]
        prediction = replace(self, model=parts[0], effects=parts[1], rates=parts[2], shift=None)
        is_covered = np.isfinite(parts[0])
        return prediction.select(is_covered), is_late[is_covered]

    @property
    def variation(self) -> float:
        """Sum of the squared deviations of the values of each column from their mean."""
        total = 0.0
        for k in np.unique(self.columns):
            values, weights = (x[self.columns == k] for x in (self.values, self.weights))
            mean = float(values @ weights / (weights @ weights)) if weights.any() else 0.0
            total += float(np.sum((values - mean * weights) ** 2))
        return total

    def fit(self, errors: Array) -> tuple[float, Array]:
        """Return the sum of squares that errors with effects (n, j) leave, and their sizes (j,).

        Sizes are 0 for errors that changes of the estimates compensate.
        """
        residuals, count = self.model - self.values, len(self.effects.T)
        effects = np.vstack([self.effects, self.cost * np.eye(count)])
        errors = np.vstack([errors, np.zeros((count, len(errors.T)))])
        residuals = np.append(residuals, np.zeros(count))
        directions, singular, _ = np.linalg.svd(effects / column_lengths(effects), False)
        directions = directions[:, singular > MIN_SINGULAR_RATIO]
        own, rest = (x - directions @ (directions.T @ x) for x in (errors, residuals))
        lengths = column_lengths(own)
        if np.any(lengths < _MIN_INDEPENDENT_PART * column_lengths(errors)):
            return float(rest @ rest), np.zeros(len(errors.T))
        sizes = -np.linalg.lstsq(own / lengths, rest, rcond=None)[0]
        rest = rest + own / lengths @ sizes
        return float(rest @ rest), sizes / lengths

    def fit_scales(self, columns: Sequence[int]) -> tuple[float, Array]:
        """Return the sum of squares that scales and offsets of columns leave, and the scales."""
        is_in = self.columns[:, None] == np.asarray(columns)
        offsets = is_in * self.weights[:, None]
        any_in = is_in.any(axis=1)
        scales, change = np.ones(len(columns)), np.zeros(len(self.effects.T))
        left = np.inf
        for _ in range(_MAX_ITERATIONS):
            # The best scales of the present change, then the linear change of all.
            model = self.model + self.effects @ change
            matrix = np.hstack([is_in * model[:, None], offsets])
            target = self.values - np.where(any_in, 0.0, model)
            best = np.linalg.lstsq(matrix / column_lengths(matrix), target, rcond=None)[0]
            scales, offset = np.split(best / column_lengths(matrix), 2)
            factors = np.where(any_in, is_in @ scales, 1.0)
            residuals = factors * model + offsets @ offset - self.values
            cost = self.cost * change
            before, left = left, float(residuals @ residuals + cost @ cost)
            if left > 0.99 * before:
                break
            whole = np.block(
                [
                    [self.effects * factors[:, None], matrix],
                    [self.cost * np.eye(len(change)), np.zeros((len(change), len(matrix.T)))],
                ]
            )
            lengths = column_lengths(whole)
            step = np.linalg.lstsq(
                whole / lengths, -np.append(residuals, cost), rcond=MIN_SINGULAR_RATIO
            )[0]
            change = change + (step / lengths)[: len(change)]
        return left, scales


def suggest_causes(problem: FitProblem, end: Evaluation, first: Evaluation | None) -> str:
    """Return the beginning of a remedy that names errors which explain the residuals, or "".

    All that explain them alike are named: only another measurement distinguishes these. The
    predictions are those of the end, then those of the first values for first parts of the data.
    """
    with np.errstate(all="ignore"):
        noise = float(problem.data.is_sigma_known)
        for evaluation in (end, first):
            if evaluation is None:
                continue
            whole = _predict(problem, evaluation, 0.0)
            shares: tuple[float, ...] = (1.0,)
            if evaluation is first:
                cost = _COST_OF_CHANGES * np.sqrt(problem.data.variation)
                whole, shares = replace(whole, cost=cost), _SHARES
                if not problem.sensors.shifts and not problem.sensors.scales:
                    whole = replace(whole, shift=_create_shift(problem, evaluation))
            found: list[tuple[float, list[_Cause]]] = []
            for share in shares:
                rows = whole.times <= share * whole.times.max()
                part, count = whole.select(rows), int(np.sum(rows))
                if count < _MIN_VALUES_PER_ESTIMATE * len(part.effects.T):
                    break
                square = float(np.sum(end.residuals[rows] ** 2))
                if evaluation is first:
                    square = min(square, part.fit(np.zeros((count, 0)))[0])
                # At least the noise is left.
                least = min(noise * count, square)
                limit = least + (1.0 - _MIN_SHARE) * (square - least)
                limit = min(limit, least + _MAX_LEFT_SHARE * part.variation)
                if causes := _choose(problem, part, limit):
                    best = max(min(x.left for x in causes), np.finfo(float).eps * square)
                    alike = _MAX_DIFFERENCE / count if evaluation is end else _MAX_RATIO
                    causes = [x for x in causes if x.left <= (1.0 + alike) * best]
                    found.append((float(np.sqrt(square / best)), causes))
            if found:
                # Vibrations of a short part determine signs, those of a long one delays.
                ratio, causes = max(found, key=lambda x: x[0])
                named = {x.kind: x.phrase for x in [*causes, *found[0][1]]}
                return (
                    f"{' or '.join(named.values())} would reduce the residuals by a factor of "
                    f"about {ratio:.2g}; otherwise, "
                )
    return ""


def _choose(problem: FitProblem, prediction: _Prediction, limit: float) -> list[_Cause]:
    """Return the errors that leave at most a sum of squares.

    Errors of all columns are considered if no error of one column, and none of the times, does.
    """
    headers = problem.data.headers
    causes = list(_errors_of_times(problem, prediction, headers, limit))
    for k in range(len(headers)):
        causes += _errors_of_values(problem, prediction, headers, [k])
    chosen = [x for x in causes if x.left <= limit]
    if not chosen and len(headers) > 1:
        causes = list(_errors_of_values(problem, prediction, headers, range(len(headers))))
        chosen = [x for x in causes if x.left <= limit]
    return chosen


def _predict(problem: FitProblem, evaluation: Evaluation, cost: float) -> _Prediction:
    """Return the prediction of an evaluation; `cost` is that of changes of the estimates."""
    weights = np.where(evaluation.is_omitted, 0.0, problem.weights)
    values = problem.data.table[VALUE].to_numpy()
    columns = pd.factorize(problem.data.table[COLUMN])[0]
    estimates = np.append(evaluation.values, evaluation.coefficients)
    sizes = np.where(estimates == 0.0, 1.0, np.abs(estimates))
    return _Prediction(
        evaluation.residuals + values * weights,
        evaluation.jacobian * sizes,
        values * weights,
        problem.weighted_rates(evaluation),
        problem.data.table[TIME].to_numpy(),
        columns,
        weights,
        cost,
    )


def _create_shift(problem: FitProblem, evaluation: Evaluation) -> _Shift:
    """Return the function `shift` of a prediction: curves of the runs at other times."""
    sizes = np.where(evaluation.values == 0.0, 1.0, np.abs(evaluation.values))
    curves = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BeamdaeWarning)
        for experiment, run in evaluation.runs.items():
            t = np.linspace(0.0, run.solution.trajectory.end, _CURVE_TIMES)
            curves[experiment] = t, run.at_times(t)

    def shift(delay: float) -> tuple[Array, Array, Array]:
        count = problem.count
        model, effects, rates = np.empty(count), np.empty((count, len(sizes))), np.empty(count)
        times = problem.data.table[TIME].to_numpy()
        for source, rows in problem.data.rows:
            header = source.header
            t, run = curves[source.experiment]
            moved, weights = times[rows] - delay, problem.weights[rows]
            is_covered = (moved >= 0.0) & (moved <= t[-1])
            curve = run.solution.columns[header]
            model[rows] = np.where(is_covered, np.interp(moved, t, curve), np.nan) * weights
            rates[rows] = np.interp(moved, t, np.gradient(curve, t)) * weights
            for j, name in enumerate(problem.names):
                derivative = run.sensitivity(header, name).to_numpy()
                effects[rows, j] = np.interp(moved, t, derivative) * sizes[j] * weights
        # Constants of sensors are part of the prediction.
        for sensor, offset in zip(problem.sensors.offsets, evaluation.coefficients, strict=True):
            model[sensor.rows] += offset * problem.weights[sensor.rows]
        return model, effects, rates

    return lru_cache(maxsize=None)(shift)


def _shift_rows(shift: _Shift, rows: Array, delay: float) -> tuple[Array, ...]:
    return tuple(x[rows] for x in shift(delay))


def _errors_of_times(
    problem: FitProblem, prediction: _Prediction, headers: Sequence[str], limit: float
) -> Iterator[_Cause]:
    """Yield delays of all data and of each of several columns, and a wrong sampling rate."""
    for number in (None, *(range(len(headers)) if len(headers) > 1 else ())):
        name = "" if number is None else remove_unit(headers[number])
        is_late = prediction.columns == number
        if number is None:
            is_late[:] = True
        left, delay = _find_delay(prediction, is_late, limit)
        if delay:
            yield _Cause(left, f"delay {name}", _describe_delay(problem, name, delay))
    left, sizes = prediction.fit((-prediction.rates * prediction.times)[:, None])
    rate = float(sizes[0])
    if rate and abs(rate) <= _MAX_CLOCK_ERROR:
        phrase = (
            f"times that are {100.0 * abs(rate):.2g} % too {'long' if rate > 0.0 else 'short'} "
            "(check the sampling rate, and what determines the frequencies of the model)"
        )
        yield _Cause(left, "clock", phrase)


def _find_delay(prediction: _Prediction, is_late: Array, limit: float) -> tuple[float, float]:
    """Return the sum of squares that a delay of some rows leaves, and the delay.

    It is the smallest of those that leave at most the limit and less than those beside them, or the
    best one: vibrations determine delays up to whole periods.
    """
    delays = np.zeros(1)
    if prediction.shift is not None:
        largest = _MAX_DELAY_SHARE * float(prediction.times.max())
        delays = np.linspace(-largest, largest, _DELAY_COUNT + 1)
    found = []
    for delay in delays.tolist():
        moved, is_moved = prediction, is_late
        if delay:
            moved, is_moved = prediction.delayed(delay, is_late)
        if len(moved.values) < _MIN_COVERED_SHARE * len(is_late):
            found.append((np.inf, delay))
            continue
        left, sizes = moved.fit((-moved.rates * is_moved)[:, None])
        left *= prediction.variation / (moved.variation or np.inf)
        found.append((left, delay + float(sizes[0])))
    ends = [(np.inf, 0.0)]
    minima = [
        y
        for x, y, z in zip(ends + found, found, found[1:] + ends, strict=False)
        if y[0] <= min(x[0], z[0], limit)
    ]
    return min(minima, key=lambda x: abs(x[1]), default=min(found))


def _describe_delay(problem: FitProblem, name: str, delay: float) -> str:
    first = float(problem.data.table[TIME].min())
    # The default bounds of shift= are the first time of the data on both sides.
    omit = f"omit data before {2.0 * delay:.2g} s and " if delay > first else ""
    shift, data = (f"shift=[{name!r}]", f"values of {name}") if name else ("shift=", "data")
    return (
        f"{data} that are {'late' if delay > 0.0 else 'early'} by about {abs(delay):.2g} s "
        f"({omit}estimate an error of the times with {shift})"
    )


def _errors_of_values(
    problem: FitProblem, prediction: _Prediction, headers: Sequence[str], numbers: Sequence[int]
) -> Iterator[_Cause]:
    """Yield wrong signs, units, calibrations and zeros of columns."""
    columns = [headers[k] for k in numbers]
    names = [remove_unit(x) for x in columns]
    is_in = prediction.columns[:, None] == np.asarray(numbers)
    left, sizes = prediction.fit(is_in * prediction.model[:, None])
    if sizes.all() and not any(_is_unit_error(1.0 + x) for x in sizes):
        amounts = [
            f"{100.0 * abs(x):.2g} % too {'large' if x > 0.0 else 'small'}" for x in sizes.tolist()
        ]
        phrase = f"values of {', '.join(names)} that are {', '.join(amounts)}"
        yield _Cause(left, f"scale {names}", f"{phrase} (estimate this with scale={names})")
    left, sizes = prediction.fit(is_in * prediction.weights[:, None])
    if sizes.all():
        units = (split_unit(x)[1] for x in columns)
        amounts = [
            format_with_unit(float(f"{x:.2g}"), unit)
            for x, unit in zip(sizes.tolist(), units, strict=True)
        ]
        phrase = f"a constant error of {', '.join(names)} of {', '.join(amounts)}"
        yield _Cause(left, f"offset {names}", f"{phrase} (estimate this with offset={names})")
    is_scaled = any(
        source.header in columns
        and any(sensor.rows[rows.start] for sensor in problem.sensors.scales)
        for source, rows in problem.data.rows
    )
    if is_scaled:
        return
    left, scales = prediction.fit_scales(list(numbers))
    if any(map(_is_unit_error, scales)):
        yield _Cause(left, f"unit {names}", _describe_scales(problem, columns, scales))


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
        if is_scaled or is_noise(values - values.mean()):
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
