"""Planar curved beam element of Pan & Liu (2012): symbolic kernels of its quadrature points.

The kernels compute the virtual work of one point from the coordinates of the floating frame and
from displacements, rotation and their slopes at the point; shape functions are constant weights.
All numbers (section properties, gravity, geometry) are inputs, so the kernels are shared by all
points of elements of any degree, curved or straight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.beams.element_data import ElementDataLayout
from beamdae.beams.elements import NODE_SIZE, PointElement, PointMotion
from beamdae.symbolic.statements import SX, ForceKernel, Local

# Local coordinates: (x0, y0, theta) of the frame, then (u, v, phi) of each node.
FRAME_SIZE = 3
ORIGIN = slice(0, 2)
THETA = 2
PHI = 2

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

    @property
    def frame_size(self) -> int:
        """Number of coordinates of the floating frame."""
        return FRAME_SIZE

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
        velocity = axis.velocity(AT_POINT, reference, to_local)
        return PointMotion(velocity, axis.angular_velocity(AT_POINT), axis.rotation(AT_POINT))

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


# The only "node" of an `AxisMotion` in the coordinates of a point.
AT_POINT = np.ones(1)


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
    force = (weight * rhoA) * axis.acceleration(AT_POINT, reference, to_local)
    moment = weight * rhoI * axis.angular_acceleration(AT_POINT)
    relative = axis.relative_position(AT_POINT, reference)
    on_angle = ca.dot(_rotate_quarter_turn(relative), force) + moment
    on_origin = axis.frame @ (to_local.T @ force)
    position = axis.position(AT_POINT, to_local.T @ reference, to_local.T)
    speed2 = ca.sumsqr(axis.velocity(AT_POINT, reference, to_local))
    kinetic = 0.5 * weight * (rhoA * speed2 + rhoI * axis.angular_velocity(AT_POINT) ** 2)
    energies = ca.vertcat(kinetic, 0, -weight * rhoA * ca.dot(gravity, position))
    return ForceKernel(local, ca.vertcat(on_origin, on_angle, force, moment), energies)
