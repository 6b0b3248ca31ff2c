"""Warnings about the end of a fit: bounds, residuals, and errors of the runs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.special import chdtr, chdtrc

from beamdae.analysis.fit.problem import MAX_NOISE_CORRELATION, Evaluation, FitProblem
from beamdae.analysis.fit.residual_causes import suggest_causes
from beamdae.analysis.fit.search import SearchResult
from beamdae.analysis.fit.variables import Scaling
from beamdae.equations.measures import TIME
from beamdae.errors import list_first
from beamdae.model_parameters import format_with_unit

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
    outliers = [_find_outliers(residuals[rows]) for _, rows in problem.data.rows]
    if is_known and freedom > 0 and chdtrc(freedom, left) < _MIN_PROBABILITY:
        sentence = (
            f"The model does not explain the data: the residuals are {np.sqrt(left / freedom):.3g} "
            "times as large as the given sigma, and the standard deviations do not apply"
        )
        pairs = zip(problem.data.rows, outliers, strict=True)
        of_outliers = sum(float(np.sum(residuals[rows][x] ** 2)) for (_, rows), x in pairs)
        if of_outliers > _MIN_OUTLIERS_SHARE * left:
            yield f"{sentence}; most of their squares are outliers."
            yield from _name_outliers(problem, outliers)
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
        correlation = sum(float(x[:-1] @ x[1:]) for x in parts) / left
        if correlation <= MAX_NOISE_CORRELATION:
            yield from _name_outliers(problem, outliers)
            return
        factor = np.sqrt((1.0 + correlation) / (1.0 - correlation))
        yield (
            f"Consecutive residuals have a correlation of {correlation:.2f}, so the standard "
            f"deviations are too small, by a factor of up to {factor:.2g}; "
            f"{suggest_causes(problem, search.evaluation, search.first)}use fewer data per second "
            "if the noise is slow, other first values or starts= if another minimum may be lower, "
            "or add what the model lacks, such as shift= or offset=."
        )


def _find_outliers(residuals: Array) -> Array:
    """Return the indices of the outliers among the residuals of a column, if these are few."""
    deviation = _NORMAL_DEVIATION * float(np.median(np.abs(residuals)))
    rows = np.flatnonzero(np.abs(residuals) > _OUTLIER_DISTANCE * deviation)
    are_few = len(rows) <= _MAX_OUTLIER_SHARE * len(residuals) and deviation > 0.0
    return rows if are_few else rows[:0]


def _name_outliers(problem: FitProblem, outliers: list[Array]) -> Iterator[str]:
    """Yield a sentence on the outliers of each column."""
    times = problem.data.table[TIME].to_numpy()
    for (source, rows), at in zip(problem.data.rows, outliers, strict=True):
        if len(at):
            named = list_first([f"{x:g} s" for x in times[rows][at]], _MAX_NAMED_OUTLIERS)
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
