"""Planar curved beam element of Pan & Liu (2012) as one symbolic kernel.

The kernel computes the virtual work of one element from the coordinates of its floating frame and
its nodes. All numbers (quadrature points, section properties, gravity) are inputs, so one kernel is
shared by all elements of the same type, curved or straight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.beams.element_data import ElementData, ElementDataLayout
from beamdae.beams.kinematics import Element, InertiaPoint, StrainRatePoint
from beamdae.beams.shape_functions import gauss_points, shape_functions
from beamdae.beams.strains import elastic_work, outer_strain_function
from beamdae.symbolic.formula import cache_kernels
from beamdae.symbolic.functions.compiled import RowFunction
from beamdae.symbolic.statements import SX, ForceKernel, Local

# Local coordinates: (x0, y0, theta) of the frame, then (u, v, phi) of each node.
FRAME_SIZE = 3
ORIGIN = slice(0, 2)
THETA = 2
NODE_SIZE = 3
PHI = 2

# Values of a point in the element data. X and Y are the components, in the local frame of the
# point, of its undeformed position relative to the origin of the floating frame. If the reference
# configuration is strained, each stiffness point also has the prestrains.
MASS_POINT_VALUES = ("weight", "X", "Y", "cos_alpha", "sin_alpha")
STIFFNESS_POINT_VALUES = ("weight", "curvature", "dxi_ds")
PRESTRAIN_VALUES = ("axial", "bending")


@dataclass(frozen=True)
class FloatingFrameElement(Element):
    """Element type of the floating frame, defined by the properties that its kernel depends on.

    Attributes
    ----------
    nodes
        Number of nodes (4 in the paper, eq. 12); the shape functions have the degree nodes - 1.
    quadrature
        Number of Gauss points of the stiffness terms.
    strain
        "nonlinear" (eq. 5), "green" (with the curvature in the quadratic terms as well), "linear"
        (without quadratic terms) or "exact" (strains of Reissner).
    damped
        True if the section has Kelvin-Voigt damping; without damping, the tangent matrix needs a
        third fewer operations.
    varying
        True if the section varies along the beam.
    prestressed
        True if the reference configuration is strained.
    """

    nodes: int = 4
    quadrature: int = 3
    strain: str = "nonlinear"
    damped: bool = True
    varying: bool = False
    prestressed: bool = False

    @property
    def mass_quadrature(self) -> int:
        """Number of inertia points, which integrate products of two shape functions exactly."""
        return self.nodes

    @property
    def size(self) -> int:
        """Number of local coordinates: (x0, y0, theta) and (u, v, phi) of each node."""
        return FRAME_SIZE + NODE_SIZE * self.nodes

    @property
    def layout(self) -> ElementDataLayout:
        """Layout of the data of an element."""
        stiffness_point = STIFFNESS_POINT_VALUES + PRESTRAIN_VALUES * self.prestressed
        counts = (self.mass_quadrature, self.quadrature)
        return ElementDataLayout(*counts, MASS_POINT_VALUES, stiffness_point, self.varying)

    @property
    def n_data(self) -> int:
        """Number of data values of one element."""
        return self.layout.size

    def kernel(self) -> ForceKernel:
        """Return the kernel of one element; see `floating_frame_kernel`."""
        return floating_frame_kernel(self)

    def strain_points(self, points: SX, q: SX) -> list[tuple[SX, SX]]:
        """Return weights and strains of the stiffness points; see the function `strain_points`."""
        return strain_points(self, points, q[FRAME_SIZE:])

    def inertia_points(self, local: Local) -> list[InertiaPoint]:
        """Return the motion of the inertia points, each in its local frame; see `AxisMotion`."""
        data = self.layout.split(local.data)
        axis = AxisMotion(local.q, local.v)
        return [
            InertiaPoint(
                weight,
                data.inertia(k)[[0, 0, 1]],
                axis.velocity(row, reference, to_local),
                axis.angular_velocity(row),
                axis.rotation(row),
            )
            for k, (row, weight, reference, to_local) in enumerate(_mass_points(self, data))
        ]

    def strain_rate_points(self, local: Local) -> list[StrainRatePoint]:
        """Return the strain rates at the stiffness points of the deformed beam."""
        data = self.layout.split(local.data)
        return [
            StrainRatePoint(weight, data.elasticity(k), local.dot(strain))
            for k, (weight, strain) in enumerate(self.strain_points(data.stiffness, local.q))
        ]


@dataclass(frozen=True, eq=False)
class AxisMotion:
    """Position, velocity and acceleration of the points of an axis (eqs. 8 and 10).

    The local frame ec of a point has the directions of the undeformed axis and its normal there. A
    point is defined by the shape functions `row`, the undeformed position `reference` in ec, and
    the rotation matrix `to_local` from the floating frame to ec. Velocities and accelerations are
    resolved in ec, in which the displacements are interpolated.

    Attributes
    ----------
    q, v, a
        Local coordinates (x0, y0, theta, (u, v, phi) of each node) and their first and second time
        derivatives. `v` may be None if only positions are evaluated.
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

    @cached_property
    def _origin_velocity(self) -> SX:
        return self.frame.T @ self.v[ORIGIN]

    @cached_property
    def _origin_acceleration(self) -> SX:
        return self.frame.T @ (self.a[ORIGIN] - self.gravity)

    @cached_property
    def _transport_matrix(self) -> SX:
        """Matrix that maps a position in the frame to centripetal plus tangential acceleration."""
        return rotation_matrix(-(self.v[THETA] ** 2), self.a[THETA])

    @cached_property
    def _deformation_accelerations(self) -> SX:
        """Accelerations due to the nodal displacements, one column per node.

        They depend linearly on the nodal motion, in the same way at all points, and can therefore
        be interpolated.
        """
        q, v, a = (_nodal_vectors(z) for z in (self.q, self.v, self.a))
        return self._transport_matrix @ q + 2 * self.v[THETA] * _rotate_quarter_turn(v) + a

    def relative_position(self, row: np.ndarray, reference: SX) -> SX:
        """Return the position relative to the origin of the frame, in ec."""
        return reference + _nodal_vectors(self.q) @ row

    def position(self, row: np.ndarray, reference_in_frame: Any, to_frame: SX) -> SX:
        """Return the position in the inertial frame.

        `reference_in_frame` is the undeformed position in the floating frame and `to_frame` the
        rotation matrix from ec to that frame.
        """
        in_frame = reference_in_frame + to_frame @ (_nodal_vectors(self.q) @ row)
        return self.q[ORIGIN] + self.frame @ in_frame

    def rotation(self, row: np.ndarray) -> SX:
        """Return phi, the rotation of the section relative to the undeformed section."""
        return _section_rotations(self.q).T @ row

    def velocity(self, row: np.ndarray, reference: SX, to_local: SX) -> SX:
        """Return the velocity in ec."""
        relative = self.relative_position(row, reference)
        transport = to_local @ self._origin_velocity + self.v[THETA] * _rotate_quarter_turn(
            relative
        )
        return transport + _nodal_vectors(self.v) @ row

    def angular_velocity(self, row: np.ndarray) -> SX:
        """Return theta' + phi' of the section."""
        return self.v[THETA] + _section_rotations(self.v).T @ row

    def acceleration(self, row: np.ndarray, reference: SX, to_local: SX) -> SX:
        """Return the acceleration relative to free fall, in ec."""
        transport = to_local @ self._origin_acceleration + self._transport_matrix @ reference
        return transport + self._deformation_accelerations @ row

    def angular_acceleration(self, row: np.ndarray) -> SX:
        """Return theta'' + phi'' of the section."""
        return self.a[THETA] + _section_rotations(self.a).T @ row


