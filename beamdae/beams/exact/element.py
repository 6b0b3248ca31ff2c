"""Geometrically exact beam element: symbolic kernels of its quadrature points.

E. Reissner, J. Appl. Math. Phys. (ZAMP) 23 (1972) 795; J. C. Simo, Comput. Methods Appl. Mech. Eng.
49 (1985) 55. The kernels compute the virtual work of one point from position, section angle and
their slopes; shape functions are constant weights. All numbers are inputs, so the kernels are
shared by all points of elements of any degree.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from beamdae.beams.element_data import ElementDataLayout
from beamdae.beams.elements import NODE_SIZE, PointElement, PointMotion
from beamdae.beams.shape_functions import gauss_points, shape_functions, weigh_nodes
from beamdae.symbolic.statements import SX, ForceKernel, Local

MASS_POINT_VALUES = ("weight",)
# `angle_offset` is the angle of the axis minus the interpolated section angle in the reference
# configuration; `free_curvature` is psi0' of the stress-free shape.
STIFFNESS_POINT_VALUES = ("weight", "dxi_ds", "angle_offset", "free_curvature")


@dataclass(frozen=True)
class ExactElement(PointElement):
    """Geometrically exact element type; the coordinates are (x, y, psi) of each node."""

    @property
    def layout(self) -> ElementDataLayout:
        """Layout of the data of an element."""
        counts = (self.nodes, self.quadrature)
        return ElementDataLayout(*counts, MASS_POINT_VALUES, STIFFNESS_POINT_VALUES)

    @property
    def differences(self) -> ca.DM:
        """Matrix of the coordinates of the first node, and of the differences from them.

        Slopes from differences of nodes, which are exact, have the rounding errors of the length of
        an element instead of those of the distance from the origin.
        """
        steps = np.eye(self.nodes)
        steps[1:, 0] = -1.0
        return ca.sparsify(ca.DM(np.kron(steps, np.eye(NODE_SIZE))))

    @property
    def stiffness_weights(self) -> list[ca.DM]:
        """Matrices of (x, y, psi) and their slopes d/dxi at the stiffness points (6, size).

        They apply to the `differences`.
        """
        xi, _ = gauss_points(self.quadrature)
        rows, slopes = (shape_functions(self.nodes, xi, k) for k in (0, 1))
        rows[:, 0], slopes[:, 0] = 1.0, 0.0
        return [weigh_nodes(0, pair) for pair in zip(rows, slopes, strict=True)]

    def motion_at(self, q: SX, v: SX, point: SX) -> PointMotion:
        """Return the motion of an inertia point in the inertial frame."""
        return PointMotion(v[:2], v[2], q[2])

    def strain_at(self, z: SX, point: SX) -> SX:
        """Return (axial strain, shear strain, kappa11) at a stiffness point.

        The strains are r'.t - 1, r'.n and psi0' - psi' with the axes t = (cos psi, sin psi) and n
        of the section; kappa11 has the sign of Pan & Liu (2012). Rigid motions do not change the
        strains, which are zero in the reference configuration unless the stress-free shape differs.
        """
        _, dxi_ds, angle_offset, free_curvature = (
            point[k] for k in range(len(STIFFNESS_POINT_VALUES))
        )
        psi = z[NODE_SIZE - 1] + angle_offset
        c, s = ca.cos(psi), ca.sin(psi)
        dx, dy, dpsi = ca.vertsplit(dxi_ds * z[NODE_SIZE:])
        return ca.vertcat(dx * c + dy * s - 1.0, dy * c - dx * s, free_curvature - dpsi)

    def inertia_kernel(self) -> ForceKernel:
        """Return the kernel of inertia and weight of a point, in (x, y, psi)."""
        return _inertia_kernel()


@cache
def _inertia_kernel() -> ForceKernel:
    local = Local(NODE_SIZE, 5)
    weight, rhoA, rhoI, *gravity = ca.vertsplit(local.data)
    inertia, free_fall = weight * ca.vertcat(rhoA, rhoA, rhoI), ca.vertcat(*gravity, 0)
    kinetic = 0.5 * ca.dot(inertia, local.v**2)
    energies = ca.vertcat(kinetic, 0, -ca.dot(inertia * free_fall, local.q))
    return ForceKernel(local, inertia * (local.a - free_fall), energies)
