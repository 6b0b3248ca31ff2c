"""Errors of the recording that would explain the residuals of a fit.

To first order, an error changes the residuals by its size times its effect, of which the other
estimates compensate a part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from beamdae.analysis.fit.problem import Evaluation, FitProblem, column_lengths
from beamdae.analysis.fit.recording_errors import advise_omission, project_out
from beamdae.model_parameters import format_with_unit, split_unit
from beamdae.results.columns import remove_unit

Array = np.ndarray

# Share of the squares of the residuals, without those of the noise of a given sigma, that an error
# explains if it is named. A wrong frequency, whose errors grow linearly over time, is a delay for
# 0.75 of them. Most of the squares may be those of the noise, but not more than the second share.
_MIN_SHARE, _MAX_NOISE_SHARE = 0.85, 0.5
# Errors that leave sums of squares that differ by less, in variances of what the best one leaves,
# explain the residuals alike: 3 standard deviations.
_MAX_DIFFERENCE = 10.0
# Smaller parts of an effect that other estimates do not compensate are not assessed.
_MIN_INDEPENDENT_PART = 0.1
# Larger errors of a sampling rate are not named; 48 kHz instead of 44.1 kHz are 9 %.
_MAX_CLOCK_ERROR = 0.1


@dataclass(frozen=True, eq=False)
class _RecordingError:
    """Error of the recording, with unknown sizes (k,).

    Attributes
    ----------
    effects
        Changes (N, k) of the weighted residuals by sizes of 1.
    describe
        Function of the sizes that returns a phrase with the remedy, or "" for implausible sizes.
    """

    effects: Array
    describe: Callable[[Array], str]


def suggest_causes(problem: FitProblem, evaluation: Evaluation) -> str:
    """Return the beginning of a remedy that names errors which explain most of the residuals.

    All that explain them alike are named: only another measurement distinguishes these. Errors of
    all columns are considered if no error of one column, and none of the times, explains them.
    """
    columns = list(dict.fromkeys(problem.headers))
    errors = [*_errors_of_times(problem, evaluation, columns)]
    for column in columns:
        errors += _errors_of_values(problem, evaluation, [column])
    causes = _name_causes(problem, evaluation, errors)
    if not causes and len(columns) > 1:
        causes = _name_causes(problem, evaluation, _errors_of_values(problem, evaluation, columns))
    return causes


def _name_causes(
    problem: FitProblem, evaluation: Evaluation, errors: Sequence[_RecordingError]
) -> str:
    """Return the beginning of a remedy that names the errors that explain the residuals, or ""."""
    square, count = evaluation.chi_square, evaluation.count
    noise = float(count) if problem.data.is_sigma_known else 0.0
    explained: dict[str, float] = {}
    for error in errors:
        sizes, reduction = _estimate(evaluation, error.effects)
        if reduction and (phrase := error.describe(sizes)):
            explained[phrase] = reduction
    best = max(explained.values(), default=0.0)
    if best <= _MIN_SHARE * max(square - noise, _MAX_NOISE_SHARE * square):
        return ""
    left = max(square - best, np.finfo(float).eps * square)
    limit = best - _MAX_DIFFERENCE * left / count
    phrases = [phrase for phrase, reduction in explained.items() if reduction >= limit]
    return (
        f"{' or '.join(phrases)} would reduce the residuals by a factor of about "
        f"{np.sqrt(square / left):.2g}; otherwise, "
    )


def _estimate(evaluation: Evaluation, effects: Array) -> tuple[Array, float]:
    """Return the best sizes (k,) of an error, and the reduction of the sum of squares."""
    independent = project_out(effects, evaluation.jacobian)
    lengths = column_lengths(independent)
    parts = np.linalg.norm(independent, axis=0) / column_lengths(effects)
    if np.any(parts < _MIN_INDEPENDENT_PART):
        return np.zeros(len(lengths)), 0.0
    directions = independent / lengths
    sizes = np.linalg.lstsq(directions, evaluation.residuals, rcond=None)[0]
    return sizes / lengths, float(evaluation.residuals @ directions @ sizes)


def _errors_of_times(
    problem: FitProblem, evaluation: Evaluation, columns: Sequence[str]
) -> list[_RecordingError]:
    """Return delays of all data and of each of several columns, and a wrong sampling rate."""
    rates = problem.weighted_rates(evaluation)
    times = np.concatenate([x.times for x in problem.data.series])

    def describe_delay(column: str, sizes: Array) -> str:
        delay, name = float(sizes[0]), remove_unit(column)
        shift, data = (f"shift=[{name!r}]", f"values of {name}") if column else ("shift=", "data")
        side = "late" if delay > 0.0 else "early"
        return (
            f"{data} that are {side} by about {abs(delay):.2g} s "
            f"({advise_omission(problem, delay)}estimate an error of the times with {shift})"
        )

    def describe_rate(sizes: Array) -> str:
        rate = float(sizes[0])
        if abs(rate) > _MAX_CLOCK_ERROR:
            return ""
        return (
            f"times that are {100.0 * abs(rate):.2g} % too {'long' if rate > 0.0 else 'short'} "
            "(check the sampling rate, and what determines the frequencies of the model)"
        )

    delays = [_RecordingError(rates[:, None], partial(describe_delay, ""))]
    for column in columns if len(columns) > 1 else ():
        effects = _select(problem, rates, column)
        delays.append(_RecordingError(effects, partial(describe_delay, column)))
    return [*delays, _RecordingError((rates * times)[:, None], describe_rate)]


def _errors_of_values(
    problem: FitProblem, evaluation: Evaluation, columns: Sequence[str]
) -> list[_RecordingError]:
    """Return wrong scales of columns, and constant errors of these."""
    names = [remove_unit(x) for x in columns]
    named = ", ".join(names)

    def describe_scales(sizes: Array) -> str:
        amounts = [
            f"{100.0 * abs(x):.2g} % too {'large' if x > 0.0 else 'small'}" for x in sizes.tolist()
        ]
        return f"values of {named} that are {', '.join(amounts)} (estimate this with scale={names})"

    def describe_offsets(sizes: Array) -> str:
        units = (split_unit(x)[1] for x in columns)
        amounts = [
            format_with_unit(float(f"{x:.2g}"), unit)
            for x, unit in zip(sizes.tolist(), units, strict=True)
        ]
        remedy = f"estimate this with offset={names}"
        return f"a constant error of {named} of {', '.join(amounts)} ({remedy})"

    values, units = -problem.recorded_values(evaluation), -np.ones_like(evaluation.residuals)
    scales, constants = ([_select(problem, x, y) for y in columns] for x in (values, units))
    weights = problem.weights[:, None]
    return [
        _RecordingError(weights * np.hstack(scales), describe_scales),
        _RecordingError(weights * np.hstack(constants), describe_offsets),
    ]


def _select(problem: FitProblem, values: Array, column: str) -> Array:
    """Return the values (N, 1) of a column, and zeros for the data of the others."""
    selected = np.zeros((len(values), 1))
    for _, header, rows in problem.rows_by_series():
        if header == column:
            selected[rows, 0] = values[rows]
    return selected
