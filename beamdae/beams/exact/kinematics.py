"""The kinematics of geometrically exact beams: positions and section angles of their nodes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, cast

import numpy as np
import scipy.sparse as sp

from beamdae.beams.element_data import (
    assemble_element_data,
    assemble_point_data,
    is_damped,
    require_free_curve,
)
from beamdae.beams.exact.element import NODE_SIZE, ExactElement
from beamdae.beams.exact.formulas import ExactDeformation, ExactSectionMotion, chord_motion
from beamdae.beams.kinematics import Kinematics, MaterialPoint, PointValues
from beamdae.beams.mesh import Mesh
from beamdae.beams.reference_frames import chord_vector, compute_frame_angle, resolve_frame
from beamdae.beams.sections import Section, VaryingSection
from beamdae.beams.shape_functions import gauss_points, lagrange_weights, shape_functions
from beamdae.beams.strains import InterpolatedStrains
from beamdae.curves.plane_curves import PlaneCurve
from beamdae.errors import require_choice, set_fields
from beamdae.symbolic.formulas import Formula
from beamdae.symbolic.statements import Named

Array = np.ndarray

# A section this near to the interpolated axis, over the length of the beam, lies on it.
_MAX_AXIS_OFFSET = 1e-13


@dataclass(frozen=True, eq=False)
class GeometricallyExact(Kinematics):
    """Positions and section angles of the nodes in the inertial frame, with Reissner's strains.

    Coordinates: (x, y, psi) a node, psi the angle of the section's direction, that of the curve's
    tangent in the drawing. There is no floating frame: `frame` is the one that deformations are
    seen from. `quadrature`, `frame` and `free_curve` are explained at `Beam`.

    The axis of an element interpolates its nodes; where its tangent is off the interpolated angles
    of the sections in the drawing, by the fourth order of its length, the sections stand normal to
    it all the same: there is no strain in the drawing, nor in a rigid motion of it.

    Section forces of degree nodes - 2 as unknowns of their own (mixed interpolation) would make the
    equations of reduced quadrature. That does not lock: compliances of a quarter circle are off by
    7e-7 with 8 elements at R/h = 4 as at 2500, where full quadrature is by 7e-3 (validation/).
    """

    name: str
    mesh: Mesh
    section: Section | VaryingSection
    quadrature: str = "reduced"
    frame: str | None = None
    free_curve: PlaneCurve | None = None
    _material_points: dict[float, MaterialPoint] = field(
        default_factory=dict, init=False, repr=False
    )

    def __post_init__(self) -> None:
        set_fields(self, frame=resolve_frame(self.name, self.mesh.curve, self.frame))
        require_choice(self.name, "quadrature", self.quadrature, ("reduced", "full"))
        _ = self._frame_angle
        if self.free_curve is not None:
            require_free_curve(self.name, self.free_curve, self.mesh.curve)

    @cached_property
    def element(self) -> ExactElement:
        """The type of all elements."""
        nodes = self.mesh.nodes
        points = nodes if self.quadrature == "full" else nodes - 1
        damped = is_damped(self.section, self.mesh, points)
        return ExactElement(nodes, points, damped, isinstance(self.section, VaryingSection))

    @cached_property
    def _angles(self) -> Array:
        """Section angles of the nodes in the drawing [rad]."""
        return np.asarray(self.mesh.tangent_angle(self.mesh.node_arc_lengths), float)

    @cached_property
    def coordinates(self) -> tuple[Named, ...]:
        """Place and section angle of each node."""
        units = (("x", "m"), ("y", "m"), ("psi", "rad"))
        return tuple(
            Named(f"{name}{i}", unit) for i in range(self.mesh.node_count) for name, unit in units
        )

    @cached_property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing."""
        drawn = np.empty((self.mesh.node_count, NODE_SIZE))
        drawn[self.mesh.element_nodes, :2] = self.mesh.node_points
        drawn[:, 2] = self._angles
        return drawn.ravel()

    def initial_velocity(self, velocity: tuple[float, float], angular_velocity: float) -> Array:
        """Rates of a rigid motion."""
        place = self.initial_position.reshape(-1, NODE_SIZE)[:, :2]
        x, y = (place - place[0]).T
        rates = np.empty((self.mesh.node_count, NODE_SIZE))
        rates[:, 0] = velocity[0] - angular_velocity * y
        rates[:, 1] = velocity[1] + angular_velocity * x
        rates[:, 2] = angular_velocity
        return rates.ravel()

    @cached_property
    def operator(self) -> sp.csr_array:
        """From the beam's coordinates to those of all elements, shape (elements * size, n)."""
        return self._picked(self.mesh.element_nodes)

    def _picked(self, nodes: Any) -> sp.csr_array:
        """Rows that pick the coordinates of these nodes."""
        columns = (NODE_SIZE * np.ravel(nodes)[:, None] + np.arange(NODE_SIZE)).ravel()
        parts = (np.ones(len(columns)), columns, np.arange(len(columns) + 1))
        return sp.csr_array(parts, shape=(len(columns), NODE_SIZE * self.mesh.node_count))

    @cached_property
    def _stiffness_points(self) -> tuple[Array, ...]:
        """What the formulation has of them: see `STIFFNESS_POINT`."""
        mesh, points = self.mesh, self.element.quadrature
        xi, _ = gauss_points(points)
        rows, slopes = (shape_functions(mesh.nodes, xi, k) for k in (0, 1))
        nodal = self._angles[mesh.element_nodes]
        weight, at = mesh.gauss(points)
        dxi_ds, bent = 1.0 / at.ds, (nodal @ slopes.T).ravel()
        free = np.zeros(len(bent))
        if self.free_curve is not None:
            # Strains by arc length of the free shape.
            s, curve, ratio = mesh.gauss_arc_lengths(points), self.mesh.curve, self._stretched
            weight, dxi_ds = weight * ratio, dxi_ds / ratio
            free = self.free_curve.curvature(ratio * s) - curve.curvature(s) / ratio
        return weight, dxi_ds, at.angle - (nodal @ rows.T).ravel(), dxi_ds * bent + free

    @property
    def _stretched(self) -> float:
        """Length of the free shape over that of the drawing."""
        free, drawn = self.free_curve, self.mesh.curve
        return 1.0 if free is None else free.length / drawn.length

    @cached_property
    def _points(self) -> Array:
        weight, _ = self.mesh.gauss(self.mesh.nodes)
        return assemble_point_data(
            self.mesh, self.element.layout, self.section, [weight], self._stiffness_points
        )

    def data(self, gravity: Array) -> Array:
        """Numbers of the elements under `gravity` (2,), shape (n_data, elements)."""
        return assemble_element_data(self._points, self.section, gravity)

    def material_point(self, s: float) -> MaterialPoint:
        """The section at arc length s [m], with the coordinates of the nodes it depends on."""
        # Ends are asked for by whatever is joined to them, observed or drawn.
        if s not in self._material_points:
            self._material_points[s] = self._section(s, on_axis=False)
        return self._material_points[s]

    def axis_point(self, s: float) -> MaterialPoint:
        """The section on the interpolated axis."""
        return self._section(s, on_axis=True)

    def _section(self, s: float, on_axis: bool) -> MaterialPoint:
        element, xi = self.mesh.locate(s)
        row = shape_functions(self.mesh.nodes, np.array([xi]))[0]
        own = np.abs(row) > 1e-12
        row, nodes = row[own], self.mesh.element_nodes[element][own]
        axis = row @ self.initial_position.reshape(-1, NODE_SIZE)[nodes, :2]
        drawn = axis if on_axis else np.asarray(self.mesh.curve.point(s), float)
        angle, apart = float(row @ self._angles[nodes]), drawn - axis
        lies_apart = bool(np.hypot(*apart) > _MAX_AXIS_OFFSET * self.mesh.curve.length)
        numbers = [angle, *row, *(apart if lies_apart else ())]
        return MaterialPoint(
            (float(drawn[0]), float(drawn[1])),
            angle,
            self._picked(nodes),
            Formula(ExactSectionMotion(len(nodes), lies_apart), tuple(map(float, numbers))),
        )

    @cached_property
    def _frame_angle(self) -> float:
        """Angle in the drawing of the frame that deformations are seen from [rad]."""
        return compute_frame_angle(self.name, self.mesh.curve, str(self.frame))

    @property
    def floating_frame(self) -> MaterialPoint:
        """The start section, or the line from it to the end: what deformations are seen from."""
        start = self.material_point(0.0)
        if self.frame == "tangent":
            return start
        ends = self._picked([0, self.mesh.node_count - 1])
        numbers = (self._angles[0], *chord_vector(self.mesh.curve))
        formula = Formula(chord_motion, tuple(map(float, numbers)))
        return MaterialPoint(start.drawn, self._frame_angle, ends, formula)

    def deformation(self, s: float, axes: str) -> PointValues:
        """(u, v, phi) at arc length s, components in the axes "inertial", "frame" or "local"."""
        frame, at = self.floating_frame, self.material_point(s)
        seen, section = (cast("Formula", x.motion) for x in (frame, at))
        carried = np.subtract(at.drawn, frame.drawn)
        kind = ExactDeformation(
            seen.kind,
            frame.operator.shape[0],
            len(seen.numbers),
            cast("ExactSectionMotion", section.kind),
            axes,
        )
        angles = (frame.inclination, at.inclination)
        numbers = (*seen.numbers, *section.numbers, *map(float, carried), *angles)
        operator = sp.csr_array(sp.vstack([frame.operator, at.operator]))
        return PointValues(operator, Formula(kind, numbers))

    def strains(self, s: float) -> PointValues:
        """Strains at arc length s, interpolated between the stiffness points of the element."""
        element, xi = self.mesh.locate(s)
        points = self.element.quadrature
        own = slice(element * points, (element + 1) * points)
        of_points = [column[own] for column in self._stiffness_points[1:]]
        numbers = [*lagrange_weights(gauss_points(points)[0], xi), *np.ravel(of_points)]
        values = Formula(InterpolatedStrains(self.element), tuple(map(float, numbers)))
        return PointValues(self._picked(self.mesh.element_nodes[element]), values)

    @property
    def curvature_error(self) -> float:
        """Largest error of psi' at the stiffness quadrature points, times the length."""
        mesh, points = self.mesh, self.element.quadrature
        xi, _ = gauss_points(points)
        _, at = mesh.gauss(points)
        bent = (self._angles[mesh.element_nodes] @ shape_functions(mesh.nodes, xi, 1).T).ravel()
        error = np.abs(bent / at.ds - mesh.curve.curvature(mesh.gauss_arc_lengths(points)))
        return float(error.max() * mesh.curve.length)
