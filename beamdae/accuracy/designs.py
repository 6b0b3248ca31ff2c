"""Errors of designs, measured by their analyses with everything refined together."""

from __future__ import annotations

from collections.abc import Collection
from functools import partial

import numpy as np

from beamdae.accuracy.errors import Errors, Refined, measure_errors
from beamdae.accuracy.refinement import refine
from beamdae.accuracy.runs import refine_method
from beamdae.analysis.optimization.search import SearchResult
from beamdae.results.solution import Solution

Array = np.ndarray


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
    equations = results[0].equations
    run = next((x for x in results if isinstance(x, Solution)), None)
    method = None if run is None else refine_method(run)

    start = problem.start_of(equations)
    bounds = np.array([0.0, *(abs(x.bound) for x in problem.limits)])
    sizes = np.maximum(np.abs(values), np.where(bounds > 0.0, bounds, np.abs(first.values)))

    def repeat(causes: Collection[str]) -> tuple[Array, Refined]:
        refinement = refine(equations, start, causes)
        found = ratios * problem.repeat(best.numbers, refinement.equations.mechanism, method)
        refined = refinement.refined
        return found, refined if run is None else refined.with_steps(run.made_by)

    compare = partial(Errors.of_values, headers, scales=sizes)
    unchecked = Errors.unchecked(headers, values, "the refined design cannot be analyzed")
    return measure_errors(unchecked, values, repeat, compare, has_accuracy=False)
