"""Errors of fits, measured by the runs with the estimates with everything refined together."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from beamdae.accuracy.errors import FACTOR, Errors, Split
from beamdae.accuracy.refinement import Refinement, refine
from beamdae.accuracy.runs import RTOL_BESIDE_ACCURATE_STEPS, describe_refinement, refine_method
from beamdae.analysis.fit.problem import MIN_SINGULAR_RATIO, Evaluation, FitProblem
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError

Array = np.ndarray


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
    peaks = [float(np.max(np.abs(predictions[x]))) for x in rows]
    sizes = np.where(values, values, 1.0)
    jacobian = evaluation.projected_jacobian * sizes
    measured = problem.data.table["value"].to_numpy()
    half_ranges = np.array([0.5 * np.ptp(measured[x]) for x in rows])
    run = next(iter(evaluation.runs.values())).solution
    method = refine_method(run, None, RTOL_BESIDE_ACCURATE_STEPS)
    first: Refinement | None = None

    def repeat(strains: bool | None) -> Array:
        """Return the change of the residuals; the mesh is not refined if `strains` is None."""

        def change(equations: EquationsOfMotion) -> Any:
            nonlocal first
            refinement = None
            if strains is not None:
                refinement = refine(equations, problem.start_of(equations), strains=strains)
                first = first or refinement
            used = equations if refinement is None else refinement.equations
            return used.mechanism

        return problem.change_of_residuals(evaluation, change, method)

    try:
        changes = repeat(True)
    except BeamdaeError as failure:
        reason = f"a refined run fails: {failure}".rstrip(".")
        return Errors.unchecked(tuple(headers), np.append(values, peaks), reason)
    refined = describe_refinement(run.equations, first, run)

    def state(changes: Array) -> Errors:
        shifts = -np.linalg.lstsq(jacobian, changes, rcond=MIN_SINGULAR_RATIO)[0] * sizes
        names = headers[: len(values)]
        of_estimates = Errors.of_values(names, values, values + shifts, refined, sizes)
        with np.errstate(divide="ignore", invalid="ignore"):
            differences = np.where(problem.weights > 0.0, changes / problem.weights, 0.0)
        largest = np.array([np.max(np.abs(differences[x])) for x in rows]) / half_ranges
        peaks_of_companion = [float(np.max(np.abs((predictions + differences)[x]))) for x in rows]
        of_columns = Errors(
            tuple(headers[len(values) :]),
            np.array(peaks),
            np.array(peaks_of_companion),
            FACTOR * largest,
            largest,
            refined,
            relative_to="half the range of the data",
        )
        return Errors.join([of_estimates, of_columns])

    def repeat_or_none(is_halved: bool) -> Array | None:
        try:
            return repeat(False if is_halved else None)
        except BeamdaeError:
            return None

    def compare(first: Array, second: Array) -> Array:
        return state(second - first).total

    split = Split(np.zeros_like(changes), changes, repeat_or_none, compare, bool(refined.inexact))
    return replace(state(changes), _split=split)
