"""What acts on a beam, section by section: forces of parts, reactions of joints, inertia, weight.

A wrench is (Fx, Fy [N], M [N m]) in inertial components, M about the start of the beam.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.shape_functions import gauss_points
from beamdae.equations.assembly.coordinate_map import CoordinateMap, map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.results.section_forces.section_motions import (
    SectionFunction,
    evaluate_sections,
    section_jacobian,
    section_motion,
)
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.statements import ConstraintStatement, ForceStatement, Local

Array = np.ndarray

GRAVITY = "gravity"
ALL_LOADS: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class AppliedLoads:
    """What acts on a beam at rows of states.

    Attributes
    ----------
    lines
        Wrenches per element coordinate xi at the points at which inertia is integrated,
        (rows, elements, points, 3): loads per length, weight, and inertia with the other sign.
    places, wrenches
        Arc lengths (rows, k) [m] and wrenches (rows, k, 3) of what acts at sections.
    """

    lines: Array
    places: Array
    wrenches: Array


class _Said(NamedTuple):
    """A statement of a part, and the multipliers it depends on."""

    part: Part
    statement: ForceStatement | ConstraintStatement
    lam: slice


def collect_applied_loads(
    beam: Beam,
    equations: EquationsOfMotion,
    times: Array,
    state: State,
    factors: Mapping[str, float] = ALL_LOADS,
) -> AppliedLoads:
    """What acts on a beam of the mechanism that the equations are of.

    Parameters
    ----------
    times
        (t, branch) rows.
    state
        Rows of states.
    factors
        How much of what parts do acts, by name, and of "gravity"; all of it where it is not given.
    """
    mechanism = equations.mechanism
    assert mechanism is not None
    on = _OnBeam(beam, equations, map_coordinates(mechanism), times, state)
    weight = factors.get(GRAVITY, 1.0)
    gravity = weight * _gravity(mechanism, times)
    on.inertia(gravity)
    for said in _statements(mechanism, None if weight == 1.0 else gravity[0]):
        factor = factors.get(said.part.name, 1.0)
        if said.part is not beam and factor:
            on.add(said, factor)
    return on.found()


def _gravity(mechanism: Mechanism, times: Array) -> Array:
    laws = mechanism.gravity_laws
    if laws is None:
        return np.broadcast_to(mechanism.gravity, (len(times), 2))
    local = Local(0)
    along = ca.densify(ca.vertcat(*(law(local.time) for law in laws.laws)))
    return RowFunction(ca.Function("gravity", [local.time], [along]))(times)


def _statements(mechanism: Mechanism, gravity: Array | None) -> list[_Said]:
    """What all parts state, with the multipliers of each joint; under this gravity, if given."""
    parts, laws = list(mechanism.parts.values()), mechanism.gravity_laws
    if gravity is not None:
        laws = None
    else:
        gravity = mechanism.gravity
    found: list[_Said] = []
    rows: dict[str, slice] = {}
    first = 0
    for part in parts:
        for held in part.constraints():
            last = first + len(held.multipliers)
            found.append(_Said(part, held, slice(first, last)))
            rows[part.name] = slice(rows.get(part.name, slice(first, last)).start, last)
            first = last
    for part in parts:
        forces = part.forces(gravity) if laws is None else laws.statements(part.forces)
        for said in forces:
            asked = slice(0, 0) if said.joint is None else rows[said.joint]
            found.append(_Said(part, said, asked))
    return found


class _OnBeam:
    """Adds up what acts on one beam."""

    def __init__(
        self,
        beam: Beam,
        equations: EquationsOfMotion,
        owners: CoordinateMap,
        times: Array,
        state: State,
    ) -> None:
        self._beam, self._owners, self._times, self._state = beam, owners, times, state
        self._own = tuple(x[:, owners.slice(beam)] for x in state[:3])
        self._rows, mesh = len(times), beam.mesh
        self._lines = np.zeros((self._rows, mesh.elements, mesh.nodes, 3))
        self._places: list[Array] = []
        self._wrenches: list[Array] = []
        self._spread: dict[Part, list[tuple[float, Array]]] = {}
        self._functions: dict[int, RowFunction] = {}
        self._start = self._motions(self._sections(np.zeros(1)))[:, 0, :2]

    def _sections(self, places: Array) -> list[SectionFunction]:
        points = (self._beam.kinematics.material_point(s) for s in places.tolist())
        return [SectionFunction(point.operator, point.motion) for point in points]

    @cached_property
    def _axis(self) -> list[SectionFunction]:
        """Sections at which inertia is integrated."""
        mesh = self._beam.mesh
        places = mesh.gauss_arc_lengths(mesh.nodes).tolist()
        points = (self._beam.kinematics.axis_point(s) for s in places)
        return [SectionFunction(point.operator, point.motion) for point in points]

    def _motions(self, at: list[SectionFunction]) -> Array:
        """Rows of (x, y, turn) and accelerations of sections."""
        return evaluate_sections(section_motion, at, *self._own)

    def inertia(self, gravity: Array) -> None:
        """Add weight, and inertia with the other sign."""
        mesh = self._beam.mesh
        s, weights = mesh.gauss_arc_lengths(mesh.nodes), mesh.gauss(mesh.nodes)[0]
        xi_weights = np.tile(gauss_points(mesh.nodes)[1], mesh.elements)
        sections = [self._beam.section.at(x) for x in s.tolist()]
        rhoA, rhoI = (np.array([getattr(x, name) for x in sections]) for name in ("rhoA", "rhoI"))
        moved, ds = self._motions(self._axis), weights / xi_weights
        force = (rhoA * ds)[:, None] * (gravity[:, None] - moved[..., 3:5])
        wrench = self._about_start(moved[..., :2], force, -rhoI * ds * moved[..., 5])
        self._lines += wrench.reshape(self._lines.shape)

    def _about_start(self, place: Array, force: Array, moment: Array) -> Array:
        arm = place - self._start[:, None]
        turned = arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]
        return np.concatenate([force, (moment + turned)[..., None]], axis=-1)

    def add(self, said: _Said, factor: float) -> None:
        """Add what a statement does to the beam, or so much of it."""
        pieces = said.statement.pieces
        if not any(piece.owner is self._beam for piece in pieces):
            return
        count = said.statement.data.shape[1]
        sizes = [piece.operator.shape[0] // count for piece in pieces]
        forces = -factor * self._evaluated(said, count)
        for piece, last, size in zip(pieces, np.cumsum(sizes), sizes, strict=True):
            if piece.owner is not self._beam:
                continue
            own = forces[..., last - size : last]
            if piece.s is None:
                self._on_elements(own)
            else:
                s = np.clip(piece.s, 0.0, self._beam.length)
                self._at_section(said.part, float(s), own.sum(axis=1))

    def _evaluated(self, said: _Said, count: int) -> Array:
        """Forces on the local coordinates, on the left-hand side, (rows, count, size)."""
        statement, (q, v, a, lam) = said.statement, self._state
        rows = self._rows
        multipliers = np.repeat(lam[:, said.lam], count, axis=0)
        data = np.tile(statement.data.T, (rows, 1))
        if isinstance(statement, ConstraintStatement):
            made = statement.kernel.residual_kernel((), False)
            given = [self._local(statement, q, count), multipliers, data]
        else:
            made = statement.kernel.force_kernel
            moved = [self._local(statement, x, count) for x in (q, v, a)]
            given = [*moved, multipliers, data]
        if id(made) not in self._functions:
            self._functions[id(made)] = RowFunction(made.function)
        local = np.concatenate(given, axis=1)
        found = self._functions[id(made)](np.repeat(self._times, count, axis=0), local)
        return found.reshape(rows, count, -1)

    def _local(self, statement: Any, x: Array, count: int) -> Array:
        found = []
        for piece in statement.pieces:
            own = (piece.operator @ x[:, self._owners.slice(piece.owner)].T).T
            found.append(own.reshape(self._rows * count, -1))
        return np.concatenate(found, axis=1)

    def _at_section(self, part: Part, s: float, force: Array) -> None:
        """Add a force on the local coordinates of a section."""
        wrench = self._wrenches_at(self._sections(np.array([s])), force)[:, 0]
        if part.load_distribution == "points":
            self._places.append(np.full(self._rows, s))
            self._wrenches.append(wrench)
        else:
            self._spread.setdefault(part, []).append((s, wrench))

    def _wrenches_at(self, at: list[SectionFunction], force: Array) -> Array:
        """Wrenches at so many sections that together are a force on local coordinates."""
        motion = self._motions(at)
        size, count = at[0].operator.shape[0], len(at)
        jacobians = evaluate_sections(section_jacobian, at, *self._own)
        rows = np.swapaxes(jacobians.reshape(self._rows, count, size, 3), 2, 3)
        stacked = rows.reshape(self._rows, 3 * count, size)
        work = stacked @ force[..., None]
        loads = np.linalg.solve(stacked @ np.swapaxes(stacked, 1, 2), work)
        loads = loads.reshape(self._rows, count, 3)
        return self._about_start(motion[..., :2], loads[..., :2], loads[..., 2])

    def _on_elements(self, forces: Array) -> None:
        """Add a force on the coordinates of each element, as one per length all along it."""
        mesh = self._beam.mesh
        for element in range(mesh.elements):
            at = self._axis[element * mesh.nodes :][: mesh.nodes]
            wrench = self._wrenches_at(at, forces[:, element]).sum(axis=1)
            self._lines[:, element] += 0.5 * wrench[:, None]

    def found(self) -> AppliedLoads:
        """All of it."""
        mesh = self._beam.mesh
        weights = gauss_points(mesh.nodes)[1]
        for part, stated in self._spread.items():
            wrenches = np.stack([wrench for _, wrench in stated], axis=1)
            if part.load_distribution == "line":
                self._lines += wrenches.reshape(self._lines.shape) / weights[:, None]
            else:
                self._places.append(_center(np.array([s for s, _ in stated]), wrenches))
                self._wrenches.append(wrenches.sum(axis=1))
        none = np.zeros((self._rows, 0))
        return AppliedLoads(
            self._lines,
            np.stack(self._places, axis=1) if self._places else none,
            np.stack(self._wrenches, axis=1) if self._places else np.zeros((self._rows, 0, 3)),
        )


def _center(places: Array, wrenches: Array) -> Array:
    """Where the shares of a force have their center; at the first place where there is none."""
    force = wrenches[..., :2]
    along = np.einsum("rkc,rc->rk", force, force.sum(axis=1))
    size = along.sum(axis=1)
    center = along @ places / np.where(size > 0.0, size, 1.0)
    return np.where(size > 0.0, center, places[0])
