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
    phrase: str


class _Part:
    """Data of some rows, in standard deviations, beside the predictions of an evaluation.

    `cost` is that of a relative change of an estimate by 1. `model` are the predicted values (N,),
    `effects` their changes by estimates (N, k), and `rates` their rates (N,).
    """

    def __init__(self, problem: FitProblem, evaluation: Evaluation, cost: float, share: float):
        self.data, table = problem.data, problem.data.table
        self.cost, self.weights, self.times = cost, problem.weights, table[TIME].to_numpy()
        self.rows = self.times <= share * self.times.max()
        self.columns = pd.factorize(table[COLUMN])[0]
        self.values = table[VALUE].to_numpy() * self.weights
        self.model, self.rates = evaluation.residuals + self.values, problem.rates(evaluation)
        self.effects = evaluation.jacobian * np.where(evaluation.estimates, evaluation.estimates, 1)

    def variation(self, rows: Array) -> float:
        """Return the sum of the squared deviations of rows from the mean of their column."""
        columns, values, weights = self.columns[rows], self.values[rows], self.weights[rows]
        means = np.bincount(columns, values * weights) / np.bincount(columns, weights**2)
        return float(np.sum((values - np.nan_to_num(means)[columns] * weights) ** 2))

    def fit(
        self, errors: Array, scaled: Array | None = None, values: Array | None = None
    ) -> tuple[float, Array]:
        """Return the sum of squares that errors with effects (N, j) leave, and their sizes (j,).

        Sizes are 0 for errors that changes of the estimates compensate. Columns (N, i) of `scaled`
        data have unknown scales, the first sizes; data over their scale are linear in its
        reciprocal. `values` replaces the data; those without a value (NaN) are omitted.
        """
        values = self.values if values is None else values
        rows, count = self.rows & np.isfinite(values), len(self.effects.T)
        if scaled is not None:
            errors = np.hstack([scaled * -values[:, None], errors])
        effects = np.vstack([self.effects[rows], self.cost * np.eye(count)])
        errors = np.vstack([errors[rows], np.zeros((count, len(errors.T)))])
        residuals = np.append((self.model - values)[rows], np.zeros(count))
        directions, singular, _ = np.linalg.svd(effects / column_lengths(effects), False)
        directions = directions[:, singular > MIN_SINGULAR_RATIO]
        own, rest = (x - directions @ (directions.T @ x) for x in (errors, residuals))
        lengths, sizes = column_lengths(own), np.zeros(len(errors.T))
        if np.all(lengths >= _MIN_INDEPENDENT_PART * column_lengths(errors)):
            sizes = -np.linalg.lstsq(own / lengths, rest, rcond=None)[0] / lengths
            rest = rest + own @ sizes
        if scaled is not None:
            sizes[: len(scaled.T)] = scales = 1.0 / (1.0 + sizes[: len(scaled.T)])
            rest[:-count] *= np.where(scaled.any(axis=1), scaled @ scales, 1.0)[rows]
        return float(rest @ rest), sizes

    def find_delay(self, is_late: Array, limit: float) -> tuple[float, float]:
        """Return the sum of squares that a delay of some data leaves, and the delay.

        It is the smallest of those that leave at most the limit and less than those beside them, or
        the best one: vibrations determine delays up to whole periods. Predictions of the end of a
        search have no long delays.
        """
        variation, delays = self.variation(self.rows), np.zeros(1)
        if self.cost:
            largest = _MAX_DELAY_SHARE * float(self.times[self.rows].max())
            delays = np.linspace(-largest, largest, _DELAY_COUNT + 1)
        ends = [(np.inf, 0.0)]
        for delay in delays.tolist():
            moved = self.values.copy()
            for _, at in self.data.rows if delay else ():
                times, recorded = self.times[at], self.values[at] / self.weights[at]
                earlier = np.interp(times + delay, times, recorded, np.nan, np.nan)
                moved[at] = np.where(is_late[at], earlier * self.weights[at], moved[at])
            covered, left = self.rows & np.isfinite(moved), np.inf
            if np.sum(covered) >= _MIN_COVERED_SHARE * np.sum(self.rows):
                left, sizes = self.fit((-self.rates * is_late)[:, None], values=moved)
                left *= variation / (self.variation(covered) or np.inf)
                delay += float(sizes[0])
            ends.append((left, delay))
        neighbors = zip(ends, ends[1:], [*ends[2:], ends[0]], strict=False)
        minima = [y for x, y, z in neighbors if y[0] <= min(x[0], z[0], limit)]
        return min(minima, key=lambda x: abs(x[1]), default=min(ends))


