"""Errors of derivatives of runs, measured by a repetition with everything refined together."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from beamdae.accuracy.errors import FACTOR, Errors, Refined, measure_errors
from beamdae.accuracy.refinement import refine_mechanism
from beamdae.accuracy.runs import (
    RTOL_BESIDE_ACCURATE_STEPS,
    check_result,
    refine_method,
)
from beamdae.analysis.gradients.gradients import Gradient
from beamdae.analysis.sensitivities.sensitivities import Sensitivities
from beamdae.errors import hold_messages
from beamdae.parts.mechanism import AS_DRAWN, Mechanism
from beamdae.results.columns import largest_of_kind
from beamdae.simulation import unchecked

Array = np.ndarray

# Errors of derivatives are relative to at least this fraction of the largest derivative of the same
# unit, and to that of a relative change of the column or the objective by the same change of the
# parameter: smaller ones may be rounding errors, as for velocities that are zero by constraints.
_MIN_EFFECT = 1e-3
# Fraction of the rows with the largest differences that is not compared: derivatives of columns
# that jump have peaks of any height, for example where a mass slides over the end of an element.
_OMITTED_ROWS = 0.01


class _Values(NamedTuple):
    """Derivatives (rows, columns) to compare, and the sizes (columns,) of their errors."""

    rows: Array
    sizes: Array


def check_derivatives(result: Sensitivities | Gradient) -> Iterator[str]:
    """Yield the sentences of the errors of derivatives, unless their measurement takes long."""
    is_gradient = isinstance(result, Gradient)
    measure: Callable[..., Errors] = measure_gradient if is_gradient else measure_sensitivities
    yield from check_result(result, result.solution, partial(measure, result))


def measure_sensitivities(result: Sensitivities, time_limit: float | None = None) -> Errors:
    """Return the errors of the derivatives of observed columns over time.

    Parameters
    ----------
    result
        The derivatives.
    time_limit
        Largest time of the run of the companion [s].
    """
    headers = tuple(result.columns.columns())
    if not headers:
        return Errors.unchecked((), np.zeros(0), "no column is observed")

    def evaluate(other: Sensitivities) -> _Values:
        # An event may stop the other run earlier.
        is_reached = result.t <= other.solution.trajectory.end
        other = other.at_times(result.t[is_reached])
        rows = np.stack(list(other.columns.columns().values()), axis=1)
        rows = np.concatenate([rows, np.repeat(rows[-1:], np.sum(~is_reached), axis=0)])
        return _Values(rows, _measure_effects(other))

    return _measure(result, headers, result._repeat, evaluate, "its mean size", time_limit)


def measure_gradient(result: Gradient, time_limit: float | None = None) -> Errors:
    """Return the errors of an objective and of its derivatives.

    Those of derivatives are relative to the largest derivative by relative changes of parameters.
    """
    names = [
        name if np.ndim(x) == 0 else f"{name}[{k}]"
        for name, x in result.derivatives.items()
        for k in range(np.size(x))
    ]

    def evaluate(other: Gradient) -> _Values:
        sizes = np.abs(np.concatenate([np.ravel(x) for x in result.parameters.values()]))
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        largest = float(np.max(sizes * np.abs(other.array)))
        largest = max(largest, _MIN_EFFECT * abs(other.value))
        return _Values(
            np.append(other.value, other.array)[None], np.append(abs(other.value), largest / sizes)
        )

    headers = ("objective [-]", *(f"d(objective)/d({x}) [per unit of {x}]" for x in names))
    relative_to = "the largest effect of a parameter"
    return _measure(result, headers, result._repeat, evaluate, relative_to, time_limit)


def _measure(
    result: Any,
    headers: tuple[str, ...],
    repeat: Callable[[Callable[[Any], Any], Any], Any] | None,
    evaluate: Callable[[Any], _Values],
    relative_to: str,
    time_limit: float | None,
) -> Errors:
    """Return the errors of a result that `repeat` computes with other mechanisms and methods."""
    run, values = result.solution, evaluate(result)
    peaks = np.abs(values.rows).max(axis=0)
    if repeat is None:
        reason = "the derivatives come from another process"
        return Errors.unchecked(headers, peaks, reason)
    method = refine_method(run, time_limit, RTOL_BESIDE_ACCURATE_STEPS)
    start = run.equations.start
    request = AS_DRAWN if start is None or start.request is None else start.request

    def repeat_values(causes: Collection[str]) -> tuple[_Values, Refined]:
        refined = Refined()

        def change(mechanism: Any) -> Any:
            nonlocal refined
            if isinstance(mechanism, Mechanism):
                mechanism, refined = refine_mechanism(mechanism, request, causes)
                refined = refined.with_steps(run.made_by)
            return mechanism

        with hold_messages(), unchecked():
            return evaluate(repeat(change, method)), refined

    def compare(first: _Values, second: _Values, refined: Refined) -> Errors:
        return _compare(headers, first, second, refined, relative_to)

    failed = Errors.unchecked(headers, peaks, "a refined repetition fails", has_failed=True)
    return measure_errors(failed, values, repeat_values, compare, has_accuracy=False)


def _compare(
    headers: tuple[str, ...], first: _Values, second: _Values, refined: Refined, relative_to: str
) -> Errors:
    peaks, others = (np.abs(x.rows).max(axis=0) for x in (first, second))
    differences = np.sort(np.abs(first.rows - second.rows), axis=0)
    count = len(differences) - int(_OMITTED_ROWS * len(differences))
    mean, largest = np.sqrt(np.mean(differences[:count] ** 2, axis=0)), differences[-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        total, rows = (np.where(x == 0.0, 0.0, x / second.sizes) for x in (mean, largest))
    of_columns = (relative_to,) * len(headers)
    return Errors(headers, peaks, others, FACTOR * total, rows, refined, of_columns)


def _measure_effects(result: Sensitivities) -> Array:
    """Return the sizes (columns,) of the derivatives of observed columns."""
    run, sizes = result.solution, []
    headers = run.equations.observed_headers
    columns = np.array([np.max(np.abs(run.columns[x]), initial=0.0) for x in headers])
    scales = largest_of_kind(headers, columns, others=run._sizes_of_mechanism)
    for name, value in result.parameters.items():
        derivatives = result.columns.observed[name].values()
        means = np.array([np.sqrt(np.mean(x**2)) for x in derivatives])
        of_change = np.maximum(largest_of_kind(headers, means), scales / (abs(value) or 1.0))
        sizes.append(np.maximum(means, _MIN_EFFECT * of_change))
    return np.concatenate(sizes)
