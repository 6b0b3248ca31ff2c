"""Derivatives of runs with redundant constraints, whose reactions have minimum norm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from beamdae.analysis.sensitivities.neighbors import Difference
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.reduced_equations import ReducedEquations, keep_constraints
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.integrators.redundant_constraints import remove_redundant
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray


@dataclass(frozen=True)
class RedundantConstraints:
    """Run of equations without their redundant constraints.

    Attributes
    ----------
    reduced
        Equations with and without the redundant constraints.
    solution
        The run, with the multipliers of the independent constraints.
    """

    reduced: ReducedEquations
    solution: Solution

    @classmethod
    def of(cls, solution: Solution) -> RedundantConstraints | None:
        """Return the run without redundant constraints; None if the model has none."""
        reduced = remove_redundant(solution.equations, solution.trajectory.start)
        if reduced is None:
            return None
        full = StateEvaluator(solution.equations)

        def reduce(interval: Interval) -> Interval:
            rows = interval.rows
            lam = np.zeros((len(rows.lam), len(reduced.independent)))
            for k, (time, q) in enumerate(zip(interval.times, rows.q, strict=True)):
                gradient = full.constraint_matrix(time, q).toarray()
                force = gradient.T @ rows.lam[k]
                lam[k] = np.linalg.lstsq(gradient[reduced.independent].T, force, rcond=None)[0]
            return replace(interval, rows=rows._replace(lam=lam))

        trajectory = Trajectory(tuple(map(reduce, solution.trajectory.intervals)))
        solution = replace(solution, equations=reduced.equations, trajectory=trajectory)
        return cls(reduced, solution)

    def reduce(self, difference: Difference) -> Difference:
        """Return neighboring models without the redundant constraints."""
        return replace(
            difference,
            base=self._keep(difference.base),
            equations=tuple(map(self._keep, difference.equations)),
        )

    def restore(self, along: Trajectory, difference: Difference) -> Trajectory:
        """Return the derivatives of a run with those of the multipliers of all constraints.

        The reactions of minimum norm are differenced along the derivatives.
        """

        def restore(interval: Interval, change: Interval) -> Interval:
            def evaluate(e: EquationsOfMotion, q: Array, lam: Array) -> Array:
                neighbor = replace(self.reduced, full=e, equations=self._keep(e))
                return neighbor.restore_reactions(interval.times, q, lam)

            (q, _, _, lam), rows = interval.rows, change.rows
            lam = difference.along(evaluate, (q, rows.q), (lam, rows.lam))
            return replace(change, rows=rows._replace(lam=lam))

        pairs = zip(self.solution.trajectory.intervals, along.intervals, strict=True)
        return Trajectory(tuple(restore(*x) for x in pairs))

    def _keep(self, equations: EquationsOfMotion) -> EquationsOfMotion:
        return keep_constraints(equations, self.reduced.independent)
