"""Warnings about the end of a fit: bounds, residuals, and errors of the runs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.special import chdtr, chdtrc

from beamdae.analysis.fit.information import Information
from beamdae.analysis.fit.problem import MAX_NOISE_CORRELATION, Evaluation, FitProblem
from beamdae.analysis.fit.residual_causes import suggest_causes
from beamdae.analysis.fit.search import SearchResult
from beamdae.analysis.fit.variables import Scaling
from beamdae.model_parameters import format_with_unit, split_unit

Array = np.ndarray

# Changes of the estimates by refined runs, in standard deviations, that are reported, and those
# at which recommended settings aim.
_MAX_SHIFT, _AIM_OF_SHIFT = 0.4, 0.1
# If larger values of chi-square are less probable, the model does not explain the data; if smaller
# ones are, sigma is too large.
_MIN_PROBABILITY = 1e-6
# Probability of larger values of chi-square below which the model is doubtful.
_MIN_USUAL_PROBABILITY = 1e-3
# From this ratio of sigma to the residuals of a column, sigma is reported.
_MAX_SIGMA_RATIO = 1.4
# Share of the variation of the data that the residuals of a known sigma leave at a local minimum.
_MIN_LOCAL_SHARE = 0.2
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
# Ratio of the scatter of two columns from which equal weights are reported.
_MAX_SCATTER_RATIO = 3.0


def check_end(
    problem: FitProblem, scaling: Scaling, search: SearchResult, information: Information
) -> Iterator[str]:
    """Yield warnings about omitted data, bounds and intervals."""
    end = search.evaluation
    values = dict(zip(problem.variables, end.values.tolist(), strict=True))
    if end.count < problem.count:
        yield (
            f"The fit leaves out {problem.count - end.count} of {problem.count} data, at which "
            "reactions of the model grow without bounds."
        )
    x, (lower, upper) = scaling.variables(end.values), scaling.limits
    starts_of_data = [x.name for x in problem.sensors.shifts if x.is_at_first_time]
    for k in np.flatnonzero(search.at_bounds):
        name, is_upper = problem.variables[k], upper[k] - x[k] < x[k] - lower[k]
        side, beyond = ("upper", "larger") if is_upper else ("lower", "smaller")
        bound = format_with_unit(float(scaling.bounds[int(is_upper)][k]), problem.units[name])
        remedy = "Widen the bounds"
        if is_upper and name in starts_of_data:
            # The run starts at 0 s, and a shift moves times back.
            remedy = f"Omit data before {2.0 * values[name]:.3g} s"
        yield (
            f"{name} is at its {side} bound {bound} and has no "
            f"standard deviation; those of other estimates hold it there. {remedy} if {beyond} "
            f"values are possible, or leave {name} out of the fit."
        )
    nonlinear = [x for x, is_in in zip(values, information.nonlinear(), strict=False) if is_in]
    if nonlinear:
        yield (
            f"The intervals of {', '.join(nonlinear)} may not hold: their linear approximation "
            "fails because the data hardly distinguish effects of estimates; use "
            f"fit.profile({nonlinear[0]!r}), which does without it, search for other minima "
            "(starts=5), or fix a parameter."
        )


def check_residuals(
    problem: FitProblem, search: SearchResult, residuals: Array, freedom: int
) -> list[str]:
    """Return the first kind of warnings about the residuals that applies.

    The residuals of the search are in units of the weights, `residuals` in standard deviations.
    """
    left, is_known = float(residuals @ residuals), problem.data.is_sigma_known
    probability = float(chdtrc(freedom, left)) if is_known and freedom > 0 else 1.0
    outliers = [_find_outliers(residuals[rows]) for _, rows in problem.data.rows]
    if probability < _MIN_PROBABILITY:
        sentence = (
            f"The model does not explain the data: the residuals are {np.sqrt(left / freedom):.3g} "
            "times as large as the given sigma, and the standard deviations do not apply"
        )
        parts = [
            residuals[rows][x] for (_, rows), x in zip(problem.data.rows, outliers, strict=True)
        ]
        if np.sum(np.concatenate(parts) ** 2) > _MIN_OUTLIERS_SHARE * left:
            sentence += "; most of their squares are outliers."
            return [sentence, *_name_outliers(problem, outliers)]
        causes = suggest_causes(problem, search.evaluation, search.first)
        local = ""
        if left > _MIN_LOCAL_SHARE * problem.data.variation:
            local = (
                "start from other values, or pass bounds= and starts= to search from several, "
                "because the search may have ended at a local minimum, "
            )
        return [
            f"{sentence}; {causes}{local}check the unit of sigma, which is that of its column, or "
            "add what the model lacks."
        ]
    sentences = list(_check_sigma(problem, search.evaluation, residuals, len(residuals) - freedom))
    sentences = sentences or _check_noise(problem, search, outliers)
    if not sentences and probability < _MIN_USUAL_PROBABILITY:
        sentences = [
            "The model may not explain the data: if it and sigma are right, larger residuals have "
            f"a probability of {probability:.1g}; check sigma and the residuals over time (plot)."
        ]
    return sentences


def _check_sigma(
    problem: FitProblem, evaluation: Evaluation, residuals: Array, unknowns: int
) -> Iterator[str]:
    """Yield a warning for each column with a given sigma clearly above its residuals.

    Residuals that are small compared with the data may be those of computed data without noise.
    """
    columns: dict[str, list[slice]] = {}
    for source, rows in problem.data.rows if problem.data.is_sigma_known else ():
        columns.setdefault(source.name_in_data, []).append(rows)
    measured = problem.data.table["value"].to_numpy()
    for name, parts in columns.items():
        every = np.concatenate([np.arange(x.start, x.stop) for x in parts])
        rows = every[~evaluation.is_omitted[every]]
        left, freedom = float(np.sum(residuals[rows] ** 2)), len(rows) - unknowns
        if freedom < _MIN_NOISE_COUNT or left * _MAX_SIGMA_RATIO**2 >= freedom:
            continue
        variation = len(rows) * float(np.var((measured * problem.weights)[rows]))
        is_noisy = left > _MAX_NOISELESS_RATIO**2 * variation
        if is_noisy and chdtr(freedom, left) < _MIN_PROBABILITY:
            column, unit = split_unit(name)
            yield (
                f"sigma of {column} is {np.sqrt(freedom / left):.2g} times as large as the "
                "residuals, so the standard deviations are too large; reduce it, or check its "
                f"unit, which is that of the column in the data{unit and f', {unit}'}."
            )


def _check_noise(problem: FitProblem, search: SearchResult, outliers: list[Array]) -> list[str]:
    """Return warnings if the residuals of a good fit are not white noise of known relative size."""
    residuals = search.evaluation.residuals
    left = float(residuals @ residuals)
    if problem.count < _MIN_NOISE_COUNT or left <= _MAX_NOISELESS_RATIO**2 * problem.data.variation:
        return []
    parts = [(source, residuals[rows]) for source, rows in problem.data.rows]
    correlation = sum(float(x[:-1] @ x[1:]) for _, x in parts) / left
    if correlation > MAX_NOISE_CORRELATION:
        factor = np.sqrt((1.0 + correlation) / (1.0 - correlation))
        causes = suggest_causes(problem, search.evaluation, search.first)
        return [
            f"Consecutive residuals have a correlation of {correlation:.2f}, so the standard "
            f"deviations are too small, by a factor of up to {factor:.2g}; {causes}use fewer data "
            "per second if the noise is slow, other first values or starts= if another minimum may "
            "be lower, or add what the model lacks, such as shift= or offset=."
        ]
    sentences = list(_name_outliers(problem, outliers))
    scatter = {
        x.label: float(np.sqrt(np.mean(y**2))) for x, y in parts if len(y) >= _MIN_NOISE_COUNT
    }
    if len(scatter) > 1 and not problem.data.is_sigma_known:
        most, least = max(scatter, key=scatter.__getitem__), min(scatter, key=scatter.__getitem__)
        if scatter[most] > _MAX_SCATTER_RATIO * scatter[least]:
            sentences.append(
                f"The residuals of {most} are {scatter[most] / scatter[least]:.2g} times as large "
                f"as those of {least}, but have the same weights; pass a long table with a column "
                "sigma."
            )
    return sentences


def _find_outliers(residuals: Array) -> Array:
    """Return the indices of the outliers among the residuals of a column, if these are few."""
    deviation = _NORMAL_DEVIATION * float(np.median(np.abs(residuals)))
    rows = np.flatnonzero(np.abs(residuals) > _OUTLIER_DISTANCE * deviation)
    are_few = len(rows) <= _MAX_OUTLIER_SHARE * len(residuals) and deviation > 0.0
    return rows if are_few else rows[:0]


def _name_outliers(problem: FitProblem, outliers: list[Array]) -> Iterator[str]:
    """Yield a sentence on the outliers of each column."""
    is_stepped = problem.integrator.accuracy.name == "step"
    times = problem.data.table["t [s]"].to_numpy()
    for (source, rows), at in zip(problem.data.rows, outliers, strict=True):
        if len(at):
            named = [f"{x:g} s" for x in times[rows][at[:_MAX_NAMED_OUTLIERS]]]
            more = len(at) - len(named)
            yield (
                f"{source.label} has outliers at t = {', '.join(named)}"
                f"{f' and at {more} further times' if more else ''}, more than "
                f"{_OUTLIER_DISTANCE:g} robust standard deviations from the model, which may shift "
                f"the estimates; if {'a shorter step' if is_stepped else 'a smaller rtol'} leaves "
                "them there, replace wrong values by NaN, and fit again."
            )


def check_errors(
    evaluation: Evaluation, errors: Any, sigma: float, scatter: float
) -> Iterator[str]:
    """Yield a warning if errors of the runs change estimates by over 0.4 standard deviations.

    `sigma` is the estimated factor of the standard deviations of the data, and `scatter` the ratio
    of the residuals to these if it exceeds 1.
    """
    values = evaluation.values
    change = evaluation.projected_jacobian @ (errors.companions[: len(values)] - values)
    shift = float(np.linalg.norm(change))
    if shift > _MAX_SHIFT * sigma * scatter:
        aim = errors.largest * _AIM_OF_SHIFT * sigma / shift
        yield (
            f"The estimates would change by up to {shift / sigma:.2g} standard deviations in "
            f"{errors.refined}; use {errors.recommend(aim)}."
        )
