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

from beamdae.beams.element_data import ElementDataLayout
from beamdae.beams.elements import NODE_SIZE, PointElement, PointMotion
from beamdae.symbolic.statements import SX, ForceKernel, Local

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
