"""Equations of motion of a mechanism: F(t, q, v, a, p) + G^T lam = 0, g(t, q) = 0.

Immutable, and symbolic: every method takes and returns CasADi expressions. Formulations combine
them into residuals, `compiled` turns those into numpy functions.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.assembly import Block, gather, scatter
from beamdae.errors import BeamdaeError
from beamdae.laws import Law
from beamdae.mechanism import Mechanism
from beamdae.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    ForceKernel,
    ForceStatement,
    Local,
    Piece,
    Quantity,
)

Array = np.ndarray
MX = ca.MX


@dataclass(frozen=True)
class _ForceTerm:
    kernel: ForceKernel
    operator: sp.csr_array
    data: slice
    count: int


@dataclass(frozen=True)
class _ConstraintTerm:
    kernel: ConstraintKernel
    operator: sp.csr_array
    data: slice
    rows: slice


@dataclass(frozen=True)
class Observable:
    """Named columns with units, and the function that gives them."""

    name: str
    columns: tuple[tuple[str, str], ...]
    function: ca.Function
    operator: sp.csr_array
    data: slice
    rows: slice

    @property
    def headers(self) -> list[str]:
        """CSV headers 'name.suffix [unit]'."""
        dotted = [".".join(filter(None, (self.name, suffix))) for suffix, _ in self.columns]
        return [f"{name} [{unit}]" for name, (_, unit) in zip(dotted, self.columns, strict=True)]


@dataclass(frozen=True)
class EquationsOfMotion:
    """F(t, q, v, a, p) + G^T lam = 0, g(t, q, p) = 0 with everything integrators ask of them.

    Attributes
    ----------
    q_names, lam_names
        'part.coordinate' of each coordinate and constraint.
    q0, v0
        Start as drawn; `initial.consistent_start` makes it consistent.
    p
        Numbers of the model: quadrature data, section, mass and load values.
    length
        Characteristic length of the mechanism [m], the scale of positions.
    laws
        Laws of time of drivers and loads.
    """

    q_names: tuple[str, ...]
    lam_names: tuple[str, ...]
    q0: Array
    v0: Array
    p: Array
    length: float
    laws: tuple[Law, ...]
    observables: tuple[Observable, ...]
    forces: tuple[_ForceTerm, ...] = field(repr=False)
    joints: tuple[_ConstraintTerm, ...] = field(repr=False)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.q_names)

    @property
    def m(self) -> int:
        """Number of constraints."""
        return len(self.lam_names)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Ascending times at which a law changes its formula."""
        return tuple(sorted({b for law in self.laws for b in law.breakpoints}))

    @property
    def time_scale(self) -> float | None:
        """Shortest time over which a law changes, or None."""
        scales = [law.time_scale for law in self.laws if law.time_scale is not None]
        return min(scales) if scales else None

    @cached_property
    def position_scales(self) -> Array:
        """Natural size of each coordinate: the characteristic length, or 1 for an angle."""
        angle = np.array([_is_angle(name) for name in self.q_names], bool)
        return np.where(angle, 1.0, self.length)

    # Symbolic pieces ------------------------------------------------------------------------

    def _force_inputs(self, term: _ForceTerm, time: MX, vectors: Sequence[MX], p: MX) -> list[MX]:
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
            total += scatter(term.operator, function(*self._force_inputs(term, time, (q, v, a), p)))
        return total

    def tangent(
        self, time: MX, q: MX, v: MX, a: MX, p: MX, c_v: MX, c_a: MX
    ) -> tuple[list[Block], list[Block]]:
        """Blocks of dF/dq and of c_v dF/dv + c_a dF/da."""
        stiffness: list[Block] = []
        rates: list[Block] = []
        for term in self.forces:
            function = self._map(term.kernel.tangent_function, term.count, [0, 5, 6])
            inputs = self._force_inputs(term, time, (q, v, a), p)
            blocks = function(*inputs, c_v, c_a)
            for target, values in zip((stiffness, rates), blocks, strict=True):
                target.append(Block(values, term.operator, term.operator, term.count))
        return stiffness, rates

    def energies(self, time: MX, q: MX, v: MX, p: MX) -> MX:
        """(kinetic, strain, gravity energy [J], power of the loads, dissipated power [W])."""
        total = MX.zeros(5)
        for term in self.forces:
            function = self._map(term.kernel.energy_function, term.count, [0], [0])
            total += function(*self._force_inputs(term, time, (q, v), p))
        return total

    def _joint_vectors(self, term: _ConstraintTerm, *vectors: MX) -> list[MX]:
        return [gather(term.operator, x, 1) for x in vectors]

    def level(self, order: int, time: MX, q: MX, v: MX, a: MX, p: MX) -> MX:
        """Constraints g (order 0), g_dot (1) or g_ddot (2) along the motion, shape (m,)."""
        rows = [
            t.kernel.level_functions[order](time, *self._joint_vectors(t, q, v, a), p[t.data])
            for t in self.joints
        ]
        return ca.vertcat(*rows) if rows else MX.zeros(0)

    def reaction(self, time: MX, q: MX, p: MX, lam: MX) -> MX:
        """G^T lam, shape (n,)."""
        total = MX.zeros(self.n)
        for t in self.joints:
            (local,) = self._joint_vectors(t, q)
            total += scatter(
                t.operator, t.kernel.reaction_function(time, local, p[t.data], lam[t.rows])
            )
        return total

    def driver_power(self, time: MX, q: MX, p: MX, lam: MX) -> MX:
        """Power of the drivers on the mechanism, lam . dg/dt [W]."""
        total = MX(0)
        for t in self.joints:
            (local,) = self._joint_vectors(t, q)
            total += t.kernel.power_function(time, local, p[t.data], lam[t.rows])
        return total

    def constraint_blocks(
        self, time: MX, q: MX, v: MX, p: MX, lam: MX
    ) -> tuple[list[Block], list[Block], list[Block]]:
        """Blocks of G, d g_dot/dq (m, n) and d(G^T lam)/dq (n, n)."""
        jacobian, rate, curvature = [], [], []
        for t in self.joints:
            inputs = (time, *self._joint_vectors(t, q, v), p[t.data], lam[t.rows])
            big_g, g_dot_q, reaction_q = t.kernel.matrices_function(*inputs)
            rows = self._rows(t)
            jacobian.append(Block(big_g, rows, t.operator, 1))
            rate.append(Block(g_dot_q, rows, t.operator, 1))
            curvature.append(Block(reaction_q, t.operator, t.operator, 1))
        return jacobian, rate, curvature

    def acceleration_blocks(
        self, time: MX, q: MX, v: MX, a: MX, p: MX
    ) -> tuple[list[Block], list[Block]]:
        """Blocks of d g_ddot/dq and d g_ddot/dv, (m, n) each."""
        by_q: list[Block] = []
        by_v: list[Block] = []
        for t in self.joints:
            inputs = (time, *self._joint_vectors(t, q, v, a), p[t.data])
            for target, values in zip(
                (by_q, by_v), t.kernel.acceleration_function(*inputs), strict=True
            ):
                target.append(Block(values, self._rows(t), t.operator, 1))
        return by_q, by_v

    def _rows(self, term: _ConstraintTerm) -> sp.csr_array:
        return sp.csr_array(sp.eye_array(self.m, format="csr")[term.rows])

    def observed(self, time: MX, q: MX, v: MX, p: MX, lam: MX) -> MX:
        """All observed columns, in the order of `observables`."""
        columns = [
            o.function(
                time, gather(o.operator, q, 1), gather(o.operator, v, 1), p[o.data], lam[o.rows]
            )
            for o in self.observables
        ]
        return ca.vertcat(*columns) if columns else MX.zeros(0)


