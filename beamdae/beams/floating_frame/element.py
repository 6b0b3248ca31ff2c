"""The planar curved beam element of Pan & Liu (2012) as one symbolic kernel.

The kernel states the virtual work of one element in the coordinates of its floating frame and its
nodes. All numbers (quadrature points, section values, gravity) are inputs, so one kernel serves
every element of a type, curved or straight, in every beam.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.beams.element_data import ElementData, ElementDataLayout
from beamdae.beams.kinematics import Element, InertiaPoint, StrainRatePoint
from beamdae.beams.shape_functions import gauss_points, shape_functions
from beamdae.beams.strains import elastic_work
from beamdae.symbolic.statements import SX, ForceKernel, Local

FRAME_SIZE = 3
NODE_SIZE = 3
# X and Y are the components of s0 in the local frame of the point.
MASS_POINT_VALUES = ("weight", "X", "Y", "cos_alpha", "sin_alpha")
STIFFNESS_POINT_VALUES = ("weight", "curvature", "dxi_ds")
# Behind those of a stiffness point: strains of the drawing.
PRESTRAIN_VALUES = ("axial", "bending")


@dataclass(frozen=True)
class FloatingFrameElement(Element):
    """What distinguishes one element kernel from another.

    Attributes
    ----------
    nodes
        Number of nodes; Lagrange shape functions of degree nodes - 1 (4 in the paper, eq. 12).
    quadrature
        Gauss points of the stiffness terms.
    strain
        "nonlinear" (eq. 5), "green" (with the curvature in the quadratic terms as well), "linear"
        (without them) or "exact" (Reissner's).
    damped
        Whether the section has Kelvin-Voigt damping; without it a third of the tangent's
        operations falls away.
    varying
        Whether the section varies along the beam.
    prestressed
        Whether the drawing is strained.
    """

    nodes: int = 4
    quadrature: int = 3
    strain: str = "nonlinear"
    damped: bool = True
    varying: bool = False
    prestressed: bool = False

    @property
    def mass_quadrature(self) -> int:
        """Gauss points of the inertia terms: exact for products of two shape functions."""
        return self.nodes

    @property
    def size(self) -> int:
        """Local coordinates: (x0, y0, theta) and (u, v, phi) of each node."""
        return FRAME_SIZE + NODE_SIZE * self.nodes

    @property
    def layout(self) -> ElementDataLayout:
        """Where its numbers stand."""
        stiffness_point = STIFFNESS_POINT_VALUES + PRESTRAIN_VALUES * self.prestressed
        counts = (self.mass_quadrature, self.quadrature)
        return ElementDataLayout(*counts, MASS_POINT_VALUES, stiffness_point, self.varying)

    @property
    def n_data(self) -> int:
        """Numbers a copy of the kernel takes."""
        return self.layout.size

    def kernel(self) -> ForceKernel:
        """Virtual work of inertia (eqs. 10, 11, 15), elasticity and damping (eq. 21)."""
        return floating_frame_kernel(self)

    def strain_points(self, points: SX, q: SX) -> list[tuple[SX, SX]]:
        """Weight and strains of the stiffness points; see `strain_points`."""
        return strain_points(self, points, q[FRAME_SIZE:])

    def inertia_points(self, local: Local) -> list[InertiaPoint]:
        """How the inertia points move, in the local frame ec of each."""
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
        """Linear strain rates at the stiffness points."""
        data = self.layout.split(local.data)
        linear = replace(self, strain="linear", prestressed=False)
        found = strain_points(linear, data.stiffness, local.v[FRAME_SIZE:])
        return [
            StrainRatePoint(weight, data.elasticity(k), rates)
            for k, (weight, rates) in enumerate(found)
        ]


@dataclass(frozen=True, eq=False)
class AxisMotion:
    """Position, velocity and acceleration of the points of an axis (eqs. 8, 10 at eta = 0).

    From local coordinates (x0, y0, theta, (u, v, phi) a node) and their rates. A point is given by
    its shape functions `row`, its undeformed place `reference` in its local frame ec, and the
    rotation `to_local` from the floating frame to ec; velocities and accelerations are told in ec,
    where plane rotations commute with interpolation. Accelerations are those relative to free fall.
    """

    q: SX
    v: Any = None
    a: Any = None
    gravity: Any = None

    @cached_property
    def frame(self) -> SX:
        """Rotation of the floating frame."""
        return rotation_matrix(ca.cos(self.q[2]), ca.sin(self.q[2]))

    @cached_property
    def _origin_velocity(self) -> SX:
        return self.frame.T @ self.v[:2]

    @cached_property
    def _origin_acceleration(self) -> SX:
        return self.frame.T @ (self.a[:2] - self.gravity)

    @cached_property
    def _swing(self) -> SX:
        """Acceleration of what the frame carries, as a linear map of its place."""
        return rotation_matrix(-(self.v[2] ** 2), self.a[2])

    @cached_property
    def _relative(self) -> SX:
        """By the nodal displacements: one linear map at all points, so it can be interpolated."""
        q, v, a = (_nodal_vectors(z) for z in (self.q, self.v, self.a))
        return self._swing @ q + 2 * self.v[2] * _rotate_quarter_turn(v) + a

    def place(self, row: np.ndarray, reference: SX) -> SX:
        """Place relative to the origin of the frame, in ec."""
        return reference + _nodal_vectors(self.q) @ row

    def position(self, row: np.ndarray, carried: Any, to_frame: SX) -> SX:
        """Position in the inertial frame, of a point whose undeformed place in the frame is given.

        `to_frame` is the rotation from ec to the floating frame.
        """
        return self.q[:2] + self.frame @ (carried + to_frame @ (_nodal_vectors(self.q) @ row))

    def rotation(self, row: np.ndarray) -> SX:
        """phi, of the section relative to the undeformed one."""
        return self.q[FRAME_SIZE + 2 :: NODE_SIZE].T @ row

    def velocity(self, row: np.ndarray, reference: SX, to_local: SX) -> SX:
        """Velocity in ec."""
        carried = to_local @ self._origin_velocity + self.v[2] * _rotate_quarter_turn(
            self.place(row, reference)
        )
        return carried + _nodal_vectors(self.v) @ row

    def angular_velocity(self, row: np.ndarray) -> SX:
        """Theta' + phi' of the section."""
        return self.v[2] + self.v[FRAME_SIZE + 2 :: NODE_SIZE].T @ row

    def acceleration(self, row: np.ndarray, reference: SX, to_local: SX) -> SX:
        """Acceleration relative to free fall, in ec."""
        carried = to_local @ self._origin_acceleration + self._swing @ reference
        return carried + self._relative @ row

    def angular_acceleration(self, row: np.ndarray) -> SX:
        """Theta'' + phi'' of the section."""
        return self.a[2] + self.a[FRAME_SIZE + 2 :: NODE_SIZE].T @ row


def rotation_matrix(cosine: SX, sine: SX) -> SX:
    """Matrix of a plane rotation."""
    return ca.vertcat(ca.horzcat(cosine, -sine), ca.horzcat(sine, cosine))


def _rotate_quarter_turn(vectors: SX) -> SX:
    """The columns turned by 90 degrees."""
    return ca.vertcat(-vectors[1, :], vectors[0, :])


def _nodal_vectors(coordinates: SX) -> SX:
    """Displacements (u, v) of the nodes, or their rates, as columns."""
    nodes = (coordinates.shape[0] - FRAME_SIZE) // NODE_SIZE
    return ca.reshape(coordinates[FRAME_SIZE:], NODE_SIZE, nodes)[:2, :]


def _mass_points(
    kind: FloatingFrameElement, data: ElementData
) -> list[tuple[np.ndarray, SX, SX, SX]]:
    """Shape functions, weight, undeformed place in ec and rotation to ec of each inertia point."""
    xi, _ = gauss_points(kind.mass_quadrature)
    return [
        (row, at[0], at[1:3], rotation_matrix(at[3], at[4]).T)
        for row, at in zip(shape_functions(kind.nodes, xi), ca.horzsplit(data.mass), strict=True)
    ]


def strain_points(kind: FloatingFrameElement, points: SX, nodal: SX) -> list[tuple[SX, SX]]:
    """Weight, and (axial strain, shear strain 2 eps12, curvature kappa11), of the stiffness points.

    Eqs. (5) and (6), kappa11 = -phi'. With along = u' - v/R and across = v' + u/R the derivative of
    the place is (1 + along, across) in ec, and the exact strains are its components in the axes of
    the section, turned by phi: (1 + along) cos phi + across sin phi - 1 and
    across cos phi - (1 + along) sin phi. `points` has a column of `STIFFNESS_POINT_VALUES` each and what
    is behind it, `nodal` are the coordinates (u, v, phi) a node.
    """
    xi, _ = gauss_points(kind.quadrature)
    rows, slopes = (shape_functions(kind.nodes, xi, k) for k in (0, 1))
    found = []
    for row, slope, point in zip(rows, slopes, ca.horzsplit(points), strict=True):
        weight, curvature, dxi_ds = point[0], point[1], point[2]
        u, v, phi = (_interpolate(row, nodal, k) for k in range(NODE_SIZE))
        du, dv, dphi = (dxi_ds * _interpolate(slope, nodal, k) for k in range(NODE_SIZE))
        along, across = du - v * curvature, dv + u * curvature
        if kind.strain == "exact":
            # By the half angle, which keeps the digits of small strains beside one.
            c, s = ca.cos(0.5 * phi), ca.sin(0.5 * phi)
            less, sine = -2.0 * s * s, 2.0 * s * c
            axial = along + (along * less + across * sine) + less
            shear = across + (across * less - along * sine) - sine
        else:
            quadratic = {
                "linear": SX(0),
                "nonlinear": 0.5 * (du**2 + dv**2),
                "green": 0.5 * (along**2 + across**2),
            }
            axial, shear = along + quadratic[kind.strain], across - phi
        strain = ca.vertcat(axial, shear, -dphi)
        if kind.prestressed:
            strain += ca.vertcat(point[3], 0, point[4])
        found.append((weight, strain))
    return found


def _interpolate(row: np.ndarray, nodal: SX, component: int) -> SX:
    return sum(
        (float(row[i]) * nodal[NODE_SIZE * i + component] for i in range(len(row))), start=SX(0)
    )


@cache
def floating_frame_kernel(kind: FloatingFrameElement) -> ForceKernel:
    """Virtual work of one element: inertia (eqs. 10, 11, 15), elasticity and damping (21).

    The inertial forces are density times the acceleration of material points, eq. (10). Departure
    from the paper: the rotary inertia is the consistent one, 1/2 rho I (theta' + phi')^2, where
    eq. (8) leads to 1/2 rho I (phi'^2 + phi^2 theta'^2).
    """
    local = Local(kind.size, kind.n_data)
    data = kind.layout.split(local.data)
    inertia, kinetic, potential = _inertial_work(kind, local, data)
    nodal, rates = local.q[FRAME_SIZE:], local.v[FRAME_SIZE:]
    points = strain_points(kind, data.stiffness, nodal)
    elastic, stored, dissipated = elastic_work(points, data, kind.damped, nodal, rates)
    force = inertia + ca.vertcat(SX.zeros(FRAME_SIZE), elastic)
    energies = ca.vertcat(kinetic, stored, potential)
    return ForceKernel(local, force, energies, ca.vertcat(0, dissipated), reused=True)


def _inertial_work(
    kind: FloatingFrameElement, local: Local, data: ElementData
) -> tuple[SX, SX, SX]:
    """Generalized inertial forces and weight, kinetic and gravity energy."""
    axis = AxisMotion(local.q, local.v, local.a, data.gravity)
    on_origin, on_angle = SX.zeros(2), SX(0)
    on_nodes = SX.zeros(NODE_SIZE * kind.nodes)
    kinetic, potential = SX(0), SX(0)
    for k, (row, weight, reference, to_local) in enumerate(_mass_points(kind, data)):
        rhoA, rhoI = ca.vertsplit(data.inertia(k))
        force = (weight * rhoA) * axis.acceleration(row, reference, to_local)
        moment = weight * rhoI * axis.angular_acceleration(row)
        on_origin += to_local.T @ force
        on_angle += ca.dot(_rotate_quarter_turn(axis.place(row, reference)), force) + moment
        on_nodes += ca.vertcat(*[float(n) * ca.vertcat(force, moment) for n in row])
        position = axis.position(row, to_local.T @ reference, to_local.T)
        potential -= weight * rhoA * ca.dot(data.gravity, position)
        speed2 = ca.sumsqr(axis.velocity(row, reference, to_local))
        kinetic += 0.5 * weight * (rhoA * speed2 + rhoI * axis.angular_velocity(row) ** 2)
    return ca.vertcat(axis.frame @ on_origin, on_angle, on_nodes), kinetic, potential
