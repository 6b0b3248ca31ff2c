"""Geometrically exact beams: positions and section angles of their nodes.

E. Reissner, J. Appl. Math. Phys. (ZAMP) 23 (1972) 795; J. C. Simo, Comput. Methods Appl. Mech. Eng.
49 (1985) 55. The kernels of the element compute the virtual work of one point from position,
section angle and their slopes; shape functions are constant weights. All numbers are inputs, so the
kernels are shared by all points of elements of any degree.

`ExactSectionMotion` and `chord_motion` are kinds of a `Formula`; see `symbolic.formula`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.beams.elements import (
    NODE_SIZE,
    ElementDataLayout,
    PointElement,
    PointMotion,
    assemble_point_data,
    is_damped,
)
from beamdae.beams.kinematics import (
    FormulationKinematics,
    MaterialPoint,
    Placement,
    PointValues,
    chord_vector,
    geometric_property,
)
from beamdae.beams.shape_functions import gauss_points, shape_functions, weigh_nodes
from beamdae.beams.strains import slice_column
from beamdae.parts.attachments import rotate
from beamdae.parts.observables import express_displacement
from beamdae.parts.part import PointFormula
from beamdae.read_only import read_only_data
from beamdae.symbolic.formula import Formula, FormulaExpression, constant_formula
from beamdae.symbolic.sparse_operators import build_selection
from beamdae.symbolic.statements import SX, ForceKernel, Local, Variable

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


Array = np.ndarray

# Largest distance from the interpolated axis, relative to the length of the beam, at which a
# section is considered to lie on the axis.
_MAX_AXIS_OFFSET = 1e-13


@dataclass(frozen=True)
class ExactSectionMotion:
    """Position and rotation of a section from (x, y, psi) there.

    `numbers` begin with the angle of the section in the reference configuration. With an offset,
    they also contain the vector (x, y) from the interpolated axis to the section in the reference
    configuration; this vector rotates with the section. Without an offset, for example at nodes,
    the motion is linear in the coordinates.
    """

    has_offset: bool

    def __call__(self, q: SX, numbers: Any) -> tuple[SX, SX]:
        """Return position and rotation."""
        rotation, position = q[2] - numbers[0], q[:2]
        if self.has_offset:
            position += rotate(rotation, slice_column(numbers, 1, 2))
        return position, rotation


def chord_motion(q: SX, numbers: Any) -> tuple[SX, SX]:
    """Return the position of the first of two nodes and the rotation of the chord between them.

    `numbers` are the angle of the first section and the vector (x, y) of the chord in the reference
    configuration. The rotation is continuous while the chord deviates by less than half a
    revolution from a chord that rotates rigidly with the first section.
    """
    section_rotation = q[2] - numbers[0]
    along = rotate(-section_rotation, q[3:5] - q[:2])
    chord = slice_column(numbers, 1, 2)
    across = chord[0] * along[1] - chord[1] * along[0]
    return q[:2], section_rotation + ca.atan2(across, ca.dot(chord, along))


@read_only_data
@dataclass(frozen=True, eq=False)
class GeometricallyExact(FormulationKinematics):
    """Positions and section angles of the nodes in the inertial frame, with Reissner's strains.

    Coordinates: (x, y, psi) of each node, where psi is the angle of the section; in the reference
    configuration, psi is the tangent angle of the curve. There is no floating frame: `frame` is the
    reference frame of deformations. `Beam` documents the settings.

    The axis of an element interpolates the positions of its nodes. In the reference configuration,
    the tangent angle of this axis differs slightly from the interpolated section angles. The
    element data contain the difference, so that the strains are zero in the reference configuration
    (without `free_curve`) and do not change under rigid motions.

    Section forces of degree nodes - 2 as additional unknowns (mixed interpolation) would result in
    the same equations as reduced quadrature. Reduced quadrature does not lock: with 8 elements of
    4 nodes, the compliances of a quarter circle have errors of at most 7e-7 for R/h from 4 to 1e5.
    With full quadrature, the error increases to 7e-3 at R/h = 2500 (see validation/).
    """

    @cached_property
    def element(self) -> ExactElement:
        """Element type, the same for all elements."""
        damped = is_damped(self.section, self.mesh, self.stiffness_points)
        return ExactElement(self.mesh.nodes, self.stiffness_points, damped)

    @geometric_property
    def _node_angles(self) -> Array:
        """Section angles of the nodes in the reference configuration [rad]."""
        return np.asarray(self.mesh.tangent_angle(self.mesh.node_arc_lengths), float)

    @geometric_property
    def coordinates(self) -> tuple[Variable, ...]:
        """Name and unit of the position and section angle of each node."""
        units = (("x", "m"), ("y", "m"), ("psi", "rad"))
        return tuple(
            Variable(f"{name}{i}", unit)
            for i in range(self.mesh.node_count)
            for name, unit in units
        )

    @geometric_property
    def initial_position(self) -> Array:
        """Coordinates [m, rad] in the reference configuration, shape (n,)."""
        nodal = np.empty((self.mesh.node_count, NODE_SIZE))
        nodal[self.mesh.element_nodes, :2] = self.mesh.node_points
        nodal[:, 2] = self._node_angles
        return nodal.ravel()

    def initial_velocity(self, velocity: tuple[float, float], angular_velocity: float) -> Array:
        """Return the rates of the coordinates (n,) for a rigid motion."""
        positions = self.initial_position.reshape(-1, NODE_SIZE)[:, :2]
        x, y = (positions - positions[0]).T
        rates = np.empty((self.mesh.node_count, NODE_SIZE))
        rates[:, 0] = velocity[0] - angular_velocity * y
        rates[:, 1] = velocity[1] + angular_velocity * x
        rates[:, 2] = angular_velocity
        return rates.ravel()

    def rigid_motions(self, q: SX) -> SX:
        """Return the rates of the coordinates in rigid motions, (n, 3)."""
        nodal = ca.reshape(q, NODE_SIZE, self.mesh.node_count)
        motions = SX(q.shape[0], 3)
        motions[0::NODE_SIZE, 0] = motions[1::NODE_SIZE, 1] = 1.0
        motions[0::NODE_SIZE, 2] = nodal[1, 0] - nodal[1, :].T
        motions[1::NODE_SIZE, 2] = nodal[0, :].T - nodal[0, 0]
        motions[2::NODE_SIZE, 2] = 1.0
        return motions

    @geometric_property
    def operator(self) -> sp.csr_array:
        """Matrix that maps beam coordinates to element coordinates, (elements * size, n)."""
        return self._select_nodes(self.mesh.element_nodes)

    def _select_nodes(self, nodes: Any) -> sp.csr_array:
        columns = (NODE_SIZE * np.ravel(nodes)[:, None] + np.arange(NODE_SIZE)).ravel()
        return build_selection(columns, NODE_SIZE * self.mesh.node_count)

    @geometric_property
    def _stiffness_values(self) -> tuple[Array, ...]:
        """Values of each of `STIFFNESS_POINT_VALUES` at the stiffness points of all elements."""
        mesh, points = self.mesh, self.stiffness_points
        xi, _ = gauss_points(points)
        rows, slopes = (shape_functions(mesh.nodes, xi, k) for k in (0, 1))
        nodal = self._node_angles[mesh.element_nodes]
        weight, axis = mesh.gauss(points)
        dxi_ds, dpsi_dxi = 1.0 / axis.ds, (nodal @ slopes.T).ravel()
        free_curvature = np.zeros(len(dpsi_dxi))
        if self.free_curve is not None:
            # Strains are derivatives with respect to the arc length of the stress-free shape.
            s, curve = mesh.gauss_arc_lengths(points), mesh.curve
            ratio = self.free_curve.length / curve.length
            weight, dxi_ds = weight * ratio, dxi_ds / ratio
            free_curvature = self.free_curve.curvature(ratio * s) - curve.curvature(s) / ratio
        angle_offset = axis.angle - (nodal @ rows.T).ravel()
        return weight, dxi_ds, angle_offset, dxi_ds * dpsi_dxi + free_curvature

    @cached_property
    def _point_data(self) -> Array:
        weight, _ = self.mesh.gauss(self.mesh.nodes)
        return assemble_point_data(
            self.mesh, self.element.layout, self.section, [weight], self._stiffness_values
        )

    def placement(self, s: float, on_axis: bool = False) -> Placement:
        """Return the section at arc length s [m]; see `Kinematics`."""
        element, xi = self.mesh.locate(s)
        row, nodes = shape_functions(self.mesh.nodes, np.array([xi]))[0], self.mesh.element_nodes
        on_element = row @ self.initial_position.reshape(-1, NODE_SIZE)[nodes[element], :2]
        position = on_element if on_axis else np.asarray(self.mesh.curve.point(s), float)
        angle, offset = float(row @ self._node_angles[nodes[element]]), position - on_element
        has_offset = bool(np.hypot(*offset) > _MAX_AXIS_OFFSET * self.mesh.curve.length)
        numbers = (angle, *(offset.tolist() if has_offset else ()))
        x, y = position.tolist()
        return Placement((x, y), angle, Formula(ExactSectionMotion(has_offset), numbers))

    @property
    def floating_frame(self) -> MaterialPoint:
        """Reference frame of deformations: the start section or the chord."""
        start = self.material_point(0.0)
        if self.frame == "tangent":
            return start
        ends = self._select_nodes([0, self.mesh.node_count - 1])
        numbers = (self._node_angles[0], *chord_vector(self.mesh.curve))
        motion = Formula(chord_motion, tuple(map(float, numbers)))
        return MaterialPoint(start.reference_position, self.frame_angle, ends, motion)

    def _deformation(self, s: float, axes: str) -> PointValues:
        frame, section = self.floating_frame, self.material_point(s)
        arm = np.subtract(section.reference_position, frame.reference_position)
        angle = {"inertial": (), "frame": (frame.inclination,), "local": (section.inclination,)}
        sizes = section.operator.shape[0], frame.operator.shape[0]
        numbers = [constant_formula(*arm.tolist()), *map(constant_formula, angle[axes])]
        values, data = FormulaExpression.of(
            PointFormula(sizes, express_displacement), (section.motion, frame.motion, *numbers)
        )
        operator = sp.csr_array(sp.vstack([section.operator, frame.operator]))
        return PointValues(operator, Formula(values, tuple(data.tolist())))
