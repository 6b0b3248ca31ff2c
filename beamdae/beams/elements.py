"""Element types, and elements as sums over points whose kernels serve elements of any degree.

Element kernels contain no numbers. Each element passes one column of `data`: the values at its
inertia points, the values at its stiffness points, and gravity. The values of a point are those of
the formulation, then those of the section.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from operator import attrgetter
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.beams.mesh import Mesh
from beamdae.beams.sections import Section, VaryingSection
from beamdae.beams.shape_functions import gauss_points, shape_functions, weigh_nodes
from beamdae.beams.strains import SHEAR, STRAIN_SIZE, slice_column
from beamdae.curves.plane_curves import PlaneCurve, require_curve
from beamdae.errors import BeamdaeError
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.force_kernel import CompliantForm, mix_law
from beamdae.symbolic.formula import cache_kernels
from beamdae.symbolic.statements import SX, ConstraintKernel, ForceAtPoint, ForceKernel, Local

# Properties of the section, appended to the values of each inertia point and stiffness point: mass
# and rotary inertia per length, stiffnesses, and the Kelvin-Voigt retardation time.
INERTIA_VALUES = ("rhoA", "rhoI")
STIFFNESS_VALUES = ("EA", "GA", "EI", "damping")
_GRAVITY_SIZE = 2

# Axial strain, relative to the length of the free curve; the strain measures assume small strains.
_MAX_INITIAL_STRAIN = 0.01


@dataclass(frozen=True)
class ElementDataLayout:
    """Order and number of the values in the data of one element.

    Attributes
    ----------
    mass_points, stiffness_points
        Numbers of inertia points and of stiffness points.
    mass_point, stiffness_point
        Names of the values that the formulation requires at each point; the first is "weight".
    """

    mass_points: int
    stiffness_points: int
    mass_point: tuple[str, ...]
    stiffness_point: tuple[str, ...]

    @property
    def mass_size(self) -> int:
        """Number of values of all inertia points."""
        return self.mass_points * len(self.mass_point + INERTIA_VALUES)

    @property
    def size(self) -> int:
        """Number of values of one element, including gravity."""
        stiffness_point = len(self.stiffness_point + STIFFNESS_VALUES)
        return self.mass_size + self.stiffness_points * stiffness_point + _GRAVITY_SIZE

    @property
    def stiffness_rows(self) -> slice:
        """Rows of the values of all stiffness points in the data of an element."""
        return slice(self.mass_size, self.size - _GRAVITY_SIZE)

    def stiffness_values(self, data: Array) -> Array:
        """Return the values of the stiffness points of all elements, (elements, points, values)."""
        return data[self.stiffness_rows].T.reshape(data.shape[1], self.stiffness_points, -1)

    def split_mass(self, data: SX) -> list[SX]:
        """Return the values of each inertia point, each followed by gravity (2,) [m/s^2]."""
        points = ca.reshape(data[: self.mass_size], -1, self.mass_points)
        gravity = data[self.size - _GRAVITY_SIZE : self.size]
        return [ca.vertcat(x, gravity) for x in ca.horzsplit(points)]

    def split_stiffness(self, data: SX) -> list[SX]:
        """Return the values of each stiffness point."""
        values = data[self.stiffness_rows]
        return ca.horzsplit(ca.reshape(values, -1, self.stiffness_points))


def is_damped(section: Section | VaryingSection, mesh: Mesh, points: int) -> bool:
    """Return True if the section has Kelvin-Voigt damping at any Gauss point.

    `points` is the number of Gauss points per element.
    """
    if isinstance(section, Section):
        return section.damping > 0.0
    return any(section.at(s).damping > 0.0 for s in mesh.gauss_arc_lengths(points))


def assemble_point_data(
    mesh: Mesh,
    layout: ElementDataLayout,
    section: Section | VaryingSection,
    mass: Sequence[Array],
    stiffness: Sequence[Array],
) -> Array:
    """Return the values of all quadrature points, one column per element.

    `mass` and `stiffness` contain one array for each name in `layout.mass_point` and
    `layout.stiffness_point`, with the values at the points of all elements in order.
    """
    columns = []
    for values, points, names in (
        (mass, layout.mass_points, INERTIA_VALUES),
        (stiffness, layout.stiffness_points, STIFFNESS_VALUES),
    ):
        sections = [section.at(s) for s in mesh.gauss_arc_lengths(points).tolist()]
        of_section = np.array([attrgetter(*names)(x) for x in sections]).T
        columns.append(np.stack([*values, *of_section], axis=-1).reshape(mesh.elements, -1).T)
    return np.concatenate(columns)


def compute_prestrains(curve: PlaneCurve, free: PlaneCurve | None, s: Array) -> list[Array]:
    """Return axial strain [-] and kappa11 [1/m] of the reference configuration at `s` [m].

    Strains are relative to the stress-free shape `free`; the list is empty if `free` is None.
    Cross-sections are normal to the axis in both shapes.
    """
    if free is None:
        return []
    ratio = free.length / curve.length
    return [
        np.full(len(s), 1.0 / ratio - 1.0),
        ratio * free.curvature(ratio * s) - curve.curvature(s),
    ]


def require_free_curve(part: str, free: Any, curve: PlaneCurve) -> None:
    """Raise BeamdaeError unless `free` is a curve that is as long as `curve`, within 1 %."""
    free = require_curve(f"{part}, free_curve", free)
    if not abs(curve.length - free.length) <= _MAX_INITIAL_STRAIN * free.length:
        raise BeamdaeError(
            f"{part}: the length of the curve, {curve.length:.6g} m, must differ by at most "
            f"{100.0 * _MAX_INITIAL_STRAIN:.0f} % from the length of free_curve, "
            f"{free.length:.6g} m; change free_curve."
        )


Array = np.ndarray

NODE_SIZE = 3  # coordinates of a node
RESULTANTS = 2  # axial and shear force
# Axial and shear stiffness that remain beside the resultants, in bending stiffnesses of an element.
_BENDING_MULTIPLE = 12.0


class PointMotion(NamedTuple):
    """Motion of a section.

    Attributes
    ----------
    velocity
        Velocity of the axis relative to the inertial frame (2,) [m/s], resolved in any orthogonal
        axes.
    angular_velocity
        Angular velocity of the section [rad/s].
    rotation
        Angle of the section relative to the axes of `velocity` [rad].
    """

    velocity: SX
    angular_velocity: SX
    rotation: SX

    @property
    def rates(self) -> SX:
        """Components of velocity, then angular velocity."""
        return ca.vertcat(self.velocity, self.angular_velocity)


@dataclass(frozen=True)
class PointElement(ABC):
    """Element type, defined by the properties that the kernels of its points depend on.

    All numbers are inputs of the kernels. The coordinates of an inertia point are those of the
    frame and the interpolated ones of the nodes; those of a stiffness point are the interpolated
    ones of the nodes, then their derivatives with respect to xi.

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
    """

    nodes: int = 4
    quadrature: int = 3
    damped: bool = True

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

        Its data are the values of `layout.mass_point`, then rhoA, rhoI and gravity (2,).
        """

    @abstractmethod
    def motion_at(self, q: SX, v: SX, point: SX) -> PointMotion:
        """Return the motion of an inertia point with the coordinates `q` and velocities `v`.

        `point` begins with the values of `layout.mass_point`.
        """

    @abstractmethod
    def strain_at(self, z: SX, point: SX) -> SX:
        """Return (axial strain, shear strain, kappa11) at a stiffness point.

        `z` are its coordinates, and `point` begins with the values of `layout.stiffness_point`.
        """

    def force_rotation_at(self, z: SX) -> SX:
        """Return the rotation of the section from the direction of EA eps11 [rad].

        It is zero by default: strains refer to the axes of the section.
        """
        return SX(0)

    @property
    def of_point(self) -> PointElement:
        """Element type with the same kernels of points, for elements of all degrees."""
        return replace(self, nodes=2, quadrature=1)

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
        layout = self.layout
        weights = np.array([x.full() for x in self.stiffness_weights])
        differences = np.einsum("st,etk->esk", self.differences.full(), columns)
        z = np.einsum("pzs,esk->epzk", weights, differences)
        points = layout.stiffness_values(data)[:, :, : len(layout.stiffness_point)]
        copies = z.reshape(-1, *z.shape[2:])
        function = _strain_function(replace(self.of_point, damped=False))
        strains = function.on_copies(copies, points.reshape(len(copies), -1).T)
        return strains.reshape(STRAIN_SIZE, *z.shape[:2], -1)

    def mass_points(self, kernel: ForceKernel, numbers: Sequence[SX]) -> list[ForceAtPoint]:
        """Return the forces of a kernel at the inertia points, with the numbers of each point."""
        eye = ca.DM.eye(self.size)
        pairs = zip(self.mass_weights, numbers, strict=True)
        return [ForceAtPoint(eye, weights, kernel, values) for weights, values in pairs]

    def stiffness_points(self, kernel: ForceKernel, numbers: Sequence[SX]) -> list[ForceAtPoint]:
        """Return the forces of a kernel at the stiffness points, with the numbers of each point."""
        pairs = zip(self.stiffness_weights, numbers, strict=True)
        return [
            ForceAtPoint(self.differences, weights, kernel, values) for weights, values in pairs
        ]

    def kernel(self) -> ForceKernel:
        """Return the kernel of the forces of inertia, elasticity, material damping and weight.

        Equal elements return the same object, because all elements that share a kernel are
        evaluated together.
        """
        return element_kernel(self)


