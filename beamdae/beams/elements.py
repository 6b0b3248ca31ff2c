"""Element types, and elements as sums over points whose kernels serve elements of any degree."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from beamdae.beams.element_data import ElementDataLayout
from beamdae.beams.shape_functions import gauss_points, shape_functions, weigh_nodes
from beamdae.beams.strains import STRAIN_SIZE
from beamdae.symbolic.formula import cache_kernels
from beamdae.symbolic.functions.compiled import RowFunction
from beamdae.symbolic.statements import SX, ForceKernel, Local, PointForce

Array = np.ndarray

NODE_SIZE = 3  # coordinates of a node


class InertiaPoint(NamedTuple):
    """Quadrature point of the inertia terms.

    Attributes
    ----------
    weight
        Length of axis that the point represents [m].
    density
        Inertia per length for the components of (velocity, angular velocity):
        (rhoA [kg/m], rhoA [kg/m], rhoI [kg m]).
    velocity
        Velocity of the axis relative to the inertial frame (2,) [m/s], resolved in any orthogonal
        axes.
    angular_velocity
        Angular velocity of the section [rad/s].
    rotation
        Angle of the section relative to the axes of `velocity` [rad].
    """

    weight: SX
    density: SX
    velocity: SX
    angular_velocity: SX
    rotation: SX


class StrainRatePoint(NamedTuple):
    """Quadrature point of the stiffness terms.

    Attributes
    ----------
    weight
        Length of axis that the point represents [m].
    stiffness
        (EA [N], GA [N], EI [N m^2]).
    rates
        Rates of axial strain [1/s], shear strain [1/s] and kappa11 [1/(m s)] of the deformed beam,
        linear in the velocities.
    """

    weight: SX
    stiffness: SX
    rates: SX


class Element(ABC):
    """Symbolic element type; hashable, with all numbers as inputs (`local.data`)."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of local coordinates of an element."""

    @property
    @abstractmethod
    def n_data(self) -> int:
        """Number of data values of one element."""

    @abstractmethod
    def kernel(self) -> ForceKernel:
        """Return the kernel of the forces of inertia, elasticity, material damping and weight.

        Equal elements must return the same object, because all elements that share a kernel are
        evaluated together.
        """

    @abstractmethod
    def inertia_points(self, local: Local) -> list[InertiaPoint]:
        """Return the motion of the inertia points; `local.data` may end with additional values."""

    @abstractmethod
    def strain_rate_points(self, local: Local) -> list[StrainRatePoint]:
        """Return the strain rates at the stiffness points; `local.data` as in `inertia_points`."""


