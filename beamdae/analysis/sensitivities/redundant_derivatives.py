"""Derivatives of runs with redundant constraints, whose reactions have minimum norm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from beamdae.analysis.sensitivities.model_differences import Difference
from beamdae.analysis.sensitivities.run_derivatives import (
    RunDerivative,
    RunDerivatives,
    derive_states,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.rank import RANK_TOLERANCE
from beamdae.equations.starts.reduced_equations import ReducedEquations, keep_constraints
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.integrators import GeneralizedAlpha, Radau
from beamdae.integrators.reaction_balance import bound_reactions
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
        solution, full = bound_reactions(solution), StateEvaluator(solution.equations)

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

    def differentiate(
        self, method: GeneralizedAlpha | Radau, differences: Mapping[str, Difference]
    ) -> dict[str, RunDerivative]:
        """Return the derivatives of the run with all multipliers, by parameter.

        The same equations must serve all parameters, see `further_key`.
        """
        reduced = {name: self.reduce(x) for name, x in differences.items()}
        intervals, result = self.solution.trajectory.intervals, {}
        for name, x in RunDerivatives(self.solution, method, reduced).by_parameter().items():
            pairs = zip(intervals, x.trajectory.intervals, strict=True)
            restored = (self._restore(*pair, differences[name]) for pair in pairs)
            result[name] = x._replace(trajectory=Trajectory(tuple(restored)))
        return result

    def reduce(self, difference: Difference) -> Difference:
        """Return neighboring models without the redundant constraints."""

        def keep(equations: EquationsOfMotion) -> EquationsOfMotion:
            return keep_constraints(equations, self.reduced.independent)

        return replace(
            difference,
            base=keep(difference.base),
            equations=tuple(map(keep, difference.equations)),
        )

    def _restore(self, interval: Interval, along: Interval, difference: Difference) -> Interval:
        """Return the derivatives with those of `ReducedEquations.restore_reactions`.

        With G^ = D^-1 G, whose rows have length one, and the projector P on the range of G^, the
        multipliers are lam = D^-1 P D lam_0. The derivative of P along dG^ is
        (I - P) dG^ G^+ + (G^+)^T dG^^T (I - P); Golub & Pereyra, SIAM J. Numer. Anal. 10 (1973)
        413, doi:10.1137/0710036.
        """
        full = difference.base
        derivatives = derive_states(difference)
        dp = difference.derivative(lambda e: e.p)
        scale_rates = difference.derivative(lambda e: e.position_scales)
        lam = np.zeros((len(interval.nodes), full.m))
        for k, time in enumerate(interval.times):
            at, change = (State(*(x[k] for x in y.rows)) for y in (interval, along))
            matrix = derivatives.solver.constraint_matrix(time, at.q)
            gradient = matrix.toarray()
            ((matrix.data,),) = derivatives.gradient_map(time, at.q).along(
                [change.q[None]], dp[None]
            )
            rate = matrix.toarray()
            rows = ScaledRows.of(gradient, full.position_scales)
            rate = rate * full.position_scales + gradient * scale_rates
            length_rate = np.sum(rows.scaled * rate, axis=1)
            scaled_rate = (rate - rows.scaled * length_rate[:, None]) / rows.length[:, None]
            start, start_rate = np.zeros(full.m), np.zeros(full.m)
            start[self.reduced.independent] = at.lam
            start_rate[self.reduced.independent] = change.lam
            start_rate = length_rate * start + rows.length * start_rate
            start = rows.length * start
            rest = start - rows.project(start)
            turned = scaled_rate @ (rows.inverse @ start)
            result = rows.project(start_rate - turned) + turned
            result += rows.inverse.T @ (scaled_rate.T @ rest)
            lam[k] = (result - (start - rest) * length_rate / rows.length) / rows.length
        return replace(along, rows=along.rows._replace(lam=lam))


@dataclass(frozen=True)
class ScaledRows:
    """Gradients of constraints G S with the scales S of the coordinates, as D G^.

    Attributes
    ----------
    length, scaled
        Lengths D of the rows of G S, (m,), and rows G^ of length one, (m, n).
    basis, inverse
        Orthonormal basis of the range of G^, and its pseudo-inverse.
    """

    length: Array
    scaled: Array
    basis: Array
    inverse: Array

    @classmethod
    def of(cls, gradient: Array, scales: Array) -> ScaledRows:
        """Return the rows of G with the scales of the coordinates."""
        gradient = gradient * scales
        length = np.linalg.norm(gradient, axis=1)
        length[length == 0.0] = 1.0
        scaled = gradient / length[:, None]
        left, singular, right = np.linalg.svd(scaled, full_matrices=False)
        is_nonzero = singular > RANK_TOLERANCE
        basis = left[:, is_nonzero]
        inverse = right[is_nonzero].T @ (basis.T / singular[is_nonzero, None])
        return cls(length, scaled, basis, inverse)

    def project(self, values: Array) -> Array:
        """Return the projection on the range of G^."""
        return self.basis @ (self.basis.T @ values)
