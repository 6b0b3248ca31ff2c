"""The planar curved beam element of Pan & Liu (2012) as one symbolic kernel.

The kernel states the virtual work of one element in the coordinates of its floating frame and its
nodes. All numbers (quadrature points, section values, gravity) are inputs, so one kernel serves
every element of a type, curved or straight, in every beam.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from beamdae.symbolic.statements import SX, ForceKernel, Local

FRAME = 3
NODE = 3
# X and Y are the components of s0 in the local frame of the point.
MASS_POINT = ("weight", "X", "Y", "cos_alpha", "sin_alpha")
STIFFNESS_POINT = ("weight", "curvature", "dxi_ds")
SECTION = ("EA", "GA", "EI", "rhoA", "rhoI", "damping")


@dataclass(frozen=True)
class ElementType:
    """What distinguishes one element kernel from another.

    Attributes
    ----------
    nodes
        Number of nodes; Lagrange shape functions of degree nodes - 1 (4 in the paper, eq. 12).
    quadrature
        Gauss points of the stiffness terms.
    strain
        "nonlinear" (eq. 5), "green" (with the curvature in the quadratic terms as well) or
        "linear" (without them).
    damped
        Whether the section has Kelvin-Voigt damping; without it a third of the tangent's
        operations falls away.
    """

    nodes: int = 4
    quadrature: int = 3
    strain: str = "nonlinear"
    damped: bool = True

    @property
    def mass_quadrature(self) -> int:
        """Gauss points of the inertia terms: exact for products of two shape functions."""
        return self.nodes

    @property
    def size(self) -> int:
        """Local coordinates: (x0, y0, theta) and (u, v, phi) of each node."""
        return FRAME + NODE * self.nodes

    @property
    def n_data(self) -> int:
        """Numbers a copy of the kernel takes."""
        points = self.mass_quadrature * len(MASS_POINT) + self.quadrature * len(STIFFNESS_POINT)
        return points + len(SECTION) + 2


def shape_functions(nodes: int, xi: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Lagrange shape functions on equidistant nodes of [-1, 1] at `xi`, shape (len(xi), nodes)."""
    at = np.linspace(-1.0, 1.0, nodes)
    columns = []
    for i in range(nodes):
        others = np.delete(at, i)
        polynomial = np.poly(others) / np.prod(at[i] - others)
        columns.append(np.polyval(np.polyder(polynomial, derivative), xi))
    return np.stack(columns, axis=-1)


class Strains(NamedTuple):
    """Strain measures of eqs. (5) and (6) at a point of the axis, or their rates."""

    axial: SX
    shear: SX
    bending: SX


def strains(kind: ElementType, row: np.ndarray, slope: np.ndarray, point: SX, nodal: SX) -> Strains:
    """Axial strain, shear strain 2 eps12 and curvature kappa11 = -phi' (eqs. 5, 6).

    `row`, `slope` are the shape functions and their xi-derivatives at the point, `point` the
    data (weight, 1/R, dxi/ds), `nodal` the coordinates (u, v, phi) a node.
    """
    curvature, dxi_ds = point[1], point[2]
    u, v, phi = (_interpolate(row, nodal, k) for k in range(NODE))
    du, dv, dphi = (dxi_ds * _interpolate(slope, nodal, k) for k in range(NODE))
    along, across = du - v * curvature, dv + u * curvature
    quadratic = {
        "linear": SX(0),
        "nonlinear": 0.5 * (du**2 + dv**2),
        "green": 0.5 * (along**2 + across**2),
    }
    return Strains(along + quadratic[kind.strain], across - phi, -dphi)


def _interpolate(row: np.ndarray, nodal: SX, component: int) -> SX:
    return sum((float(row[i]) * nodal[NODE * i + component] for i in range(len(row))), start=SX(0))


class Data(NamedTuple):
    """The numbers of one element: a column a point, values of the section, gravity."""

    mass: SX
    stiffness: SX
    section: SX
    gravity: SX


def split(kind: ElementType, data: SX) -> Data:
    """The data of a kernel as what they are; `data` may hold more behind them."""
    n_mass = kind.mass_quadrature * len(MASS_POINT)
    n_stiffness = kind.quadrature * len(STIFFNESS_POINT)
    return Data(
        ca.reshape(data[:n_mass], len(MASS_POINT), kind.mass_quadrature),
        ca.reshape(data[n_mass : n_mass + n_stiffness], len(STIFFNESS_POINT), kind.quadrature),
        data[n_mass + n_stiffness : n_mass + n_stiffness + len(SECTION)],
        data[kind.n_data - 2 : kind.n_data],
    )


class PointMotion(NamedTuple):
    """Velocity of a point of the axis in its local frame ec, and of its section."""

    weight: SX
    velocity: SX
    spin: SX
    rotation: SX


def point_motions(kind: ElementType, local: Local, data: Data) -> list[PointMotion]:
    """How the inertia points of an element move: the rate of eq. (8) at eta = 0, theta' + phi'.

    `rotation` is phi, of the section relative to the undeformed one.
    """
    xi, _ = np.polynomial.legendre.leggauss(kind.mass_quadrature)
    omega = local.v[2]
    frame = _rotation(ca.cos(local.q[2]), ca.sin(local.q[2]))
    origin_velocity = frame.T @ local.v[:2]
    q, v = (_nodal_vectors(kind, z) for z in (local.q, local.v))
    phi, dphi = local.q[FRAME + 2 :: NODE].T, local.v[FRAME + 2 :: NODE].T
    motions = []
    for k, row in enumerate(shape_functions(kind.nodes, xi)):
        to_local = _rotation(data.mass[3, k], data.mass[4, k]).T
        place = data.mass[1:3, k] + q @ row
        velocity = to_local @ origin_velocity + omega * _turn(place) + v @ row
        motions.append(PointMotion(data.mass[0, k], velocity, omega + dphi @ row, phi @ row))
    return motions


