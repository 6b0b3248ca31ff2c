"""Loads along a beam: forces of other parts, joint reactions, inertia and weight.

A wrench is (Fx [N], Fy [N], M [N m]) in inertial components, with M about the start of the beam.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.shape_functions import gauss_points
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, PartStatements, State
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.results.section_forces.section_motions import (
    SectionFunction,
    evaluate_sections,
    section_jacobian,
    section_motion,
)
from beamdae.symbolic.functions.compiled import RowFunction
from beamdae.symbolic.statements import ConstraintStatement, ForceStatement, Local

Array = np.ndarray

GRAVITY = "gravity"  # name of gravity among the loads
ALL_LOADS: Mapping[str, float] = MappingProxyType({})  # all load factors have the default 1


@dataclass(frozen=True)
class AppliedLoads:
    """Loads on a beam at several states.

    Attributes
    ----------
    line_loads
        Wrenches per unit of the element coordinate xi at the inertia points, (rows, elements,
        points, 3): distributed loads, weight and d'Alembert forces.
    arc_lengths, wrenches
        Arc lengths (rows, k) [m] and wrenches (rows, k, 3) of concentrated loads.
    """

    line_loads: Array
    arc_lengths: Array
    wrenches: Array


def collect_applied_loads(
    beam: Beam,
    equations: EquationsOfMotion,
    times: Array,
    state: State,
    factors: Mapping[str, float] = ALL_LOADS,
) -> AppliedLoads:
    """Collect all loads on a beam.

    Parameters
    ----------
    beam
        The beam.
    equations
        Equations of motion of the mechanism.
    times
        Rows (t, branch), (rows, 2).
    state
        States at these times, one row per time.
    factors
        Load factors by part name, and of gravity by the name "gravity". Missing factors are 1.
    """
    mechanism = equations.mechanism
    assert mechanism is not None
    collector = _LoadCollector(beam, mechanism, times, state)
    gravity_factor = factors.get(GRAVITY, 1.0)
    gravity = gravity_factor * _evaluate_gravity(mechanism, times)
    collector.add_inertia_and_weight(gravity)
    constant_gravity = None if gravity_factor == 1.0 else gravity[0]
    for statement in _list_statements(equations.statements, constant_gravity):
        factor = factors.get(statement.part.name, 1.0)
        if statement.part is not beam and factor:
            collector.add_statement(statement, factor)
    return collector.collect()


def _evaluate_gravity(mechanism: Mechanism, times: Array) -> Array:
    """Return the gravitational acceleration (rows, 2) [m/s^2] at rows (t, branch)."""
    laws = mechanism.gravity_laws
    if laws is None:
        return np.broadcast_to(mechanism.gravity, (len(times), 2))
    local = Local(0)
    acceleration = ca.densify(ca.vertcat(*(law(local.time) for law in laws.laws)))
    return RowFunction(ca.Function("gravity", [local.time], [acceleration]))(times)


class _PartStatement(NamedTuple):
    """A statement of a part, and the slice of the multipliers on which the statement depends."""

    part: Part
    statement: ForceStatement | ConstraintStatement
    lam: slice


def _list_statements(
    of_parts: Sequence[PartStatements], gravity: Array | None
) -> list[_PartStatement]:
    """List the statements of all parts.

    If `gravity` [m/s^2] is None, the formulas are those of the run, even if objects to which laws
    refer have changed since. Otherwise, the forces are stated again with this gravity.
    """
    statements: list[_PartStatement] = []
    multipliers: dict[str, slice] = {}
    first = 0
    for part, constraints, _ in of_parts:
        for constraint in constraints:
            last = first + len(constraint.multipliers)
            statements.append(_PartStatement(part, constraint, slice(first, last)))
            start = multipliers.get(part.name, slice(first, last)).start
            multipliers[part.name] = slice(start, last)
            first = last
    for part, _, forces in of_parts:
        for force in forces if gravity is None else part.forces(gravity):
            lam = slice(0, 0) if force.joint is None else multipliers[force.joint]
            statements.append(_PartStatement(part, force, lam))
    return statements


class _LoadCollector:
    def __init__(self, beam: Beam, mechanism: Mechanism, times: Array, state: State) -> None:
        self._beam, self._times, self._state = beam, times, state
        self._coordinates = map_coordinates(mechanism)
        rows_of_beam = self._coordinates.slice_of(beam)
        self._beam_state = tuple(x[:, rows_of_beam] for x in state[:3])
        self._rows, mesh = len(times), beam.mesh
        self._line_loads = np.zeros((self._rows, mesh.elements, mesh.nodes, 3))
        self._arc_lengths: list[Array] = []
        self._wrenches: list[Array] = []
        # Loads of parts that act on several sections: (arc length, wrench) by part.
        self._distributed: dict[Part, list[tuple[float, Array]]] = {}
        self._functions: dict[int, RowFunction] = {}
        self._start = self._evaluate_motion(self._sections_at(np.zeros(1)))[:, 0, :2]

    def add_inertia_and_weight(self, gravity: Array) -> None:
        mesh = self._beam.mesh
        s, weights = mesh.gauss_arc_lengths(mesh.nodes), mesh.gauss(mesh.nodes)[0]
        xi_weights = np.tile(gauss_points(mesh.nodes)[1], mesh.elements)
        sections = [self._beam.section.at(x) for x in s.tolist()]
        rhoA, rhoI = (np.array([getattr(x, name) for x in sections]) for name in ("rhoA", "rhoI"))
        motion, ds = self._evaluate_motion(self._inertia_sections), weights / xi_weights
        force = (rhoA * ds)[:, None] * (gravity[:, None] - motion[..., 3:5])
        wrench = self._move_to_start(motion[..., :2], force, -rhoI * ds * motion[..., 5])
        self._line_loads += wrench.reshape(self._line_loads.shape)

    def add_statement(self, entry: _PartStatement, factor: float) -> None:
        """Add the forces that a statement exerts on the beam, multiplied by a load factor."""
        pieces = entry.statement.pieces
        if not any(piece.owner is self._beam for piece in pieces):
            return
        count = entry.statement.data.shape[1]
        sizes = [piece.operator.shape[0] // count for piece in pieces]
        forces = -factor * self._evaluate_statement(entry, count)
        for piece, last, size in zip(pieces, np.cumsum(sizes), sizes, strict=True):
            force = forces[..., last - size : last]
            # Laws that read sensors have no force on the coordinates that these measure.
            if piece.owner is not self._beam or not force.any():
                continue
            if piece.s is None:
                self._add_to_elements(force)
            else:
                s = np.clip(piece.s, 0.0, self._beam.length)
                self._add_at_section(entry.part, float(s), force.sum(axis=1))

    def collect(self) -> AppliedLoads:
        weights = gauss_points(self._beam.mesh.nodes)[1]
        for part, loads in self._distributed.items():
            wrenches = np.stack([wrench for _, wrench in loads], axis=1)
            if part.load_distribution == "line":
                self._line_loads += wrenches.reshape(self._line_loads.shape) / weights[:, None]
            else:
                s = np.array([s for s, _ in loads])
                self._arc_lengths.append(_center_of_force(s, wrenches))
                self._wrenches.append(wrenches.sum(axis=1))
        if not self._wrenches:
            no_arc_lengths, no_wrenches = np.zeros((self._rows, 0)), np.zeros((self._rows, 0, 3))
            return AppliedLoads(self._line_loads, no_arc_lengths, no_wrenches)
        arc_lengths, wrenches = (np.stack(x, axis=1) for x in (self._arc_lengths, self._wrenches))
        return AppliedLoads(self._line_loads, arc_lengths, wrenches)

    @cached_property
    def _inertia_sections(self) -> list[SectionFunction]:
        mesh = self._beam.mesh
        s = mesh.gauss_arc_lengths(mesh.nodes).tolist()
        points = (self._beam.kinematics.axis_point(x) for x in s)
        return [SectionFunction(point.operator, point.motion) for point in points]

    def _sections_at(self, s: Array) -> list[SectionFunction]:
        points = (self._beam.kinematics.material_point(x) for x in s.tolist())
        return [SectionFunction(point.operator, point.motion) for point in points]

    def _evaluate_motion(self, at: list[SectionFunction]) -> Array:
        """Return x, y, rotation and their second time derivatives, (rows, sections, 6)."""
        return evaluate_sections(section_motion, at, *self._beam_state)

    def _move_to_start(self, position: Array, force: Array, moment: Array) -> Array:
        """Return wrenches about the start of the beam, given forces and moments at positions."""
        arm = position - self._start[:, None]
        transport = arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]
        return np.concatenate([force, (moment + transport)[..., None]], axis=-1)

    def _evaluate_statement(self, entry: _PartStatement, count: int) -> Array:
        """Return the forces of a statement in local coordinates, (rows, count, size).

        The forces have the sign of terms on the left-hand side of the equations of motion.
        """
        statement, (q, v, a, lam) = entry.statement, self._state
        multipliers = np.repeat(lam[:, entry.lam], count, axis=0)
        data = np.tile(statement.data.T, (self._rows, 1))
        if isinstance(statement, ConstraintStatement):
            kernel = statement.kernel.residual_kernel((), False)
            inputs = [self._select_local(statement, q, count), multipliers, data]
        else:
            kernel = statement.kernel.force_kernel
            motion = [self._select_local(statement, x, count) for x in (q, v, a)]
            inputs = [*motion, multipliers, data]
        if id(kernel) not in self._functions:
            self._functions[id(kernel)] = RowFunction(kernel.function)
        times = np.repeat(self._times, count, axis=0)
        forces = self._functions[id(kernel)](times, np.concatenate(inputs, axis=1))
        return forces.reshape(self._rows, count, -1)

    def _select_local(self, statement: Any, x: Array, count: int) -> Array:
        """Return the local coordinates (rows * count, size) of a statement."""
        columns = []
        for piece in statement.pieces:
            local = (piece.operator @ x[:, self._coordinates.slice_of(piece.owner)].T).T
            columns.append(local.reshape(self._rows * count, -1))
        return np.concatenate(columns, axis=1)

    def _add_at_section(self, part: Part, s: float, force: Array) -> None:
        """Add a generalized force on the local coordinates of the section at arc length `s` [m]."""
        wrench = self._equivalent_wrenches(self._sections_at(np.array([s])), force)[:, 0]
        if part.load_distribution == "points":
            self._arc_lengths.append(np.full(self._rows, s))
            self._wrenches.append(wrench)
        else:
            self._distributed.setdefault(part, []).append((s, wrench))

    def _add_to_elements(self, forces: Array) -> None:
        """Add generalized forces on each element as a uniform load along the element."""
        mesh = self._beam.mesh
        for element in range(mesh.elements):
            at = self._inertia_sections[element * mesh.nodes :][: mesh.nodes]
            wrench = self._equivalent_wrenches(at, forces[:, element]).sum(axis=1)
            self._line_loads[:, element] += 0.5 * wrench[:, None]

    def _equivalent_wrenches(self, at: list[SectionFunction], force: Array) -> Array:
        """Return wrenches at sections that do the same virtual work as a generalized force.

        With too few sections to reproduce the virtual work exactly, the wrenches are the
        least-squares solution.
        """
        motion = self._evaluate_motion(at)
        size, count = at[0].operator.shape[0], len(at)
        jacobians = evaluate_sections(section_jacobian, at, *self._beam_state)
        rows = np.swapaxes(jacobians.reshape(self._rows, count, size, 3), 2, 3)
        stacked = rows.reshape(self._rows, 3 * count, size)
        work = stacked @ force[..., None]
        loads = np.linalg.solve(stacked @ np.swapaxes(stacked, 1, 2), work)
        loads = loads.reshape(self._rows, count, 3)
        return self._move_to_start(motion[..., :2], loads[..., :2], loads[..., 2])


def _center_of_force(s: Array, wrenches: Array) -> Array:
    """Return the arc length [m] of the center of the forces, or `s[0]` if the forces cancel."""
    force = wrenches[..., :2]
    along = np.einsum("rkc,rc->rk", force, force.sum(axis=1))
    total = along.sum(axis=1)
    center = along @ s / np.where(total > 0.0, total, 1.0)
    return np.where(total > 0.0, center, s[0])
