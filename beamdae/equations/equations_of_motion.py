"""Equations of motion of a mechanism: F(t, q, v, a, p) + G^T lam = 0, g(t, q) = 0.

Immutable, and symbolic: every method takes and returns CasADi expressions. Formulations combine
them into residuals, `compiled` turns those into numpy functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, wraps
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.poles import LawOfPart
from beamdae.symbolic.sparse_sums import Block, gather, scatter
from beamdae.symbolic.statements import ConstraintKernel, ForceKernel, Named, RangeStatement

Array = np.ndarray
MX = ca.MX

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True)
class ForceTerm:
    """Copies of one force kernel on the global coordinates."""

    kernel: ForceKernel
    operator: sp.csr_array
    data: slice
    count: int


@dataclass(frozen=True)
class ConstraintTerm:
    """Copies of one constraint kernel on the global coordinates; `rows` picks their rows of g."""

    kernel: ConstraintKernel
    operator: sp.csr_array
    data: slice
    rows: sp.csr_array
    count: int


@dataclass(frozen=True)
class RangeTerm:
    """What tells how far a part's strains are to be trusted, on the global coordinates."""

    statement: RangeStatement
    operator: sp.csr_array

    def largest(self, q: Array) -> Array:
        """Largest (deflection over length, rotation [rad], strain) over rows of coordinates."""
        kernel, data = self.statement.kernel, self.statement.data
        copies = data.shape[1]
        local = np.asarray(self.operator @ q.T).T.reshape(len(q) * copies, kernel.local.size)
        found = kernel.function(local, np.tile(data.T, (len(q), 1)))
        return found.max(axis=0)


@dataclass(frozen=True)
class Observable:
    """Named columns with units, and the function that gives them."""

    name: str
    columns: tuple[Named, ...]
    function: ca.Function
    operator: sp.csr_array
    data: slice
    rows: slice

    @property
    def headers(self) -> list[str]:
        """CSV headers 'name.suffix [unit]'."""
        return [
            Named(".".join(filter(None, (self.name, column.name))), column.unit).header
            for column in self.columns
        ]


