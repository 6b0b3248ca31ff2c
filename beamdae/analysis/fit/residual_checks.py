"""Warnings about the end of a fit: bounds, residuals, and errors of the runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
from scipy.special import chdtr, chdtrc

from beamdae.analysis.fit.information import find_covariance
from beamdae.analysis.fit.problem import Evaluation, FitProblem, Scaling, find_correlation
from beamdae.analysis.fit.search import SearchResult, local_search
from beamdae.analysis.fit.sensors import OFFSET, SCALE, SHIFT
from beamdae.equations.measures import TIME
from beamdae.errors import list_first
from beamdae.model_parameters import format_with_unit
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


def check_residuals(
    problem: FitProblem, scaling: Scaling, search: SearchResult, residuals: Array
) -> Iterator[str]:
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
            f"{sentence}; {suggest_sensors(problem, scaling, search)}check the unit "
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
            f"{suggest_sensors(problem, scaling, search)}use fewer data per second "
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


# Share of the squares of the residuals, without those of the noise of a given sigma, that unknown
# sensors explain if they are named, and evaluations of a fit with them.
_MIN_EXPLAINED_SHARE, _MAX_EVALUATIONS = 0.85, 30
# Delays are sought up to this share of the time, in the data after it.
_MAX_DELAY = 0.1
_MIN_DEVIATIONS = 3.0  # of named properties from those of a perfect sensor, in standard deviations


def suggest_sensors(problem: FitProblem, scaling: Scaling, search: SearchResult) -> str:
    """Return the beginning of a remedy: sensors with which a fit explains the residuals, or "".

    One fit has unknown scales and offsets of all columns, the other one unknown delays. Those that
    differ from a perfect sensor are named.
    """
    is_known, least, best = problem.data.is_sigma_known, 1.0 - _MIN_EXPLAINED_SHARE, None
    for kinds, begin in (((SCALE, OFFSET), 0.0), ((SHIFT,), _MAX_DELAY)):
        part, rows = problem.within(begin, 1.0)
        left = float(np.sum(search.evaluation.residuals[rows] ** 2))
        noise = min(float(is_known) * np.sum(rows), left)
        with suppress(ValueError, ArithmeticError):  # There are no such sensors, or no run.
            other = part.with_sensors(kinds)
            variables = scaling.of(other)
            first = np.ones(len(other.variables))
            if search.explains:
                first[: len(scaling.first)] = scaling.variables(search.evaluation.values)
            end = local_search(other, variables, first, _MAX_EVALUATIONS)
            unexplained = (end.chi_square - noise) / (left - noise) if left > noise else 1.0
            if unexplained <= least:
                least, best = unexplained, (other, variables, end, left)
    if best is None:
        return ""
    other, variables, end, left = best
    most = end.chi_square
    sigma = 1.0 if is_known else float(np.sqrt(most / max(other.count - len(other.estimated), 1)))
    covariance = find_covariance(other, variables, end.evaluation, end.at_bounds, sigma)[2]
    values = dict(zip(other.estimated, end.evaluation.estimates.tolist(), strict=True))
    errors = dict(zip(other.estimated, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    found = [
        x
        for x in other.sensors[len(problem.sensors) :]
        if abs(values[x.name] - (x.kind == SCALE)) > _MIN_DEVIATIONS * errors[x.name]
    ]
    if not found:
        return ""
    columns: dict[str, list[str]] = {}
    for x in found:
        columns.setdefault(x.kind, []).append(remove_unit(x.name.removeprefix(f"{x.kind} of ")))
    arguments = " and ".join(f"{x}={y}" for x, y in columns.items())
    ends = [
        f"{remove_unit(x.name)} = {format_with_unit(float(f'{values[x.name]:.2g}'), x.unit)}"
        for x in found
    ]
    return (
        f"a fit with {arguments} leaves {np.sqrt(left / most):.2g} times smaller residuals "
        f"({', '.join(ends)}); otherwise, "
    )
