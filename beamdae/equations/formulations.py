"""From equations of motion to residuals: five first-order forms, two step equations.

First-order forms of F(t, q, v, a) + G^T lam = 0, g(t, q) = 0 for an integrator of
0 = R(t, y, y'):

==================  =============  ==========================================================
form                y              equations
==================  =============  ==========================================================
index3              q, v, lam      q' = v; F + G^T lam = 0; g = 0
index2              q, v, lam      q' = v; F + G^T lam = 0; g_dot = 0
index1              q, v, lam      q' = v; F + G^T lam = 0; g_ddot = 0
ggl                 q, v, lam, mu  q' = v - G^T mu; F + G^T lam = 0; g = 0; g_dot = 0
stabilized-index1   q, v, Lam, Mu  as ggl with lam = Lam', mu = Mu'
==================  =============  ==========================================================

ggl: Gear, Gupta & Leimkuhler, J. Comput. Appl. Math. 12-13 (1985) 77. stabilized-index1:
Anantharaman & Hiller, Int. J. Numer. Meth. Eng. 32 (1991) 1531.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import one_of
from beamdae.symbolic.sparse_sums import Block, SparseSum

Array = np.ndarray
MX = ca.MX

FIRST_ORDER = ("stabilized-index1", "ggl", "index2", "index1", "index3")
_LEVELS = {"index3": (0,), "index2": (1,), "index1": (2,)}


class State(NamedTuple):
    """Rows of a trajectory: coordinates, velocities, accelerations and multipliers."""

    q: Array
    v: Array
    a: Array
    lam: Array


@dataclass(frozen=True)
class FirstOrder:
    """Residual R(t, y, y') of a first-order form with its exact Jacobian.

    Attributes
    ----------
    residual
        (time, y, y', p) -> R.
    jacobian
        (time, y, y', p, c) -> non-zeros of dR/dy + c dR/dy' on `pattern`.
    pattern
        CSC pattern of the Jacobian.
    """

    equations: EquationsOfMotion
    form: str
    residual: ca.Function
    jacobian: ca.Function
    pattern: sp.csc_array

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.pattern.shape[0]

    @property
    def _parts(self) -> tuple[slice, slice, slice]:
        n, m = self.equations.n, self.equations.m
        return slice(0, n), slice(n, 2 * n), slice(2 * n, 2 * n + m)

    def pack(self, state: State) -> tuple[Array, Array]:
        """Consistent (y, y') of a consistent state."""
        q, v, lam = self._parts
        y, yp = np.zeros(self.size), np.zeros(self.size)
        y[q], y[v], yp[q], yp[v] = state.q, state.v, state.v, state.a
        (yp if self.form == "stabilized-index1" else y)[lam] = state.lam
        return y, yp

    def unpack(self, y: Array, yp: Array) -> State:
        """State of (y, y'), for one row or many."""
        q, v, lam = self._parts
        multipliers = yp if self.form == "stabilized-index1" else y
        return State(y[..., q], y[..., v], yp[..., v], multipliers[..., lam])


def first_order(equations: EquationsOfMotion, form: str) -> FirstOrder:
    """Build a first-order form; `form` is one of `FIRST_ORDER`."""
    one_of("formulation", "form", form, FIRST_ORDER)
    n, m = equations.n, equations.m
    stabilized = form not in _LEVELS
    derivative = form == "stabilized-index1"
    levels = (0, 1) if stabilized else _LEVELS[form]
    size = 2 * n + m * (2 if stabilized else 1)

    time, y, yp, p = (
        MX.sym("time", 2),
        MX.sym("y", size),
        MX.sym("yp", size),
        MX.sym("p", len(equations.p)),
    )
    c = MX.sym("c")
    q, v, a = y[:n], y[n : 2 * n], yp[n : 2 * n]
    multipliers = yp if derivative else y
    lam, mu = multipliers[2 * n : 2 * n + m], multipliers[2 * n + m :]

    kinematic = yp[:n] - v
    if stabilized:
        kinematic += equations.reaction(time, q, p, mu)
    dynamic = equations.force(time, q, v, a, p) + equations.reaction(time, q, p, lam)
    constraints = [equations.level(k, time, q, v, a, p) for k in levels]
    residual = ca.vertcat(kinematic, dynamic, *constraints)

    total = SparseSum((size, size))
    total.add_identity(n, c, 0, 0)
    total.add_identity(n, MX(-1), 0, n)
    stiffness, rates = equations.tangent(time, q, v, a, p, MX(1), c)
    jacobian, g_dot_q, reaction_q = equations.constraint_blocks(time, q, v, p, lam)
    for block in (*stiffness, *reaction_q):
        total.add(block, n, 0)
    for block in rates:
        total.add(block, n, n)
    factor = c if derivative else MX(1)
    for block in jacobian:
        total.add(block.transposed.scaled(factor), n, 2 * n)
    if stabilized:
        for block in jacobian:
            total.add(block.transposed.scaled(factor), 0, 2 * n + m)
        for block in equations.constraint_blocks(time, q, v, p, mu)[2]:
            total.add(block, 0, 0)
    for k, level in enumerate(levels):
        motion = (time, q, v, a, p)
        _add_level(total, level, 2 * n + k * m, equations, motion, jacobian, g_dot_q, c)
    pattern, nonzeros = total.assemble()
    return FirstOrder(
        equations,
        form,
        ca.Function("residual", [time, y, yp, p], [ca.densify(residual)]),
        ca.Function("jacobian", [time, y, yp, p, c], [nonzeros]),
        pattern,
    )


def _add_level(
    total: SparseSum,
    level: int,
    row: int,
    equations: EquationsOfMotion,
    motion: tuple[MX, ...],
    jacobian: list[Block],
    g_dot_q: list[Block],
    c: MX,
) -> None:
    """Add the rows of g (level 0), g_dot (1) or g_ddot (2) of a first-order Jacobian."""
    n = equations.n
    if level == 0:
        for block in jacobian:
            total.add(block, row, 0)
    elif level == 1:
        for by_q, by_v in zip(g_dot_q, jacobian, strict=True):
            total.add(by_q, row, 0)
            total.add(by_v, row, n)
    else:
        g_ddot_q, g_ddot_v = equations.acceleration_blocks(*motion)
        for by_q, by_v, by_a in zip(g_ddot_q, g_ddot_v, jacobian, strict=True):
            total.add(by_q, row, 0)
            total.add(by_v, row, n)
            total.add(by_a.scaled(c), row, n)


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
    stiffness, rates = equations.tangent(time, q, v, a, p, c_v, c_a)
    constraint, g_dot_q, reaction_q = equations.constraint_blocks(time, q, v, p, lam)
    for block in stiffness:
        by_q.add(block.scaled(c_f))
    for block in reaction_q:
        by_q.add(block)
    for block in rates:
        by_d.add(block.scaled(c_f))
    big_g = _sum((m, n), constraint)
    k_q = by_q.matrix()
    blocks = [[k_q + by_d.matrix(), big_g.T], [big_g, MX(m, m)]]
    if stabilized:
        h_q = _sum((m, n), g_dot_q) / c_v
        anchor = equations.constraint_blocks(time, predicted[3], v, p, lam)[0]
        shift = -_sum((m, n), anchor).T
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


def _sum(shape: tuple[int, int], blocks: list[Block]) -> MX:
    total = SparseSum(shape)
    for block in blocks:
        total.add(block)
    return total.matrix()
