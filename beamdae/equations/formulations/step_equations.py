"""Equations of one implicit step of a second-order integrator (generalized-alpha)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp

from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.sums import (
    FIRST_LEVEL,
    GRADIENT,
    REACTION_STIFFNESS,
    InputLayout,
    add_joint_matrices,
    add_tangents,
    assemble_reactions,
    assemble_residual,
    create_matrix_sum,
    select_holonomic,
)
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.symbolic.force_kernel import DAMPING, MASS, STIFFNESS, Tangents
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_matrix_factors, set_time
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator

Array = np.ndarray


@dataclass(frozen=True)
class StepEquations:
    """Equations of one implicit step of a second-order integrator, scaled by the step size.

    The unknowns x = (d, lam_bar[, eta_bar]) are increments d to a prediction and scaled multipliers
    lam_bar = c_f lam, with

        q = q_p + d [+ r, r = -G(q_n)^T eta_bar],   v = v_p + c_v d,   a = a_p + c_a d.

    The equations are

        c_f F + G^T lam_bar = 0,   g = 0 [, g_dot / c_v = 0],

    where the terms in brackets belong to the stabilized index-2 form. For nonholonomic constraints,
    g = 0 is replaced by g_dot / c_v = 0 in the index-3 form, and by eta_bar = 0 in the stabilized
    form. If c_f is proportional to the square of the step size, the condition number of the
    iteration matrix stays bounded as the step size decreases (Bottasso, Bauchau & Cardona, SIAM J.
    Sci. Comput. 29 (2007) 397).

    Attributes
    ----------
    equations
        Equations of motion.
    stabilized
        True for the stabilized index-2 form, False for index 3.
    pattern
        CSC pattern of the iteration matrix in (d, lam_bar[, eta_bar, r]). The entries of r that can
        differ from zero remain unknowns, so that the matrix is a sum of local matrices.
    sums
        Plans of the sums of kernels that evaluate the equations, G(q_n)^T eta_bar and the iteration
        matrix, with the inputs (q, v, a, lam, q_n, eta_bar).
    """

    equations: EquationsOfMotion
    stabilized: bool
    pattern: sp.csc_array
    sums: tuple[SumPlan, SumPlan, SumPlan]

    @property
    def size(self) -> int:
        """Number of unknowns x, without r."""
        return self.equations.n + self.equations.m * (2 if self.stabilized else 1)

    @cached_property
    def _evaluators(self) -> list[SumEvaluator]:
        return [SumEvaluator(plan, self.equations.p) for plan in self.sums]

    def residual(self, time: Array, at: StepPrediction, x: Array) -> Array:
        """Return the residual (size,) at time = (t, branch); for loops, see `core.h`."""
        n, m, (c_v, _, c_f) = self.equations.n, self.equations.m, at.coefficients
        evaluate = self._evaluators[0]
        set_time(evaluate, *time)
        result = evaluate(self._inputs(time, at, x, 1.0 / c_f), self.size)
        result[:n] *= c_f
        result[self._velocity_rows] /= c_v
        result[n + m :] *= 1.0 / c_v
        return result

    def jacobian(self, time: Array, at: StepPrediction, x: Array) -> Array:
        """Return the non-zeros of the iteration matrix on `pattern` at time = (t, branch)."""
        (c_v, c_a, c_f), evaluate = at.coefficients, self._evaluators[2]
        set_time(evaluate, *time)
        set_matrix_factors(evaluate, c_f, c_f * c_v, c_f * c_a, 1.0, 1.0 / c_v, 1.0 / c_f)
        return evaluate(self._inputs(time, at, x, 1.0), self.pattern.nnz)

    def position(self, time: Array, at: StepPrediction, x: Array) -> Array:
        """Return the positions q, (n,), at the unknowns x."""
        return self._inputs(time, at, x, 1.0)[: self.equations.n]

    def _inputs(self, time: Array, at: StepPrediction, x: Array, lam_factor: float) -> Array:
        """Return the inputs of the sums, with multipliers times a factor."""
        n, m, (c_v, c_a, _) = self.equations.n, self.equations.m, at.coefficients
        d, lam, eta = np.split(x, [n, n + m])
        motion = np.zeros(4 * n + 2 * m)
        motion[3 * n : 3 * n + m] = lam_factor * lam
        motion[:n] = at.q + d
        if self.stabilized:
            motion[3 * n + m : 4 * n + m], motion[4 * n + m :] = at.before, eta
            evaluate = self._evaluators[1]
            set_time(evaluate, *time)
            motion[:n] -= evaluate(motion, n)
        motion[n : 2 * n], motion[2 * n : 3 * n] = at.v + c_v * d, at.a + c_a * d
        return motion

    def buffers(self) -> Workspace:
        """Return new buffers for evaluating the equations in one run."""
        n, m = self.equations.n, self.equations.m
        motion = np.zeros(4 * n + 2 * m)
        residual, anchor, matrix = (total.sum(True, self.equations.p) for total in self.sums)
        return Workspace(
            "StepBuffers",
            n=n,
            m=m,
            stabilized=int(self.stabilized),
            motion=motion,
            velocity_rows=self._velocity_rows,
            residual=residual,
            anchor=anchor,
            matrix=matrix,
        )

    @property
    def _velocity_rows(self) -> Array:
        """Rows in which g_dot / c_v replaces g."""
        rows = self.equations.n + self.equations.nonholonomic_rows
        return rows[:0] if self.stabilized else rows


@dataclass(slots=True)
class StepPrediction:
    """Predicted state of a step, to which the increments are added.

    Attributes
    ----------
    q, v, a
        Predicted coordinates, velocities and accelerations, (n,) each.
    before
        Positions q_n at the beginning of the step, (n,).
    coefficients
        Factors (c_v, c_a, c_f) of `StepEquations`.
    """

    q: Array
    v: Array
    a: Array
    before: Array
    coefficients: Array


@cache_on_owner
def formulate_step(equations: EquationsOfMotion, stabilized: bool) -> StepEquations:
    """Return the step equations of the index-3 form or of the stabilized index-2 form."""
    return StepEquations(equations, stabilized, *plan_step_sums(equations.structure, stabilized))


@cache_on_owner
def plan_step_sums(
    structure: Structure, stabilized: bool
) -> tuple[sp.csc_array, tuple[SumPlan, SumPlan, SumPlan]]:
    """Return the pattern of the iteration matrix and the sums of `StepEquations`."""
    n, m = structure.n, structure.m
    layout = InputLayout(q=0, v=n, a=2 * n, lam=3 * n, mu=4 * n + m)
    anchor = InputLayout(q=3 * n + m, lam=4 * n + m)
    levels = (0, 1) if stabilized else (0,)
    residual = assemble_residual(structure, layout, levels, stabilized=False)
    coordinates = np.unique(
        np.concatenate([[], *(joint.operator.indices for joint in select_holonomic(structure))])
    )
    # Selects the entries of r.
    corrected = sp.csr_array(sp.eye_array(n, format="csc")[:, coordinates.astype(int)])
    total = create_matrix_sum()
    eta, r = n + m, n + 2 * m
    # Only the stiffness multiplies r. Without r, all derivatives enter one block.
    sums: Tangents = ((STIFFNESS, DAMPING, MASS),)
    if stabilized:
        sums = ((STIFFNESS,), (DAMPING, MASS))
    for term, copies in add_tangents(total, structure, layout, sums):
        add, on_q = partial(total.add_matrix, copies), term.operator
        for output in range(len(sums)):
            add(output, on_q, on_q, (0, 0))
        if term.rows is not None:
            add(len(sums), on_q, term.rows, (0, n))
        if stabilized:
            add(0, on_q, sp.csr_array(on_q @ corrected), (0, r))
    for joint, copies in add_joint_matrices(total, structure, layout, levels, False):
        add, on_q, on_g = partial(total.add_matrix, copies), joint.operator, joint.rows
        nonholonomic = not joint.kernel.is_holonomic
        if not (nonholonomic and stabilized):
            add(GRADIENT, on_g, on_q, (n, 0))
        add(GRADIENT, on_g, on_q, (0, n), transposed=True)
        add(REACTION_STIFFNESS, on_q, on_q, (0, 0))
        if nonholonomic and not stabilized:
            add(FIRST_LEVEL, on_g, on_q, (n, 0))
        if stabilized:
            on_r = sp.csr_array(on_q @ corrected)
            add(REACTION_STIFFNESS, on_q, on_r, (0, r))
            if nonholonomic:
                identity = FIRST_LEVEL + 1
                add(identity, on_g, on_g, (n, eta))
            else:
                add(GRADIENT, on_g, on_r, (n, r))
            add(GRADIENT, on_g, on_q, (eta, 0))
            add(FIRST_LEVEL, on_g, on_q, (eta, 0))
            add(FIRST_LEVEL, on_g, on_r, (eta, r))
    size = n + m
    if stabilized:
        for joint, copies in add_joint_matrices(total, structure, anchor, (), False):
            if joint.kernel.is_holonomic:
                on_r = sp.csr_array(joint.operator @ corrected)
                total.add_matrix(copies, GRADIENT, joint.rows, on_r, (r, eta), transposed=True)
        size = r + corrected.shape[1]
        total.add_diagonal(corrected.shape[1], (r, r), None, 1.0)
    pattern, matrix = total.matrix((size, size))
    reactions = assemble_reactions(structure, anchor, holonomic_only=True)
    return pattern, (residual.vector(), reactions.vector(), matrix)
