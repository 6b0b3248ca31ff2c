"""The curved beam as a body: a mesh of elements in one floating frame."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.beams.floating_frame_element import (
    FRAME,
    NODE,
    ElementType,
    beam_kernel,
    shape_functions,
    strains,
)
from beamdae.beams.mesh import Mesh, MeshError
from beamdae.beams.sections import Section
from beamdae.curves.plane_curves import PlaneCurve, require_curve, turned
from beamdae.errors import BeamdaeError, count, finite, one_of, point
from beamdae.parts.bodies import Attachment, require_name, rotate
from beamdae.symbolic.statements import SX, ForceStatement, Local, Piece, Quantity

Array = np.ndarray


class Beam:
    """Planar, shear-flexible, geometrically nonlinear curved beam in a floating frame.

    Pan & Liu, Theor. Appl. Mech. Lett. 2 (2012) 063006, doi:10.1063/2.1206306. Coordinates:
    (x0, y0, theta) of the floating frame and the free ones of (u, v, phi) at the nodes,
    displacements in the local tangent frame and section rotation relative to the undeformed one.

    Parameters
    ----------
    name
        Unique name.
    curve
        Reference curve of the axis by arc length (Line, Arc, Parabola, Curve, Segment).
    section
        Cross-section, constant along the beam.
    elements
        Number of elements, of equal arc length.
    strain
        "nonlinear" (eq. 5, the paper's), with the quadratic terms (u'^2 + v'^2)/2; "green", with
        Green's ((u' - v/R)^2 + (v' + u/R)^2)/2 instead; or "linear", with none.
    elements_shape
        "curved" (the paper's) or "straight": the polygon through the curve.
    continuity
        What elements share at their common node besides the section rotation: "cartesian", the
        displacement vector (default), or "local", its components along and across the axis (the
        paper's, curved elements only). The axes of neighboring elements meet at a small angle that
        the paper overlooks; it limits the convergence to order 2 instead of 4 and more (measured,
        see validation/).
    nodes
        Nodes of an element: 4 (cubic, the paper's), 3 or 2 (linear, straight whatever the curve).
    quadrature
        Gauss points of the stiffness terms: "reduced", one less than nodes, or "full", as many as
        nodes. Reduced needs about half as many elements for the same error (measured, see
        validation/); with full quadrature 2-node elements lock, and curved ones of 3 nodes.
    frame
        Floating frame on the start section ("tangent") or from end to end ("chord"). The strains
        of eqs. (5) and (6) hold for moderate displacements and rotations relative to the frame, so
        the two are two models that agree as the deformation falls (tip deflections of a tenth of
        the length: to 2 %); a beam that bends further is cut into several welded together.
    velocity, angular_velocity
        Of the floating frame at the start [m/s], [rad/s]; made consistent with the joints.
    """

    def __init__(
        self,
        name: str,
        curve: PlaneCurve,
        section: Section,
        elements: int = 8,
        strain: str = "nonlinear",
        elements_shape: str = "curved",
        continuity: str = "cartesian",
        nodes: int = 4,
        quadrature: str = "reduced",
        frame: str = "tangent",
        velocity: tuple[float, float] = (0.0, 0.0),
        angular_velocity: float = 0.0,
    ) -> None:
        self.name = require_name("Beam", name)
        if not isinstance(section, Section):
            raise BeamdaeError(f"{name}: section must be a Section, got {section!r}.")
        self.curve = require_curve(name, curve)
        self.section = section
        self.velocity = point(name, "velocity", velocity)
        self.angular_velocity = finite(name, "angular_velocity", angular_velocity)
        one_of(name, "strain", strain, ("nonlinear", "green", "linear"))
        nodes = one_of(name, "nodes", count(name, "nodes", nodes), (2, 3, 4))
        one_of(name, "quadrature", quadrature, ("reduced", "full"))
        if (elements_shape == "straight" or nodes == 2) and continuity == "local":
            raise BeamdaeError(
                f"{name}: straight elements meet at kinks, continuity must be 'cartesian'."
            )
        points = nodes if quadrature == "full" else nodes - 1
        try:
            self.mesh = Mesh(
                curve,
                ElementType(nodes, points, strain, damped=section.damping > 0.0),
                count(name, "elements", elements),
                one_of(name, "elements_shape", elements_shape, ("curved", "straight")),
                one_of(name, "continuity", continuity, ("cartesian", "local")),
                one_of(name, "frame", frame, ("tangent", "chord")),
            )
            _ = self.mesh.frame_angle
        except MeshError as problem:
            raise BeamdaeError(f"{name}: {problem}.") from None

    @property
    def length(self) -> float:
        """Arc length of the reference curve [m]."""
        return self.curve.length

    @property
    def mesh_errors(self) -> tuple[float, float]:
        """Largest relative error of arc length, largest error of curvature times length."""
        return self.mesh.errors

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """One name a coordinate."""
        return ("x0", "y0", "theta", *self.mesh.free_names)

    @property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing."""
        nodal = np.zeros(len(self.mesh.free_names))
        return np.concatenate([self.mesh.origin, [self.mesh.frame_angle], nodal])

    @property
    def initial_velocity(self) -> Array:
        """Their rates at the start."""
        nodal = np.zeros(len(self.mesh.free_names))
        return np.concatenate([self.velocity, [self.angular_velocity], nodal])

    @property
    def outline(self) -> Array:
        """Points (n, 2) of the reference drawing that tell how large the body is [m]."""
        return self.curve.point(np.linspace(0.0, self.length, 33))

    @property
    def section_values(self) -> Array:
        """(EA, GA, EI, rhoA, rhoI, damping), the section data of the element kernel."""
        x = self.section
        return np.array([x.EA, x.GA, x.EI, x.rhoA, x.rhoI, x.damping])

    def force_statements(self, gravity: Array) -> list[ForceStatement]:
        """What the part adds to the equations of motion."""
        data = self.mesh.quadrature_data(self.section_values, gravity)
        piece = Piece(self, self.mesh.coordinates)
        return [ForceStatement(self.name, beam_kernel(self.mesh.kind), (piece,), data)]

    @property
    def start(self) -> Attachment:
        """The section at arc length 0."""
        return self.at(0.0)

    @property
    def end(self) -> Attachment:
        """The section at the full arc length."""
        return self.at(self.length)

    def at(self, s: float) -> Attachment:
        """The section at arc length `s` [m]."""
        element, xi = self._locate(s)
        row = shape_functions(self.mesh.kind.nodes, np.array([xi]))[0]
        nodes = np.flatnonzero(np.abs(row) > 1e-12)
        angle = float(self.mesh.axis(np.array([element]), np.array([xi]))[1][0])
        reference = self.mesh.frame_angle
        drawn = self.curve.point(s)
        place = turned(drawn - self.mesh.origin, -reference)
        weights = [float(row[i]) for i in nodes]

        def kinematics(q: SX) -> tuple[SX, SX]:
            nodal = ca.reshape(q[FRAME:], NODE, len(weights)) @ ca.DM(weights)
            displaced = place + rotate(angle, nodal[:2])
            return q[:2] + rotate(q[2], displaced), q[2] - reference + nodal[2]

        local = np.concatenate(
            [np.arange(FRAME), *(FRAME + NODE * i + np.arange(NODE) for i in nodes)]
        )
        rows = element * self.mesh.kind.size + local
        return Attachment(
            self,
            (float(drawn[0]), float(drawn[1])),
            angle + reference,
            self.mesh.coordinates[rows],
            kinematics,
        )

    @property
    def floating_frame(self) -> Attachment:
        """The floating frame, as something to observe."""
        reference = self.mesh.frame_angle
        rows = sp.eye_array(FRAME, len(self.coordinate_names), format="csr")
        origin = (float(self.mesh.origin[0]), float(self.mesh.origin[1]))
        return Attachment(self, origin, reference, rows, lambda q: (q[:2], q[2] - reference))

    def _locate(self, s: float) -> tuple[int, float]:
        s = finite(self.name, "arc length s", s)
        if not -1e-9 * self.length <= s <= self.length * (1.0 + 1e-9):
            raise BeamdaeError(
                f"{self.name}: arc length s must lie in [0, {self.length:.6g}] m, got {s:g}."
            )
        return self.mesh.locate(s)

    def _element_piece(self, element: int) -> Piece:
        size = self.mesh.kind.size
        return Piece(self, self.mesh.coordinates[element * size : (element + 1) * size])

    def deformation(self, s: float, axes: str = "inertial") -> Quantity:
        """Displacement of the axis at `s` [m] relative to the undeformed beam in its frame.

        Columns u, v [m] and phi [rad]: components in the inertial frame (`axes="inertial"`), in
        the floating frame ("frame") or in the local tangent frame of the point ("local").
        """
        one_of(self.name, "axes", axes, ("inertial", "frame", "local"))
        element, xi = self._locate(s)
        row = shape_functions(self.mesh.kind.nodes, np.array([xi]))[0]
        angle = float(self.mesh.axis(np.array([element]), np.array([xi]))[1][0])

        def expression(local: Local) -> SX:
            nodal = ca.reshape(local.q[FRAME:], NODE, self.mesh.kind.nodes) @ row
            turn = {"inertial": local.q[2] + angle, "frame": angle, "local": 0.0}[axes]
            return ca.vertcat(rotate(turn, nodal), nodal[2])

        columns = (("u", "m"), ("v", "m"), ("phi", "rad"))
        return Quantity(columns, (self._element_piece(element),), expression)

    def strain(self, s: float, offset: float) -> Quantity:
        """Longitudinal strain eps11 at arc length `s` and distance `offset` [m] from the axis (5).

        `offset` is positive to the left of the curve. Taken from the stiffness quadrature points,
        where the strains of the element are most accurate, and interpolated to `s`.
        """
        offset = finite(self.name, "offset", offset)
        return self._strain_quantity(
            s, (("", "-"),), lambda strain, rate, section: strain[0] + offset * strain[2]
        )

    def section_forces(self, s: float) -> Quantity:
        """Axial force N, shear force Q [N] and bending moment M [N m] at arc length `s`.

        N = EA eps11, Q = GA 2 eps12, M = EI kappa11 on the axis (eqs. 5-7), with the damping part.
        The sign of M is that of kappa11 = -phi': positive M lengthens the left side.
        """
        return self._strain_quantity(
            s,
            (("N", "N"), ("Q", "N"), ("M", "N m")),
            lambda strain, rate, section: section[:3] * (strain + section[5] * rate),
        )

    def _strain_quantity(self, s: float, columns: tuple, evaluate: Any) -> Quantity:
        element, xi = self._locate(s)
        kind = self.mesh.kind
        gauss, _ = np.polynomial.legendre.leggauss(kind.quadrature)
        share = [
            float(np.prod([(xi - x) / (gauss[k] - x) for x in np.delete(gauss, k)]))
            for k in range(kind.quadrature)
        ]
        rows, slopes = shape_functions(kind.nodes, gauss), shape_functions(kind.nodes, gauss, 1)
        _, _, curvature, ds = self.mesh.axis(np.full(kind.quadrature, element), gauss)

        def expression(local: Local) -> SX:
            strain = SX.zeros(3)
            for k in range(kind.quadrature):
                at = SX([0.0, curvature[k], 1.0 / ds[k]])
                strain += share[k] * ca.vertcat(
                    *strains(kind, rows[k], slopes[k], at, local.q[FRAME:])
                )
            return evaluate(strain, local.dot(strain), local.data)

        piece = self._element_piece(element)
        return Quantity(columns, (piece,), expression, self.section_values)
