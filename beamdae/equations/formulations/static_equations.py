"""Static equilibrium F(t, q, 0, 0) + G^T lam = 0, g(t, q) = 0, with its tangent."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.compliant_equations import introduce_resultants
from beamdae.equations.formulations.sums import (
    InputLayout,
    add_saddle_point,
    assemble_residual,
    create_matrix_sum,
)
from beamdae.equations.formulations.tangents import Convert
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.errors import BeamdaeError
from beamdae.symbolic.force_kernel import STIFFNESS
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_matrix_factors, set_time
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator

Array = np.ndarray


@dataclass(frozen=True)
class StaticSums:
    """Plans of the sums of `StaticEquations`, with inputs (q, 0, lam), and the tangent pattern."""

    residual: SumPlan
    tangent: SumPlan
    pattern: sp.csc_array


@cache_on_owner
def plan_static_sums(structure: Structure) -> StaticSums:
    """Return the plans that evaluate the static residual and its tangent."""
    n, m, total = structure.n, structure.m, create_matrix_sum()
    # Velocities and accelerations share the zeros of the input.
    layout = InputLayout(q=0, v=n, a=n, lam=2 * n)
    residual = assemble_residual(structure, layout, (0,), stabilized=False).vector()
    add_saddle_point(total, structure, layout, ((STIFFNESS,),), with_reaction_stiffness=True)
    pattern, tangent = total.matrix((n + m, n + m))
    return StaticSums(residual, tangent, pattern)


@dataclass(frozen=True)
class StaticEquations:
    """Static equations in the unknowns (q, lam). Do not share an instance between threads.

    Attributes
    ----------
    equations
        Equations of motion; inertia and damping do not enter.
    time
        (t, branch), at which laws and drivers are evaluated.

    Raises
    ------
    BeamdaeError
        If a constraint is nonholonomic, which leaves the positions at rest undetermined.
    """

    equations: EquationsOfMotion
    time: Array

    def __post_init__(self) -> None:
        rows = self.equations.nonholonomic_rows
        if len(rows):
            raise BeamdaeError(
                f"{self.equations.lam_names[int(rows[0])]}: this constraint acts on "
                "velocities only, so the position at rest is undetermined; constrain "
                "a position instead."
            )

    @property
    def size(self) -> int:
        """Number of unknowns (q, lam)."""
        return self.equations.n + self.equations.m

    @property
    def pattern(self) -> sp.csc_array:
        """CSC pattern of the tangent [[K, G^T + dF/dlam], [G, 0]], K = d(F + G^T lam)/dq."""
        return plan_static_sums(self.equations.structure).pattern

    @cached_property
    def _residual(self) -> SumEvaluator:
        sums = plan_static_sums(self.equations.structure)
        return SumEvaluator(sums.residual, self.equations.p)

    @cached_property
    def _tangent(self) -> SumEvaluator:
        sums = plan_static_sums(self.equations.structure)
        return SumEvaluator(sums.tangent, self.equations.p)

    def residual(self, q: Array, lam: Array) -> Array:
        """Return F + G^T lam and g at positions q and multipliers lam, (n + m,)."""
        return self._evaluate(self._residual, q, lam, self.size)

    def tangent(self, q: Array, lam: Array) -> Array:
        """Return the non-zeros of the tangent on `pattern`, (nnz,)."""
        # All factors are 1; the factors of damping and mass are not used.
        set_matrix_factors(self._tangent, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
        return self._evaluate(self._tangent, q, lam, self.pattern.nnz)

    def convert(self, change: Convert) -> StaticEquations:
        """Return these static equations of converted equations of motion."""
        return replace(self, equations=change(self.equations))

    def matrix(self, q: Array, lam: Array) -> sp.csc_array:
        """Return the tangent, sparse (n + m, n + m)."""
        entries = (self.tangent(q, lam), self.pattern.indices, self.pattern.indptr)
        return sp.csc_array(entries, shape=self.pattern.shape)

    def _evaluate(self, total: SumEvaluator, q: Array, lam: Array, size: int) -> Array:
        set_time(total, *self.time)
        with np.errstate(over="ignore", invalid="ignore"):
            return total(np.concatenate([q, np.zeros(len(q)), lam]), size)


def find_idle_forces(static: StaticEquations) -> Array:
    """Return the mask of the forces of springs without stiffness, see `introduce_resultants`."""
    form = introduce_resultants(static.equations)
    e, first = form.equations, static.equations.n + form.joint_count
    rows = StaticEquations(e, static.time).matrix(e.q0, np.zeros(e.m))[first:]
    return np.asarray(abs(rows).sum(axis=1) == 0.0)
