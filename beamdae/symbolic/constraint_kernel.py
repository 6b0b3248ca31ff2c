"""Holonomic constraints of one statement, and what is derived from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca

from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.kernel_sums import Kernel
from beamdae.symbolic.local_symbols import SX, Local, column_misfit

# In place of the level of a constraint that has none: mu = 0.
UNHELD = -1


@dataclass(frozen=True)
class ConstraintKernel:
    """Holonomic constraints 0 = g(time, q, data) of one joint and everything derived from them.

    Attributes
    ----------
    local
        Symbols.
    constraint
        g, shape (n_multipliers,).
    reused
        Whether many statements share the kernel as it is.
    """

    local: Local
    constraint: SX
    reused: bool = False
    _kernels: dict[Any, Kernel] = field(default_factory=dict, init=False, repr=False)

    @property
    def inputs(self) -> list[SX]:
        """(time, q, data), what it may depend on."""
        return [self.local.time, self.local.q, self.local.data]

    @property
    def outputs(self) -> list[SX]:
        """The constraints alone."""
        return [self.constraint]

    @classmethod
    def stated(cls, local: Local, outputs: list[SX]) -> ConstraintKernel:
        """The kernel of these `outputs`."""
        (constraint,) = outputs
        return cls(local, constraint)

    @property
    def size(self) -> int:
        """Number of constraints."""
        return self.constraint.shape[0]

    @cached_property
    def misfit(self) -> str:
        """What is wrong with its expression, a phrase, or nothing."""
        x = self.local
        return column_misfit("constraint", self.constraint, x.n_multipliers, x.time, x.q, x.data)

    @cached_property
    def has_branches(self) -> bool:
        """Whether it follows a law of several pieces."""
        return ca.depends_on(self.constraint, self.local.time[1])

    @property
    def holonomic(self) -> bool:
        """Whether it holds positions, not velocities alone."""
        return True

    def asked(self, levels: tuple[int, ...], stabilized: bool) -> tuple[tuple[int, ...], bool]:
        """The levels it has in place of these, and whether it has G^T mu; see `UNHELD`."""
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
    def _driven(self) -> SX:
        """What of g_dot is there at rest."""
        return ca.jtimes(self.constraint, self.local.time, SX([1, 0]))

    def _reaction_q(self, held: SX) -> SX:
        """d(G^T held)/dq, of half as many operations as the Jacobian of G^T held."""
        return ca.hessian(ca.dot(held, self.constraint), self.local.q)[0]

    def _local(self, levels: tuple[int, ...], mu: SX) -> SX:
        """(q, v, a, lam, mu, data), of v and a what the levels ask for."""
        x = self.local
        v, a = x.v if max(levels, default=0) > 0 else SX(0, 1), x.a if 2 in levels else SX(0, 1)
        return ca.vertcat(x.q, v, a, x.lam, mu, x.data)

    def _kept(
        self,
        make: Callable[[tuple[int, ...], bool], Kernel],
        levels: tuple[int, ...],
        stabilized: bool,
    ) -> Kernel:
        key = (make.__name__, levels, stabilized)
        if key not in self._kernels:
            self._kernels[key] = make(levels, stabilized)
        return self._kernels[key]

    def _mu(self, levels: tuple[int, ...], stabilized: bool) -> SX:
        held = stabilized or UNHELD in levels
        return SX.sym("mu", self.local.n_multipliers if held else 0)

    def residual_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        """Shared (t, branch), local (q, v, a, lam, mu, data) -> G^T lam, G^T mu, levels.

        Of the levels g (0), g_dot (1) and g_ddot (2) those that are named; v goes in with level 1
        or 2, a with level 2, mu and G^T mu if `stabilized`. The level `UNHELD` is mu itself.
        """
        return self._kept(self._residual_kernel, levels, stabilized)

    def _residual_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        x, mu = self.local, self._mu(levels, stabilized)
        reactions = [self._jacobian.T @ held for held in ([x.lam, mu] if stabilized else [x.lam])]
        stated = {UNHELD: mu, 0: self._g, 1: self._g_dot}
        if 2 in levels:
            stated[2] = x.rate(self._g_dot)
        outputs = [ca.densify(o) for o in (*reactions, *(stated[k] for k in levels))]
        return Kernel.of("joint", x.time, self._local(levels, mu), outputs)

    def matrices_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        """Shared `MATRIX_SHARED` -> matrices of `residual_kernel`, local as there.

        G, c_l G, d(G^T lam)/dq, if `stabilized` d(G^T mu)/dq, with level 1 c_h d g_dot/dq, with
        level 2 d g_ddot/dq, d g_ddot/dv and c_a G, with `UNHELD` 1 and c_l on the diagonal.
        """
        return self._kept(self._matrices_kernel, levels, stabilized)

    def _matrices_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        x, mu, c = self.local, self._mu(levels, stabilized), self.local.factors()
        outputs = [self._jacobian, c[3] * self._jacobian]
        outputs += [self._reaction_q(held) for held in ([x.lam, mu] if stabilized else [x.lam])]
        if 1 in levels:
            outputs.append(c[4] * ca.jacobian(self._g_dot, x.q))
        if 2 in levels:
            g_ddot = x.rate(self._g_dot)
            outputs += [ca.jacobian(g_ddot, x.q), ca.jacobian(g_ddot, x.v), c[2] * self._jacobian]
        if UNHELD in levels:
            outputs += [SX.eye(x.n_multipliers), c[3] * SX.eye(x.n_multipliers)]
        return Kernel.of("joint", ca.vertcat(x.time, c), self._local(levels, mu), outputs)

    @property
    def gradient_pattern(self) -> ca.Sparsity:
        """Pattern of dg/dq."""
        return self._jacobian.sparsity()

    @cached_property
    def gradients(self) -> RowFunction:
        """Rows of (time, q, data) -> rows of the non-zeros of dg/dq."""
        nonzeros = ca.densify(ca.vec(self._jacobian.nz[:]))
        x = self.local
        return RowFunction(ca.Function("gradients", [x.time, x.q, x.data], [nonzeros]))

    @cached_property
    def balance_kernel(self) -> Kernel:
        """Shared (t, branch), local (q, v, lam, data) -> G^T lam, g, g_dot, power of a driver."""
        x = self.local
        power = ca.dot(self._driven, x.lam)
        outputs = [self._jacobian.T @ x.lam, self._g, self._g_dot, power]
        local = ca.vertcat(x.q, x.v, x.lam, x.data)
        return Kernel.of("balance", x.time, local, [ca.densify(o) for o in outputs])