@cache_kernels
def element_kernel(element: PointElement) -> ForceKernel:
    """Return the kernel of one element, the sum over its points."""
    local, layout = Local(element.size, element.n_data), element.layout
    inertia, elasticity = element.inertia_kernel(), stiffness_kernel(element.of_point)
    points = element.mass_points(inertia, layout.split_mass(local.data))
    points += element.stiffness_points(elasticity, layout.split_stiffness(local.data))
    weights = np.array([x.full() for x in element.stiffness_weights])
    operators = weights @ element.differences.full()
    split = partial(_split_stiffness, layout)
    form = CompliantForm(_resultant_kernel(element.of_point), operators, split)
    return ForceKernel.of_points(local, points, form)


def _split_stiffness(
    layout: ElementDataLayout, data: Array, idle: Array | None = None
) -> tuple[Array, ...]:
    """Return the arrays of `CompliantForm.split`: the rest is bending, and shares of EA and GA.

    The shares, at most half, have the size of the bending stiffness. They keep the stiffness
    without resultants regular inside elements, which are eliminated with pivots on the diagonal.
    Points of elements have stiffness; none is `idle`.
    """
    rest = data.copy()
    values, first = layout.stiffness_values(data), len(layout.stiffness_point)
    whole, bending = values[..., first : first + RESULTANTS], values[..., first + RESULTANTS]
    size = bending / np.sum(values[..., 0], axis=1, keepdims=True) ** 2
    share = np.minimum(0.5 * whole, _BENDING_MULTIPLE * size[..., None])
    soft, stiff = values.copy(), values[..., : first + RESULTANTS].copy()
    soft[..., first : first + RESULTANTS], stiff[..., first:] = share, whole - share
    rest[layout.stiffness_rows] = soft.reshape(data.shape[1], -1).T
    times = np.broadcast_to(values[..., -1:], share.shape)
    return rest, stiff, times, share / (whole - share)


