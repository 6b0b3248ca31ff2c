"""The geometrically exact beam element as one symbolic kernel.

E. Reissner, J. Appl. Math. Phys. (ZAMP) 23 (1972) 795; J. C. Simo, Comput. Methods Appl. Mech. Eng.
49 (1985) 55. The kernel states the virtual work of one element in positions and section angles of
its nodes; all numbers are inputs, so one kernel serves every element of a type in every beam.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from beamdae.beams.element_data import ElementData, ElementDataLayout
from beamdae.beams.kinematics import Element, InertiaPoint, StrainRatePoint
from beamdae.beams.shape_functions import gauss_points, shape_functions
from beamdae.beams.strains import elastic_work
from beamdae.symbolic.statements import SX, ForceKernel, Local

NODE_SIZE = 3
MASS_POINT_VALUES = ("weight",)
# Angle of the axis less that of the interpolated nodes, and psi0' of the shape free of strain.
STIFFNESS_POINT_VALUES = ("weight", "dxi_ds", "apart", "bending")


@dataclass(frozen=True)
class ExactElement(Element):
    """What distinguishes one kernel from another.

    Attributes
    ----------
    nodes
        Number of nodes; Lagrange shape functions of degree nodes - 1.
    quadrature
        Gauss points of the stiffness terms.
    damped
        Whether the section has Kelvin-Voigt damping.
    varying
        Whether the section varies along the beam.
    """

    nodes: int = 4
    quadrature: int = 3
    damped: bool = True
    varying: bool = False

    @property
    def size(self) -> int:
        """Local coordinates: (x, y, psi) of each node."""
        return NODE_SIZE * self.nodes

    @property
    def layout(self) -> ElementDataLayout:
        """Where its numbers stand; inertia is exact for products of two shape functions."""
        return ElementDataLayout(
            self.nodes, self.quadrature, MASS_POINT_VALUES, STIFFNESS_POINT_VALUES, self.varying
        )

    @property
    def n_data(self) -> int:
        """Numbers a copy of the kernel takes."""
        return self.layout.size

    def kernel(self) -> ForceKernel:
        """Virtual work of inertia, elasticity, damping and weight."""
        return exact_kernel(self)

    def strain_points(self, points: SX, q: SX) -> list[tuple[SX, SX]]:
        """Weight, and (axial strain, shear strain, kappa11), of the stiffness points.

        r'.t - 1, r'.n and psi0' - psi' with the axes t = (cos psi, sin psi) and n of the section:
        kappa11 has the sign of the paper's beam. Zero of the elements as drawn, and in any rigid
        motion of them. `points` has a column of `STIFFNESS_POINT_VALUES` each and what is behind it.
        """
        xi, _ = gauss_points(self.quadrature)
        rows, slopes = (shape_functions(self.nodes, xi, k) for k in (0, 1))
        nodal = ca.reshape(q, NODE_SIZE, self.nodes)
        found = []
        for row, slope, point in zip(rows, slopes, ca.horzsplit(points), strict=True):
            weight, dxi_ds, apart, bending = (point[k] for k in range(4))
            psi = nodal[2, :] @ row + apart
            c, s = ca.cos(psi), ca.sin(psi)
            x, y, turned = ca.vertsplit(dxi_ds * (nodal @ slope))
            strain = ca.vertcat(x * c + y * s - 1.0, y * c - x * s, bending - turned)
            found.append((weight, strain))
        return found

    def inertia_points(self, local: Local) -> list[InertiaPoint]:
        """How the inertia points move, in the inertial frame."""
        data = self.layout.split(local.data)
        motion = (ca.reshape(z, NODE_SIZE, self.nodes) for z in (local.q, local.v))
        q, v = motion
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
        """Strain rates at the stiffness points, of the beam as it is bent."""
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


@cache
def exact_kernel(kind: ExactElement) -> ForceKernel:
    """Virtual work of one element: inertia, elasticity and damping."""
    local = Local(kind.size, kind.n_data)
    data = kind.layout.split(local.data)
    inertia, kinetic, potential = _inertial_work(kind, local, data)
    strains = kind.strain_points(data.stiffness, local.q)
    elastic, stored, dissipated = elastic_work(strains, data, kind.damped, local.q, local.v)
    energies = ca.vertcat(kinetic, stored, potential)
    return ForceKernel(local, inertia + elastic, energies, ca.vertcat(0, dissipated), reused=True)


def _inertial_work(kind: ExactElement, local: Local, data: ElementData) -> tuple[SX, SX, SX]:
    """Inertial forces and weight, by a constant mass matrix; kinetic and gravity energy."""
    q, v, a = (ca.reshape(z, NODE_SIZE, kind.nodes) for z in (local.q, local.v, local.a))
    fall = ca.vertcat(data.gravity, 0)
    force, kinetic, potential = SX.zeros(NODE_SIZE, kind.nodes), SX(0), SX(0)
    for k, row in enumerate(kind._mass_rows):
        inertia = data.mass[0, k] * data.inertia(k)[[0, 0, 1]]
        force += (inertia * (a @ row - fall)) @ row[None, :]
        kinetic += 0.5 * ca.dot(inertia, (v @ row) ** 2)
        potential -= ca.dot(inertia * fall, q @ row)
    return ca.vec(force), kinetic, potential
