"""Errors of designs, measured by their analyses with everything refined together."""

from __future__ import annotations

import numpy as np

from beamdae.accuracy.errors import Errors, Split
from beamdae.accuracy.refinement import Refinement, refine
from beamdae.accuracy.runs import describe_refinement, refine_method
from beamdae.analysis.optimization.search_result import SearchResult
from beamdae.errors import BeamdaeError
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
    method = None if run is None else refine_method(run, None)

    def analyze(refinement: Refinement | None) -> Array:
        used = equations if refinement is None else refinement.equations
        return ratios * problem.repeat(best.numbers, used.mechanism, method)

    start = problem.start_of(equations)
    try:
        refinement = refine(equations, start)
        companions = analyze(refinement)
    except BeamdaeError as problem_of_companion:
        reason = f"the refined design cannot be analyzed: {problem_of_companion}".rstrip(".")
        return Errors.unchecked(headers, values, reason)
    refined = describe_refinement(equations, refinement, run)
    bounds = np.array([0.0, *(abs(x.bound) for x in problem.limits)])
    sizes = np.maximum(np.abs(values), np.where(bounds > 0.0, bounds, np.abs(first.values)))

    def repeat(is_halved: bool) -> Array | None:
        try:
            return analyze(refine(equations, start, strains=False) if is_halved else None)
        except BeamdaeError:
            return None

    def compare(one: Array, other: Array) -> Array:
        return Errors.of_values(headers, one, other, refined, sizes).total

    split = Split(values, companions, repeat, compare, bool(refined.inexact))
    return Errors.of_values(headers, values, companions, refined, sizes, split)
