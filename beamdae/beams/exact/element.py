"""Geometrically exact beam element: symbolic kernels of its quadrature points.

E. Reissner, J. Appl. Math. Phys. (ZAMP) 23 (1972) 795; J. C. Simo, Comput. Methods Appl. Mech. Eng.
49 (1985) 55. The kernels compute the virtual work of one point from position, section angle and
their slopes; shape functions are constant weights. All numbers are inputs, so the kernels are
shared by all points of elements of any degree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np

from beamdae.beams.element_data import ElementDataLayout
from beamdae.beams.kinematics import Element, InertiaPoint, StrainRatePoint
from beamdae.beams.shape_functions import gauss_points, shape_functions, weigh_nodes
from beamdae.beams.strains import elastic_kernel, outer_strain_function
from beamdae.symbolic.formula import cache_kernels
from beamdae.symbolic.functions.compiled import RowFunction
from beamdae.symbolic.statements import SX, ForceKernel, Local, PointForce

NODE_SIZE = 3  # coordinates (x, y, psi) of a node
MASS_POINT_VALUES = ("weight",)
# `angle_offset` is the angle of the axis minus the interpolated section angle in the reference
# configuration; `free_curvature` is psi0' of the stress-free shape.
STIFFNESS_POINT_VALUES = ("weight", "dxi_ds", "angle_offset", "free_curvature")


@dataclass(frozen=True)
class ExactElement(Element):
    """Geometrically exact element type, defined by the properties that its kernel depends on.

    Attributes
    ----------
    nodes
        Number of nodes; Lagrange shape functions of degree nodes - 1.
    quadrature
        Number of Gauss points of the stiffness terms.
    damped
        True if the section has Kelvin-Voigt damping.
    varying
        True if the section varies along the beam.
    """

    nodes: int = 4
    quadrature: int = 3
    damped: bool = True
    varying: bool = False

    @property
    def size(self) -> int:
        """Number of local coordinates: (x, y, psi) of each node."""
        return NODE_SIZE * self.nodes

    @property
    def layout(self) -> ElementDataLayout:
        """Layout of the data, with as many inertia points as nodes."""
        return ElementDataLayout(
            self.nodes, self.quadrature, MASS_POINT_VALUES, STIFFNESS_POINT_VALUES, self.varying
        )

    @property
    def n_data(self) -> int:
        """Number of data values of one element."""
        return self.layout.size

    def kernel(self) -> ForceKernel:
        """Return the kernel of the forces of inertia, elasticity, material damping and weight."""
        return exact_kernel(self)

    def strain_points(self, points: SX, q: SX) -> list[tuple[SX, SX]]:
        """Return weight and (axial strain, shear strain, kappa11) of each stiffness point.

        Parameters
        ----------
        points
            Values `STIFFNESS_POINT_VALUES` of each point, one column per point.
        q
            Local coordinates.
        """
        changes = SX(self._differences) @ q
        columns = zip(self._stiffness_weights, ca.horzsplit(points), strict=True)
        return [
            (point[0], _strain(self, SX(weights) @ changes, point)) for weights, point in columns
        ]

    def inertia_points(self, local: Local) -> list[InertiaPoint]:
        """Return the motion of the inertia points in the inertial frame."""
        data = self.layout.split(local.data)
        q, v = (ca.reshape(z, NODE_SIZE, self.nodes) for z in (local.q, local.v))
        return [
            InertiaPoint(
                data.mass[0, k],
                data.inertia(k)[[0, 0, 1]],
                v[:2, :] @ row,
                v[2, :] @ row,
                q[2, :] @ row,
            )
            for k, row in enumerate(self._mass_rows)
        ]

    def strain_rate_points(self, local: Local) -> list[StrainRatePoint]:
        """Return the strain rates at the stiffness points of the deformed beam."""
        data = self.layout.split(local.data)
        return [
            StrainRatePoint(weight, data.elasticity(k), local.dot(strain))
            for k, (weight, strain) in enumerate(self.strain_points(data.stiffness, local.q))
        ]

    @property
    def _mass_rows(self) -> np.ndarray:
        """Shape functions at the inertia points."""
        xi, _ = gauss_points(self.nodes)
        return shape_functions(self.nodes, xi)

    @property
    def _differences(self) -> ca.DM:
        """Matrix of the coordinates of the first node, and of the differences from them.

        Slopes from differences of nodes, which are exact, have the rounding errors of the length of
        an element instead of those of the distance from the origin.
        """
        steps = np.eye(self.nodes)
        steps[1:, 0] = -1.0
        return ca.sparsify(ca.DM(np.kron(steps, np.eye(NODE_SIZE))))

    @property
    def _stiffness_weights(self) -> list[ca.DM]:
        """Matrices of (x, y, psi) and their slopes d/dxi at the stiffness points (6, size).

        They apply to the differences.
        """
        xi, _ = gauss_points(self.quadrature)
        rows, slopes = (shape_functions(self.nodes, xi, k) for k in (0, 1))
        rows[:, 0], slopes[:, 0] = 1.0, 0.0
        return [weigh_nodes(0, pair) for pair in zip(rows, slopes, strict=True)]


def _strain(element: ExactElement, z: SX, point: SX) -> SX:
    """Return (axial strain, shear strain, kappa11) at a stiffness point.

    The strains are r'.t - 1, r'.n and psi0' - psi' with the axes t = (cos psi, sin psi) and n of
    the section; kappa11 has the sign of Pan & Liu (2012). Rigid motions do not change the strains,
    which are zero in the reference configuration unless the stress-free shape differs.
    """
    _, dxi_ds, angle_offset, free_curvature = (point[k] for k in range(len(STIFFNESS_POINT_VALUES)))
    psi = z[NODE_SIZE - 1] + angle_offset
    c, s = ca.cos(psi), ca.sin(psi)
    dx, dy, dpsi = ca.vertsplit(dxi_ds * z[NODE_SIZE:])
    return ca.vertcat(dx * c + dy * s - 1.0, dy * c - dx * s, free_curvature - dpsi)


@cache_kernels
def exact_kernel(element: ExactElement) -> ForceKernel:
    """Return the kernel of one element: forces of inertia, elasticity, damping and weight."""
    local = Local(element.size, element.n_data)
    data, same = element.layout.split(local.data), ca.DM.eye(element.size)
    inertia = _inertia_kernel()
    points = [
        PointForce(
            same,
            weigh_nodes(0, [row]),
            inertia,
            ca.vertcat(data.mass[0, k], data.inertia(k), data.gravity),
        )
        for k, row in enumerate(element._mass_rows)
    ]
    one_size = replace(element, nodes=2, quadrature=1, varying=False)
    elasticity = elastic_kernel(one_size, 2 * NODE_SIZE, _strain)
    values = len(STIFFNESS_POINT_VALUES)
    points += [
        PointForce(
            element._differences,
            weights,
            elasticity,
            ca.vertcat(data.stiffness[:values, k], data.elasticity(k), data.damping(k)),
        )
        for k, weights in enumerate(element._stiffness_weights)
    ]
    return ForceKernel.of_points(local, points)


@cache
def _inertia_kernel() -> ForceKernel:
    """Return the kernel of inertia and weight of a point, in (x, y, psi)."""
    local = Local(NODE_SIZE, 5)
    weight, rhoA, rhoI, *gravity = ca.vertsplit(local.data)
    inertia, free_fall = weight * ca.vertcat(rhoA, rhoA, rhoI), ca.vertcat(*gravity, 0)
    kinetic = 0.5 * ca.dot(inertia, local.v**2)
    energies = ca.vertcat(kinetic, 0, -ca.dot(inertia * free_fall, local.q))
    return ForceKernel(local, inertia * (local.a - free_fall), energies)


@cache
def strain_function(element: ExactElement) -> RowFunction:
    """Return the function of (q, data) for the largest axial strain of an element's fibers."""
    local = Local(element.size, element.n_data)
    data = element.layout.split(local.data)
    strains = [strain for _, strain in element.strain_points(data.stiffness, local.q)]
    return outer_strain_function(local, data, strains)
