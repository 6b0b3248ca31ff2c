"""Loads along a beam: forces of other parts, joint reactions, inertia and weight.

A wrench is (Fx [N], Fy [N], M [N m]) in inertial components, with M about the start of the beam.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

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
    position_and_angle,
    section_jacobian,
)
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.statements import ConstraintStatement, ForceKernel, ForceStatement, Local
from beamdae.symbolic.sums.kernel_sums import Kernel

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
    gravity: Array = np.broadcast_to(mechanism.gravity, (len(times), 2))  # [m/s^2]
    if mechanism.gravity_laws is not None:
        local = Local(0)
        laws = (law(local.time) for law in mechanism.gravity_laws.laws)
        function = ca.Function("gravity", [local.time], [ca.densify(ca.vertcat(*laws))])
        gravity = RowFunction(function)(times)
    gravity = gravity_factor * gravity
    collector.add_inertia_and_weight(gravity)
    constant_gravity = None if gravity_factor == 1.0 else gravity[0]
    for statement in _list_statements(equations.statements, constant_gravity):
        factor = factors.get(statement.part.name, 1.0)
        if statement.part is not beam and statement.part.load_distribution != "none" and factor:
            collector.add_statement(statement, factor)
    return collector.collect()


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
        self._rows = len(times)
        # Generalized forces on elements, along their axes (True) and along the curve (False).
        shape = (self._rows, beam.mesh.elements, beam.kinematics.element.size)
        self._element_forces = {on_axis: np.zeros(shape) for on_axis in (True, False)}
        self._arc_lengths: list[Array] = []
        self._wrenches: list[Array] = []
        # Shares of the loads of parts: (arc length, wrench) by part.
        self._shares: dict[Part, list[tuple[float, Array]]] = {}
        self._functions: dict[int, RowFunction] = {}
        self._start = self._evaluate_motion(self._sections_at(np.zeros(1)))[:, 0, :2]

    def add_inertia_and_weight(self, gravity: Array) -> None:
        """Add the forces of inertia and weight, for gravity (rows, 2) [m/s^2]."""
        (statement,) = self._beam.forces(np.zeros(2))
        entry = _PartStatement(self._beam, statement, slice(0, 0))
        forces = self._evaluate_statement(entry, gravity)
        self._element_forces[True] -= forces.reshape(self._element_forces[True].shape)

    def add_statement(self, entry: _PartStatement, factor: float) -> None:
        """Add the forces that a statement exerts on the beam, multiplied by a load factor."""
        pieces = entry.statement.pieces
        if not any(piece.owner is self._beam for piece in pieces):
            return
        forces = -factor * self._evaluate_statement(entry)
        ends = np.cumsum([piece.operator.shape[0] for piece in pieces])
        element, size = 0, self._beam.kinematics.element.size
        for piece, force in zip(pieces, np.split(forces, ends[:-1], axis=1), strict=True):
            # Laws that read sensors have no force on the coordinates that these measure.
            if piece.owner is not self._beam or not force.any():
                continue
            if piece.s is None:
                copies = force.reshape(self._rows, -1, size)
                on_axis = entry.part.load_distribution != "line"
                self._element_forces[on_axis][:, element : element + copies.shape[1]] += copies
                element += copies.shape[1]
            else:
                s = np.clip(piece.s, 0.0, self._beam.length)
                self._add_at_section(entry.part, float(s), force)

    def collect(self) -> AppliedLoads:
        mesh = self._beam.mesh
        line_loads = np.zeros((self._rows, mesh.elements, mesh.nodes, 3))
        for on_axis, forces in self._element_forces.items():
            if forces.any():
                line_loads += self._locate_forces(forces, on_axis)
        for loads in self._shares.values():
            s, wrenches = np.array([s for s, _ in loads]), np.stack([x for _, x in loads], axis=1)
            # The center of the forces, or the first section if they cancel.
            along = np.einsum("rkc,rc->rk", wrenches[..., :2], wrenches[..., :2].sum(axis=1))
            total = along.sum(axis=1)
            center = along @ s / np.where(total > 0.0, total, 1.0)
            self._arc_lengths.append(np.where(total > 0.0, center, s[0]))
            self._wrenches.append(wrenches.sum(axis=1))
        if not self._wrenches:
            no_arc_lengths, no_wrenches = np.zeros((self._rows, 0)), np.zeros((self._rows, 0, 3))
            return AppliedLoads(line_loads, no_arc_lengths, no_wrenches)
        arc_lengths, wrenches = (np.stack(x, axis=1) for x in (self._arc_lengths, self._wrenches))
        return AppliedLoads(line_loads, arc_lengths, wrenches)

    def _sections_at(self, s: Array) -> list[SectionFunction]:
        points = (self._beam.kinematics.material_point(x) for x in s.tolist())
        return [(point.operator, point.motion) for point in points]

    def _evaluate_motion(self, at: list[SectionFunction]) -> Array:
        """Return x, y and rotation, (rows, sections, 3)."""
        return evaluate_sections(position_and_angle, at, *self._beam_state)

    def _evaluate_statement(self, entry: _PartStatement, gravity: Array | None = None) -> Array:
        """Return the forces of a statement in the local coordinates of its pieces, (rows, n).

        The forces have the sign of terms on the left-hand side of the equations of motion.
        `gravity` (rows, 2) replaces that of the data of elements.
        """
        statement, (q, v, a, lam) = entry.statement, self._state
        count = statement.data.shape[1]
        multipliers = np.repeat(lam[:, entry.lam], count, axis=0)
        data = np.tile(statement.data.T, (self._rows, 1))
        if gravity is not None:
            data[:, -2:] = np.repeat(gravity, count, axis=0)
        motion = [q] if isinstance(statement, ConstraintStatement) else [q, v, a]
        # Local coordinates (rows * count, size) of the statement.
        local = (
            np.concatenate(
                [
                    (piece.operator @ x[:, self._coordinates.slice_of(piece.owner)].T).T
                    for piece in statement.pieces
                ],
                axis=1,
            ).reshape(self._rows * count, -1)
            for x in motion
        )
        inputs = [*local, multipliers, data]
        # Statements keep their kernels, so that Python does not reuse their ids.
        key = id(statement.kernel)
        if key not in self._functions:
            self._functions[key] = RowFunction(self._load_kernel(statement).function)
        times = np.repeat(self._times, count, axis=0)
        forces = self._functions[key](times, np.concatenate(inputs, axis=1))
        return forces.reshape(self._rows, -1)

    def _load_kernel(self, statement: ForceStatement | ConstraintStatement) -> Kernel:
        if isinstance(statement, ConstraintStatement):
            return statement.kernel.residual_kernel((), False)
        kernel, nodes = statement.kernel, self._beam.mesh.nodes
        if len(kernel.points) > nodes:
            # The points beyond the inertia points have section forces.
            kernel = ForceKernel.of_points(kernel.local, kernel.points[:nodes])
        return kernel.force_kernel

    def _add_at_section(self, part: Part, s: float, force: Array) -> None:
        """Add a generalized force on the local coordinates of the section at arc length `s` [m]."""
        sections = self._sections_at(np.array([s]))
        wrench = self._equivalent_wrenches(sections, force[:, None])[:, 0, 0]
        if part.load_distribution == "points":
            self._arc_lengths.append(np.full(self._rows, s))
            self._wrenches.append(wrench)
        else:
            self._shares.setdefault(part, []).append((s, wrench))

    def _locate_forces(self, forces: Array, on_axis: bool) -> Array:
        """Return the wrenches per xi at the inertia points by generalized forces on each element.

        There are as many inertia points as nodes, so that one load at each does this virtual work.
        """
        mesh, kinematics = self._beam.mesh, self._beam.kinematics
        arc_lengths = mesh.gauss_arc_lengths(mesh.nodes).tolist()
        points = [kinematics.element_point(s, on_axis) for s in arc_lengths]
        sections = [(point.operator, point.motion) for point in points]
        return self._equivalent_wrenches(sections, forces) / gauss_points(mesh.nodes)[1][:, None]

    def _equivalent_wrenches(self, at: list[SectionFunction], forces: Array) -> Array:
        """Return wrenches at sections that do the same virtual work as generalized forces.

        If there is no exact solution, the wrenches are those of the least-squares solution.

        Parameters
        ----------
        at
            Sections, with the same number of them for each force.
        forces
            Generalized forces (rows, count, size).

        Returns
        -------
        ndarray
            Wrenches (rows, count, sections of each force, 3).
        """
        rows, count, size = forces.shape
        motion = self._evaluate_motion(at)
        jacobians = evaluate_sections(section_jacobian, at, *self._beam_state)
        stacked = jacobians.reshape(rows, count, -1, size, 3).swapaxes(3, 4)
        stacked = stacked.reshape(rows, count, -1, size)
        work = stacked @ forces[..., None]
        loads = np.linalg.solve(stacked @ stacked.swapaxes(2, 3), work).reshape(*motion.shape)
        # About the start of the beam.
        arm, force = motion[..., :2] - self._start[:, None], loads[..., :2]
        transport = arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]
        wrenches = np.concatenate([force, (loads[..., 2] + transport)[..., None]], axis=-1)
        return wrenches.reshape(rows, count, -1, 3)
