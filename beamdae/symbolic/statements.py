"""Local statements of mechanics: what one part says about a few coordinates.

A statement is a small symbolic kernel together with constant sparse operators that pick its local
coordinates from those of the bodies it concerns. The equations of motion of a mechanism are the
sum of the statements of its parts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.kernel_sums import Kernel

SX = ca.SX

# What the kernels of all matrices share: the time, and what their parts are multiplied by.
MATRIX_SHARED = ("t", "branch", "c_q", "c_v", "c_a", "c_l", "c_h")


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
        dot = self.dot(expression)
        moved = ca.jtimes(dot, self.q, self.v) + ca.jtimes(dot, self.v, self.a) if self.size else 0
        return moved + ca.jtimes(dot, self.time, SX([1, 0]))


class Named(NamedTuple):
    """A name and its unit: of a coordinate, a multiplier or an observed column."""

    name: str
    unit: str

    @property
    def header(self) -> str:
        """'name [unit]', as tables have it."""
        return f"{self.name} [{self.unit}]"

    @property
    def rate(self) -> Named:
        """Its rate of change."""
        return Named(f"{self.name}_dot", "1/s" if self.unit == "-" else f"{self.unit}/s")


class Piece(NamedTuple):
    """Rows of a constant operator on the coordinates of one owner (a body, or a joint's lam)."""

    owner: Any
    operator: sp.csr_array


def _misfit(name: str, value: Any, rows: int, *symbols: SX) -> str:
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


@dataclass(frozen=True)
class ForceKernel:
    """Virtual work of one statement: minus the generalized forces, F = M a - f.

    Attributes
    ----------
    local
        Symbols.
    force
        F(time, q, v, a, data), shape (size,): inertial, elastic, damping and gravity forces and
        loads on the left-hand side of F + G^T lam = 0.
    energies
        (kinetic, strain, gravity) [J].
    powers
        (power of the loads, dissipated power) [W].
    reused
        Whether many statements share the kernel, so that compiling it to machine code pays.
    """

    local: Local
    force: SX
    energies: SX = field(default_factory=lambda: SX.zeros(3))
    powers: SX = field(default_factory=lambda: SX.zeros(2))
    reused: bool = False

    @property
    def inputs(self) -> list[SX]:
        """(time, q, v, a, data), what it may depend on."""
        x = self.local
        return [x.time, x.q, x.v, x.a, x.data]

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
        motion = (x.time, x.q, x.v, x.data)
        return (
            _misfit("force", self.force, x.size, *motion, x.a)
            or _misfit("energies", self.energies, 3, *motion)
            or _misfit("powers", self.powers, 2, *motion)
        )

    @cached_property
    def has_branches(self) -> bool:
        """Whether it follows a law of several pieces."""
        return ca.depends_on(self.force, self.local.time[1])

    @cached_property
    def force_function(self) -> ca.Function:
        """(time, q, v, a, data) -> F."""
        return ca.Function("force", self.inputs, [ca.densify(self.force)])

    @cached_property
    def tangent_function(self) -> ca.Function:
        """(..., c_v, c_a) -> dF/dq and c_v dF/dv + c_a dF/da, (size, size) each, sparse."""
        x = self.local
        c_v, c_a, d = SX.sym("c_v"), SX.sym("c_a"), SX.sym("d", x.size)
        moved = ca.substitute(
            self.force, ca.vertcat(x.v, x.a), ca.vertcat(x.v + c_v * d, x.a + c_a * d)
        )
        damping_and_mass = ca.substitute(ca.jacobian(moved, d), d, SX.zeros(x.size))
        outputs = ca.cse([ca.jacobian(self.force, x.q), damping_and_mass])
        return ca.Function("tangent", [*self.inputs, c_v, c_a], outputs)

    @cached_property
    def force_kernel(self) -> Kernel:
        """Shared (t, branch), local (q, v, a, data) -> F."""
        x = self.local
        local = ca.vertcat(x.q, x.v, x.a, x.data)
        return Kernel.of("force", x.time, local, [ca.densify(self.force)])

    @cached_property
    def tangent_kernel(self) -> Kernel:
        """Shared `MATRIX_SHARED`, local as above -> c_q dF/dq, c_v dF/dv and c_a dF/da."""
        x, c = self.local, SX.sym("c", 5)
        outputs = [c[k] * ca.jacobian(self.force, held) for k, held in enumerate((x.q, x.v, x.a))]
        local = ca.vertcat(x.q, x.v, x.a, x.data)
        return Kernel.of("tangent", ca.vertcat(x.time, c), local, outputs)

    @cached_property
    def balance_kernel(self) -> Kernel:
        """Local (t, branch, q, v, a, data) -> F, F at a = 0, (energies, powers)."""
        x = self.local
        local = ca.vertcat(x.time, x.q, x.v, x.a, x.data)
        still = ca.substitute(self.force, x.a, SX.zeros(x.a.shape))
        outputs = [self.force, still, ca.vertcat(self.energies, self.powers)]
        return Kernel.of("balance", SX(0, 1), local, [ca.densify(o) for o in outputs])

    @cached_property
    def energy_function(self) -> ca.Function:
        """(time, q, v, data) -> (kinetic, strain, gravity, load power, dissipated power)."""
        x = self.local
        values = ca.densify(ca.vertcat(self.energies, self.powers))
        return ca.Function("energy", [x.time, x.q, x.v, x.data], [values])


@dataclass(frozen=True)
class ForceStatement:
    """`count` copies of one force kernel: `data` has one column a copy.

    Each piece's operator stacks the local rows of copy 0, copy 1, ... so that it has
    count * rows rows; the pieces of one copy follow each other in the local coordinates.
    """

    part: str
    kernel: ForceKernel
    pieces: tuple[Piece, ...]
    data: np.ndarray

    @property
    def count(self) -> int:
        """Number of copies."""
        return self.data.shape[1]


@dataclass(frozen=True)
class ConstraintKernel:
    """Holonomic constraints 0 = g(time, q, data) of one joint and everything derived from them."""

    local: Local
    constraint: SX
    _kernels: dict[Any, Kernel] = field(default_factory=dict, init=False, repr=False)
    reused: ClassVar[bool] = False

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
        return _misfit("constraint", self.constraint, x.n_multipliers, x.time, x.q, x.data)

    @cached_property
    def has_branches(self) -> bool:
        """Whether it follows a law of several pieces."""
        return ca.depends_on(self.constraint, self.local.time[1])

    @cached_property
    def _jacobian(self) -> SX:
        return ca.jacobian(self.constraint, self.local.q)

    @cached_property
    def _g_dot(self) -> SX:
        return self.local.dot(self.constraint)

    @cached_property
    def level_functions(self) -> tuple[ca.Function, ca.Function, ca.Function]:
        """g, g_dot and g_ddot as functions of their own, (time, q, v, a, data) each."""
        x = self.local
        levels = (self.constraint, self._g_dot, x.ddot(self.constraint))
        inputs = [x.time, x.q, x.v, x.a, x.data]
        g, g_dot, g_ddot = (ca.Function("level", inputs, [ca.densify(o)]) for o in levels)
        return g, g_dot, g_ddot

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

    def _mu(self, stabilized: bool) -> SX:
        return SX.sym("mu", self.local.n_multipliers if stabilized else 0)

    def residual_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        """Shared (t, branch), local (q, v, a, lam, mu, data) -> G^T lam, G^T mu, levels.

        Of the levels g (0), g_dot (1) and g_ddot (2) those that are named; v goes in with level 1
        or 2, a with level 2, mu and G^T mu if `stabilized`.
        """
        return self._kept(self._residual_kernel, levels, stabilized)

    def _residual_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        x, mu = self.local, self._mu(stabilized)
        reactions = [self._jacobian.T @ held for held in ([x.lam, mu] if stabilized else [x.lam])]
        stated = [self.constraint, self._g_dot]
        if 2 in levels:
            stated.append(x.ddot(self.constraint))
        outputs = [ca.densify(o) for o in (*reactions, *(stated[k] for k in levels))]
        return Kernel.of("joint", x.time, self._local(levels, mu), outputs)

    def matrices_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        """Shared `MATRIX_SHARED` -> matrices of `residual_kernel`, local as there.

        G, c_l G, d(G^T lam)/dq, if `stabilized` d(G^T mu)/dq, with level 1 c_h d g_dot/dq, with
        level 2 d g_ddot/dq, d g_ddot/dv and c_a G.
        """
        return self._kept(self._matrices_kernel, levels, stabilized)

    def _matrices_kernel(self, levels: tuple[int, ...], stabilized: bool) -> Kernel:
        x, mu, c = self.local, self._mu(stabilized), SX.sym("c", 5)
        outputs = [self._jacobian, c[3] * self._jacobian]
        outputs += [
            ca.jacobian(self._jacobian.T @ held, x.q)
            for held in ([x.lam, mu] if stabilized else [x.lam])
        ]
        if 1 in levels:
            outputs.append(c[4] * ca.jacobian(self._g_dot, x.q))
        if 2 in levels:
            g_ddot = x.ddot(self.constraint)
            outputs += [ca.jacobian(g_ddot, x.q), ca.jacobian(g_ddot, x.v), c[2] * self._jacobian]
        return Kernel.of("joint", ca.vertcat(x.time, c), self._local(levels, mu), outputs)

    @cached_property
    def reaction_function(self) -> ca.Function:
        """(time, q, data, lam) -> G^T lam, shape (size of q,)."""
        x = self.local
        return ca.Function(
            "reaction", [x.time, x.q, x.data, x.lam], [ca.densify(self._jacobian.T @ x.lam)]
        )

    @cached_property
    def matrices_function(self) -> ca.Function:
        """(time, q, v, data, lam) -> G, d g_dot/dq and d(G^T lam)/dq, sparse."""
        x = self.local
        outputs = [
            self._jacobian,
            ca.jacobian(self._g_dot, x.q),
            ca.jacobian(self._jacobian.T @ x.lam, x.q),
        ]
        return ca.Function("matrices", [x.time, x.q, x.v, x.data, x.lam], ca.cse(outputs))

    @cached_property
    def acceleration_function(self) -> ca.Function:
        """(time, q, v, a, data) -> d g_ddot/dq, d g_ddot/dv, sparse."""
        x = self.local
        level = x.ddot(self.constraint)
        outputs = [ca.jacobian(level, x.q), ca.jacobian(level, x.v)]
        return ca.Function("acceleration", [x.time, x.q, x.v, x.a, x.data], ca.cse(outputs))

    @cached_property
    def balance_kernel(self) -> Kernel:
        """Local (t, branch, q, v, lam, data) -> G^T lam, g, g_dot and the power of a driver."""
        x = self.local
        rate = ca.jtimes(self.constraint, x.time, SX([1, 0]))
        outputs = [self._jacobian.T @ x.lam, self.constraint, self._g_dot, ca.dot(rate, x.lam)]
        local = ca.vertcat(x.time, x.q, x.v, x.lam, x.data)
        return Kernel.of("balance", SX(0, 1), local, [ca.densify(o) for o in outputs])

    @cached_property
    def power_function(self) -> ca.Function:
        """(time, q, data, lam) -> lam . dg/dt, the power of a driver on the mechanism [W]."""
        x = self.local
        rate = ca.jtimes(self.constraint, x.time, SX([1, 0]))
        return ca.Function("power", [x.time, x.q, x.data, x.lam], [ca.densify(ca.dot(rate, x.lam))])


@dataclass(frozen=True)
class ConstraintStatement:
    """Constraints of one part; `multipliers` names what each row of g holds, in the unit of lam."""

    part: str
    kernel: ConstraintKernel
    pieces: tuple[Piece, ...]
    multipliers: tuple[Named, ...]
    data: np.ndarray = field(default_factory=lambda: np.zeros((0, 1)))


@dataclass(frozen=True)
class RangeKernel:
    """How far one copy of a statement has gone from where it holds.

    Attributes
    ----------
    local
        Symbols.
    values
        (deflection over length [-], rotation [rad], strain [-]) from local.q and local.data, all
        positive or zero.
    """

    local: Local
    values: SX

    # Rotations follow no law of time.
    has_branches = False

    @cached_property
    def misfit(self) -> str:
        """What is wrong with its expression, a phrase, or nothing."""
        return _misfit("values", self.values, 3, self.local.q, self.local.data)

    @cached_property
    def function(self) -> RowFunction:
        """Rows of (q, data) -> rows of `values`."""
        inputs = [self.local.q, self.local.data]
        return RowFunction(ca.Function("range", inputs, [ca.densify(self.values)]))


@dataclass(frozen=True)
class RangeStatement:
    """What of a part tells how far its strains are to be trusted.

    Pieces, copies and `data` as in `ForceStatement`.

    Attributes
    ----------
    error
        (a, b): at a rotation of r [rad] its deformation is off by a r + b r^2 of itself; None if
        its strains have no limit.
    remedies
        What helps besides cutting it into several bodies, as settings.
    """

    part: str
    kernel: RangeKernel
    pieces: tuple[Piece, ...]
    data: np.ndarray
    error: tuple[float, float] | None = None
    remedies: tuple[str, ...] = ()


@dataclass(frozen=True)
class Quantity:
    """Something observed: columns computed from a few coordinates, and perhaps multipliers.

    Attributes
    ----------
    columns
        What each value is; an empty name stands for the observable's own.
    pieces
        Where the local coordinates come from.
    expression
        local -> SX of shape (len(columns),).
    data
        Values of local.data, shape (n_data,).
    joint
        Name of the part whose multipliers are local.lam, or None.
    """

    columns: tuple[Named, ...]
    pieces: tuple[Piece, ...]
    expression: Callable[[Local], SX]
    data: np.ndarray = field(default_factory=lambda: np.zeros(0))
    joint: str | None = None