def rotation_matrix(cosine: SX, sine: SX) -> SX:
    """Return the matrix of a plane rotation by the angle with this cosine and sine."""
    return ca.vertcat(ca.horzcat(cosine, -sine), ca.horzcat(sine, cosine))


def _rotate_quarter_turn(vectors: SX) -> SX:
    """Return the columns rotated counter-clockwise by 90 degrees."""
    return ca.vertcat(-vectors[1, :], vectors[0, :])


def _nodal_vectors(coordinates: SX) -> SX:
    """Return the displacements (u, v) of the nodes, or their rates, as columns."""
    nodes = (coordinates.shape[0] - FRAME_SIZE) // NODE_SIZE
    return ca.reshape(coordinates[FRAME_SIZE:], NODE_SIZE, nodes)[:2, :]


def _section_rotations(coordinates: SX) -> SX:
    """Return the section rotations phi of the nodes, or their rates."""
    return coordinates[FRAME_SIZE + PHI :: NODE_SIZE]


def _mass_points(
    element: FloatingFrameElement, data: ElementData
) -> list[tuple[np.ndarray, SX, SX, SX]]:
    """Return shape functions, weight, undeformed position in ec and rotation to ec per point."""
    xi, _ = gauss_points(element.mass_quadrature)
    points = []
    for row, point in zip(shape_functions(element.nodes, xi), ca.horzsplit(data.mass), strict=True):
        weight, x, y, cosine, sine = (point[k] for k in range(len(MASS_POINT_VALUES)))
        points.append((row, weight, ca.vertcat(x, y), rotation_matrix(cosine, sine).T))
    return points


@cache
def strain_function(element: FloatingFrameElement) -> RowFunction:
    """Return the function of (q, data) for the largest axial strain of an element's fibers."""
    local = Local(element.size, element.n_data)
    data = element.layout.split(local.data)
    points = strain_points(element, data.stiffness, local.q[FRAME_SIZE:])
    return outer_strain_function(local, data, [strain for _, strain in points])


