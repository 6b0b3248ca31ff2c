"""Errors of derivatives of runs, designs and fits, measured by refined repetitions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from beamdae.accuracy.errors import FACTOR, Errors, Refined, measure_errors
from beamdae.accuracy.refinement import refine_mechanism
from beamdae.accuracy.runs import (
    RTOL_BESIDE_ACCURATE_STEPS,
    refine_method,
)
from beamdae.analysis.fit.problem import MIN_SINGULAR_RATIO, Evaluation, FitProblem
from beamdae.analysis.gradients.gradients import Gradient
from beamdae.analysis.optimization.search import SearchResult
from beamdae.analysis.sensitivities.sensitivities import Sensitivities
from beamdae.errors import hold_messages
from beamdae.parts.mechanism import AS_DRAWN, Mechanism
from beamdae.results.columns import largest_of_kind
from beamdae.results.solution import Solution
from beamdae.simulation import unchecked

Array = np.ndarray
Result = TypeVar("Result")

# Errors of derivatives are relative to at least this fraction of the largest derivative of the same
# unit, and to that of a relative change of the column or the objective by the same change of the
# parameter: smaller ones may be rounding errors, as for velocities that are zero by constraints.
_MIN_EFFECT = 1e-3
# Fraction of the rows with the largest differences that is not compared: derivatives of columns
# that jump have peaks of any height, for example where a mass slides over the end of an element.
_OMITTED_ROWS = 0.01


def measure_sensitivities(result: Sensitivities) -> Errors:
    """Return the errors of the derivatives of observed columns over time."""
    headers = tuple(result.columns.columns())
    if not headers:
        return Errors.unchecked((), np.zeros(0), "no column is observed")

    def evaluate(other: Sensitivities) -> Array:
        """Return the derivatives, and their sizes in the last row."""
        # An event may stop the other run earlier.
        is_reached = result.t <= other.solution.trajectory.end
        other = other.at_times(result.t[is_reached])
        rows = np.stack(list(other.columns.columns().values()), axis=1)
        missing = np.repeat(rows[-1:], np.sum(~is_reached), axis=0)
        return np.vstack([rows, missing, _measure_effects(other)])

    def compare(first: Array, second: Array, refined: Refined) -> Errors:
        peaks, others = (np.abs(x[:-1]).max(axis=0) for x in (first, second))
        differences = np.sort(np.abs(first - second)[:-1], axis=0)
        count = len(differences) - int(_OMITTED_ROWS * len(differences))
        mean, largest = np.sqrt(np.mean(differences[:count] ** 2, axis=0)), differences[-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            total, rows = (np.where(x == 0.0, 0.0, x / second[-1]) for x in (mean, largest))
        relative_to = ("its mean size",) * len(headers)
        return Errors(headers, peaks, others, FACTOR * total, rows, refined, relative_to)

    peaks = np.array([np.max(np.abs(x)) for x in result.columns.columns().values()])
    return _measure(result, headers, peaks, evaluate, compare)


def measure_gradient(result: Gradient) -> Errors:
    """Return the errors of an objective and of its derivatives.

    Those of derivatives are relative to the largest derivative by relative changes of parameters.
    """
    names = [
        name if np.ndim(x) == 0 else f"{name}[{k}]"
        for name, x in result.derivatives.items()
        for k in range(np.size(x))
    ]
    headers = ("objective [-]", *(f"d(objective)/d({x}) [per unit of {x}]" for x in names))
    sizes = np.abs(np.concatenate([np.ravel(x) for x in result.parameters.values()]))
    sizes = np.where(sizes > 0.0, sizes, 1.0)

    def evaluate(other: Gradient) -> Array:
        return np.append(other.value, other.array)

    def compare(first: Array, second: Array, refined: Refined) -> Errors:
        value, largest = abs(second[0]), np.max(sizes * np.abs(second[1:]))
        scales = np.append(value, max(largest, _MIN_EFFECT * value) / sizes)
        relative_to = "the largest effect of a parameter"
        return Errors.of_values(headers, first, second, refined, scales, relative_to)

    peaks = np.abs(evaluate(result))
    return _measure(result, headers, peaks, evaluate, compare)


def _measure(
    result: Any,
    headers: Sequence[str],
    peaks: Array,
    evaluate: Callable[[Any], Array],
    compare: Callable[[Array, Array, Refined], Errors],
) -> Errors:
    """Return the errors of the values that `evaluate` returns for a result and its repetition."""
    run = result.solution
    if result._repeat is None:
        reason = "the derivatives come from another process"
        return Errors.unchecked(headers, peaks, reason)
    method = refine_method(run, RTOL_BESIDE_ACCURATE_STEPS)
    start = run.equations.start
    request = AS_DRAWN if start is None or start.request is None else start.request

    def repeat(causes: Collection[str]) -> tuple[Array, Refined]:
        return _repeat(lambda x: evaluate(result._repeat(x, method)), causes, request, run)

    failed = Errors.unchecked(headers, peaks, "a refined repetition fails", has_failed=True)
    return replace(measure_errors(failed, evaluate(result), repeat, compare), has_accuracy=False)


def _repeat(
    compute: Callable[[Callable[[Any], Any]], Result],
    causes: Collection[str],
    start: Any,
    run: Solution | None,
) -> tuple[Result, Refined]:
    """Return what `compute` returns for a function that refines mechanisms, and what it refines.

    `start` is that of the runs, None for that of the mechanisms; `run` is one of those that are
    repeated with other steps.
    """
    refined = Refined()

    def change(mechanism: Any) -> Any:
        nonlocal refined
        if isinstance(mechanism, Mechanism):
            request = mechanism.start if start is None else start
            mechanism, refined = refine_mechanism(mechanism, request, causes)
        return mechanism

    with hold_messages(), unchecked():
        result = compute(change)
    return result, refined if run is None else refined.with_steps(run.made_by)


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


def measure_design(search: SearchResult) -> Errors:
    """Return the errors of the objective and of the limited quantities of the best design.

    They are relative to the larger one of the value and the limit; without a limit, or if it is
    zero, of the values of the best and the first design.
    """
    problem, best, first = search.problem, search.best, search.trials[0]
    design = problem.design(best.numbers)
    ratios = np.append(1.0, search.problem.ratios)
    values = ratios * best.values
    labels = [x.label for x in problem.quantities]
    headers = tuple(f"{x} [{unit or '-'}]" for x, unit in zip(labels, search.units, strict=True))
    results = [x for x in design.results if hasattr(x, "equations")]
    if not results:
        return Errors.unchecked(headers, values, "no quantity depends on steps or beams")
    run = next((x for x in results if isinstance(x, Solution)), None)
    method = None if run is None else refine_method(run)
    bounds = np.array([0.0, *(abs(x.bound) for x in problem.limits)])
    sizes = np.maximum(np.abs(values), np.where(bounds > 0.0, bounds, np.abs(first.values)))

    def repeat(causes: Collection[str]) -> tuple[Array, Refined]:
        def compute(change: Callable[[Any], Any]) -> Array:
            return ratios * problem.repeat(best.numbers, change, method)

        return _repeat(compute, causes, problem.settings.start, run)

    compare = partial(Errors.of_values, headers, scales=sizes)
    unchecked = Errors.unchecked(headers, values, "the refined design cannot be analyzed")
    return replace(measure_errors(unchecked, values, repeat, compare), has_accuracy=False)


def measure_fit(problem: FitProblem, evaluation: Evaluation) -> Errors:
    """Return the errors of the estimates and of the fitted columns.

    Estimates follow the predictions of the refined runs linearly, and their errors are relative to
    their values. Those of columns are relative to half the range of the data.
    """
    values, sources = evaluation.values, problem.data.sources
    headers = [f"{name} [{problem.units[name] or '-'}]" for name in problem.variables]
    headers += [f"{x.experiment}: {x.header}" if x.experiment else x.header for x in sources]
    predictions = problem.recorded_values(evaluation)
    rows = [x for _, x in problem.data.rows]
    sizes = np.where(values, values, 1.0)
    jacobian = evaluation.projected_jacobian * sizes
    measured = problem.data.table["value"].to_numpy()
    run = next(iter(evaluation.runs.values())).solution
    method = refine_method(run, RTOL_BESIDE_ACCURATE_STEPS)

    def repeat(causes: Collection[str]) -> tuple[Array, Refined]:
        def compute(change: Callable[[Any], Any]) -> Array:
            return problem.recorded_values(problem.repeat(values, method, change))

        return _repeat(compute, causes, problem.start, run)

    def compare(first: Array, second: Array, refined: Refined) -> Errors:
        changes = (second - first) * problem.weights
        shifts = -np.linalg.lstsq(jacobian, changes, rcond=MIN_SINGULAR_RATIO)[0] * sizes
        names = headers[: len(values)]
        errors = [Errors.of_values(names, values, values + shifts, refined, sizes)]
        for header, x in zip(headers[len(values) :], rows, strict=True):
            # The headline is the largest magnitude.
            here, there = (np.append(np.abs(y[x]).max(), y[x])[None] for y in (first, second))
            scale = np.array([0.5 * np.ptp(measured[x])])
            relative_to = "half the range of the data"
            errors.append(Errors.of_values([header], here, there, refined, scale, relative_to))
        return Errors.join(errors)

    peaks = [np.abs(predictions[x]).max() for x in rows]
    unchecked = Errors.unchecked(headers, np.append(values, peaks), "a refined run fails")
    return replace(measure_errors(unchecked, predictions, repeat, compare), has_accuracy=False)
