"""From equations of motion to the equations of one implicit step of a second-order integrator."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, once
from beamdae.symbolic.sparse_sums import SparseSum

MX = ca.MX


@dataclass(frozen=True)
class StepEquations:
    """Equations of one implicit step of a second-order integrator, scaled by the step.

    Unknowns x = (d, lam_bar[, eta_bar]): increments d of a prediction,
    q = q_p + d [- G(q_n)^T eta_bar], v = v_p + c_v d, a = a_p + c_a d, and scaled multipliers
    lam_bar = c_f lam. Equations: c_f F + G^T lam_bar = 0, g = 0 [, g_dot / c_v = 0]; in brackets
    the stabilized index-2 form. With c_f ~ h^2 the condition of the iteration matrix does not
    depend on the step (Bottasso, Bauchau & Cardona, SIAM J. Sci. Comput. 29 (2007) 397).

    Attributes
    ----------
    residual
        (x, time, q_p, v_p, a_p, q_n, coefficients (c_v, c_a, c_f), p) -> equations.
    jacobian
        The same arguments -> non-zeros of the iteration matrix on `pattern`.
    position
        (x, time, q_p, q_n, p) -> q.
    """

    equations: EquationsOfMotion
    residual: ca.Function
    jacobian: ca.Function
    position: ca.Function
    pattern: sp.csc_array

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.pattern.shape[0]


@once
def step_equations(equations: EquationsOfMotion, stabilized: bool) -> StepEquations:
    """Build the step equations on index 3, or on the stabilized index-2 form."""
    n, m = equations.n, equations.m
    size = n + m * (2 if stabilized else 1)
    x, time, p = MX.sym("x", size), MX.sym("time", 2), MX.sym("p", len(equations.p))
    predicted = [MX.sym(name, n) for name in ("q_p", "v_p", "a_p", "q_n")]
    coefficients = MX.sym("c", 3)
    c_v, c_a, c_f = (coefficients[i] for i in range(3))
    inputs = [x, time, *predicted, coefficients, p]

    d, lam = x[:n], x[n : n + m]
    q, v, a = predicted[0] + d, predicted[1] + c_v * d, predicted[2] + c_a * d
    if stabilized:
        q = q - equations.reaction(time, predicted[3], p, x[n + m :])
    rows = [
        c_f * equations.force(time, q, v, a, p) + equations.reaction(time, q, p, lam),
        equations.level(0, time, q, v, a, p),
    ]
    if stabilized:
        rows.append(equations.level(1, time, q, v, a, p) / c_v)

    by_q, by_d = SparseSum((n, n)), SparseSum((n, n))
    stiffness, damping_and_mass = equations.tangent(time, q, v, a, p, c_v, c_a)
    constraint, g_dot_q, reaction_q = equations.constraint_blocks(time, q, v, p, lam)
    for block in stiffness:
        by_q.add(block.scaled(c_f))
    for block in reaction_q:
        by_q.add(block)
    for block in damping_and_mass:
        by_d.add(block.scaled(c_f))
    big_g = SparseSum.of((m, n), constraint).matrix()
    k_q = by_q.matrix()
    blocks = [[k_q + by_d.matrix(), big_g.T], [big_g, MX(m, m)]]
    if stabilized:
        h_q = SparseSum.of((m, n), g_dot_q).matrix() / c_v
        anchor = equations.constraint_blocks(time, predicted[3], v, p, lam)[0]
        shift = -SparseSum.of((m, n), anchor).matrix().T
        blocks = [
            [*blocks[0], k_q @ shift],
            [*blocks[1], big_g @ shift],
            [big_g + h_q, MX(m, m), h_q @ shift],
        ]
    matrix = ca.blockcat(blocks)
    pattern = sp.csc_array(
        (np.ones(matrix.nnz()), matrix.sparsity().row(), matrix.sparsity().colind()),
        shape=matrix.shape,
    )
    return StepEquations(
        equations,
        ca.Function("residual", inputs, [ca.densify(ca.vertcat(*rows))]),
        ca.Function("jacobian", inputs, [ca.densify(matrix.nz[:])]),
        ca.Function("position", [x, time, predicted[0], predicted[3], p], [ca.densify(q)]),
        pattern,
    )
