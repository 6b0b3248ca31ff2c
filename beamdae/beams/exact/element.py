"""Geometrically exact beam element as one symbolic kernel.

E. Reissner, J. Appl. Math. Phys. (ZAMP) 23 (1972) 795; J. C. Simo, Comput. Methods Appl. Mech. Eng.
49 (1985) 55. The kernel computes the virtual work of one element from the positions and section
angles of its nodes. All numbers are inputs, so one kernel is shared by all elements of the same
type.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from beamdae.beams.element_data import ElementData, ElementDataLayout
from beamdae.beams.kinematics import Element, InertiaPoint, StrainRatePoint
from beamdae.beams.shape_functions import gauss_points, shape_functions
from beamdae.beams.strains import elastic_work, outer_strain_function
from beamdae.symbolic.formula import cache_kernels
from beamdae.symbolic.functions.compiled import RowFunction
from beamdae.symbolic.statements import SX, ForceKernel, Local

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

        The strains are r'.t - 1, r'.n and psi0' - psi' with the axes t = (cos psi, sin psi) and n
        of the section; kappa11 has the sign of Pan & Liu (2012). Rigid motions do not change the
        strains, which are zero in the reference configuration unless the stress-free shape differs.

        Parameters
        ----------
        points
            Values `STIFFNESS_POINT_VALUES` of each point, one column per point.
        q
            Local coordinates.
        """
        xi, _ = gauss_points(self.quadrature)
        rows, slopes = (shape_functions(self.nodes, xi, k) for k in (0, 1))
        nodal = ca.reshape(q, NODE_SIZE, self.nodes)
        # Slopes from differences of nodes, which are exact, have the rounding errors of the length
        # of an element instead of those of the distance from the origin.
        changes = nodal[:, 1:] - ca.repmat(nodal[:, 0], 1, self.nodes - 1)
        strains = []
        for row, slope, point in zip(rows, slopes, ca.horzsplit(points), strict=True):
            weight, dxi_ds, angle_offset, free_curvature = (
                point[k] for k in range(len(STIFFNESS_POINT_VALUES))
            )
            psi = nodal[2, :] @ row + angle_offset
            c, s = ca.cos(psi), ca.sin(psi)
            dx, dy, dpsi = ca.vertsplit(dxi_ds * (changes @ slope[1:]))
            strain = ca.vertcat(dx * c + dy * s - 1.0, dy * c - dx * s, free_curvature - dpsi)
            strains.append((weight, strain))
        return strains

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


@cache_kernels
def exact_kernel(element: ExactElement) -> ForceKernel:
    """Return the kernel of one element: forces of inertia, elasticity, damping and weight."""
    local = Local(element.size, element.n_data)
    data = element.layout.split(local.data)
    inertia, kinetic, potential = _inertial_work(element, local, data)
    strains = element.strain_points(data.stiffness, local.q)
    elastic, strain_energy, dissipated = elastic_work(
        strains, data, element.damped, local.q, local.v
    )
    energies = ca.vertcat(kinetic, strain_energy, potential)
    return ForceKernel(local, inertia + elastic, energies, ca.vertcat(0, dissipated), reused=True)


@cache
def strain_function(element: ExactElement) -> RowFunction:
    """Return the function of (q, data) for the largest axial strain of an element's fibers."""
    local = Local(element.size, element.n_data)
    data = element.layout.split(local.data)
    strains = [strain for _, strain in element.strain_points(data.stiffness, local.q)]
    return outer_strain_function(local, data, strains)


def _inertial_work(element: ExactElement, local: Local, data: ElementData) -> tuple[SX, SX, SX]:
    """Return generalized forces of inertia and weight, kinetic energy and potential of gravity."""
    q, v, a = (ca.reshape(z, NODE_SIZE, element.nodes) for z in (local.q, local.v, local.a))
    free_fall = ca.vertcat(data.gravity, 0)
    force, kinetic, potential = SX.zeros(NODE_SIZE, element.nodes), SX(0), SX(0)
    for k, row in enumerate(element._mass_rows):
        inertia = data.mass[0, k] * data.inertia(k)[[0, 0, 1]]
        force += (inertia * (a @ row - free_fall)) @ row[None, :]
        kinetic += 0.5 * ca.dot(inertia, (v @ row) ** 2)
        potential -= ca.dot(inertia * free_fall, q @ row)
    return ca.vec(force), kinetic, potential