@cache
def beam_kernel(kind: ElementType) -> ForceKernel:
    """Virtual work of one element: inertia (eqs. 10, 11, 15), elasticity and damping (21).

    The inertial forces are density times the acceleration of material points, eq. (10). Departure
    from the paper: the rotary inertia is the consistent one, 1/2 rho I (theta' + phi')^2, where
    eq. (8) leads to 1/2 rho I (phi'^2 + phi^2 theta'^2).
    """
    local = Local(kind.size, kind.n_data)
    data = split(kind, local.data)
    inertia, kinetic, potential = _inertia(kind, local, data)
    elastic, stored, dissipated = _elasticity(kind, local, data)
    force = inertia + ca.vertcat(SX.zeros(FRAME), elastic)
    energies = ca.vertcat(kinetic, stored, potential)
    return ForceKernel(local, force, energies, ca.vertcat(0, dissipated), reused=True)


def _inertia(kind: ElementType, local: Local, data: Data) -> tuple[SX, SX, SX]:
    """Everything in the local frame ec of the point, where plane rotations commute with I."""
    xi, _ = np.polynomial.legendre.leggauss(kind.mass_quadrature)
    rhoA, rhoI = data.section[3], data.section[4]
    omega, alpha = local.v[2], local.a[2]
    frame = _rotation(ca.cos(local.q[2]), ca.sin(local.q[2]))
    origin_acceleration = frame.T @ (local.a[:2] - data.gravity)
    on_origin, on_angle = SX.zeros(2), SX(0)
    on_nodes = SX.zeros(NODE * kind.nodes)
    potential = SX(0)
    # Rotations commute in the plane, so eq. (10) is one linear map of (q, v, a), the same at every
    # point, and its nodal values can be interpolated like displacements.
    swing = _rotation(-(omega**2), alpha)
    q, v, a = (_nodal_vectors(kind, z) for z in (local.q, local.v, local.a))
    relative = swing @ q + 2 * omega * _turn(v) + a
    ddphi = local.a[FRAME + 2 :: NODE].T
    for k, row in enumerate(shape_functions(kind.nodes, xi)):
        weight, cos_alpha, sin_alpha = data.mass[0, k], data.mass[3, k], data.mass[4, k]
        reference = data.mass[1:3, k]
        to_local = _rotation(cos_alpha, sin_alpha).T
        place = reference + q @ row
        force = (weight * rhoA) * (
            to_local @ origin_acceleration + swing @ reference + relative @ row
        )
        moment = weight * rhoI * (alpha + ddphi @ row)
        on_origin += to_local.T @ force
        on_angle += ca.dot(_turn(place), force) + moment
        on_nodes += ca.vertcat(*[float(n) * ca.vertcat(force, moment) for n in row])
        height = ca.dot(data.gravity, local.q[:2] + frame @ to_local.T @ place)
        potential -= weight * rhoA * height
    kinetic = SX(0)
    for point in point_motions(kind, local, data):
        speed2, spin2 = ca.sumsqr(point.velocity), point.spin**2
        kinetic += 0.5 * point.weight * (rhoA * speed2 + rhoI * spin2)
    return ca.vertcat(frame @ on_origin, on_angle, on_nodes), kinetic, potential


def _rotation(cosine: SX, sine: SX) -> SX:
    return ca.vertcat(ca.horzcat(cosine, -sine), ca.horzcat(sine, cosine))


def _turn(vectors: SX) -> SX:
    """The columns turned by 90 degrees."""
    return ca.vertcat(-vectors[1, :], vectors[0, :])


def _nodal_vectors(kind: ElementType, coordinates: SX) -> SX:
    """Displacements (u, v) of the nodes, or their rates, as columns."""
    return ca.reshape(coordinates[FRAME:], NODE, kind.nodes)[:2, :]


def _elasticity(kind: ElementType, local: Local, data: Data) -> tuple[SX, SX, SX]:
    xi, _ = np.polynomial.legendre.leggauss(kind.quadrature)
    shapes, slopes = shape_functions(kind.nodes, xi), shape_functions(kind.nodes, xi, 1)
    nodal, rates = local.q[FRAME:], local.v[FRAME:]
    stiffness, damping = data.section[:3], data.section[5]
    force = SX.zeros(NODE * kind.nodes)
    stored, dissipated = SX(0), SX(0)
    for k in range(kind.quadrature):
        point = data.stiffness[:, k]
        strain = ca.vertcat(*strains(kind, shapes[k], slopes[k], point, nodal))
        section_forces = stiffness * strain
        stored += 0.5 * point[0] * ca.dot(section_forces, strain)
        if kind.damped:
            viscous = damping * stiffness * ca.jtimes(strain, nodal, rates)
            section_forces += viscous
            dissipated += point[0] * ca.dot(viscous, ca.jtimes(strain, nodal, rates))
        force += point[0] * ca.jtimes(strain, nodal, section_forces, True)
    return force, stored, dissipated
