"""Nonholonomic constraints of one statement: they hold velocities, whatever the positions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from beamdae.symbolic.constraint_kernel import UNHELD, ConstraintKernel
from beamdae.symbolic.local_symbols import SX, column_misfit


@dataclass(frozen=True)
class NonholonomicKernel(ConstraintKernel):
    """Nonholonomic constraints 0 = A(time, q, data) v + b(time, q, data) of one joint.

    They stand for g_dot: G is A, and there is no g. Where a form of the equations holds positions
    alone they hold their velocities; where it holds both, nothing corrects positions for them.

    Attributes
    ----------
    constraint
        A v + b, shape (n_multipliers,).
    """

    @property
    def inputs(self) -> list[SX]:
        """(time, q, v, data), what it may depend on."""
        x = self.local
        return [x.time, x.q, x.v, x.data]

    @cached_property
    def misfit(self) -> str:
        """What is wrong with its expression, a phrase, or nothing."""
        x = self.local
        allowed = (x.time, x.q, x.v, x.data)
        found = column_misfit("constraint", self.constraint, x.n_multipliers, *allowed)
        if not found and not ca.is_linear(self.constraint, x.v):
            return "its nonholonomic constraint must be linear in the velocities"
        return found

    @property
    def holonomic(self) -> bool:
        """Whether it holds positions, not velocities alone."""
        return False

    def asked(self, levels: tuple[int, ...], stabilized: bool) -> tuple[tuple[int, ...], bool]:
        """The levels it has in place of these, and that it has no G^T mu."""
        instead = UNHELD if 1 in levels else 1
        return tuple(instead if level == 0 else level for level in levels), False

    @cached_property
    def _jacobian(self) -> SX:
        return ca.substitute(ca.jacobian(self.constraint, self.local.v), self.local.v, 0)

    @cached_property
    def _g(self) -> SX:
        return SX.zeros(self.constraint.shape)

    @cached_property
    def _g_dot(self) -> SX:
        return self.constraint

    @cached_property
    def _driven(self) -> SX:
        return ca.substitute(self.constraint, self.local.v, 0)

    def _reaction_q(self, held: SX) -> SX:
        return ca.jacobian(self._jacobian.T @ held, self.local.q)
