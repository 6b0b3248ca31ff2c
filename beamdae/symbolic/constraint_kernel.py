"""Holonomic and nonholonomic constraints of one statement and the kernels derived from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca

from beamdae.symbolic.local_symbols import SX, Local, describe_column_error
from beamdae.symbolic.sums.kernel_sums import Kernel

# Level of constraints whose equation is replaced by mu = 0.
NO_LEVEL = -1


@dataclass(frozen=True)
class ConstraintKernel:
    """Holonomic constraints 0 = g(time, q, data) of one joint.

    Attributes
    ----------
    local
        Symbols of the coordinates, multipliers and data.
    constraint
        g, shape (n_multipliers,).
    reused
        True if statements share the kernel unchanged; see `kernel_groups` for other kernels.
    """

    local: Local
    constraint: SX
    reused: bool = False
    _kernels: dict[Any, Kernel] = field(default_factory=dict, init=False, repr=False)

    @property
    def inputs(self) -> list[SX]:
        """Symbols on which the constraints may depend: (time, q, data)."""
        return [self.local.time, self.local.q, self.local.data]

    @property
    def outputs(self) -> list[SX]:
        """List that contains the column of constraints."""
        return [self.constraint]

    @property
    def size(self) -> int:
        """Number of constraints of one copy."""
        return self.constraint.shape[0]

    @cached_property
    def expression_error(self) -> str:
        """Error message about the expression; '' if it is valid."""
        return describe_column_error(
            "constraint", self.constraint, self.local.n_multipliers, *self.inputs
        )

    @cached_property
    def has_branches(self) -> bool:
        """True if the constraints depend on the branch of a law."""
        return ca.depends_on(self.constraint, self.local.time[1])

    @cached_property
    def has_time(self) -> bool:
        """True if the constraints depend on time."""
        return self.has_branches or ca.depends_on(self.constraint, self.local.time[0])

    @property
    def is_holonomic(self) -> bool:
        """True if the constraints are imposed on positions, False if on velocities only."""
        return True

    @property
    def is_scleronomic(self) -> bool:
        """True for holonomic constraints that do not depend on time: they permit rest."""
        return self.is_holonomic and not self.has_time

    def effective_levels(
        self, levels: tuple[int, ...], stabilized: bool
    ) -> tuple[tuple[int, ...], bool]:
        """Return the levels that replace `levels`, and True if the term G^T mu corrects q'.

        For holonomic constraints, both arguments are returned unchanged.
        """
        return levels, stabilized

    @cached_property
    def _jacobian(self) -> SX:
        return ca.jacobian(self.constraint, self.local.q)

    @cached_property
    def _g(self) -> SX:
        return self.constraint

    @cached_property
    def _g_dot(self) -> SX:
        return self.local.dot(self.constraint)

    @cached_property
    def _g_dot_at_rest(self) -> SX:
        return self.local.partial_t(self.constraint)

    def _reaction_stiffness(self, multipliers: SX) -> SX:
        """Return d(G^T multipliers)/dq; the Hessian needs half the operations of a Jacobian."""
        return ca.hessian(ca.dot(multipliers, self.constraint), self.local.q)[0]

    def _stack_inputs(self, levels: tuple[int, ...], mu: SX) -> SX:
        """Return (q, v, a, lam, mu, data), without v and a unless a level needs them."""
        x = self.local
        v, a = x.v if max(levels, default=0) > 0 else SX(0, 1), x.a if 2 in levels else SX(0, 1)
        return ca.vertcat(x.q, v, a, x.lam, mu, x.data)

    def _cache_kernel(
        self,
        build: Callable[[tuple[int, ...], bool], Kernel],
        levels: tuple[int, ...],
        stabilized: bool,
    ) -> Kernel:
        key = (build.__name__, levels, stabilized)
        if key not in self._kernels:
            self._kernels[key] = build(levels, stabilized)
        return self._kernels[key]

    def _mu(self, levels: tuple[int, ...], stabilized: bool) -> SX:
        has_mu = stabilized or NO_LEVEL in levels
        return SX.sym("mu", self.local.n_multipliers if has_mu else 0)

    def residual_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        """Return the kernel of G^T lam, G^T mu (if `stabilized`) and the constraints at `levels`.

        The inputs are (t, branch) and (q, v, a, lam, mu, data), with v only for levels 1 and 2, a
        only for level 2, and mu only if `stabilized` or for `NO_LEVEL`. The constraint of level 0
        is g, that of level 1 g_dot, that of level 2 g_ddot and that of `NO_LEVEL` mu.
        """
        return self._cache_kernel(self._build_residual_kernel, levels, stabilized)

    def _build_residual_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        x, mu = self.local, self._mu(levels, stabilized)
        reactions = [self._jacobian.T @ y for y in ([x.lam, mu] if stabilized else [x.lam])]
        by_level = {NO_LEVEL: mu, 0: self._g, 1: self._g_dot}
        if 2 in levels:
            by_level[2] = x.rate(self._g_dot)
        outputs = [ca.densify(o) for o in (*reactions, *(by_level[k] for k in levels))]
        return Kernel.of("joint", x.time, self._stack_inputs(levels, mu), outputs)

    def matrices_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        """Return the kernel of the Jacobian blocks of `residual_kernel`.

        The shared inputs are `MATRIX_SHARED`. The outputs are G, c_l G and d(G^T lam)/dq, followed
        by d(G^T mu)/dq if `stabilized`; c_h d g_dot/dq for level 1; d g_ddot/dq, d g_ddot/dv and
        c_a G for level 2; the identity and c_l times the identity for `NO_LEVEL`.
        """
        return self._cache_kernel(self._build_matrices_kernel, levels, stabilized)

    def _build_matrices_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        x, mu = self.local, self._mu(levels, stabilized)
        shared, c = x.matrix_inputs()
        outputs = [self._jacobian, c.c_l * self._jacobian]
        outputs += [self._reaction_stiffness(y) for y in ([x.lam, mu] if stabilized else [x.lam])]
        if 1 in levels:
            outputs.append(c.c_h * ca.jacobian(self._g_dot, x.q))
        if 2 in levels:
            g_ddot = x.rate(self._g_dot)
            outputs += [ca.jacobian(g_ddot, x.q), ca.jacobian(g_ddot, x.v), c.c_a * self._jacobian]
        if NO_LEVEL in levels:
            outputs += [SX.eye(x.n_multipliers), c.c_l * SX.eye(x.n_multipliers)]
        return Kernel.of("joint", shared, self._stack_inputs(levels, mu), outputs)

    @cached_property
    def balance_kernel(self) -> Kernel:
        """Kernel of G^T lam, g, g_dot, and the power lam^T g_dot at v = 0.

        The inputs are (t, branch) and (q, v, lam, data).
        """
        x = self.local
        power = ca.dot(self._g_dot_at_rest, x.lam)
        outputs = [self._jacobian.T @ x.lam, self._g, self._g_dot, power]
        local = ca.vertcat(x.q, x.v, x.lam, x.data)
        return Kernel.of("balance", x.time, local, [ca.densify(o) for o in outputs])


@dataclass(frozen=True)
class NonholonomicKernel(ConstraintKernel):
    """Constraints 0 = A(time, q, data) v + b(time, q, data) of one joint, imposed on velocities.

    They are nonholonomic, or integrable but not imposed on positions. A v + b replaces g_dot, A
    replaces G, and g is zero. Formulations that impose g = 0 but not g_dot = 0 impose A v + b = 0
    instead; formulations that impose both impose only A v + b = 0, without a correction of
    positions.

    Attributes
    ----------
    constraint
        A v + b, shape (n_multipliers,).
    """

    is_holonomic = False

    @property
    def inputs(self) -> list[SX]:
        """Symbols on which the constraints may depend: (time, q, v, data)."""
        x = self.local
        return [x.time, x.q, x.v, x.data]

    @cached_property
    def expression_error(self) -> str:
        """Error message about the expression; '' if it is valid."""
        x = self.local
        error = describe_column_error("constraint", self.constraint, x.n_multipliers, *self.inputs)
        if not error and not ca.is_linear(self.constraint, x.v):
            return "the nonholonomic constraint must be linear in the velocities"
        return error

    def effective_levels(
        self, levels: tuple[int, ...], stabilized: bool
    ) -> tuple[tuple[int, ...], bool]:
        """Return the levels that replace `levels`, and False, because q' excludes G^T mu.

        If `stabilized`, level 1 takes the place of level 0, whose rows belong to the multipliers
        lam: elimination with diagonal pivots needs each constraint in the row of its multiplier.
        """
        others = {0: NO_LEVEL if 1 in levels else 1}
        instead = {0: 1, 1: NO_LEVEL} if stabilized else others
        return tuple(instead.get(level, level) for level in levels), False

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
    def _g_dot_at_rest(self) -> SX:
        return ca.substitute(self.constraint, self.local.v, 0)

    def _reaction_stiffness(self, multipliers: SX) -> SX:
        return ca.jacobian(self._jacobian.T @ multipliers, self.local.q)