class PartCoordinates(NamedTuple):
    """Coordinates that move together.

    Attributes
    ----------
    name
        Of the part, or of the coordinate.
    rows
        Which coordinates.
    size
        How far from each other its points are [m]: an angle is worth the way it carries a point
        that far away.
    """

    name: str
    rows: slice
    size: float


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """F(t, q, v, a, p) + G^T lam = 0, g(t, q, p) = 0 with everything integrators ask of them.

    Attributes
    ----------
    coordinates, multipliers
        'part.coordinate' and unit of each coordinate and multiplier.
    q0, v0
        Start as drawn; `consistent_start.Starter` makes it consistent.
    p
        Numbers of the model: quadrature data, section, mass and load values.
    length
        Characteristic length of the mechanism [m], the scale of positions.
    parts
        Coordinates that move together.
    breakpoints
        Ascending times [s] at which a law changes its formula; integrators stop and restart there.
    time_scale
        Shortest time [s] over which a law changes, or None.
    scales
        How far each coordinate moves [its unit], (n,), where that is given; None: integrators
        find out.
    laws
        Those that change with time, with the parts that follow them.
    """

    coordinates: tuple[Named, ...]
    multipliers: tuple[Named, ...]
    q0: Array
    v0: Array
    p: Array
    length: float
    parts: tuple[PartCoordinates, ...]
    breakpoints: tuple[float, ...]
    time_scale: float | None
    observables: tuple[Observable, ...]
    forces: tuple[ForceTerm, ...] = field(repr=False)
    joints: tuple[ConstraintTerm, ...] = field(repr=False)
    scales: Array | None = None
    ranges: tuple[RangeTerm, ...] = field(default=(), repr=False)
    laws: tuple[LawOfPart, ...] = field(default=(), repr=False)
    _derived: dict[Any, Any] = field(default_factory=dict, init=False, repr=False)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def m(self) -> int:
        """Number of constraints."""
        return len(self.multipliers)

    @cached_property
    def q_names(self) -> tuple[str, ...]:
        """'part.coordinate' of each coordinate."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    @cached_property
    def lam_names(self) -> tuple[str, ...]:
        """'part.constraint' of each multiplier."""
        return tuple(multiplier.name for multiplier in self.multipliers)

    @cached_property
    def position_scales(self) -> Array:
        """Natural size of each coordinate: the characteristic length, or 1 for an angle."""
        angle = np.array([coordinate.unit == "rad" for coordinate in self.coordinates], bool)
        return np.where(angle, 1.0, self.length)

    # Symbolic pieces ------------------------------------------------------------------------

    def _inputs(
        self, term: ForceTerm | ConstraintTerm, time: MX, vectors: Sequence[MX], p: MX
    ) -> list[MX]:
        """(time, local vectors, data), a column a copy."""
        local = [gather(term.operator, x, term.count) for x in vectors]
        data = ca.reshape(p[term.data], term.kernel.local.n_data, term.count)
        return [time, *local, data]

    def _map(
        self, function: ca.Function, count: int, shared: Iterable[int], summed: Iterable[int] = ()
    ) -> Any:
        if count == 1:
            return function
        return function.map(function.name(), "serial", count, list(shared), list(summed))

    def force(self, time: MX, q: MX, v: MX, a: MX, p: MX) -> MX:
        """F(t, q, v, a, p), shape (n,)."""
        total = MX.zeros(self.n)
        for term in self.forces:
            function = self._map(term.kernel.force_function, term.count, [0])
            total += scatter(term.operator, function(*self._inputs(term, time, (q, v, a), p)))
        return total

    def tangent(
        self, time: MX, q: MX, v: MX, a: MX, p: MX, c_v: MX, c_a: MX
    ) -> tuple[list[Block], list[Block]]:
        """Blocks of dF/dq and of c_v dF/dv + c_a dF/da."""
        stiffness: list[Block] = []
        damping_and_mass: list[Block] = []
        for term in self.forces:
            function = self._map(term.kernel.tangent_function, term.count, [0, 5, 6])
            inputs = self._inputs(term, time, (q, v, a), p)
            blocks = function(*inputs, c_v, c_a)
            for target, values in zip((stiffness, damping_and_mass), blocks, strict=True):
                target.append(Block(values, term.operator, term.operator, term.count))
        return stiffness, damping_and_mass

    def level(self, order: int, time: MX, q: MX, v: MX, a: MX, p: MX) -> MX:
        """Constraints g (order 0), g_dot (1) or g_ddot (2) along the motion, shape (m,)."""
        total = MX.zeros(self.m)
        for t in self.joints:
            function = self._map(t.kernel.level_functions[order], t.count, [0])
            total += scatter(t.rows, function(*self._inputs(t, time, (q, v, a), p)))
        return total

    def _held(self, term: ConstraintTerm, lam: MX) -> MX:
        """Multipliers, a column a copy."""
        return gather(term.rows, lam, term.count)

    def reaction(self, time: MX, q: MX, p: MX, lam: MX) -> MX:
        """G^T lam, shape (n,)."""
        total = MX.zeros(self.n)
        for t in self.joints:
            function = self._map(t.kernel.reaction_function, t.count, [0])
            forces = function(*self._inputs(t, time, (q,), p), self._held(t, lam))
            total += scatter(t.operator, forces)
        return total

    def constraint_blocks(
        self, time: MX, q: MX, v: MX, p: MX, lam: MX
    ) -> tuple[list[Block], list[Block], list[Block]]:
        """Blocks of G, d g_dot/dq (m, n) and d(G^T lam)/dq (n, n)."""
        jacobian, rate, curvature = [], [], []
        for t in self.joints:
            function = self._map(t.kernel.matrices_function, t.count, [0])
            inputs = (*self._inputs(t, time, (q, v), p), self._held(t, lam))
            big_g, g_dot_q, reaction_q = function(*inputs)
            jacobian.append(Block(big_g, t.rows, t.operator, t.count))
            rate.append(Block(g_dot_q, t.rows, t.operator, t.count))
            curvature.append(Block(reaction_q, t.operator, t.operator, t.count))
        return jacobian, rate, curvature

    def observed(self, time: MX, q: MX, v: MX, p: MX, lam: MX) -> MX:
        """All observed columns, in the order of `observables`."""
        columns = [
            o.function(
                time, gather(o.operator, q, 1), gather(o.operator, v, 1), p[o.data], lam[o.rows]
            )
            for o in self.observables
        ]
        return ca.vertcat(*columns) if columns else MX.zeros(0)


def once(
    build: Callable[Concatenate[EquationsOfMotion, P], T],
) -> Callable[Concatenate[EquationsOfMotion, P], T]:
    """Decorate what is built from equations of motion: built once for the same ones, kept on them.

    What it gives has to be immutable: runs share it.
    """

    @wraps(build)
    def kept(equations: EquationsOfMotion, *args: P.args, **kwargs: P.kwargs) -> T:
        key = (build, args, tuple(sorted(kwargs.items())))
        if key not in equations._derived:
            equations._derived[key] = build(equations, *args, **kwargs)
        return equations._derived[key]

    return kept
