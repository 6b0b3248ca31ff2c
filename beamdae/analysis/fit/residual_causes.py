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
from beamdae.equations.measures import TIME
from beamdae.model_parameters import format_with_unit, split_unit
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
        self.times, self.weights = table[TIME].to_numpy(), problem.weights
        self.values = table[VALUE].to_numpy() * self.weights
        sizes = np.abs(evaluation.estimates)
        self.model = evaluation.residuals + self.values
        self.effects = evaluation.jacobian * np.where(sizes == 0.0, 1.0, sizes)
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

    def fit_scales(self, is_in: Array, rows: Array, has_offsets: bool) -> tuple[float, Array]:
        """Return the sum of squares that scales of columns (N, j) leave, and the scales (j,).

        The data over their scale are linear in the reciprocal scale.
        """
        errors = is_in * -self.values[:, None]
        if has_offsets:
            errors = np.hstack([errors, is_in * self.weights[:, None]])
        rest, sizes = self.fit(errors, rows)
        scales = 1.0 / (1.0 + sizes[: len(is_in.T)])
        factors = np.where(is_in.any(axis=1), is_in @ scales, 1.0)[rows]
        rest[: len(factors)] *= factors
        return float(rest @ rest), scales

    def advanced(self, delay: float, is_late: Array) -> Array:
        """Return the values (N,) in which some rows are earlier; NaN beyond the end of the data."""
        values = self.values.copy()
        for _, rows in self.problem.data.rows if delay else ():
            times, recorded = self.times[rows], self.values[rows] / self.weights[rows]
            moved = np.interp(times + delay, times, recorded, np.nan, np.nan)
            values[rows] = np.where(is_late[rows], moved * self.weights[rows], values[rows])
        return values


def suggest_causes(problem: FitProblem, end: Evaluation, first: Evaluation) -> str:
    """Return the beginning of a remedy that names errors which explain the residuals, or "".

    All that explain them alike are named: only another measurement distinguishes these. The
    predictions are those of the end, then those of the first values for first parts of the data.
    """
    cost = _COST_OF_CHANGES * float(np.sqrt(problem.data.variation))
    stages = (end, 0.0, (1.0,)), (first, cost, _SHARES)
    for evaluation, cost, shares in stages:
        data, explained = _Comparison(problem, evaluation, cost), []
        for share in shares:
            rows = data.times <= share * data.times.max()
            count = int(np.sum(rows))
            if count < _MIN_VALUES_PER_ESTIMATE * len(data.effects.T):
                break
            with np.errstate(all="ignore"):
                rest, _ = data.fit(np.zeros((len(rows), 0)), rows)
                square = min(float(np.sum(end.residuals[rows] ** 2)), float(rest @ rest))
                # At least the noise is left.
                least = min(float(problem.data.is_sigma_known) * count, square)
                limit = least + (1.0 - _MIN_SHARE) * (square - least)
                limit = min(limit, least + _MAX_LEFT_SHARE * data.variation(rows))
                causes = _choose(data, rows, limit)
            if causes:
                best = max(min(x.left for x in causes), np.finfo(float).eps * square)
                alike = _MAX_RATIO if cost else _MAX_DIFFERENCE / count
                causes = [x for x in causes if x.left <= (1.0 + alike) * best]
                explained.append((float(np.sqrt(square / best)), causes))
        if explained:
            # Vibrations of a short part determine signs, those of a long one delays.
            ratio, causes = max(explained, key=lambda x: x[0])
            named = {x.kind: x.phrase for x in [*causes, *explained[0][1]]}
            return (
                f"{' or '.join(named.values())} would reduce the residuals by a factor of about "
                f"{ratio:.2g}; otherwise, "
            )
    return ""


def _choose(data: _Comparison, rows: Array, limit: float) -> list[_Cause]:
    """Return the errors that leave at most a sum of squares.

    Errors of all columns are considered if no error of one column, and none of the times, does.
    """
    every = [k for k in range(len(data.headers)) if varies(data.values[data.columns == k])]
    causes = list(_errors_of_times(data, rows, limit)) if every else []
    causes += [cause for k in every for cause in _errors_of_values(data, [k], rows)]
    chosen = [x for x in causes if x.left <= limit]
    if not chosen and len(every) > 1:
        chosen = [x for x in _errors_of_values(data, every, rows) if x.left <= limit]
    return chosen


def _errors_of_times(data: _Comparison, rows: Array, limit: float) -> Iterator[_Cause]:
    """Yield delays of all data and of each of several columns, and a wrong sampling rate."""
    first = float(data.times.min())
    groups = {"": np.ones(len(rows), bool)}
    if len(data.headers) > 1:
        groups |= {remove_unit(x): data.columns == k for k, x in enumerate(data.headers)}
    for name, is_late in groups.items():
        left, delay = _find_delay(data, rows, is_late, limit)
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
    data: _Comparison, rows: Array, is_late: Array, limit: float
) -> tuple[float, float]:
    """Return the sum of squares that a delay of some rows leaves, and the delay.

    It is the smallest of those that leave at most the limit and less than those beside them, or the
    best one: vibrations determine delays up to whole periods. Predictions of the end of a search
    have no long delays.
    """
    variation, delays = data.variation(rows), np.zeros(1)
    if data.cost:
        largest = _MAX_DELAY_SHARE * float(data.times[rows].max())
        delays = np.linspace(-largest, largest, _DELAY_COUNT + 1)
    ends = []
    for delay in delays.tolist():
        moved = data.advanced(delay, is_late)
        covered = rows & np.isfinite(moved)
        left = np.inf
        if np.sum(covered) >= _MIN_COVERED_SHARE * np.sum(rows):
            rest, sizes = data.fit((-data.rates * is_late)[:, None], covered, moved)
            left = float(rest @ rest) * variation / (data.variation(covered) or np.inf)
            delay += float(sizes[0])
        ends.append((left, delay))
    outside = [(np.inf, 0.0)]
    neighbors = zip(outside + ends, ends, ends[1:] + outside, strict=False)
    minima = [y for x, y, z in neighbors if y[0] <= min(x[0], z[0], limit)]
    return min(minima, key=lambda x: abs(x[1]), default=min(ends))


def _errors_of_values(data: _Comparison, numbers: Sequence[int], rows: Array) -> Iterator[_Cause]:
    """Yield wrong signs, units, calibrations and zeros of columns."""
    columns = [data.headers[k] for k in numbers]
    names = [remove_unit(x) for x in columns]
    is_in = data.columns[:, None] == np.asarray(numbers)
    left, scales = data.fit_scales(is_in, rows, has_offsets=False)
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
    left, scales = data.fit_scales(is_in, rows, has_offsets=True)
    wrong = {x: y for x, y in zip(names, scales.tolist(), strict=True) if _is_unit_error(y)}
    if wrong:
        worst = max(wrong.values(), key=lambda x: abs(np.log(abs(x))))
        is_sign = worst < 0.0 and not _is_unit_error(-worst)
        word, advice = "scaled", "check the calibration and the unit in the header"
        if is_sign:
            word, advice = "mirrored", "reverse their sign"
        listed = list(wrong)
        phrase = (
            f"data of {', '.join(listed)} that are {word} (scale {worst:.3g}; {advice}, or "
            f"estimate the scale with scale={listed} and offset={listed})"
        )
        yield _Cause(left, f"unit {names}", phrase)


def _is_unit_error(scale: float) -> bool:
    """Return True if a scale is too far from 1 to be that of a calibration."""
    return not 1.0 / _MIN_FACTOR <= scale <= _MIN_FACTOR
