"""Warnings about the end of a fit: bounds, residuals, and errors of the runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import chdtr, chdtrc

from beamdae.analysis.fit.data import COLUMN, VALUE
from beamdae.analysis.fit.problem import (
    MIN_SINGULAR_RATIO,
    Evaluation,
    FitProblem,
    Scaling,
    column_lengths,
    find_correlation,
    varies,
)
from beamdae.analysis.fit.search import SearchResult
from beamdae.equations.measures import TIME
from beamdae.errors import list_first
from beamdae.model_parameters import format_with_unit, split_unit
from beamdae.results.columns import remove_unit

Array = np.ndarray

# Changes of the estimates by refined runs, in standard deviations, that are reported, and those
# at which recommended settings aim.
_MAX_SHIFT, _AIM_OF_SHIFT = 0.4, 0.1
# If larger values of chi-square are less probable, the model does not explain the data; if smaller
# ones are, sigma is too large.
_MIN_PROBABILITY = 1e-6
# Ratio of sigma to the residuals that is reported.
_MAX_SIGMA_RATIO = 1.4
# Residuals below this ratio to the standard deviation of the data may be errors of the runs.
_MAX_NOISELESS_RATIO = 1e-3
# Numbers of data from which their noise is judged.
_MIN_NOISE_COUNT = 10
# Outliers are this many robust standard deviations away; at most one in ten data is an outlier.
_OUTLIER_DISTANCE = 6.0
_MAX_OUTLIER_SHARE = 0.1
_NORMAL_DEVIATION = 1.4826  # standard deviation of normal noise by the median of its magnitude
_MAX_NAMED_OUTLIERS = 3
# Share of chi-square of outliers that explain a large value.
_MIN_OUTLIERS_SHARE = 0.5


def check_bounds(problem: FitProblem, scaling: Scaling, search: SearchResult) -> Iterator[str]:
    """Yield a warning for each variable at a bound."""
    values = search.evaluation.values
    for k in np.flatnonzero(search.at_bounds):
        name, distances = problem.variables[k], [abs(x[k] - values[k]) for x in scaling.bounds]
        is_upper = distances[1] < distances[0]
        side, beyond = ("upper", "larger") if is_upper else ("lower", "smaller")
        bound = format_with_unit(float(scaling.bounds[int(is_upper)][k]), problem.units[name])
        yield (
            f"{name} is at its {side} bound {bound} and has no standard deviation; those of other "
            f"estimates hold it there. Widen the bounds if {beyond} values are possible (of a "
            f"shift, omit earlier data), or leave {name} out of the fit."
        )


def check_residuals(problem: FitProblem, search: SearchResult, residuals: Array) -> Iterator[str]:
    """Yield the first kind of warnings about the residuals that applies.

    The residuals of the search are in units of the weights, `residuals` in standard deviations.
    """
    left, is_known = float(residuals @ residuals), problem.data.is_sigma_known
    square, freedom = search.evaluation.chi_square, problem.count - len(problem.estimated)
    is_outlier = _find_outliers(problem, residuals)
    if is_known and freedom > 0 and chdtrc(freedom, left) < _MIN_PROBABILITY:
        sentence = (
            f"The model does not explain the data: the residuals are {np.sqrt(left / freedom):.3g} "
            "times as large as the given sigma, and the standard deviations do not apply"
        )
        if np.sum(residuals[is_outlier] ** 2) > _MIN_OUTLIERS_SHARE * left:
            yield f"{sentence}; most of their squares are outliers."
            yield from _name_outliers(problem, is_outlier)
            return
        yield (
            f"{sentence}; {suggest_causes(problem, search.evaluation, search.first)}check the unit "
            "of sigma, which is that of its column, search from other values (parameters=, "
            "starts=), or add what the model lacks."
        )
    elif square <= _MAX_NOISELESS_RATIO**2 * problem.data.variation or freedom < _MIN_NOISE_COUNT:
        return  # Data without noise, or too few.
    elif (
        is_known
        and left * _MAX_SIGMA_RATIO**2 < freedom
        and chdtr(freedom, left) < _MIN_PROBABILITY
    ):
        yield (
            f"sigma is {np.sqrt(freedom / left):.2g} times as large as the residuals, so the "
            "standard deviations are too large; reduce it, or check its unit, which is that of the "
            "column in the data."
        )
    else:
        parts = [residuals[rows] for _, rows in problem.data.rows]
        alike = find_correlation(parts)
        if not alike:
            yield from _name_outliers(problem, is_outlier)
            return
        yield (
            f"Residuals are alike over about {alike:.2g} consecutive data, so the standard "
            f"deviations are too small, by a factor of up to {np.sqrt(alike):.2g}; "
            f"{suggest_causes(problem, search.evaluation, search.first)}use fewer data per second "
            "if the noise is slow, other first values or starts= if another minimum may be lower, "
            "or add what the model lacks, such as shift= or offset=."
        )


def _find_outliers(problem: FitProblem, residuals: Array) -> Array:
    """Return True (N,) for the outliers among the residuals of columns in which these are few."""
    result = np.zeros(len(residuals), bool)
    for _, rows in problem.data.rows:
        sizes = np.abs(residuals[rows])
        limit = _OUTLIER_DISTANCE * _NORMAL_DEVIATION * np.median(sizes)
        are_few = np.mean(sizes > limit) <= _MAX_OUTLIER_SHARE and limit > 0.0
        result[rows] = (sizes > limit) & are_few
    return result


def _name_outliers(problem: FitProblem, is_outlier: Array) -> Iterator[str]:
    """Yield a sentence on the outliers of each column."""
    times = problem.data.table[TIME].to_numpy()
    for source, rows in problem.data.rows:
        at = times[rows][is_outlier[rows]]
        if len(at):
            named = list_first([f"{x:g} s" for x in at], _MAX_NAMED_OUTLIERS)
            yield (
                f"{source.label} has outliers at t = {named}, more than {_OUTLIER_DISTANCE:g} "
                "robust standard deviations from the model, which may shift the estimates; if more "
                "accurate runs leave them there, replace wrong values by NaN, and fit again."
            )


def check_errors(
    evaluation: Evaluation, errors: Any, sigma: float, residuals: Array
) -> Iterator[str]:
    """Yield a warning if errors of the runs change estimates by over 0.4 standard deviations.

    `sigma` is the estimated factor of the standard deviations of the data, in which `residuals` are
    given.
    """
    values = evaluation.values
    change = evaluation.projected_jacobian @ (errors.companions[: len(values)] - values)
    shift = float(np.linalg.norm(change)) / sigma
    # Residuals far above sigma, perhaps in a wrong unit, are no errors of the steps.
    if shift > _MAX_SHIFT * max(1.0, float(np.sqrt(np.mean(residuals**2)))):
        aim = errors.largest * _AIM_OF_SHIFT / shift
        yield (
            f"The estimates would change by up to {shift:.2g} standard deviations in "
            f"{errors.refined}; use {errors.recommend(aim)}."
        )


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
# cost of a relative change of an estimate by 1, as a share of the deviation of the prediction.
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


@dataclass(frozen=True, eq=False)
class _Part:
    """Data of a first part of the time, in standard deviations, beside predictions.

    Attributes
    ----------
    problem
        The fit.
    columns, times, values
        Number of the column, time and value of all data, (N,) each; NaN for those of other parts.
    model, effects, rates
        Predicted values (N,), their changes by relative changes of the k estimates (N, k), and
        their rates (N,).
    cost
        Cost of a relative change of an estimate by 1.
    """

    problem: FitProblem
    columns: Array
    times: Array
    values: Array
    model: Array
    effects: Array
    rates: Array
    cost: float

    @classmethod
    def of(cls, problem: FitProblem, evaluation: Evaluation, cost: float, share: float) -> _Part:
        """Return the first `share` of the time, beside the predictions of an evaluation."""
        table, estimates = problem.data.table, evaluation.estimates
        times, values = table[TIME].to_numpy(), table[VALUE].to_numpy() * problem.weights
        effects = evaluation.jacobian * np.where(estimates, estimates, 1.0)
        columns, model = pd.factorize(table[COLUMN])[0], evaluation.residuals + values
        inside = np.where(times <= share * times.max(), values, np.nan)
        rates = problem.rates(evaluation)
        part = cls(problem, columns, times, inside, model, effects, rates, 0.0)
        return replace(part, cost=cost * np.sqrt(part.vary(model)))

    @property
    def rows(self) -> Array:
        """True (N,) for the data of the part."""
        return np.isfinite(self.values)

    def vary(self, values: Array) -> float:
        """Return the sum of squared deviations of values (N,) in the part from column means."""
        rows = self.rows
        columns, values, weights = (x[rows] for x in (self.columns, values, self.problem.weights))
        means = np.bincount(columns, values * weights) / np.bincount(columns, weights**2)
        return float(np.sum((values - np.nan_to_num(means)[columns] * weights) ** 2))

    def explain(self, *errors: Array) -> tuple[float, Array]:
        """Return the sum of squares that errors with effects (N, j) leave, and their sizes (j,).

        Sizes are 0 for errors that changes of the estimates compensate.
        """
        rows, count = self.rows, len(self.effects.T)
        effects = np.vstack([self.effects[rows], self.cost * np.eye(count)])
        table = np.column_stack([np.zeros((len(rows), 0)), *errors])[rows]
        table = np.vstack([table, np.zeros((count, len(table.T)))])
        residuals = np.append((self.model - self.values)[rows], np.zeros(count))
        effects = effects / column_lengths(effects)
        own, rest = (
            x - effects @ np.linalg.lstsq(effects, x, MIN_SINGULAR_RATIO)[0]
            for x in (table, residuals)
        )
        lengths, sizes = column_lengths(own), np.zeros(len(own.T))
        if np.all(lengths >= _MIN_INDEPENDENT_PART * column_lengths(table)):
            sizes = -np.linalg.lstsq(own / lengths, rest, rcond=None)[0] / lengths
            rest = rest + own @ sizes
        return float(rest @ rest), sizes

    def find_delay(self, is_late: Array, limit: float) -> tuple[float, float]:
        """Return the sum of squares that a delay of some data leaves, and the delay.

        It is the smallest of those that leave at most the limit and less than those beside them, or
        the best one: vibrations determine delays up to whole periods. Predictions of the end of a
        search have no long delays.
        """
        largest = _MAX_DELAY_SHARE * float(self.times[self.rows].max())
        delays = np.linspace(-largest, largest, _DELAY_COUNT + 1) if self.cost else np.zeros(1)
        ends = [(np.inf, 0.0)]
        for delay in delays.tolist():
            moved, left = self._advance(is_late, delay), np.inf
            if np.sum(moved.rows) >= _MIN_COVERED_SHARE * np.sum(self.rows):
                left, (further,) = moved.explain(-self.rates * is_late)
                left *= self.vary(self.values) / (moved.vary(moved.values) or np.inf)
                delay += float(further)
            ends.append((left, delay))
        neighbors = zip(ends, ends[1:], [*ends[2:], ends[0]], strict=False)
        minima = [y for x, y, z in neighbors if y[0] <= min(x[0], z[0], limit)]
        return min(minima, key=lambda x: abs(x[1]), default=min(ends))

    def _advance(self, is_late: Array, delay: float) -> _Part:
        """Return the part with data that were recorded later by a delay [s]."""
        values, weights = self.values.copy(), self.problem.weights
        for _, at in self.problem.data.rows if delay else ():
            times, recorded = self.times[at], self.values[at] / weights[at]
            earlier = np.interp(times + delay, times, recorded, np.nan, np.nan) * weights[at]
            values[at] = np.where(is_late[at], earlier, values[at])
        return replace(self, values=values)


def suggest_causes(problem: FitProblem, end: Evaluation, first: Evaluation) -> str:
    """Return the beginning of a remedy that names errors which explain the residuals, or "".

    All that explain them alike are named: only another measurement distinguishes these. The
    predictions are those of the end, then those of the first values for first parts of the data.
    """
    for evaluation, cost, shares in ((end, 0.0, (1.0,)), (first, _COST_OF_CHANGES, _SHARES)):
        explained = []
        for share in shares:
            part = _Part.of(problem, evaluation, cost, share)
            count = int(np.sum(part.rows))
            if count < _MIN_VALUES_PER_ESTIMATE * len(part.effects.T):
                break
            with np.errstate(all="ignore"):
                square = min(float(np.sum(end.residuals[part.rows] ** 2)), part.explain()[0])
                # At least the noise is left.
                least = min(float(problem.data.is_sigma_known) * count, square)
                limit = (1.0 - _MIN_SHARE) * (square - least)
                limit = least + min(limit, _MAX_LEFT_SHARE * part.vary(part.values))
                causes = _choose(part, limit)
            if causes:
                best = max(min(x.left for x in causes.values()), np.finfo(float).eps * square)
                most = (1.0 + (_MAX_RATIO if cost else _MAX_DIFFERENCE / count)) * best
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
    data = part.problem.data
    values = data.table[VALUE].to_numpy() * part.problem.weights
    every = [k for k in range(len(data.headers)) if varies(values[part.columns == k])]
    causes = list(_errors_of_times(part, limit)) if every else []
    for k in every:
        causes += _errors_of_values(part, [k])
    if len(every) > 1 and not any(x.left <= limit for _, x in causes):
        causes += _errors_of_values(part, every)
    return {kind: x for kind, x in causes if x.left <= limit}


def _errors_of_times(part: _Part, limit: float) -> Iterator[tuple[str, _Cause]]:
    """Yield delays of all data and of each of several columns, and a wrong sampling rate."""
    groups, headers = {"": np.ones(len(part.rows), bool)}, part.problem.data.headers
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
    left, (rate,) = part.explain(-part.rates * part.times)
    if rate and abs(rate) <= _MAX_CLOCK_ERROR:
        phrase = (
            f"times that are {100.0 * abs(rate):.2g} % too {'long' if rate > 0.0 else 'short'} "
            "(check the sampling rate, and what determines the frequencies of the model)"
        )
        yield "clock", _Cause(left, phrase)


def _errors_of_values(part: _Part, numbers: Sequence[int]) -> Iterator[tuple[str, _Cause]]:
    """Yield wrong calibrations, zeros, and signs or units of columns."""
    headers = [part.problem.data.headers[k] for k in numbers]
    names = [remove_unit(x) for x in headers]
    is_in = (part.columns[:, None] == np.asarray(numbers)).astype(float)
    scaled, zeros = is_in * part.model[:, None], is_in * part.problem.weights[:, None]
    left, sizes = part.explain(scaled)
    if np.all(sizes) and not any(map(_is_unit_error, sizes)):
        amounts = [f"{100 * abs(x):.2g} % too {'large' if x > 0 else 'small'}" for x in sizes]
        phrase = f"values of {', '.join(names)} that are {', '.join(amounts)} (estimate this with "
        yield f"scale {names}", _Cause(left, f"{phrase}scale={names})")
    left, offsets = part.explain(zeros)
    if offsets.all():
        amounts = [
            format_with_unit(float(f"{x:.2g}"), split_unit(header)[1])
            for x, header in zip(offsets, headers, strict=True)
        ]
        phrase = f"a constant error of {', '.join(names)} of {', '.join(amounts)} (estimate this "
        yield f"offset {names}", _Cause(left, f"{phrase}with offset={names})")
    left, sizes = part.explain(scaled, zeros)
    wrong = {x: y for x, y in zip(names, sizes.tolist(), strict=False) if _is_unit_error(y)}
    if wrong:
        worst, listed = max(wrong.values(), key=lambda x: abs(np.log(abs(1.0 + x)))), list(wrong)
        word, advice = "scaled", "check the calibration and the unit in the header"
        if worst < -1.0 and not _is_unit_error(-2.0 - worst):
            word, advice = "mirrored", "reverse their sign"
        phrase = (
            f"data of {', '.join(listed)} that are {word} (scale {1.0 + worst:.3g}; {advice}, or "
            f"estimate the scale with scale={listed} and offset={listed})"
        )
        yield f"unit {names}", _Cause(left, phrase)


def _is_unit_error(error: float) -> bool:
    """Return True if a scale of 1 + error is too far from 1 to be that of a calibration."""
    return not 1.0 / _MIN_FACTOR <= 1.0 + error <= _MIN_FACTOR