@cache
def _resultant_kernel(element: PointElement) -> ConstraintKernel:
    """Return the constraints of the axial and shear strains of a point."""
    first = len(element.layout.stiffness_point)
    local = Local(2 * NODE_SIZE, first + RESULTANTS, RESULTANTS)
    strain, stiffness = element.strain_at(local.q, local.data), local.data[first:]
    return ConstraintKernel(local, ca.sqrt(local.data[0] * stiffness) * strain[:RESULTANTS], True)


class StiffnessPoint(NamedTuple):
    """Strains and section forces at a stiffness point, in its coordinates and data.

    The section forces are D (eps + tau eps') with D = diag(EA, GA, EI), eq. (21) of Pan & Liu
    (2012): `elastic` plus `viscous`. The data are the values of `layout.stiffness_point`, then EA,
    GA, EI and the retardation time tau.
    """

    local: Local
    strain: SX
    strain_rate: SX
    elastic: SX
    viscous: SX

    @classmethod
    def of(cls, element: PointElement) -> StiffnessPoint:
        """Return the point of an element type."""
        first = len(element.layout.stiffness_point)
        local = Local(2 * NODE_SIZE, first + len(STIFFNESS_VALUES))
        stiffness, time = local.data[first:-1], local.data[-1] if element.damped else SX(0)
        strain = element.strain_at(local.q, local.data)
        rate = ca.jtimes(strain, local.q, local.v)
        return cls(local, strain, rate, stiffness * strain, time * stiffness * rate)


