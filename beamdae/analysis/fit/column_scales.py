"""Scales of measured columns relative to the model: mirrored data, and data in other units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from beamdae.analysis.fit.data import label_series
from beamdae.analysis.fit.problem import Evaluation, FitProblem, Scaling
from beamdae.errors import BeamdaeError, InputWarning, list_first, warn_user
from beamdae.model_parameters import format_with_unit, split_unit
from beamdae.results.columns import remove_unit

Array = np.ndarray

# Ratio of the ranges of a column in the first run and in the data from which a fit warns, and from
# which it does not search if no parameter explains it.
_MAX_RANGE_RATIO = 100.0
_MAX_SEARCHED_RATIO = 300.0
# Correlation of consecutive data up to which these may be noise.
_MIN_CORRELATION = 0.5
# A model is about proportional to a power of a parameter, of at least the first number, if its
# derivative has at least this squared correlation with the model.
_MIN_EXPONENT, _MIN_SHAPE = 0.5, 0.9
# Squared correlation of model and data from which a scale describes the data.
_MIN_SQUARED_CORRELATION = 0.7
# A scale and an offset explain residuals far better than a fit if they leave less than this share,
# and less than this share of those that an offset alone leaves.
_MAX_LEFT_SHARE = 0.3
_MAX_MIRRORED_FACTOR = 3.0
# Factors between usual units, and their relative tolerance.
_UNIT_FACTORS = {
    9.80665: "g and m/s^2",
    25.4: "inches and mm",
    180.0 / np.pi: "radians and degrees",
    1e3: "a unit and its thousandth",
    1e6: "a unit and its millionth",
}
_FACTOR_TOLERANCE = 0.15
_MIN_SURE_FACTOR = 10.0  # of units; smaller ones may be due to first values
_MAX_NAMES = 3  # in a message


class ColumnScale(NamedTuple):
    """Linear trial of a series: data = scale * model + offset.

    Attributes
    ----------
    series
        Number of the series in `FitProblem.data.series`.
    scale
        Best scale.
    left, left_by_offset
        Weighted sums of squares that scale and offset leave, and that an offset alone leaves.
    """

    series: int
    scale: float
    left: float
    left_by_offset: float

    @property
    def is_mirrored(self) -> bool:
        """True if the model describes the data with the opposite sign."""
        return self.scale < 0.0 and self.factor < _MAX_MIRRORED_FACTOR

    @property
    def factor(self) -> float:
        """Absolute value of the scale, or of its inverse if that is larger."""
        return max(abs(self.scale), 1.0 / abs(self.scale))

    @property
    def units(self) -> str:
        """Units whose ratio is the scale, or ""."""
        near = (
            units
            for ratio, units in _UNIT_FACTORS.items()
            if abs(np.log(self.factor / ratio)) < _FACTOR_TOLERANCE
        )
        return next(near, "")

    @property
    def is_sure(self) -> bool:
        """True if wrong values of parameters are no likely reason of the scale."""
        return self.is_mirrored or (self.factor > _MIN_SURE_FACTOR and bool(self.units))


def estimate_scales(problem: FitProblem, evaluation: Evaluation) -> list[ColumnScale]:
    """Return the linear trial of each series without an unknown scale, if it describes the data."""
    model, scales, end = problem.recorded_values(evaluation), [], 0
    for k, series in enumerate(problem.data.series):
        begin, end = end, end + len(series.values)
        if any(begin in sensor.rows for sensor in problem.sensors.scales):
            continue
        # With weighted means, the offset is eliminated.
        weights = series.sigma**-2 / np.sum(series.sigma**-2)
        x, y = ((z - weights @ z) / series.sigma for z in (model[begin:end], series.values))
        square, variation = float(x @ x), float(y @ y)
        if square == 0.0 or variation == 0.0:
            continue
        scale = float(x @ y) / square
        left = max(variation - scale**2 * square, 0.0)
        if left <= (1.0 - _MIN_SQUARED_CORRELATION) * variation:
            scales.append(ColumnScale(k, scale, left, float((x - y) @ (x - y))))
    return scales


def check_first_run(problem: FitProblem, scaling: Scaling, first: Evaluation) -> list[ColumnScale]:
    """Compare the columns of the first run with the data, and return `estimate_scales`.

    Columns with an unknown scale are not compared, nor data that may be noise about a constant.

    Raises
    ------
    BeamdaeError
        If the ranges of a column differ by a factor above 300 that no parameter explains.

    Warns
    -----
    BeamdaeWarning
        If the ranges differ by a factor above 100, or the data look mirrored or in another unit.
    """
    model, scales = problem.recorded_values(first), estimate_scales(problem, first)
    end = 0
    for k, (series, header) in enumerate(zip(problem.data.series, problem.headers, strict=True)):
        begin, end = end, end + len(series.values)
        changes = series.values - series.values.mean()
        is_noise = changes[1:] @ changes[:-1] <= _MIN_CORRELATION * (changes @ changes)
        if is_noise or any(begin in sensor.rows for sensor in problem.sensors.scales):
            continue
        rows, column = slice(begin, end), remove_unit(header)
        low, high = sorted(ranges := [float(np.ptp(x)) for x in (model[rows], series.values)])
        if high > _MAX_RANGE_RATIO * low:
            unit = split_unit(header)[1]
            texts = [format_with_unit(float(f"{x:.3g}"), unit) for x in ranges]
            sentence = (
                f"fit: {series.label} has a range of {texts[0]} in the first run and of "
                f"{texts[1]} in the data"
            )
            is_searched = high < _MAX_SEARCHED_RATIO * low or low == 0.0
            if is_searched or _may_scale(problem, scaling, first, rows, high / low):
                advice = "check start=, loads, units and first values"
                warn_user(f"{sentence}; {advice}.", InputWarning)
                continue
            raise BeamdaeError(
                f"{sentence}, and no change of {', '.join(problem.names)} explains this factor of "
                f"{high / low:.2g}; check the unit in the header "
                f"{series.name_in_data or series.column!r}, start=, loads and first values, or "
                f"estimate the factor with scale=[{column!r}]."
            )
        trial = next((x for x in scales if x.series == k), None)
        if trial is None or not trial.is_sure:
            continue
        # Bounds do not permit a change of the sign.
        ratio = np.inf if trial.is_mirrored else trial.factor
        if not _may_scale(problem, scaling, first, rows, ratio):
            clause = _describe(problem, [trial])
            warn_user(f"fit: relative to the first run, {clause}.", InputWarning)
    return scales


def describe_scales(
    problem: FitProblem, evaluation: Evaluation, first: Sequence[ColumnScale]
) -> str:
    """Return a clause on series that scales and offsets explain far better than a fit, or "".

    Parameters
    ----------
    problem, evaluation
        The fit and its last evaluation.
    first
        Linear trials of the first evaluation; a search may end where the model has no shape.
    """
    squares = evaluation.residuals**2
    ends = np.cumsum([0, *(len(x.values) for x in problem.data.series)])
    trials: dict[int, ColumnScale] = {}
    for trial in (x for x in (*first, *estimate_scales(problem, evaluation)) if x.is_sure):
        left = float(np.sum(squares[ends[trial.series] : ends[trial.series + 1]]))
        known = trials.get(trial.series)
        is_far_better = trial.left < _MAX_LEFT_SHARE * min(left, trial.left_by_offset)
        if is_far_better and (known is None or trial.left < known.left):
            trials[trial.series] = trial
    if not trials:
        return ""
    worst = max(trials.values(), key=lambda x: squares[ends[x.series] : ends[x.series + 1]].sum())
    alike = [x for x in trials.values() if x.is_mirrored == worst.is_mirrored]
    return _describe(problem, [worst, *(x for x in alike if x is not worst)])


def _may_scale(
    problem: FitProblem, scaling: Scaling, first: Evaluation, rows: slice, ratio: float
) -> bool:
    """Return True if a change of a parameter may change the size of the model by a ratio.

    It may if its value is zero, if the model is about proportional to a power of it, or if its
    bounds permit a change by this ratio.
    """
    values, (lower, upper) = first.values, map(scaling.values, scaling.limits)
    is_between = (lower > 0.0) & np.isfinite(upper)
    is_wide = is_between & ((upper >= ratio * values) | (lower * ratio <= values))
    jacobian = first.projected_jacobian[rows]
    is_zero = (values == 0.0) & np.any(jacobian, axis=0)
    model = (problem.recorded_values(first) * problem.weights)[rows]
    changes = jacobian * values
    model, changes = model - model.mean(), changes - changes.mean(axis=0)
    size, work = float(model @ model), model @ changes
    is_power = (abs(work) > _MIN_EXPONENT * size) & (
        work**2 > _MIN_SHAPE * size * np.sum(changes**2, axis=0)
    )
    return bool(np.any(is_wide | is_zero | is_power))


def _describe(problem: FitProblem, trials: Sequence[ColumnScale]) -> str:
    """Return a clause on series with scales of one kind; the first one is the most important."""
    first, series = trials[0], [problem.data.series[x.series] for x in trials]
    columns = [remove_unit(problem.headers[x.series]) for x in trials]
    labels = [label_series(x, y.experiment) for x, y in zip(columns, series, strict=True)]
    remedy = f"scale=[{', '.join(map(repr, dict.fromkeys(columns)))}]"
    named = f"the data of {list_first(labels, _MAX_NAMES)} look"
    if first.is_mirrored:
        return (
            f"{named} mirrored (scale {first.scale:.3g}); reverse their sign, or estimate it with "
            f"{remedy}"
        )
    header = series[0].name_in_data or series[0].column
    units = f", as between {first.units}" if first.units else ""
    return (
        f"{named} scaled (scale {first.scale:.3g}{units}); check the calibration and the unit in "
        f"the header {header!r}, or estimate the factor with {remedy}"
    )