def strain_points(element: FloatingFrameElement, points: SX, nodal: SX) -> list[tuple[SX, SX]]:
    """Return weight and (axial strain, shear strain 2 eps12, kappa11) of each stiffness point.

    The strains are those of eqs. (5) and (6) with kappa11 = -phi'. With along = u' - v/R and
    across = v' + u/R, the derivative of the position is (1 + along, across) in ec. The exact
    strains are the components of this vector in the axes of the section, rotated by phi, minus 1
    for the axial strain: (1 + along) cos phi + across sin phi - 1 and
    across cos phi - (1 + along) sin phi.

    Parameters
    ----------
    element
        Element type.
    points
        Values `STIFFNESS_POINT_VALUES` of each point, one column per point; further rows may
        follow.
    nodal
        Coordinates (u, v, phi) of each node.
    """
    xi, _ = gauss_points(element.quadrature)
    nodes = ca.reshape(nodal, NODE_SIZE, element.nodes)
    values, slopes = (ca.horzsplit(nodes @ shape_functions(element.nodes, xi, k).T) for k in (0, 1))
    strains = []
    for value, slope, point in zip(values, slopes, ca.horzsplit(points), strict=True):
        weight, curvature, dxi_ds = (point[k] for k in range(len(STIFFNESS_POINT_VALUES)))
        u, v, phi = ca.vertsplit(value)
        du, dv, dphi = ca.vertsplit(dxi_ds * slope)
        along, across = du - v * curvature, dv + u * curvature
        if element.strain == "exact":
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
            axial, shear = along + quadratic[element.strain], across - phi
        strain = ca.vertcat(axial, shear, -dphi)
        if element.prestressed:
            first = len(STIFFNESS_POINT_VALUES)
            axial_prestrain, bending_prestrain = point[first], point[first + 1]
            strain += ca.vertcat(axial_prestrain, 0, bending_prestrain)
        strains.append((weight, strain))
    return strains


@cache_kernels
def floating_frame_kernel(element: FloatingFrameElement) -> ForceKernel:
    """Return the kernel of one element: forces of inertia, weight, elasticity and damping.

    Eqs. (10), (11), (15) and (21) of Pan & Liu (2012). Inertial forces follow from the mass per
    length and the acceleration of the axis. Unlike in the paper, the rotary inertia is consistent:
    the kinetic energy of rotation is 1/2 rho I (theta' + phi')^2, while eq. (8) leads to
    1/2 rho I (phi'^2 + phi^2 theta'^2).
    """
    local = Local(element.size, element.n_data)
    data = element.layout.split(local.data)
    inertia, kinetic, potential = _inertial_work(element, local, data)
    nodal, rates = local.q[FRAME_SIZE:], local.v[FRAME_SIZE:]
    points = strain_points(element, data.stiffness, nodal)
    elastic, strain_energy, dissipated = elastic_work(points, data, element.damped, nodal, rates)
    force = inertia + ca.vertcat(SX.zeros(FRAME_SIZE), elastic)
    energies = ca.vertcat(kinetic, strain_energy, potential)
    return ForceKernel(local, force, energies, ca.vertcat(0, dissipated), reused=True)


def _inertial_work(
    element: FloatingFrameElement, local: Local, data: ElementData
) -> tuple[SX, SX, SX]:
    """Return generalized forces of inertia and weight, kinetic energy and potential of gravity."""
    axis = AxisMotion(local.q, local.v, local.a, data.gravity)
    on_origin, on_angle = SX.zeros(2), SX(0)
    on_nodes = SX.zeros(NODE_SIZE * element.nodes)
    kinetic, potential = SX(0), SX(0)
    for k, (row, weight, reference, to_local) in enumerate(_mass_points(element, data)):
        rhoA, rhoI = ca.vertsplit(data.inertia(k))
        force = (weight * rhoA) * axis.acceleration(row, reference, to_local)
        moment = weight * rhoI * axis.angular_acceleration(row)
        on_origin += to_local.T @ force
        relative = axis.relative_position(row, reference)
        on_angle += ca.dot(_rotate_quarter_turn(relative), force) + moment
        on_nodes += ca.vec(ca.vertcat(force, moment) @ row[None])
        position = axis.position(row, to_local.T @ reference, to_local.T)
        potential -= weight * rhoA * ca.dot(data.gravity, position)
        speed2 = ca.sumsqr(axis.velocity(row, reference, to_local))
        kinetic += 0.5 * weight * (rhoA * speed2 + rhoI * axis.angular_velocity(row) ** 2)
    return ca.vertcat(axis.frame @ on_origin, on_angle, on_nodes), kinetic, potential