@cache
def stiffness_kernel(element: PointElement, has_elasticity: bool = True) -> ForceKernel:
    """Return the kernel of elasticity and damping, or of damping alone, of a stiffness point."""
    local, strain, rate, elastic, viscous = StiffnessPoint.of(element)
    elastic = elastic if has_elasticity else SX.zeros(STRAIN_SIZE)
    weight = local.data[0]
    force = weight * ca.jtimes(strain, local.q, elastic + viscous, True)
    energies = ca.vertcat(0, 0.5 * weight * ca.dot(elastic, strain), 0)
    powers = ca.vertcat(0, weight * ca.dot(viscous, rate))
    mix = partial(mix_law, local, strain, weight * (elastic + viscous), RESULTANTS)
    return ForceKernel(local, force, energies, powers, mix=mix)


@dataclass(frozen=True)
class InterpolatedForces:
    """Section forces at a section, interpolated between the stiffness points of an element.

    `numbers` are the weights of the stiffness points at the section, then the data of each point.
    Where stiffnesses have kinks or jumps, section forces are smooth, but strains are not.
    """

    element: PointElement

    def __call__(self, local: Local, numbers: Any) -> SX:
        """Return (conjugate elastic forces (3,), conjugate viscous forces (3,), rest of N) (7,).

        The rest of N is N minus the force conjugate to the axial strain.
        """
        kernel = stiffness_kernel(self.element.of_point)
        points = partial(self.element.stiffness_points, kernel)
        return self.interpolate(local, numbers, points, _section_force_function)

    def interpolate(
        self,
        local: Local,
        numbers: Any,
        points_of: Callable[[list[SX]], list[ForceAtPoint]],
        function_of: Callable[[PointElement], ca.Function],
    ) -> SX:
        """Return the interpolated values of a function of (q, v, data) of the points."""
        count, total = self.element.quadrature, SX(0)
        function = function_of(self.element.of_point)
        values = ca.reshape(slice_column(numbers, count, function.numel_in(2) * count), -1, count)
        for k, point in enumerate(points_of(ca.horzsplit(values))):
            _, q, v, _, data = point.inputs(local)
            total += numbers[k] * function(q, v, data)
        return total


@cache
def _section_force_function(element: PointElement) -> ca.Function:
    local, _, _, elastic, viscous = StiffnessPoint.of(element)
    rest = ca.sin(element.force_rotation_at(local.q)) * (elastic + viscous)[SHEAR]
    values = ca.densify(ca.vertcat(elastic, viscous, rest))
    return ca.Function("section_forces", [local.q, local.v, local.data], [values])


@cache
def _strain_function(element: PointElement) -> RowFunction:
    z, point = SX.sym("z", 2 * NODE_SIZE), SX.sym("point", len(element.layout.stiffness_point))
    return RowFunction(ca.Function("strains", [z, point], [element.strain_at(z, point)]))
