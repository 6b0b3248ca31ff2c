"""Kinematics of Pan & Liu (2012): small strains relative to a floating frame.

`section_motion`, `frame_motion` and `FloatingFrameDeformation` are kinds of a `Formula`; see
`symbolic.formula`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.beams.element_data import assemble_point_data, compute_prestrains, is_damped
from beamdae.beams.floating_frame.element import (
    FRAME_SIZE,
    NODE_SIZE,
    ORIGIN,
    PHI,
    THETA,
    AxisMotion,
    FloatingFrameElement,
    rotation_matrix,
)
from beamdae.beams.kinematics import (
    FormulationKinematics,
    MaterialPoint,
    Placement,
    PointValues,
    geometric_property,
)
from beamdae.beams.mesh import Mesh
from beamdae.beams.shape_functions import (
    node_positions,
    shape_functions,
)
from beamdae.beams.strains import slice_column
from beamdae.curves.plane_curves import rotate_points
from beamdae.errors import BeamdaeError, choice_of, convert_fields
from beamdae.parts.attachments import rotate
from beamdae.read_only import read_only_data
from beamdae.symbolic.formula import Formula
from beamdae.symbolic.statements import SX, Local, Variable

Array = np.ndarray

STRAINS = ("nonlinear", "green", "linear", "exact")
# Entries of the operator up to this size are rounding errors of the angles of straight beams.
# Derivatives need neighboring models with the same entries.
_OPERATOR_ROUNDING = 1e-14


def section_motion(q: SX, numbers: Any) -> tuple[SX, SX]:
    """Return position and rotation of a section from (x0, y0, theta, u, v, phi).

    `numbers` are the undeformed position (x, y) in the frame, the cosine and sine of the axis angle
    at this position, and the angle of the frame in the reference configuration.
    """
    x, y, cosine, sine, frame_angle = (numbers[k] for k in range(5))
    position = AxisMotion(q).position(ca.vertcat(x, y), rotation_matrix(cosine, sine))
    return position, q[THETA] - frame_angle + q[FRAME_SIZE + PHI]


def frame_motion(q: SX, frame_angle: Any) -> tuple[SX, SX]:
    """Return position and rotation of the frame.

    `frame_angle[0]` is the angle of the frame in the reference configuration [rad].
    """
    return q[ORIGIN], q[THETA] - frame_angle[0]


@dataclass(frozen=True)
class FloatingFrameDeformation:
    """Deformation (u, v, phi) of a section in the axes `axes`.

    `numbers` are the angle of the undeformed axis in the frame and the shape functions.
    """

    nodes: int
    axes: str

    def __call__(self, local: Local, numbers: Any) -> SX:
        """Return (u, v, phi) from local coordinates."""
        row = slice_column(numbers, 1, self.nodes)
        nodal = ca.reshape(local.q[FRAME_SIZE:], NODE_SIZE, self.nodes) @ row
        axis_angle = numbers[0]
        angle = {
            "inertial": local.q[THETA] + axis_angle,
            "frame": axis_angle,
            "local": 0.0,
        }[self.axes]
        return ca.vertcat(rotate(angle, nodal), nodal[PHI])


@read_only_data
@dataclass(frozen=True, eq=False)
class FloatingFrame(FormulationKinematics):
    """Displacements and section rotations relative to a floating frame.

    Coordinates: (x0, y0, theta) of the frame and the free components of (u, v, phi) at the nodes,
    where (u, v) is the displacement in the local tangent frame and phi the rotation of the section
    relative to the undeformed section. In a chord frame, the displacement of the end along the
    chord replaces (u, v) of the last node. `Beam` documents the settings.

    Raises
    ------
    BeamdaeError
        See `FormulationKinematics`; also if continuity="local" is combined with straight elements.
    """

    strain: str = "exact"
    continuity: str = "cartesian"

    def __post_init__(self) -> None:
        super().__post_init__()
        convert_fields(self, strain=choice_of(*STRAINS), continuity=choice_of("cartesian", "local"))
        has_kinks = self.mesh.shape == "straight" or self.mesh.nodes == 2
        if has_kinks and self.continuity == "local":
            raise BeamdaeError(
                f"{self.name}: continuity='local' requires curved elements, but straight elements "
                "meet at kinks; set continuity='cartesian'."
            )

    @cached_property
    def element(self) -> FloatingFrameElement:
        """Element type, the same for all elements."""
        return FloatingFrameElement(
            self.mesh.nodes,
            self.stiffness_points,
            is_damped(self.section, self.mesh, self.stiffness_points),
            self.strain,
            self.free_curve is not None,
        )

    @geometric_property
    def origin(self) -> tuple[float, float]:
        """Origin of the frame in the reference configuration, the start point [m]."""
        x, y = np.asarray(self.mesh.curve.point(0.0), float)
        return float(x), float(y)

    @geometric_property
    def mesh_in_frame(self) -> Mesh:
        """The mesh in the axes of the floating frame."""
        return self.mesh.in_axes(self.origin, self.frame_angle)

    @geometric_property
    def coordinates(self) -> tuple[Variable, ...]:
        """Name and unit of each coordinate: the frame, then the free nodal coordinates."""
        frame = (Variable("x0", "m"), Variable("y0", "m"), Variable("theta", "rad"))
        nodal = [
            Variable(f"{name}{i}", unit)
            for i in range(self.mesh.node_count)
            for name, unit in (("u", "m"), ("v", "m"), ("phi", "rad"))
        ]
        if self.frame == "tangent":
            return (*frame, *nodal[NODE_SIZE:])
        return (*frame, *nodal[2:-3], Variable("chord", "m"), nodal[-1])

    @property
    def rigid_coordinate_count(self) -> int:
        """Number of leading coordinates that describe a rigid motion: those of the frame."""
        return FRAME_SIZE

    @property
    def frame_follows_section(self) -> bool:
        """True if the body has a floating frame that moves with one of its sections."""
        return self.frame == "tangent"

    @property
    def initial_position(self) -> Array:
        """Coordinates [m, rad] in the reference configuration, shape (n,)."""
        return self._without_deformation([*self.origin, self.frame_angle])

    def initial_velocity(self, velocity: tuple[float, float], angular_velocity: float) -> Array:
        """Return the rates of the coordinates (n,): those of the frame, and zero for the rest."""
        return self._without_deformation([*velocity, angular_velocity])

    def rigid_motions(self, q: SX) -> SX:
        """Return the rates of the coordinates in rigid motions (n, 3): those of the frame."""
        motions = SX(len(self.coordinates), FRAME_SIZE)
        for k in range(FRAME_SIZE):
            motions[k, k] = 1.0
        return motions

    def _without_deformation(self, frame: list[float]) -> Array:
        return np.concatenate([frame, np.zeros(len(self.coordinates) - FRAME_SIZE)])

    @geometric_property
    def operator(self) -> sp.csr_array:
        """Matrix that maps beam coordinates to element coordinates, (elements * size, n).

        Nodal coordinates are (u, v, phi) in the tangent frame of the curve at the node. The axes of
        neighboring elements meet at a small angle, which is of third order in the element length
        for curved 4-node elements and of first order for straight elements. With "cartesian"
        continuity, each element rotates the nodal displacement into the direction of the element
        axis; with "local" continuity, the element uses the components unchanged.
        """
        mesh, element_type = self.mesh_in_frame, self.element
        element = np.repeat(np.arange(mesh.elements), element_type.nodes)
        local = np.tile(np.arange(element_type.nodes), mesh.elements)
        node = mesh.element_nodes.ravel()
        kink = self._kink_angles(element, node)
        row = element * element_type.size + FRAME_SIZE + NODE_SIZE * local
        c, s = np.cos(kink), np.sin(kink)
        entries = [(0, 0, c), (0, 1, s), (1, 0, -s), (1, 1, c), (2, 2, np.ones_like(c))]
        coordinate, factor = self._nodal_to_free
        nodal = [NODE_SIZE * node + j for _, j, _ in entries]
        size = mesh.elements * element_type.size
        frame_rows = np.arange(size).reshape(-1, element_type.size)[:, :FRAME_SIZE].ravel()
        rows = np.concatenate([frame_rows, *(row + i for i, _, _ in entries)])
        columns = np.concatenate([frame_rows % element_type.size, *(coordinate[j] for j in nodal)])
        rotations = [value * factor[j] for j, (_, _, value) in zip(nodal, entries, strict=True)]
        values = np.concatenate([np.ones(len(frame_rows)), *rotations])
        values[np.abs(values) < _OPERATOR_ROUNDING] = 0.0
        shape = (size, len(self.coordinates))
        operator = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=shape))
        operator.eliminate_zeros()
        return operator

    def _kink_angles(self, element: Array, node: Array) -> Array:
        """Return the angles from the curve to the element axis at the nodes of elements [rad].

        The angles are zero for "local" continuity, which neglects them.
        """
        if self.continuity == "local":
            return np.zeros(len(element))
        mesh = self.mesh_in_frame
        xi = np.tile(node_positions(mesh.nodes), mesh.elements)
        return mesh.axis(element, xi).angle - mesh.tangent_angle(mesh.node_arc_lengths[node])

    @property
    def _nodal_to_free(self) -> tuple[Array, Array]:
        """Index of the free coordinate and factor that determine each nodal coordinate.

        Index and factor express the conditions of the floating frame; the factor of a fixed
        coordinate is zero.
        """
        size, free = NODE_SIZE * self.mesh.node_count, len(self.coordinates)
        fixed = NODE_SIZE if self.frame == "tangent" else 2
        coordinate = np.maximum(np.arange(size) - fixed, 0) + FRAME_SIZE
        factor = np.ones(size)
        factor[:fixed] = 0.0
        if self.frame == "chord":
            # The end of the beam moves along the chord only.
            angle = float(self.mesh_in_frame.tangent_angle(self.mesh.curve.length))
            factor[-3:-1] = np.cos(angle), -np.sin(angle)
            coordinate[-3:-1], coordinate[-1] = free - 2, free - 1
        return coordinate, factor

    @cached_property
    def _point_data(self) -> Array:
        mesh, layout = self.mesh_in_frame, self.element.layout
        mass, stiffness = self._geometry.derive(
            ("points", layout.mass_points), lambda: self._measure_points(layout.mass_points)
        )

        return assemble_point_data(mesh, layout, self.section, mass, stiffness)

    def _measure_points(self, mass_points: int) -> tuple[list[Array], list[Array]]:
        """Return the geometric values of the inertia points and of the stiffness points."""
        mesh, stiffness_points = self.mesh_in_frame, self.stiffness_points
        weight, axis = mesh.gauss(mass_points)
        local_position = rotate_points(axis.position, -axis.angle)
        mass = [weight, *local_position.T, np.cos(axis.angle), np.sin(axis.angle)]
        weight, axis = mesh.gauss(stiffness_points)
        s = mesh.gauss_arc_lengths(stiffness_points)
        prestrains = compute_prestrains(mesh.curve, self.free_curve, s)
        return mass, [weight, axis.curvature, 1.0 / axis.ds, *prestrains]

    def _locate_section(self, s: float) -> tuple[int, Array, float]:
        """Return the element at s, the shape functions and the angle of the axis in the frame."""
        element, xi = self.mesh.locate(s)
        row = shape_functions(self.mesh.nodes, np.array([xi]))[0]
        angle = float(self.mesh_in_frame.axis(np.array([element]), np.array([xi])).angle[0])
        return element, row, angle

    def placement(self, s: float, on_axis: bool = False) -> Placement:
        """Return the section at arc length s [m]; see `Kinematics`."""
        located, xi = self.mesh.locate(s)
        if on_axis:
            position = self.mesh.axis(np.array([located]), np.array([xi])).position[0]
        else:
            position = np.asarray(self.mesh.curve.point(s), float)
        _, _, angle = self._locate_section(s)
        in_frame = rotate_points(position - np.asarray(self.origin), -self.frame_angle)
        numbers = (*in_frame.tolist(), math.cos(angle), math.sin(angle), self.frame_angle)
        # The section as drawn is normal to the curve, not to the axis interpolated by the elements.
        inclination = float(self.mesh_in_frame.tangent_angle(s)) + self.frame_angle
        x, y = position.tolist()
        return Placement((x, y), inclination, Formula(section_motion, numbers))

    @geometric_property
    def floating_frame(self) -> MaterialPoint:
        """Origin and rotation of the floating frame."""
        rows = sp.eye_array(FRAME_SIZE, len(self.coordinates), format="csr")
        motion = Formula(frame_motion, (self.frame_angle,))
        return MaterialPoint(self.origin, self.frame_angle, rows, motion)

    def _deformation(self, s: float, axes: str) -> PointValues:
        def create() -> PointValues:
            element, row, angle = self._locate_section(s)
            formula = Formula(
                FloatingFrameDeformation(self.mesh.nodes, axes), tuple(map(float, (angle, *row)))
            )
            return PointValues(self.rows_of_element(element), formula)

        return self._geometry.derive(("deformation", s, axes, self.element), create)
