"""Jerk prescribed by the constraints, which corrects velocities after a change of the step.

The equivalent for the start of an interval is `ConsistencySolver.evaluate_normal_jerk`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.sums import InputLayout, assemble_accelerations
from beamdae.equations.starts.state_evaluator import plan_state_sums
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.integrators.alpha.workspace import AlphaWorkspace
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.symbolic.sums.kernel_sums import Sum, SumPlan

Array = np.ndarray


@cache_on_owner
def _plan_accelerations(structure: Structure) -> SumPlan:
    n = structure.n
    return assemble_accelerations(structure, InputLayout(q=0, v=n, a=2 * n, lam=3 * n)).vector()


@dataclass(frozen=True)
class JerkEquations:
    """Equations of the jerk normal to the constraint manifold.

    Attributes
    ----------
    equations
        Equations of motion.
    accelerations
        Evaluation plan of g_ddot.
    saddle, matrix
        Evaluation plan of [[M, G^T], [G, 0]], and the matrix to factorize.
    """

    equations: EquationsOfMotion
    accelerations: SumPlan
    saddle: SumPlan
    matrix: FactorizedMatrix

    @classmethod
    def from_equations(cls, equations: EquationsOfMotion) -> JerkEquations:
        """Return the jerk equations with a new matrix, for one run."""
        structure = equations.structure
        sums = plan_state_sums(structure)
        matrix = FactorizedMatrix.from_pattern(sums.saddle_pattern)
        return cls(equations, _plan_accelerations(structure), sums.saddle, matrix)

    @property
    def is_native(self) -> bool:
        """True if the equations can be evaluated in machine code."""
        return self.accelerations.is_native and self.saddle.is_native

    def buffers(self, native: bool) -> JerkBuffers:
        """Return the work arrays in which a loop evaluates the jerk."""
        n, m, p = self.equations.n, self.equations.m, self.equations.p
        return JerkBuffers(
            accelerations=self.accelerations.sum(native, p),
            saddle=self.saddle.sum(native, p),
            linear=self.matrix.make_solver(),
            motion=np.zeros(3 * n + m),
            ahead=np.zeros(m),
            behind=np.zeros(m),
            nonzeros=self.matrix.nonzeros,
            unknowns=np.zeros(n + m),
        )


@dataclass(slots=True)
class JerkBuffers:
    """Work arrays for the evaluation of the jerk.

    Attributes
    ----------
    accelerations
        Evaluation of g_ddot.
    saddle, linear, nonzeros
        Evaluation of [[M, G^T], [G, 0]], its linear solver, and its non-zeros.
    motion
        (q, v, a, lam).
    ahead, behind
        g_ddot shortly after and shortly before the current time.
    unknowns
        Jerk, followed by its multipliers.
    """

    accelerations: Sum
    saddle: Sum
    linear: Any
    motion: Array
    ahead: Array
    behind: Array
    nonzeros: Array
    unknowns: Array


@dataclass(slots=True, kw_only=True)
class AdaptiveAlphaWorkspace(AlphaWorkspace):
    """Work arrays of a run with adaptive steps.

    Attributes
    ----------
    jerk
        Work arrays of the jerk that corrects velocities when the step changes.
    corrects_velocities
        1 if velocities are corrected when the step changes, otherwise 0.
    multiplier_weights, multiplier_tolerance, shortest_tested_step
        Error test of the multipliers; see `MultiplierTolerances`.
    lam_before
        Multipliers at the start of the step before, for the extrapolation after a rejected step.
    """

    jerk: JerkBuffers
    corrects_velocities: int
    multiplier_weights: Array
    multiplier_tolerance: float
    shortest_tested_step: float
    lam_before: Array
