"""Jerk prescribed by the constraints, which corrects velocities after a change of the step.

The equivalent for the start of an interval is `ConsistencySolver.evaluate_normal_jerk`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.sums import InputLayout, assemble_accelerations
from beamdae.equations.starts.state_evaluator import plan_state_sums
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.symbolic.sums.kernel_sums import SumPlan

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

    def buffers(self, native: bool) -> Workspace:
        """Return the work arrays in which a loop evaluates the jerk."""
        n, m, p = self.equations.n, self.equations.m, self.equations.p
        return Workspace(
            "JerkBuffers",
            accelerations=self.accelerations.sum(native, p),
            saddle=self.saddle.sum(native, p),
            linear=self.matrix.make_solver(),
            motion=np.zeros(3 * n + m),
            ahead=np.zeros(m),
            behind=np.zeros(m),
            nonzeros=self.matrix.nonzeros,
            unknowns=np.zeros(n + m),
        )
