"""Warnings about the end of a fit: bounds, residuals, and errors of the runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from scipy.special import chdtr, chdtrc

from beamdae.analysis.fit.problem import FitProblem, Scaling, find_correlation
from beamdae.analysis.fit.search import SearchResult, find_covariance, local_search
from beamdae.analysis.fit.sensors import CLOCK, OFFSET, SCALE, SHIFT
from beamdae.equations.measures import TIME
from beamdae.errors import list_first
from beamdae.model_parameters import format_with_unit
from beamdae.results.columns import remove_unit

Array = np.ndarray

# Share of the squares of the residuals, without those of the noise of a given sigma, that unknown
# sensors explain if they are named, and evaluations of a fit with them.
_MIN_EXPLAINED_SHARE, _MAX_EVALUATIONS = 0.85, 30
# Delays are sought up to this share of the time, in the data after it.
_MAX_DELAY = 0.1
_MIN_DEVIATIONS = 3.0  # of named properties from those of a perfect sensor, in standard deviations
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
# Share of chi-square of outliers that explain a large value.
_MIN_OUTLIERS_SHARE = 0.5


def check_residuals(
    problem: FitProblem, scaling: Scaling, search: SearchResult, residuals: Array
) -> Iterator[str]:
    """Yield the first kind of warnings about the residuals that applies.

    The residuals of the search are in units of the weights, `residuals` in standard deviations.
    """
    left, is_known = float(residuals @ residuals), problem.data.is_sigma_known
    square, freedom = search.evaluation.chi_square, problem.count - len(problem.estimated)
    # Outliers of columns in which these are few.
    is_outlier = np.zeros(len(residuals), bool)
    for _, rows in problem.data.rows:
        sizes = np.abs(residuals[rows])
        limit = _OUTLIER_DISTANCE * _NORMAL_DEVIATION * np.median(sizes)
        are_few = np.mean(sizes > limit) <= _MAX_OUTLIER_SHARE and limit > 0.0
        is_outlier[rows] = (sizes > limit) & are_few
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


def _name_outliers(problem: FitProblem, is_outlier: Array) -> Iterator[str]:
    """Yield a sentence on the outliers of each column."""
    times = problem.data.table[TIME].to_numpy()
    for source, rows in problem.data.rows:
        at = times[rows][is_outlier[rows]]
        if len(at):
            named = list_first([f"{x:g} s" for x in at])
            yield (
                f"{source.label} has outliers at t = {named}, more than {_OUTLIER_DISTANCE:g} "
                "robust standard deviations from the model, which may shift the estimates; if more "
                "accurate runs leave them there, replace wrong values by NaN, and fit again."
            )


def suggest_sensors(problem: FitProblem, scaling: Scaling, search: SearchResult) -> str:
    """Return the beginning of a remedy: sensors with which a fit explains the residuals, or "".

    One fit has unknown scales and offsets of all columns, one unknown delays and, if these explain
    nothing, one unknown clocks. Those that differ from a perfect sensor are named.
    """
    is_known, least, best = problem.data.is_sigma_known, 1.0 - _MIN_EXPLAINED_SHARE, None
    for kinds, begin in (((SCALE, OFFSET), 0.0), ((SHIFT,), _MAX_DELAY), ((CLOCK,), 0.0)):
        if best is not None and CLOCK in kinds:
            break  # Other parameters, such as a stiffness, have similar effects as clocks.
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
        if abs(values[x.name] - x.perfect) > _MIN_DEVIATIONS * errors[x.name]
    ]
    if not found:
        return ""
    columns: dict[str, list[str]] = {}
    for x in found:
        columns.setdefault(x.kind, []).append(remove_unit(x.name.removeprefix(f"{x.kind} of ")))
    arguments = " and ".join(f"{x}={y}" for x, y in columns.items())
    ends = [
        f"{remove_unit(x.name)} = {format_with_unit(float(f'{values[x.name]:.3g}'), x.unit)}"
        for x in found
    ]
    return (
        f"a fit with {arguments} leaves {np.sqrt(left / most):.2g} times smaller residuals "
        f"({', '.join(ends)}); otherwise, "
    )