def _is_angle(name: str) -> bool:
    coordinate = name.rsplit(".", 1)[-1]
    return coordinate in ("angle", "theta") or coordinate.startswith("phi")


def equations_of_motion(mechanism: Mechanism) -> EquationsOfMotion:
    """Equations of motion of a mechanism: the sum of what its parts state."""
    bodies = [p for p in mechanism.parts.values() if hasattr(p, "coordinate_names")]
    start = np.cumsum([0, *(len(b.coordinate_names) for b in bodies)])
    if start[-1] == 0:
        raise BeamdaeError("Mechanism: it needs at least one body that can move.")
    offsets = {id(b): int(s) for b, s in zip(bodies, start[:-1], strict=True)}
    forces = [
        statement
        for part in mechanism.parts.values()
        if hasattr(part, "force_statements")
        for statement in part.force_statements(mechanism.gravity)
    ]
    constraints = [joint.constraint_statement() for joint in mechanism.joints]
    return build(
        q_names=tuple(f"{b.name}.{c}" for b in bodies for c in b.coordinate_names),
        q0=np.concatenate([b.initial_position for b in bodies]),
        v0=np.concatenate([b.initial_velocity for b in bodies]),
        length=_size(mechanism),
        laws=tuple(mechanism.laws),
        forces=forces,
        constraints=constraints,
        observables=mechanism.observables,
        offsets=offsets,
    )


