"""Symbols of one local statement, and what its expressions may depend on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

SX = ca.SX

# What the kernels of all matrices share: the time, what their parts are multiplied by, and what
# the multipliers that go in are to be multiplied by to be those of the equations.
MATRIX_SHARED = ("t", "branch", "c_q", "c_v", "c_a", "c_l", "c_h", "c_r")


@dataclass(frozen=True)
class Local:
    """Symbols of one local statement.

    `time` is (t, branch): laws read their values at t and choose their piece by branch, a time
    inside the smooth interval under integration, so that an integrator can end a step exactly on a
    breakpoint.
    """

    size: int
    n_data: int = 0
    n_multipliers: int = 0

    @cached_property
    def time(self) -> SX:
        """(t, branch)."""
        return SX.sym("time", 2)

    @cached_property
    def q(self) -> SX:
        """Coordinates."""
        return SX.sym("q", self.size)

    @cached_property
    def v(self) -> SX:
        """Velocities."""
        return SX.sym("v", self.size)

    @cached_property
    def a(self) -> SX:
        """Accelerations."""
        return SX.sym("a", self.size)

    @cached_property
    def data(self) -> SX:
        """Numbers of the model."""
        return SX.sym("data", self.n_data)

    @cached_property
    def lam(self) -> SX:
        """Multipliers."""
        return SX.sym("lam", self.n_multipliers)

    def dot(self, expression: SX) -> SX:
        """Time derivative of an expression in t and q along the motion."""
        moved = ca.jtimes(expression, self.q, self.v) if self.size else 0
        return moved + ca.jtimes(expression, self.time, SX([1, 0]))

    def ddot(self, expression: SX) -> SX:
        """Second time derivative of an expression in t and q along the motion."""
        return self.rate(self.dot(expression))

    def rate(self, dot: SX) -> SX:
        """Time derivative of an expression in t, q and v along the motion."""
        moved = ca.jtimes(dot, self.q, self.v) + ca.jtimes(dot, self.v, self.a) if self.size else 0
        return moved + ca.jtimes(dot, self.time, SX([1, 0]))

    @staticmethod
    def factors() -> SX:
        """What `MATRIX_SHARED` has behind the time."""
        return SX.sym("c", len(MATRIX_SHARED) - 2)


def column_misfit(name: str, value: Any, rows: int, *symbols: SX) -> str:
    """What is wrong with an expression that has to be a column in these symbols, or nothing."""
    if not isinstance(value, SX):
        return f"its {name} must be a CasADi SX column, got {type(value).__name__}"
    if value.shape != (rows, 1):
        return f"its {name} must have shape {(rows, 1)}, got {value.shape}"
    allowed = {symbol.element_hash() for symbol in ca.symvar(ca.vertcat(*symbols))}
    others = [x.name() for x in ca.symvar(value) if x.element_hash() not in allowed]
    if others:
        return f"its {name} must not depend on {', '.join(others[:3])}"
    return ""
