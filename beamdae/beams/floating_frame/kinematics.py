"""The kinematics of Pan & Liu (2012): small strains relative to a floating frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from beamdae.beams.element_data import (
    assemble_element_data,
    assemble_point_data,
    compute_prestrains,
    is_damped,
    require_free_curve,
)
from beamdae.beams.floating_frame.element import FRAME_SIZE, NODE_SIZE, FloatingFrameElement
from beamdae.beams.floating_frame.formulas import (
    FloatingFrameDeformation,
    SectionMotion,
    frame_motion,
)
from beamdae.beams.floating_frame.strain_validity import range_kernel, strain_error_coefficients
from beamdae.beams.kinematics import Kinematics, MaterialPoint, PointValues, StrainValidity
from beamdae.beams.mesh import Mesh
from beamdae.beams.reference_frames import compute_frame_angle, has_chord, resolve_frame
from beamdae.beams.sections import Section, VaryingSection
from beamdae.beams.shape_functions import gauss_points, lagrange_weights, shape_functions
from beamdae.beams.strains import InterpolatedStrains
from beamdae.curves.plane_curves import PlaneCurve, rotate_points
from beamdae.errors import BeamdaeError, require_choice, set_fields
from beamdae.symbolic.formulas import Formula
from beamdae.symbolic.sparse_operators import select_rows
from beamdae.symbolic.statements import Named

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class FloatingFrame(Kinematics):
    """Displacements and section rotations relative to a frame that rides on the beam.

    Coordinates: (x0, y0, theta) of the frame and the free ones of (u, v, phi) at the nodes,
    displacements in the local tangent frame and section rotation relative to the undeformed one.
    `strain`, `continuity`, `quadrature`, `frame` and `free_curve` are explained at `Beam`.
    """

    name: str
    mesh: Mesh
    section: Section | VaryingSection
    strain: str = "green"
    continuity: str = "cartesian"
    quadrature: str = "reduced"
    frame: str | None = None
    free_curve: PlaneCurve | None = None
    _material_points: dict[float, MaterialPoint] = field(
        default_factory=dict, init=False, repr=False
    )

    def __post_init__(self) -> None:
        set_fields(self, frame=resolve_frame(self.name, self.mesh.curve, self.frame))
        require_choice(self.name, "strain", self.strain, ("nonlinear", "green", "linear", "exact"))
        require_choice(self.name, "continuity", self.continuity, ("cartesian", "local"))
        require_choice(self.name, "quadrature", self.quadrature, ("reduced", "full"))
        kinked = self.mesh.shape == "straight" or self.mesh.nodes == 2
        if kinked and self.continuity == "local":
            raise BeamdaeError(
                f"{self.name}: straight elements meet at kinks, continuity must be 'cartesian'."
            )
        _ = self.angle
        if self.free_curve is not None:
            require_free_curve(self.name, self.free_curve, self.mesh.curve)

    @cached_property
    def element(self) -> FloatingFrameElement:
        """The type of all elements."""
        nodes = self.mesh.nodes
        points = nodes if self.quadrature == "full" else nodes - 1
        return FloatingFrameElement(
            nodes,
            points,
            self.strain,
            is_damped(self.section, self.mesh, points),
            isinstance(self.section, VaryingSection),
            self.free_curve is not None,
        )

    @cached_property
    def origin(self) -> tuple[float, float]:
        """Reference position of the frame's origin, the start point [m]."""
        x, y = np.asarray(self.mesh.curve.point(0.0), float)
        return float(x), float(y)

    @cached_property
    def angle(self) -> float:
        """Reference angle of the frame [rad]."""
        return compute_frame_angle(self.name, self.mesh.curve, str(self.frame))

    @cached_property
    def mesh_in_frame(self) -> Mesh:
        """The mesh as the frame carries it."""
        return self.mesh.in_axes(self.origin, self.angle)

    @cached_property
    def coordinates(self) -> tuple[Named, ...]:
        """Frame, and free nodal coordinates."""
        frame = (Named("x0", "m"), Named("y0", "m"), Named("theta", "rad"))
        nodal = [
            Named(f"{name}{i}", unit)
            for i in range(self.mesh.node_count)
            for name, unit in (("u", "m"), ("v", "m"), ("phi", "rad"))
        ]
        if self.frame == "tangent":
            return (*frame, *nodal[NODE_SIZE:])
        return (*frame, *nodal[2:-3], Named("chord", "m"), nodal[-1])

    @property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing."""
        return self._undeformed([*self.origin, self.angle])

    def initial_velocity(self, velocity: tuple[float, float], angular_velocity: float) -> Array:
        """Rates of the frame, without any of the deformation."""
        return self._undeformed([*velocity, angular_velocity])

    def _undeformed(self, frame: list[float]) -> Array:
        return np.concatenate([frame, np.zeros(len(self.coordinates) - FRAME_SIZE)])

    @cached_property
    def operator(self) -> sp.csr_array:
        """From the beam's coordinates to those of all elements, shape (elements * size, n).

        Nodal coordinates are (u, v, phi) in the tangent frame of the curve at the node. The axes of
        two neighboring elements meet at a small angle, of the order of the cube of their length (of
        their length for straight ones): with "cartesian" continuity each turns the nodal
        displacement into its own direction there, with "local" continuity it is taken over as it
        is.
        """
        mesh, kind = self.mesh_in_frame, self.element
        element = np.repeat(np.arange(mesh.elements), kind.nodes)
        local = np.tile(np.arange(kind.nodes), mesh.elements)
        node = mesh.element_nodes.ravel()
        turn = self._kink(element, node)
        row = element * kind.size + FRAME_SIZE + NODE_SIZE * local
        c, s = np.cos(turn), np.sin(turn)
        entries = [(0, 0, c), (0, 1, s), (1, 0, -s), (1, 1, c), (2, 2, np.ones_like(c))]
        into, share = self._free
        column = [NODE_SIZE * node + j for _, j, _ in entries]
        size = mesh.elements * kind.size
        in_frame = np.arange(size).reshape(-1, kind.size)[:, :FRAME_SIZE].ravel()
        rows = np.concatenate([in_frame, *(row + i for i, _, _ in entries)])
        columns = np.concatenate([in_frame % kind.size, *(into[j] for j in column)])
        turns = [value * share[j] for j, (_, _, value) in zip(column, entries, strict=True)]
        values = np.concatenate([np.ones(len(in_frame)), *turns])
        shape = (size, len(self.coordinates))
        operator = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=shape))
        operator.eliminate_zeros()
        return operator

    def _kink(self, element: Array, node: Array) -> Array:
        """Angle from the curve's tangent at a node to the element's own axis there."""
        if self.continuity == "local":
            return np.zeros(len(element))
        mesh = self.mesh_in_frame
        xi = np.tile(np.linspace(-1.0, 1.0, mesh.nodes), mesh.elements)
        return mesh.axis(element, xi).angle - mesh.tangent_angle(mesh.node_arc_lengths[node])

    @property
    def _free(self) -> tuple[Array, Array]:
        """Which coordinate moves each of those of all nodes, and how much: the frame's conditions.

        What the frame holds moves by nothing.
        """
        size, free = NODE_SIZE * self.mesh.node_count, len(self.coordinates)
        held = NODE_SIZE if self.frame == "tangent" else 2
        into, share = np.maximum(np.arange(size) - held, 0) + FRAME_SIZE, np.ones(size)
        share[:held] = 0.0
        if self.frame == "chord":
            angle = float(self.mesh_in_frame.tangent_angle(self.mesh.curve.length))
            share[-3:-1] = np.cos(angle), -np.sin(angle)
            into[-3:-1], into[-1] = free - 2, free - 1
        return into, share

    @cached_property
    def _points(self) -> Array:
        mesh, layout = self.mesh_in_frame, self.element.layout
        weight, at = mesh.gauss(layout.mass_points)
        mass = [weight, *rotate_points(at.place, -at.angle).T, np.cos(at.angle), np.sin(at.angle)]
        weight, at = mesh.gauss(layout.stiffness_points)
        s = mesh.gauss_arc_lengths(layout.stiffness_points)
        drawn = compute_prestrains(mesh.curve, self.free_curve, s)
        stiffness = [weight, at.curvature, 1.0 / at.ds, *drawn]
        return assemble_point_data(mesh, layout, self.section, mass, stiffness)

    def data(self, gravity: Array) -> Array:
        """Numbers of the elements under `gravity` (2,), shape (n_data, elements)."""
        return assemble_element_data(self._points, self.section, gravity)

    def _located(self, s: float) -> tuple[int, Array, float]:
        """The element at s, its shape functions there, and the angle of its axis in the frame."""
        element, xi = self.mesh.locate(s)
        row = shape_functions(self.mesh.nodes, np.array([xi]))[0]
        angle = float(self.mesh_in_frame.axis(np.array([element]), np.array([xi])).angle[0])
        return element, row, angle

    def _rows_of(self, element: int, nodes: Array | None = None) -> sp.csr_array:
        """Rows of the operator of an element: of the frame, and of these nodes or of all."""
        size = self.element.size
        rows = np.arange(size)
        if nodes is not None:
            own = FRAME_SIZE + NODE_SIZE * nodes[:, None] + np.arange(NODE_SIZE)
            rows = np.concatenate([rows[:FRAME_SIZE], own.ravel()])
        return select_rows(self.operator, rows + element * size)

    def material_point(self, s: float) -> MaterialPoint:
        """The section at arc length s [m], with the coordinates of the nodes it depends on."""
        # Ends are asked for by whatever is joined to them, observed or drawn.
        if s not in self._material_points:
            drawn = np.asarray(self.mesh.curve.point(s), float)
            self._material_points[s] = self._section(s, drawn)
        return self._material_points[s]

    def axis_point(self, s: float) -> MaterialPoint:
        """The section on the interpolated axis."""
        element, xi = self.mesh.locate(s)
        return self._section(s, self.mesh.axis(np.array([element]), np.array([xi])).place[0])

    def _section(self, s: float, drawn: Array) -> MaterialPoint:
        element, row, angle = self._located(s)
        nodes = np.flatnonzero(np.abs(row) > 1e-12)
        mesh_in_frame = rotate_points(drawn - np.asarray(self.origin), -self.angle)
        numbers = [*mesh_in_frame, math.cos(angle), math.sin(angle), self.angle, *row[nodes]]
        return MaterialPoint(
            (float(drawn[0]), float(drawn[1])),
            angle + self.angle,
            self._rows_of(element, nodes),
            Formula(SectionMotion(len(nodes)), tuple(map(float, numbers))),
        )

    @property
    def strain_validity(self) -> StrainValidity:
        """How far it bends, and how far its strains reach."""
        curve = self.mesh.curve
        data = self.data(np.zeros(2))
        lengths = np.full((1, self.mesh.elements), curve.length)
        turning = float(np.ptp(curve.tangent_angle(np.linspace(0.0, curve.length, 65))))
        # Measured: the curvature in the quadratic strains helps in a chord frame alone.
        remedies = {
            "frame='chord'": self.frame == "tangent" and has_chord(curve),
            "strain='green'": self.frame == "chord" and self.strain == "nonlinear" and turning > 0,
            "strain='nonlinear'": self.strain == "linear",
            "strain='exact'": self.strain != "exact",
        }
        return StrainValidity(
            range_kernel(self.element),
            np.concatenate([data, lengths]),
            strain_error_coefficients(self.strain, str(self.frame), turning),
            tuple(setting for setting, helps in remedies.items() if helps),
        )

    @property
    def floating_frame(self) -> MaterialPoint:
        """Origin and angle of the frame."""
        rows = sp.eye_array(FRAME_SIZE, len(self.coordinates), format="csr")
        return MaterialPoint(self.origin, self.angle, rows, Formula(frame_motion, (self.angle,)))

    def strains(self, s: float) -> PointValues:
        """Strains at arc length s, eqs. (5) and (6).

        Taken from the stiffness quadrature points, where those of an element are most accurate, and
        interpolated.
        """
        element, xi = self.mesh.locate(s)
        points = self.element.quadrature
        gauss, _ = gauss_points(points)
        at = self.mesh_in_frame.axis(np.full(points, element), gauss)
        s_points = self.mesh.gauss_arc_lengths(points)[element * points :][:points]
        drawn = compute_prestrains(self.mesh.curve, self.free_curve, s_points)
        numbers = [*lagrange_weights(gauss, xi), *at.curvature, *(1.0 / at.ds), *np.ravel(drawn)]
        values = Formula(InterpolatedStrains(self.element), tuple(map(float, numbers)))
        return PointValues(self._rows_of(element), values)

    def deformation(self, s: float, axes: str) -> PointValues:
        """(u, v, phi) at arc length s, components in the axes "inertial", "frame" or "local"."""
        element, row, angle = self._located(s)
        numbers = tuple(map(float, (angle, *row)))
        return PointValues(
            self._rows_of(element),
            Formula(FloatingFrameDeformation(self.mesh.nodes, axes), numbers),
        )

    @property
    def curvature_error(self) -> float:
        """Largest error of curvature at the stiffness quadrature points, times the length."""
        return self.mesh_in_frame.curvature_error(self.element.quadrature)
