"""Beams of Pan & Liu (2012): small strains relative to a floating frame.

The kernels of the element compute the virtual work of one point from the coordinates of the
floating frame and from displacements, rotation and their slopes at the point; shape functions are
constant weights. All numbers (section properties, gravity, geometry) are inputs, so the kernels are
shared by all points of elements of any degree, curved or straight.

`section_motion`, `frame_motion` and `FloatingFrameDeformation` are kinds of a `Formula`; see
`symbolic.formula`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.beams.elements import (
    NODE_SIZE,
    ElementDataLayout,
    PointElement,
    PointMotion,
    assemble_point_data,
    compute_prestrains,
    is_damped,
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
from beamdae.symbolic.statements import SX, ForceKernel, Local, Variable

# Local coordinates: (x0, y0, theta) of the frame, then (u, v, phi) of each node.
FRAME_SIZE = 3
ORIGIN = slice(0, 2)
THETA = 2
PHI = 2
DISPLACEMENT = slice(FRAME_SIZE, FRAME_SIZE + 2)  # of a point

# Values of a point in the element data. X and Y are the components, in the local frame of the
# point, of its undeformed position relative to the origin of the floating frame. If the reference
# configuration is strained, each stiffness point also has the prestrains.
MASS_POINT_VALUES = ("weight", "X", "Y", "cos_alpha", "sin_alpha")
STIFFNESS_POINT_VALUES = ("weight", "curvature", "dxi_ds")
PRESTRAIN_VALUES = ("axial", "bending")


@dataclass(frozen=True)
class FloatingFrameElement(PointElement):
    """Element type of the floating frame.

    The coordinates are (x0, y0, theta) of the frame and (u, v, phi) of each node.

    Attributes
    ----------
    strain
        "nonlinear" (eq. 5), "green" (with the curvature in the quadratic terms as well), "linear"
        (without quadratic terms) or "exact" (strains of Reissner).
    prestressed
        True if the reference configuration is strained.
    """

    strain: str = "nonlinear"
    prestressed: bool = False
    frame_size = FRAME_SIZE

    @property
    def layout(self) -> ElementDataLayout:
        """Layout of the data of an element."""
        stiffness_point = STIFFNESS_POINT_VALUES + PRESTRAIN_VALUES * self.prestressed
        counts = (self.nodes, self.quadrature)
        return ElementDataLayout(*counts, MASS_POINT_VALUES, stiffness_point)

    def motion_at(self, q: SX, v: SX, point: SX) -> PointMotion:
        """Return the motion of an inertia point in its local frame; see `AxisMotion`."""
        _, reference, to_local = _read_mass_point(point)
        axis = AxisMotion(q, v)
        velocity = axis.velocity(reference, to_local)
        return PointMotion(velocity, axis.angular_velocity, q[FRAME_SIZE + PHI])

    def force_rotation_at(self, z: SX) -> SX:
        """Return phi; for exact and linear strains, zero.

        In strains for moderate rotations, such as u' + v'^2 / 2, the energy conjugate of the axial
        strain is the force along the undeformed axis, while that of the shear strain v' - phi is
        the shear force in the section. In linear strains, phi Q is neglected.
        """
        return SX(0) if self.strain in ("exact", "linear") else z[PHI]

    def strain_at(self, z: SX, point: SX) -> SX:
        """Return (axial strain, shear strain 2 eps12, kappa11) at a stiffness point.

        The strains are those of eqs. (5) and (6) with kappa11 = -phi'. With along = u' - v/R and
        across = v' + u/R, the derivative of the position is (1 + along, across) in ec. The exact
        strains are the components of this vector in the axes of the section, rotated by phi, minus
        1 for the axial strain: (1 + along) cos phi + across sin phi - 1 and
        across cos phi - (1 + along) sin phi.
        """
        _, curvature, dxi_ds = (point[k] for k in range(len(STIFFNESS_POINT_VALUES)))
        u, v, phi = ca.vertsplit(z[:NODE_SIZE])
        du, dv, dphi = ca.vertsplit(dxi_ds * z[NODE_SIZE:])
        along, across = du - v * curvature, dv + u * curvature
        if self.strain == "exact":
            # cos phi - 1 from the half angle avoids cancellation for small strains.
            c, s = ca.cos(0.5 * phi), ca.sin(0.5 * phi)
            cosine_minus_1, sine = -2.0 * s * s, 2.0 * s * c
            axial = along + (along * cosine_minus_1 + across * sine) + cosine_minus_1
            shear = across + (across * cosine_minus_1 - along * sine) - sine
        else:
            quadratic = {
                "linear": SX(0),
                "nonlinear": 0.5 * (du**2 + dv**2),
                "green": 0.5 * (along**2 + across**2),
            }
            axial, shear = along + quadratic[self.strain], across - phi
        strain = ca.vertcat(axial, shear, -dphi)
        if self.prestressed:
            first = len(STIFFNESS_POINT_VALUES)
            strain += ca.vertcat(point[first], 0, point[first + 1])
        return strain

    def inertia_kernel(self) -> ForceKernel:
        """Return the kernel of inertia and weight of a point, in (x0, y0, theta, u, v, phi).

        Eqs. (10), (11) and (15) of Pan & Liu (2012). Inertial forces follow from the mass per
        length and the acceleration of the axis. Unlike in the paper, the rotary inertia is
        consistent: the kinetic energy of rotation is 1/2 rho I (theta' + phi')^2, while eq. (8)
        leads to 1/2 rho I (phi'^2 + phi^2 theta'^2).
        """
        return _inertia_kernel()


@dataclass(frozen=True, eq=False)
class AxisMotion:
    """Position, velocity and acceleration of a point of an axis (eqs. 8 and 10).

    The local frame ec of a point has the directions of the undeformed axis and its normal there. A
    point is defined by the undeformed position `reference` in ec, and the rotation matrix
    `to_local` from the floating frame to ec. Velocities and accelerations are resolved in ec, in
    which the displacements are interpolated.

    Attributes
    ----------
    q, v, a
        Coordinates (x0, y0, theta, u, v, phi) and their first and second time derivatives. `v` may
        be None if only positions are evaluated.
    gravity
        Acceleration of gravity (2,) [m/s^2]; accelerations are relative to free fall. `a` and
        `gravity` may be None if accelerations are not evaluated.
    """

    q: SX
    v: Any = None
    a: Any = None
    gravity: Any = None

    @cached_property
    def frame(self) -> SX:
        """Rotation matrix of the floating frame."""
        return rotation_matrix(ca.cos(self.q[THETA]), ca.sin(self.q[THETA]))

    def relative_position(self, reference: SX) -> SX:
        """Return the position relative to the origin of the frame, in ec."""
        return reference + self.q[DISPLACEMENT]

    def position(self, reference_in_frame: Any, to_frame: SX) -> SX:
        """Return the position in the inertial frame.

        `reference_in_frame` is the undeformed position in the floating frame and `to_frame` the
        rotation matrix from ec to that frame.
        """
        in_frame = reference_in_frame + to_frame @ self.q[DISPLACEMENT]
        return self.q[ORIGIN] + self.frame @ in_frame

    def velocity(self, reference: SX, to_local: SX) -> SX:
        """Return the velocity in ec."""
        relative = _rotate_quarter_turn(self.relative_position(reference))
        transport = to_local @ (self.frame.T @ self.v[ORIGIN]) + self.v[THETA] * relative
        return transport + self.v[DISPLACEMENT]

    @property
    def angular_velocity(self) -> SX:
        """Theta' + phi' of the section."""
        return self.v[THETA] + self.v[FRAME_SIZE + PHI]

    def acceleration(self, reference: SX, to_local: SX) -> SX:
        """Return the acceleration relative to free fall, in ec."""
        # Centripetal and tangential, Coriolis, and relative acceleration.
        transport = rotation_matrix(-(self.v[THETA] ** 2), self.a[THETA])
        q, v, a = (x[DISPLACEMENT] for x in (self.q, self.v, self.a))
        of_origin = to_local @ (self.frame.T @ (self.a[ORIGIN] - self.gravity))
        of_deformation = transport @ q + 2 * self.v[THETA] * _rotate_quarter_turn(v) + a
        return of_origin + transport @ reference + of_deformation

    @property
    def angular_acceleration(self) -> SX:
        """Theta'' + phi'' of the section."""
        return self.a[THETA] + self.a[FRAME_SIZE + PHI]


def rotation_matrix(cosine: SX, sine: SX) -> SX:
    """Return the matrix of a plane rotation by the angle with this cosine and sine."""
    return ca.vertcat(ca.horzcat(cosine, -sine), ca.horzcat(sine, cosine))


def _rotate_quarter_turn(vector: SX) -> SX:
    """Return the vector rotated counter-clockwise by 90 degrees."""
    return ca.vertcat(-vector[1], vector[0])


def _read_mass_point(point: SX) -> tuple[SX, SX, SX]:
    """Return the weight, the undeformed position in ec and the rotation to ec of a point."""
    weight, x, y, cosine, sine = (point[k] for k in range(len(MASS_POINT_VALUES)))
    return weight, ca.vertcat(x, y), rotation_matrix(cosine, sine).T


@cache
def _inertia_kernel() -> ForceKernel:
    local = Local(FRAME_SIZE + NODE_SIZE, len(MASS_POINT_VALUES) + 4)
    weight, reference, to_local = _read_mass_point(local.data)
    rhoA, rhoI, *g = ca.vertsplit(local.data[len(MASS_POINT_VALUES) :])
    gravity = ca.vertcat(*g)
    axis = AxisMotion(local.q, local.v, local.a, gravity)
    force = (weight * rhoA) * axis.acceleration(reference, to_local)
    moment = weight * rhoI * axis.angular_acceleration
    relative = axis.relative_position(reference)
    on_angle = ca.dot(_rotate_quarter_turn(relative), force) + moment
    on_origin = axis.frame @ (to_local.T @ force)
    position = axis.position(to_local.T @ reference, to_local.T)
    speed2 = ca.sumsqr(axis.velocity(reference, to_local))
    kinetic = 0.5 * weight * (rhoA * speed2 + rhoI * axis.angular_velocity**2)
    energies = ca.vertcat(kinetic, 0, -weight * rhoA * ca.dot(gravity, position))
    return ForceKernel(local, ca.vertcat(on_origin, on_angle, force, moment), energies)


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
    rigid_coordinate_count = FRAME_SIZE

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