def _size(mechanism: Mechanism) -> float:
    """Largest extent of the drawing: bodies and the points they are joined at."""
    outlines = [p.outline for p in mechanism.parts.values() if hasattr(p, "outline")]
    points = [[a.point for a in (j.a, j.b)] for j in mechanism.joints]
    everything = np.concatenate([*outlines, *(np.reshape(p, (-1, 2)) for p in points)])
    extent = float(np.max(np.ptp(everything, axis=0)))
    return extent if extent > 0.0 else 1.0


def build(
    *,
    q_names: tuple[str, ...],
    q0: Array,
    v0: Array,
    length: float,
    laws: tuple[Law, ...],
    forces: list[ForceStatement],
    constraints: list[ConstraintStatement],
    observables: dict[str, Quantity],
    offsets: dict[int, int],
) -> EquationsOfMotion:
    """Resolve statements on bodies to terms in the global coordinates."""
    n = len(q_names)
    data: list[Array] = []

    def store(values: Array) -> slice:
        begin = sum(len(d) for d in data)
        data.append(np.asarray(values, float).ravel(order="F"))
        return slice(begin, begin + len(data[-1]))

    force_terms = [
        _ForceTerm(
            s[0].kernel,
            _stack([_globally(x, n, offsets) for x in s]),
            store(_joined(s)),
            sum(x.count for x in s),
        )
        for s in _by_kernel(forces)
    ]
    constraint_terms: list[_ConstraintTerm] = []
    lam_names: list[str] = []
    rows: dict[str, slice] = {}
    for statement in constraints:
        begin = len(lam_names)
        lam_names += [f"{statement.part}.{name}" for name in statement.names]
        rows[statement.part] = slice(begin, len(lam_names))
        operator = _globally(statement, n, offsets)
        constraint_terms.append(
            _ConstraintTerm(statement.kernel, operator, store(statement.data), rows[statement.part])
        )
    resolved = []
    for name, quantity in observables.items():
        operator = _globally(quantity, n, offsets)
        lam_rows = rows[quantity.joint] if quantity.joint else slice(0, 0)
        function = _quantity_function(quantity, operator.shape[0], lam_rows.stop - lam_rows.start)
        resolved.append(
            Observable(name, quantity.columns, function, operator, store(quantity.data), lam_rows)
        )
    return EquationsOfMotion(
        q_names=q_names,
        lam_names=tuple(lam_names),
        q0=q0,
        v0=v0,
        p=np.concatenate(data) if data else np.zeros(0),
        length=length,
        laws=laws,
        observables=tuple(resolved),
        forces=tuple(force_terms),
        joints=tuple(constraint_terms),
    )


def _by_kernel(statements: list[ForceStatement]) -> list[list[ForceStatement]]:
    """Statements that share a kernel, together: they are evaluated in one map."""
    groups: dict[int, list[ForceStatement]] = {}
    for statement in statements:
        groups.setdefault(id(statement.kernel), []).append(statement)
    return list(groups.values())


def _joined(statements: list[ForceStatement]) -> Array:
    return np.concatenate([s.data for s in statements], axis=1)


def _stack(operators: list[sp.csr_array]) -> sp.csr_array:
    return operators[0] if len(operators) == 1 else sp.csr_array(sp.vstack(operators))


def _globally(statement: Any, n: int, offsets: dict[int, int]) -> sp.csr_array:
    """The pieces' operators on the global coordinates, one above the other."""
    return _stack(
        [_shifted(piece, n, offsets) for piece in statement.pieces] or [sp.csr_array((0, n))]
    )


def _shifted(piece: Piece, n: int, offsets: dict[int, int]) -> sp.csr_array:
    operator = sp.csr_array(piece.operator)
    offset = offsets.get(id(piece.owner), 0)
    parts = (operator.data, operator.indices + offset, operator.indptr)
    return sp.csr_array(parts, shape=(operator.shape[0], n))


def _quantity_function(quantity: Quantity, size: int, n_multipliers: int) -> ca.Function:
    local = Local(size, len(quantity.data), n_multipliers)
    value = ca.densify(SX(quantity.expression(local)))
    if value.shape != (len(quantity.columns), 1):
        raise BeamdaeError(
            f"a quantity must give one value for each of {quantity.columns}, "
            f"got shape {value.shape}."
        )
    return ca.Function("observed", [local.time, local.q, local.v, local.data, local.lam], [value])
