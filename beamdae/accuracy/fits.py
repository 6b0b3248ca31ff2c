"""Errors of fits, measured by the runs with the estimates with everything refined together."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from beamdae.accuracy.errors import FACTOR, Errors, Refined, measure_errors
from beamdae.accuracy.refinement import refine
from beamdae.accuracy.runs import RTOL_BESIDE_ACCURATE_STEPS, refine_method
from beamdae.analysis.fit.problem import MIN_SINGULAR_RATIO, Evaluation, FitProblem
from beamdae.equations.equations_of_motion import EquationsOfMotion

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
    method = refine_method(run, RTOL_BESIDE_ACCURATE_STEPS)

    def repeat(causes: Collection[str]) -> tuple[Array, Refined]:
        """Return the change of the residuals."""
        refined = Refined()

        def change(equations: EquationsOfMotion) -> Any:
            nonlocal refined
            refinement = refine(equations, problem.start_of(equations), causes)
            refined = refinement.refined.with_steps(run.made_by)
            return refinement.equations.mechanism

        return problem.change_of_residuals(evaluation, change, method), refined

    def compare(first: Array, second: Array, refined: Refined) -> Errors:
        changes = second - first
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
            ("half the range of the data",) * len(rows),
        )
        return Errors.join([of_estimates, of_columns])

    none = np.zeros(len(problem.weights))
    unchecked = Errors.unchecked(headers, np.append(values, peaks), "a refined run fails")
    return measure_errors(unchecked, none, repeat, compare, has_accuracy=False)
