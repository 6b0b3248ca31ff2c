"""The curved beam as a body: a curve, a section, a mesh, and the kinematics of all three."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.beams.exact.kinematics import GeometricallyExact
from beamdae.beams.floating_frame.kinematics import FloatingFrame
from beamdae.beams.kinematics import Kinematics, MaterialPoint, create_custom_kinematics
from beamdae.beams.mesh import Mesh
from beamdae.beams.sections import Section, SectionLaw, Taper, VaryingSection, require_section
from beamdae.beams.strains import fiber_strain, fiber_stress, identity, section_forces
from beamdae.curves.plane_curves import PlaneCurve, require_curve
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    require_choice,
    require_count,
    require_finite,
    require_name,
    require_point,
)
from beamdae.memory import available_memory, require_memory
from beamdae.parts.attachments import Attachment
from beamdae.parts.part import Drawing, Part
from beamdae.symbolic.formulas import FormulaExpression, constant_formula
from beamdae.symbolic.statements import (
    SX,
    ForceStatement,
    Named,
    Piece,
    Quantity,
    RangeStatement,
)

FORMULATIONS: dict[str, type[FloatingFrame] | type[GeometricallyExact]] = {
    "floating frame": FloatingFrame,
    "exact": GeometricallyExact,
}


def create_kinematics(
    part: str,
    formulation: str,
    make: Callable[[str, Mesh, Any], Kinematics] | None,
    mesh: Mesh,
    section: Any,
    settings: Mapping[str, Any],
) -> Kinematics:
    """The kinematics of a formulation with these settings, or what `make` makes without any.

    Raises
    ------
    BeamdaeError
        If a setting belongs to another formulation.
    """
    require_choice(part, "formulation", formulation, tuple(FORMULATIONS))
    if make is not None:
        given = [*settings, *(["formulation"] if formulation != "floating frame" else [])]
        if given:
            raise BeamdaeError(
                f"{part}: {', '.join(given)} belong to beamdae's formulations, the kinematics "
                "given has settings of its own."
            )
        return create_custom_kinematics(part, make, mesh, section)
    kind = FORMULATIONS[formulation]
    foreign = [name for name in settings if name not in {field.name for field in fields(kind)}]
    if foreign:
        raise BeamdaeError(
            f"{part}: {' and '.join(foreign)} belong to formulation='floating frame', leave them "
            f"out with {formulation!r}."
        )
    return kind(part, mesh, section, **settings)


# Curvature times element length at which the compliance of an arc is off by 1 %, by nodes and
# straight ones (measured: 6e-3 at 1.6, of order 4; 9e-5 at 0.4, of order 4; 8e-3 at 0.2, of order
# 2; see tests/beams/test_castigliano.py).
_MAX_TURN_PER_CURVED_ELEMENT = {4: 1.6, 3: 1.2, 2: 0.2}
_MAX_TURN_PER_STRAIGHT_ELEMENT = 0.2
# Curvature times height at which the bending stiffness of a rectangle (Winkler & Bach's over
# EI, 1 + 0.15 (h/R)^2) is off by 1 %; the stress at the inner surface is by h / (3 R), 8 %.
_MAX_CURVATURE_TIMES_HEIGHT = 0.26


def measure_curvature(mesh: Mesh, section: Section | VaryingSection) -> Mapping[str, float]:
    """Largest curvature times the length of an element, and times the height of the section."""
    s = mesh.gauss_arc_lengths(mesh.nodes)
    curvature = np.abs(mesh.curve.curvature(s))
    length = mesh.curve.length / mesh.elements
    found = {"largest curvature times element length": float(curvature.max()) * length}
    heights = (
        np.full(len(s), section.height, float)
        if isinstance(section, Section)
        else np.array([section.at(x).height for x in s.tolist()], float)
    )
    if not np.isnan(heights).any():
        found["largest curvature times section height"] = float(np.max(curvature * heights))
    return found


def warn_about_curvature(part: str, mesh: Mesh, section: Section | VaryingSection) -> None:
    """Warn where elements or a section are too large for the curvature of a beam."""
    by_length, *by_height = measure_curvature(mesh, section).values()
    straight = mesh.shape == "straight"
    most = _MAX_TURN_PER_STRAIGHT_ELEMENT if straight else _MAX_TURN_PER_CURVED_ELEMENT[mesh.nodes]
    if by_length > most:
        enough = int(np.ceil(mesh.elements * by_length / most))
        sentence = (
            f"{part}: its curve turns by {by_length:.2g} rad within an element, more than the "
            f"{most:g} rad at which deflections are off by 1 %; take elements={enough} or more."
        )
        warnings.warn(sentence, BeamdaeWarning, stacklevel=3)
    if by_height and by_height[0] > _MAX_CURVATURE_TIMES_HEIGHT:
        sentence = (
            f"{part}: its section is {by_height[0]:.2g} times as high as the radius of its curve, "
            f"where the bending stiffness of beams is off by {0.15 * by_height[0] ** 2:.1%} and "
            f"the stress at the inner surface by {by_height[0] / 3.0:.0%}."
        )
        warnings.warn(sentence, BeamdaeWarning, stacklevel=3)


# Radius of gyration over length: bending is lost in the rounding of stretching below, and nothing
# above is a beam.
_MIN_GYRATION_RATIO, _MAX_GYRATION_RATIO = 1e-12, 1e2
# What a run takes at least for each element, whatever the integrator, times nodes less one [bytes].
# Measured: 95 to 150 kB, in long chains of beams and in a single one of 10 000 elements.
_BYTES_PER_ELEMENT_INTERVAL = 9e4


def require_valid_slenderness(part: str, section: Section | VaryingSection, length: float) -> None:
    """Refuse a section that is none beside the length of the beam [m]."""
    for at in map(section.at, np.linspace(0.0, length, 3)):
        gyration = float(np.sqrt(at.second_moment / at.area))
        if not _MIN_GYRATION_RATIO <= gyration / length <= _MAX_GYRATION_RATIO:
            raise BeamdaeError(
                f"{part}: second_moment {at.second_moment:g} m^4 and area {at.area:g} m^2 make a "
                f"radius of gyration of {gyration:.3g} m, it must be {_MIN_GYRATION_RATIO:g} to "
                f"{_MAX_GYRATION_RATIO:g} times the length of {length:g} m."
            )


def require_mesh_memory(part: str, mesh: Mesh) -> None:
    """Refuse more elements than there is memory for, before any of it is asked for."""
    each, there = _BYTES_PER_ELEMENT_INTERVAL * (mesh.nodes - 1), available_memory()
    if each * mesh.elements <= there:
        return
    most = int(there / each)
    remedy = f"take at most elements={most}"
    require_memory(part, f"a run of elements={mesh.elements}", each * mesh.elements, remedy)


Array = np.ndarray


class Beam(Part):
    """Planar, shear-flexible, geometrically nonlinear curved beam.

    Pan & Liu, Theor. Appl. Mech. Lett. 2 (2012) 063006, doi:10.1063/2.1206306, whose floating frame
    `strain` and `continuity` are settings of; with `formulation="exact"` Reissner, J. Appl. Math.
    Phys. 23 (1972) 795, and Simo, Comput. Methods Appl. Mech. Eng. 49 (1985) 55.

    Parameters
    ----------
    name
        Unique name.
    curve
        Reference curve of the axis by arc length (Line, Arc, Parabola, Curve, Segment).
    section
        Cross-section, or what varies along the beam: a function of arc length s [m] that gives a
        `Section`, evaluated at the quadrature points, or a `taper`.
    elements
        Number of elements, of equal arc length.
    elements_shape
        "curved" (the paper's) or "straight": the polygon through the curve.
    nodes
        Nodes of an element: 4 (cubic, the paper's), 3 or 2 (linear, straight whatever the curve).
    strain
        Quadratic terms of the axial strain: "green" (default), Green's
        ((u' - v/R)^2 + (v' + u/R)^2)/2; "nonlinear", the paper's (eq. 5), (u'^2 + v'^2)/2 without
        the curvature; or "linear", none. On straight beams the first two are the same. "exact" are
        Reissner's strains, which hold for any rotation relative to the frame.
    continuity
        What elements share at their common node besides the section rotation: "cartesian", the
        displacement vector (default), or "local", its components along and across the axis (the
        paper's, curved elements only). The axes of neighboring elements meet at a small angle that
        the paper overlooks; it limits the convergence to order 2 instead of 4 and more (measured,
        see validation/).
    quadrature
        Gauss points of the stiffness terms: "reduced" (default), one less than nodes, or "full",
        as many as nodes. Reduced needs about half as many elements for the same error (measured,
        see validation/); with full quadrature 2-node elements lock, and curved ones of 3 nodes.
    frame
        Floating frame from end to end ("chord", default unless the ends are nearer than a tenth of
        the length) or on the start section ("tangent", the paper's, and the default of rings). The
        strains hold for moderate rotations relative to the frame: in a chord frame a beam bends
        several times as far for the same error (measured, see validation/; with "nonlinear"
        strains and more than a right angle of curve the tangent frame does), and integrators take
        up to half the steps. `Solution.validity` tells how far a beam bent; one that bends further
        is cut into several with `welded_beams`, or takes an exact strain. An exact beam has none:
        it is the frame that `deformation` is seen from.
    velocity, angular_velocity
        Of the floating frame at the start [m/s], [rad/s]; made consistent with the joints.
    free_curve
        The curve of the beam without any strain, where it is drawn bent: it starts under the
        moment M = EI (1/R_free - 1/R). Where this curve lies does not matter; its length may differ
        by 1 %, for an axial strain of the drawing. Strains, section forces and the strain energy
        are those since the free shape.
    kinematics
        Another description of the beam's motion than the two of `formulation`: a function of (name,
        mesh, section) that gives a `Kinematics`, such as a class of them.
    formulation
        "floating frame" (default), the paper's: small strains and moderate rotations relative to a
        frame that rides on the beam. "exact": positions and angles of the sections in the inertial
        frame and the exact strains r'.t - 1, r'.n and psi' - psi0' of axes t, n that turn with the
        section, however far the beam bends; its mass matrix is constant. What turns fast and far
        takes fewer steps in a frame, with `strain="exact"` (measured, see validation/).

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    >>> arc = bd.Arc(radius=0.85, length=0.8, angle=-0.6)
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> beam = mech.add(bd.Beam("beam", arc, strip, elements=6))
    >>> mech.observe("tip", beam.end)
    """

    def __init__(
        self,
        name: str,
        curve: PlaneCurve,
        section: Section | SectionLaw | Taper,
        elements: int = 8,
        strain: str | None = None,
        elements_shape: str = "curved",
        continuity: str | None = None,
        nodes: int = 4,
        quadrature: str | None = None,
        frame: str | None = None,
        velocity: tuple[float, float] = (0.0, 0.0),
        angular_velocity: float = 0.0,
        kinematics: Callable[[str, Mesh, Any], Kinematics] | None = None,
        free_curve: PlaneCurve | None = None,
        formulation: str = "floating frame",
    ) -> None:
        self.name = require_name("Beam", name)
        self.curve = require_curve(name, curve)
        self.section: Section | VaryingSection = require_section(name, section, curve.length)
        self.velocity = require_point(name, "velocity", velocity)
        self.angular_velocity = require_finite(name, "angular_velocity", angular_velocity)
        self.mesh = Mesh(
            curve,
            require_count(name, "elements", elements),
            require_choice(name, "nodes", require_count(name, "nodes", nodes), (2, 3, 4)),
            require_choice(name, "elements_shape", elements_shape, ("curved", "straight")),
        )
        require_mesh_memory(name, self.mesh)
        require_valid_slenderness(name, self.section, self.length)
        self.mesh.require_resolved_curve(name)
        warn_about_curvature(name, self.mesh, self.section)
        settings: dict[str, Any] = {
            "strain": strain,
            "continuity": continuity,
            "quadrature": quadrature,
            "frame": frame,
            "free_curve": free_curve,
        }
        given = {setting: value for setting, value in settings.items() if value is not None}
        self.kinematics: Kinematics = create_kinematics(
            name, formulation, kinematics, self.mesh, self.section, given
        )

    def __repr__(self) -> str:
        return f"Beam(name={self.name!r}, {self.length:.6g} m in {self.mesh.elements} elements)"

    @property
    def length(self) -> float:
        """Arc length of the reference curve [m]."""
        return self.curve.length

    @property
    def facts(self) -> Mapping[str, float]:
        """How well the elements follow the curve, and the curve its points."""
        return {
            "largest relative error of arc length": self.mesh.length_error,
            "largest error of curvature times length": self.kinematics.curvature_error,
            **measure_curvature(self.mesh, self.section),
            **getattr(self.curve, "facts", {}),
        }

    @property
    def coordinates(self) -> tuple[Named, ...]:
        """Name and unit of each coordinate."""
        return self.kinematics.coordinates

    @property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing."""
        return self.kinematics.initial_position

    @property
    def initial_velocity(self) -> Array:
        """Their rates at the start."""
        return self.kinematics.initial_velocity(self.velocity, self.angular_velocity)

    @cached_property
    def outline(self) -> Array:
        """Points along the axis."""
        return self.curve.point(np.linspace(0.0, self.length, 33))

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Inertia, elasticity, material damping and weight."""
        kernel, piece = self.kinematics.element.kernel(), Piece(self, self.kinematics.operator)
        return [ForceStatement(self.name, kernel, (piece,), self.kinematics.data(gravity))]

    def ranges(self) -> list[RangeStatement]:
        """How far it bends, where its kinematics has a limit to that."""
        validity = self.kinematics.strain_validity
        if validity is None:
            return []
        pieces = (Piece(self, self.kinematics.operator),)
        return [RangeStatement(self.name, validity.kernel, pieces, *validity[1:])]

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """Points along the axis."""
        return Drawing("beam", [self.at(s) for s in np.linspace(0.0, self.length, points)])

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
        s = self._inside(s)
        return self._attachment(self.kinematics.material_point(s), s)

    @property
    def floating_frame(self) -> Attachment:
        """The floating frame, as something to observe."""
        return self._attachment(self.kinematics.floating_frame)

    def _attachment(self, at: MaterialPoint, s: float | None = None) -> Attachment:
        return Attachment(self, at.drawn, at.inclination, at.operator, at.motion, s=s)

    def _inside(self, s: float) -> float:
        s = require_finite(self.name, "arc length s", s)
        if not -1e-9 * self.length <= s <= self.length * (1.0 + 1e-9):
            raise BeamdaeError(
                f"{self.name}: arc length s must lie in [0, {self.length:.6g}] m, got {s:g}."
            )
        return s

    def deformation(self, s: float, axes: str = "inertial") -> Quantity:
        """Displacement of the axis at `s` [m] relative to the undeformed beam in its frame.

        Columns u, v [m] and phi [rad]: components in the inertial frame (`axes="inertial"`), in
        the floating frame ("frame") or in the local tangent frame of the point ("local").
        """
        require_choice(self.name, "axes", axes, ("inertial", "frame", "local"))
        at = self.kinematics.deformation(self._inside(s), axes)
        columns = (Named("u", "m"), Named("v", "m"), Named("phi", "rad"))
        values, data = FormulaExpression.of(identity, (at.values,))
        return Quantity(columns, (Piece(self, at.operator),), values, data)

    def strain(self, s: float, offset: float | str) -> Quantity:
        """Longitudinal strain eps11 at arc length `s` and distance `offset` [m] from the axis (5).

        `offset` is positive to the left of the curve; "top" is the surface there and "bottom" the
        one on the right, where the section knows its height. Taken from the stiffness quadrature
        points, where the strains of the element are most accurate, and interpolated to `s`.
        """
        offset = self._section_at(s).fiber_offset(self.name, offset)
        return self._of_strains(s, (Named("", "-"),), fiber_strain, offset)

    def stress(self, s: float, offset: float | str) -> Quantity:
        """Longitudinal stress E eps11 [Pa], with the damping part; arguments as of `strain`."""
        x = self._section_at(s)
        own = (x.fiber_offset(self.name, offset), x.material.E, x.damping)
        return self._of_strains(s, (Named("", "Pa"),), fiber_stress, *own)

    def section_forces(self, s: float) -> Quantity:
        """Axial force N, shear force Q [N] and bending moment M [N m] at arc length `s`.

        N = EA eps11, Q = GA 2 eps12, M = EI kappa11 on the axis (eqs. 5-7), with the damping part.
        The sign of M is that of kappa11 = -phi': positive M lengthens the left side.
        """
        x = self._section_at(s)
        columns = (Named("N", "N"), Named("Q", "N"), Named("M", "N m"))
        return self._of_strains(s, columns, section_forces, x.EA, x.GA, x.EI, x.damping)

    def _section_at(self, s: float) -> Section:
        return self.section.at(self._inside(s))

    def _of_strains(
        self, s: float, columns: tuple[Named, ...], kind: Callable[..., SX], *own: float
    ) -> Quantity:
        at = self.kinematics.strains(self._inside(s))
        values, data = FormulaExpression.of(kind, (at.values, constant_formula(*own)))
        return Quantity(columns, (Piece(self, at.operator),), values, data)
