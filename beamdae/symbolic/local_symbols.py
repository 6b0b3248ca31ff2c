"""Symbols of one local statement, and checks of expressions in them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca

SX = ca.SX

# Shared inputs of the kernels of all matrices: (t, branch), then the `MatrixFactors`.
MATRIX_SHARED = ("t", "branch", "c_q", "c_v", "c_a", "c_l", "c_h", "c_r")
SHARED_T, SHARED_BRANCH, C_Q, C_V, C_A, C_L, C_H, C_R = range(len(MATRIX_SHARED))


class MatrixFactors(NamedTuple):
    """Factors of the parts of an iteration matrix.

    Attributes
    ----------
    c_q, c_v, c_a
        Factors of dF/dq, dF/dv and dF/da; c_a is also the factor of d g_ddot/da.
    c_l
        Factor of derivatives with respect to multipliers if their time integrals are the unknowns.
    c_h
        Factor of d g_dot/dq.
    c_r
        Factor that converts the input multipliers to the multipliers of the forces F.
    """

    c_q: SX
    c_v: SX
    c_a: SX
    c_l: SX
    c_h: SX
    c_r: SX


@dataclass(frozen=True)
class Local:
    """Symbols of one local statement.

    `time` is (t, branch). Laws are evaluated at t and select their piece by branch, a time inside
    the current smooth interval, so that an integrator can end a step exactly on a breakpoint.

    Parameters
    ----------
    size
        Number of coordinates.
    n_data
        Number of data values.
    n_multipliers
        Number of multipliers.
    """

    size: int
    n_data: int = 0
    n_multipliers: int = 0

    @cached_property
    def time(self) -> SX:
        """Symbols (t, branch)."""
        return SX.sym("time", 2)

    @cached_property
    def q(self) -> SX:
        """Symbols of the local coordinates."""
        return SX.sym("q", self.size)

    @cached_property
    def v(self) -> SX:
        """Symbols of the local velocities."""
        return SX.sym("v", self.size)

    @cached_property
    def a(self) -> SX:
        """Symbols of the local accelerations."""
        return SX.sym("a", self.size)

    @cached_property
    def data(self) -> SX:
        """Symbols of the data, the numbers of the model."""
        return SX.sym("data", self.n_data)

    @cached_property
    def lam(self) -> SX:
        """Symbols of the multipliers."""
        return SX.sym("lam", self.n_multipliers)

    def partial_t(self, expression: SX) -> SX:
        """Return the partial derivative with respect to t, at constant branch."""
        return ca.jtimes(expression, self.time, SX([1, 0]))

    def dot(self, expression: SX) -> SX:
        """Return the time derivative of an expression in t and q along the motion."""
        by_q = ca.jtimes(expression, self.q, self.v) if self.size else 0
        return by_q + self.partial_t(expression)

    def ddot(self, expression: SX) -> SX:
        """Return the second time derivative of an expression in t and q along the motion."""
        return self.rate(self.dot(expression))

    def rate(self, dot: SX) -> SX:
        """Return the time derivative of an expression in t, q and v along the motion."""
        by_q = ca.jtimes(dot, self.q, self.v) + ca.jtimes(dot, self.v, self.a) if self.size else 0
        return by_q + self.partial_t(dot)

    def matrix_inputs(self) -> tuple[SX, MatrixFactors]:
        """Return the symbols of `MATRIX_SHARED` as one column, and the new factors by name."""
        factors = SX.sym("c", len(MatrixFactors._fields))
        return ca.vertcat(self.time, factors), MatrixFactors(*ca.vertsplit(factors))


def describe_column_error(name: str, value: Any, rows: int, *symbols: SX) -> str:
    """Return an error message if `value` is not a column (`rows`, 1) in `symbols`; otherwise ''."""
    if not isinstance(value, SX):
        return f"{name} must be a CasADi SX column, got {type(value).__name__}"
    if value.shape != (rows, 1):
        return f"{name} must have shape {(rows, 1)}, got {value.shape}"
    allowed_hashes = {symbol.element_hash() for symbol in ca.symvar(ca.vertcat(*symbols))}
    others = [x.name() for x in ca.symvar(value) if x.element_hash() not in allowed_hashes]
    if others:
        return f"{name} must not depend on {', '.join(others[:3])}"
    return ""