def suggest_causes(problem: FitProblem, end: Evaluation, first: Evaluation) -> str:
    """Return the beginning of a remedy that names errors which explain the residuals, or "".

    All that explain them alike are named: only another measurement distinguishes these. The
    predictions are those of the end, then those of the first values for first parts of the data.
    """
    cost_at_first = _COST_OF_CHANGES * float(np.sqrt(problem.data.variation))
    stages = (end, 0.0, (1.0,)), (first, cost_at_first, _SHARES)
    for evaluation, cost, shares in stages:
        explained = []
        for share in shares:
            part = _Part(problem, evaluation, cost, share)
            count = int(np.sum(part.rows))
            if count < _MIN_VALUES_PER_ESTIMATE * len(part.effects.T):
                break
            with np.errstate(all="ignore"):
                rest, _ = part.fit(np.zeros((len(part.rows), 0)))
                square = min(float(np.sum(end.residuals[part.rows] ** 2)), rest)
                # At least the noise is left.
                least = min(float(problem.data.is_sigma_known) * count, square)
                limit = least + (1.0 - _MIN_SHARE) * (square - least)
                limit = min(limit, least + _MAX_LEFT_SHARE * part.variation(part.rows))
                causes = _choose(part, limit)
            if causes:
                best = max(min(x.left for x in causes.values()), np.finfo(float).eps * square)
                alike = _MAX_RATIO if cost else _MAX_DIFFERENCE / count
                most = (1.0 + alike) * best
                named = {kind: x.phrase for kind, x in causes.items() if x.left <= most}
                explained.append((float(np.sqrt(square / best)), named))
        if explained:
            # Vibrations of a short part determine signs, those of a long one delays.
            ratio, named = max(explained, key=lambda x: x[0])
            return (
                f"{' or '.join((named | explained[0][1]).values())} would reduce the residuals by "
                f"a factor of about {ratio:.2g}; otherwise, "
            )
    return ""


def _choose(part: _Part, limit: float) -> dict[str, _Cause]:
    """Return the errors that leave at most a sum of squares, by their kinds.

    Errors of all columns are considered if no error of one column, and none of the times, does.
    """
    headers = part.data.headers
    every = [k for k in range(len(headers)) if varies(part.values[part.columns == k])]
    causes = dict(_errors_of_times(part, limit)) if every else {}
    for k in every:
        causes |= _errors_of_values(part, [k])
    chosen = {kind: x for kind, x in causes.items() if x.left <= limit}
    if not chosen and len(every) > 1:
        joint = _errors_of_values(part, every)
        chosen = {kind: x for kind, x in joint.items() if x.left <= limit}
    return chosen


def _errors_of_times(part: _Part, limit: float) -> Iterator[tuple[str, _Cause]]:
    """Yield delays of all data and of each of several columns, and a wrong sampling rate."""
    groups, headers = {"": np.ones(len(part.rows), bool)}, part.data.headers
    if len(headers) > 1:
        groups |= {remove_unit(x): part.columns == k for k, x in enumerate(headers)}
    for name, is_late in groups.items():
        left, delay = part.find_delay(is_late, limit)
        if delay:
            # The default bounds of shift= are the first time of the data on both sides.
            omit = f"omit data before {2.0 * delay:.2g} s and " if delay > part.times.min() else ""
            phrase = (
                f"{f'values of {name}' if name else 'data'} that are "
                f"{'late' if delay > 0.0 else 'early'} by about {abs(delay):.2g} s ({omit}estimate "
                f"an error of the times with shift={[name] if name else ''})"
            )
            yield f"delay {name}", _Cause(left, phrase)
    left, (rate,) = part.fit((-part.rates * part.times)[:, None])
    if rate and abs(rate) <= _MAX_CLOCK_ERROR:
        phrase = (
            f"times that are {100.0 * abs(rate):.2g} % too {'long' if rate > 0.0 else 'short'} "
            "(check the sampling rate, and what determines the frequencies of the model)"
        )
        yield "clock", _Cause(left, phrase)


def _errors_of_values(part: _Part, numbers: Sequence[int]) -> dict[str, _Cause]:
    """Return wrong calibrations, zeros, and signs or units of columns."""
    headers, causes = [part.data.headers[k] for k in numbers], {}
    names = [remove_unit(x) for x in headers]
    is_in = (part.columns[:, None] == np.asarray(numbers)).astype(float)
    zeros = is_in * part.weights[:, None]
    left, scales = part.fit(zeros[:, :0], is_in)
    if np.all(scales != 1.0) and not any(map(_is_unit_error, scales)):
        amounts = [f"{100 * abs(x - 1):.2g} % too {'large' if x > 1 else 'small'}" for x in scales]
        phrase = f"values of {', '.join(names)} that are {', '.join(amounts)} (estimate this with "
        causes[f"scale {names}"] = _Cause(left, f"{phrase}scale={names})")
    left, offsets = part.fit(zeros)
    if offsets.all():
        amounts = [
            format_with_unit(float(f"{x:.2g}"), split_unit(header)[1])
            for x, header in zip(offsets, headers, strict=True)
        ]
        phrase = f"a constant error of {', '.join(names)} of {', '.join(amounts)} (estimate this "
        causes[f"offset {names}"] = _Cause(left, f"{phrase}with offset={names})")
    left, scales = part.fit(zeros, is_in)
    wrong = {x: y for x, y in zip(names, scales.tolist(), strict=False) if _is_unit_error(y)}
    if wrong:
        worst, listed = max(wrong.values(), key=lambda x: abs(np.log(abs(x)))), list(wrong)
        word, advice = "scaled", "check the calibration and the unit in the header"
        if worst < 0.0 and not _is_unit_error(-worst):
            word, advice = "mirrored", "reverse their sign"
        phrase = (
            f"data of {', '.join(listed)} that are {word} (scale {worst:.3g}; {advice}, or "
            f"estimate the scale with scale={listed} and offset={listed})"
        )
        causes[f"unit {names}"] = _Cause(left, phrase)
    return causes


def _is_unit_error(scale: float) -> bool:
    """Return True if a scale is too far from 1 to be that of a calibration."""
    return not 1.0 / _MIN_FACTOR <= scale <= _MIN_FACTOR