@dataclass(frozen=True)
class PointElement(Element):
    """Element type, defined by the properties that the kernels of its points depend on.

    Attributes
    ----------
    nodes
        Number of nodes (4 in Pan & Liu, 2012, eq. 12); Lagrange shape functions of degree
        nodes - 1. As many inertia points integrate products of two shape functions exactly.
    quadrature
        Number of Gauss points of the stiffness terms.
    damped
        True if the section has Kelvin-Voigt damping, without which the tangent matrix needs fewer
        operations.
    varying
        True if the section varies along the beam.
    """

    nodes: int = 4
    quadrature: int = 3
    damped: bool = True
    varying: bool = False

    @property
    def frame_size(self) -> int:
        """Number of coordinates of the floating frame, before those of the nodes."""
        return 0

    @property
    def size(self) -> int:
        """Number of local coordinates: those of the frame, then three of each node."""
        return self.frame_size + NODE_SIZE * self.nodes

    @property
    @abstractmethod
    def layout(self) -> ElementDataLayout:
        """Layout of the data of an element."""

    @property
    def n_data(self) -> int:
        """Number of data values of one element."""
        return self.layout.size

    @abstractmethod
    def inertia_kernel(self) -> ForceKernel:
        """Return the kernel of inertia and weight of a point.

        Its coordinates are those of the frame and the interpolated ones of the nodes. Its data are
        the values of `layout.mass_point`, then rhoA, rhoI and gravity (2,).
        """

    @abstractmethod
    def strain_at(self, z: SX, point: SX) -> SX:
        """Return (axial strain, shear strain, kappa11) at a stiffness point.

        Parameters
        ----------
        z
            Interpolated coordinates of the nodes, then their derivatives with respect to xi.
        point
            Values of `layout.stiffness_point`; further ones may follow.
        """

    @property
    def differences(self) -> ca.DM:
        """Matrix of local coordinates whose combinations are interpolated at stiffness points."""
        return ca.DM.eye(self.size)

    @property
    def mass_weights(self) -> list[ca.DM]:
        """Matrices of the coordinates at each inertia point."""
        xi, _ = gauss_points(self.nodes)
        frame = np.eye(self.frame_size, self.size)
        rows = shape_functions(self.nodes, xi)
        return [weigh_nodes(self.frame_size, [row], frame) for row in rows]

    @property
    def stiffness_weights(self) -> list[ca.DM]:
        """Matrices of the coordinates and derivatives at each stiffness point (6, size).

        They apply to the `differences`.
        """
        xi, _ = gauss_points(self.quadrature)
        rows, slopes = (shape_functions(self.nodes, xi, k) for k in (0, 1))
        return [weigh_nodes(self.frame_size, pair) for pair in zip(rows, slopes, strict=True)]

    def strains_on_copies(self, columns: Array, data: Array) -> Array:
        """Return the strains at the stiffness points of elements, (3, elements, points, k).

        Parameters
        ----------
        columns
            Local coordinates (elements, size, k).
        data
            Data of the elements (n_data, elements).
        """
        layout, differences = self.layout, self.differences.full()
        weights = np.array([x.full() @ differences for x in self.stiffness_weights])
        z = np.einsum("pzs,esk->epzk", weights, columns)
        points = layout.stiffness_values(data)[:, :, : len(layout.stiffness_point)]
        copies = z.reshape(-1, *z.shape[2:])
        # Points of elements of all degrees share a function.
        kind = replace(self, nodes=2, quadrature=1, damped=False, varying=False)
        strains = _strain_function(kind).on_copies(copies, points.reshape(len(copies), -1).T)
        return strains.reshape(STRAIN_SIZE, *z.shape[:2], -1)

    def kernel(self) -> ForceKernel:
        """Return the kernel of the forces of inertia, elasticity, material damping and weight."""
        return element_kernel(self)

    def strain_points(self, points: SX, q: SX) -> list[tuple[SX, SX]]:
        """Return weight and strains of each stiffness point.

        Parameters
        ----------
        points
            Values of `layout.stiffness_point` of each point, one column per point; further rows may
            follow.
        q
            Local coordinates.
        """
        changes = SX(self.differences) @ q
        columns = zip(self.stiffness_weights, ca.horzsplit(points), strict=True)
        return [
            (point[0], self.strain_at(SX(weights) @ changes, point)) for weights, point in columns
        ]

    def strain_rate_points(self, local: Local) -> list[StrainRatePoint]:
        """Return the strain rates at the stiffness points of the deformed beam."""
        data = self.layout.split(local.data)
        return [
            StrainRatePoint(weight, data.elasticity(k), local.dot(strain))
            for k, (weight, strain) in enumerate(self.strain_points(data.stiffness, local.q))
        ]


@cache_kernels
def element_kernel(element: PointElement) -> ForceKernel:
    """Return the kernel of one element, the sum over its points."""
    local, layout = Local(element.size, element.n_data), element.layout
    data, inertia = layout.split(local.data), element.inertia_kernel()
    # Points of elements of all degrees share a kernel.
    elasticity = _elastic_kernel(replace(element, nodes=2, quadrature=1, varying=False))
    points = []
    for k, weights in enumerate(element.mass_weights):
        values = data.mass[: len(layout.mass_point), k]
        numbers = ca.vertcat(values, data.inertia(k), data.gravity)
        points.append(PointForce(ca.DM.eye(element.size), weights, inertia, numbers))
    for k, weights in enumerate(element.stiffness_weights):
        values = data.stiffness[: len(layout.stiffness_point), k]
        numbers = ca.vertcat(values, data.elasticity(k), data.damping(k))
        points.append(PointForce(element.differences, weights, elasticity, numbers))
    return ForceKernel.of_points(local, points)


@cache
def _elastic_kernel(element: PointElement) -> ForceKernel:
    """Return the kernel of elasticity and damping of a stiffness point.

    The section forces are D (eps + damping eps') with D = diag(EA, GA, EI), eq. (21) of Pan & Liu
    (2012). The data are the values of `layout.stiffness_point`, which begin with the weight [m],
    then (EA, GA, EI) and the retardation time.
    """
    values = len(element.layout.stiffness_point)
    local = Local(2 * NODE_SIZE, values + STRAIN_SIZE + 1)
    weight, stiffness = local.data[0], local.data[values : values + STRAIN_SIZE]
    strain = element.strain_at(local.q, local.data)
    section_forces = stiffness * strain
    energy, dissipated = 0.5 * weight * ca.dot(section_forces, strain), SX(0)
    if element.damped:
        strain_rate = ca.jtimes(strain, local.q, local.v)
        viscous = local.data[-1] * stiffness * strain_rate
        section_forces += viscous
        dissipated = weight * ca.dot(viscous, strain_rate)
    force = weight * ca.jtimes(strain, local.q, section_forces, True)
    return ForceKernel(local, force, ca.vertcat(0, energy, 0), ca.vertcat(0, dissipated))


@cache
def _strain_function(element: PointElement) -> RowFunction:
    z, point = SX.sym("z", 2 * NODE_SIZE), SX.sym("point", len(element.layout.stiffness_point))
    return RowFunction(ca.Function("strains", [z, point], [element.strain_at(z, point)]))
