"""Virtual work of one statement, and what is derived from it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca

from beamdae.symbolic.kernel_sums import Kernel
from beamdae.symbolic.local_symbols import SX, Local, column_misfit

# Which of stiffness (0), damping (1) and mass (2) are added up in each of the matrices.
Tangents = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class ForceKernel:
    """Virtual work of one statement: minus the generalized forces, F = M a - f.

    Attributes
    ----------
    local
        Symbols.
    force
        F(time, q, v, a, lam, data), shape (size,): inertial, elastic, damping and gravity forces
        and loads on the left-hand side of F + G^T lam = 0; lam those of a joint, as for friction.
    energies
        (kinetic, strain, gravity) [J].
    powers
        (power of the loads, dissipated power) [W].
    reused
        Whether many statements share the kernel as it is.
    """

    local: Local
    force: SX
    energies: SX = field(default_factory=lambda: SX.zeros(3))
    powers: SX = field(default_factory=lambda: SX.zeros(2))
    reused: bool = False
    _tangents: dict[Tangents, Kernel] = field(default_factory=dict, init=False, repr=False)

    @property
    def inputs(self) -> list[SX]:
        """(time, q, v, a, lam, data), what it may depend on."""
        x = self.local
        return [x.time, x.q, x.v, x.a, x.lam, x.data]

    @property
    def outputs(self) -> list[SX]:
        """(force, energies, powers)."""
        return [self.force, self.energies, self.powers]

    @classmethod
    def stated(cls, local: Local, outputs: list[SX]) -> ForceKernel:
        """The kernel of these `outputs`."""
        force, energies, powers = outputs
        return cls(local, force, energies, powers)

    @cached_property
    def misfit(self) -> str:
        """What is wrong with its expressions, a phrase, or nothing."""
        x = self.local
        motion = (x.time, x.q, x.v, x.lam, x.data)
        return (
            column_misfit("force", self.force, x.size, *motion, x.a)
            or column_misfit("energies", self.energies, 3, *motion)
            or column_misfit("powers", self.powers, 2, *motion)
        )

    @cached_property
    def has_branches(self) -> bool:
        """Whether it follows a law of several pieces."""
        return ca.depends_on(self.force, self.local.time[1])

    @cached_property
    def _stacked(self) -> SX:
        x = self.local
        return ca.vertcat(x.q, x.v, x.a, x.lam, x.data)

    @cached_property
    def force_kernel(self) -> Kernel:
        """Shared (t, branch), local (q, v, a, lam, data) -> F."""
        return Kernel.of("force", self.local.time, self._stacked, [ca.densify(self.force)])

    def tangent_kernel(self, sums: Tangents) -> Kernel:
        """Shared `MATRIX_SHARED`, local as above -> sums of c_q dF/dq, c_v dF/dv and c_a dF/da.

        If it depends on multipliers, dF/dlam and c_l dF/dlam come last.
        """
        if sums not in self._tangents:
            self._tangents[sums] = self._tangent_kernel(sums)
        return self._tangents[sums]

    def _tangent_kernel(self, sums: Tangents) -> Kernel:
        x, c = self.local, self.local.factors()
        parts = [c[k] * ca.jacobian(self.force, held) for k, held in enumerate((x.q, x.v, x.a))]
        outputs = [sum((parts[k] for k in of), start=SX(x.size, x.size)) for of in sums]
        if x.n_multipliers:
            by_lam = ca.jacobian(self.force, x.lam)
            outputs += [by_lam, c[3] * by_lam]
            outputs = ca.substitute(outputs, [x.lam], [c[5] * x.lam])
        return Kernel.of("tangent", ca.vertcat(x.time, c), self._stacked, outputs)

    @cached_property
    def balance_kernel(self) -> Kernel:
        """Shared (t, branch), local (q, v, a, lam, data) -> F, F at a = 0, (energies, powers)."""
        x = self.local
        still = ca.substitute(self.force, x.a, SX.zeros(x.a.shape))
        outputs = [self.force, still, ca.vertcat(self.energies, self.powers)]
        return Kernel.of("balance", x.time, self._stacked, [ca.densify(o) for o in outputs])
