"""Curved beam as a body, defined by a curve, a section, a mesh and a formulation.

The module also contains the checks of the settings and the warnings about curvature.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from beamdae.beams.floating_frame import FloatingFrame
from beamdae.beams.kinematics import (
    Kinematics,
    MaterialPoint,
    create_custom_kinematics,
    prolongation_matrix,
)
from beamdae.beams.mesh import Mesh, choose_mesh, intern_mesh
from beamdae.beams.sections import Section, SectionLaw, Taper, VaryingSection, require_section
from beamdae.beams.strains import (
    LargestStress,
    fiber_strain,
    fiber_stress,
    identity,
    section_forces,
    strain_by_forces,
)
from beamdae.curves.plane_curves import (
    ARC_LENGTH_TOLERANCE,
    PlaneCurve,
    Segment,
    curve_breaks,
    require_curve,
)
from beamdae.errors import (
    BeamdaeError,
    as_real,
    as_text,
    format_count,
    format_distinct,
    optional,
    require_between,
    require_choice,
    require_count,
    require_finite,
    require_name,
    require_point,
    require_sequence,
    set_fields,
    short_repr,
    warn_user,
)
from beamdae.memory import UNCHECKED_BYTES, available_memory, require_memory
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.observables import relative_displacement
from beamdae.parts.part import AttachedPart, Drawing, Part
from beamdae.symbolic.formula import constant_formula
from beamdae.symbolic.statements import (
    SX,
    ForceStatement,
    Piece,
    Quantity,
    Variable,
    formula_quantity,
    rebuilt_for_mesh,
)

if TYPE_CHECKING:
    from beamdae.beams.exact import GeometricallyExact

Array = np.ndarray

_DEFAULT_FORMULATION = "floating frame"
EXACT_FORMULATION = "exact"
CUSTOM_FORMULATION = "custom"
FORMULATIONS = (_DEFAULT_FORMULATION, EXACT_FORMULATION)
NODES = tuple(range(2, 14))  # per element
_DEFAULT_ELEMENTS, _DEFAULT_NODES = 8, 4

# Sections higher than the beam is long are those of blocks, or width and height are exchanged, as
# of short flexures; sizes in millimeters give factors of 1000. Beams joined to others may be short
# pieces of a longer bar.
_MAX_HEIGHT_TO_LENGTH_RATIO, _MAX_HEIGHT_TO_LENGTH_RATIO_OF_PIECES = 1.0, 3.0
# Metals have damping ratios below 1e-2. Round dampings above 1 ms, such as 0.02, are ratios by
# mistake rather than values that damp the fast vibrations of a mechanism, typically 1e-5 to 1e-4 s.
# Values that follow from a ratio and a frequency have more digits.
_MIN_STIFFNESS_OF_METALS = 1e10  # Pa
_MAX_DAMPING_RATIO_OF_METALS = 0.1
_MAX_DAMPING_OF_METALS = 1e-3  # s
_DIGITS_OF_RATIOS = 2
# First frequency of a cantilever, (1.8751^2 / (2 pi L^2)) sqrt(EI / rhoA).
_CANTILEVER_FREQUENCY = 1.8751040687**2 / (2.0 * np.pi)

# Winkler & Bach: the bending stiffness of a curved rectangle whose axis keeps its length is
# EI (1 + 0.15 (h/R)^2); without a normal force, the factor is 0.067.
_WINKLER_BACH_STIFFNESS = 0.15
# Curvature times height at which the bending stiffness has an error of 1 %.
_MAX_CURVATURE_TIMES_HEIGHT = 0.26

# Radius of gyration over length. Below the minimum, the bending terms are lost in rounding errors
# of the axial terms.
_MIN_GYRATION_RATIO = 1e-12
_MAX_GYRATION_RATIO = 1e2
_GYRATION_SAMPLES = 3  # sections at which a varying section is checked

# Largest exponent of `Beam.largest_stress`.
_MIN_STRESS_INTERVALS = 16  # between the sections of a largest stress, along the beam
STRESS_SECTIONS_OF_TAPERS = 6  # per section of a largest stress in a beam of constant section
_MAX_EXPONENT = 1000.0

# Lower bound of the memory of a run per element and node interval, for all integrators [bytes].
# Measured: 95 to 150 kB, in long chains of beams and in a single beam of 10 000 elements.
_BYTES_PER_ELEMENT_INTERVAL = 9e4


class Beam(Part):
    """Planar, shear-flexible, geometrically nonlinear curved beam.

    The default formulation is the floating frame of Pan & Liu, Theor. Appl. Mech. Lett. 2 (2012)
    063006, doi:10.1063/2.1206306. `formulation="exact"` selects the geometrically exact formulation
    of Reissner, J. Appl. Math. Phys. 23 (1972) 795, and Simo, Comput. Methods Appl. Mech. Eng. 49
    (1985) 55.

    Parameters
    ----------
    name
        Unique name.
    curve
        Reference curve of the axis: a Line, Arc, Parabola, Curve, IntrinsicCurve, Segment or
        another `PlaneCurve`.
    section
        Cross-section. For a section that varies along the beam, a `taper` or a function of arc
        length s [m] that returns a `Section`. With `elements`, elements end at the kinks of a
        `taper`; where a function jumps, pass `elements=[...]`.
    elements
        By default (None), the program chooses the mesh in the first assembly (run, check or
        analysis). Elements end at joints, masses, loads and other attachments, at kinks of a
        `taper`, at jumps of a function of s, and at the `breaks` of a curve. They have the same
        degree: 7 without such ends, and 6, 5 or 3 where more elements are needed, also to follow
        the curve or a moving load. With more than about 20 ends, there are eight cubic
        elements. Modes and linear models use a copy with elements that resolve ten modes of each
        beam, unless they are about an instant of a run or an `Equilibrium`.
        Otherwise, the number of elements (by default 8, for settings that exclude long elements:
        `nodes`, custom `kinematics`, elements_shape="straight" or continuity="local"), or the arc
        lengths of the element ends [m], ascending from 0 to the length of the curve. With a number
        n, the elements have equal arc length, unless a joint, a mass, a load or another part is
        attached between two element ends. The first assembly then divides the beam there into at
        least n elements, none of which is longer than with equal lengths. A beam is not divided if
        it would need more than 2 n + 8 elements, if it has custom `kinematics`, or if its
        coordinates must not change because the start or a custom `Quantity` refers to them.
        `errors` of results include those by all meshes.
    strain
        Strain measure of the floating frame:

        - "exact" (default): Reissner's strains, valid for any rotation relative to the frame.
        - "nonlinear": the paper's quadratic terms (eq. 5), (u'^2 + v'^2)/2 in the axial strain.
        - "green": Green's quadratic terms ((u' - v/R)^2 + (v' + u/R)^2)/2, with the curvature.
          Equivalent to "nonlinear" for straight beams.
        - "linear": no quadratic terms.
    elements_shape
        "curved" (default, as in the paper) or "straight" (polygon through points of the curve).
    continuity
        Quantity that neighboring elements share at their common node, in addition to the section
        rotation: "cartesian" (default), the displacement vector, or "local", its components along
        and across the axis (as in the paper; curved elements with 3 or 4 nodes only). Floating
        frame only.
        With "local", the small angle at which the axes of the elements meet is neglected, which
        limits convergence to order 2 instead of 4 and more (measured, see validation/).
    nodes
        Nodes per element: 4 (default with `elements`, cubic, as in the paper), 3, 2 (linear, always
        straight), or 5 to 13 Gauss-Lobatto points. With smooth curves and sections, errors decrease
        exponentially with the number of nodes.
    quadrature
        Number of Gauss points per element for the stiffness terms: nodes - 1 with "reduced"
        (default), nodes with "full". Reduced quadrature needs about half as many elements for the
        same error (measured, see validation/). With full quadrature, 2-node elements and curved
        3-node elements lock, and curved 4-node elements lose accuracy on slender arcs.
    frame
        Position of the floating frame: "chord", from end to end (default if the distance between
        the ends is at least a tenth of the length), or "tangent", on the start section (as in the
        paper; the default otherwise). In a chord frame, integrators need as few as a quarter of the
        steps, but many where the ends pass each other closely. Except for strain="exact", the
        strains hold for moderate rotations relative to the frame, and a beam with a chord frame can
        bend several times as far for the same error (measured, see validation/). With "nonlinear"
        strains and a curve whose tangent rotates by more than 90 degrees, the tangent frame is more
        accurate. `Solution.errors` states the error by the strains ("theory"). A beam with
        formulation="exact" has no floating frame: `frame` is then the reference frame of
        `deformation`.
    velocity, angular_velocity
        Initial velocity of the start point [m/s] and angular velocity [rad/s] of the beam, moving
        as a rigid body. Values that are given, also zero, are kept if the joints allow it, and the
        connected bodies move with them. By default (None), the beam follows the joints.
    kinematics
        Custom kinematics in place of `formulation`: a subclass of `Kinematics` (in the module
        beamdae.beams.kinematics), or a function of (name, mesh, section) that returns an instance
        of such a class.
    free_curve
        Stress-free shape of a beam that is bent in the reference configuration, where it carries
        the moment M = EI (1/R_free - 1/R). The position of this curve is irrelevant. Its length may
        differ by up to 1 % from the length of `curve`, which causes an initial axial strain.
        Strains, section forces and the strain energy are measured from the stress-free shape.
    formulation
        - "floating frame" (default): displacements relative to a frame that moves with the beam.
        - "exact": positions and angles of the sections in the inertial frame and the exact strains
          r'.t - 1, r'.n and psi0' - psi', valid for any deformation, with the axes t, n that rotate
          with the section. The mass matrix is constant. For fast, large rotations, the floating
          frame needs fewer steps (measured, see validation/).

    Raises
    ------
    BeamdaeError
        If a setting is invalid or belongs to another formulation, the radius of gyration of the
        section does not fit the length of the beam, the elements are too few to follow the curve,
        or memory is insufficient.

    Warns
    -----
    BeamdaeWarning
        If the section is too high for the curvature of the axis. At assembly, if the section is
        higher than the curve is long (over three times as high if other beams are joined to it), or
        a damping of more than 1 ms with two digits, such as 0.02, would give a metal cantilever of
        its length a damping ratio above 0.1.

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    >>> arc = bd.Arc(radius=0.85, length=0.8, angle=-0.6)
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> beam = mech.add(bd.Beam("beam", arc, strip))
    >>> mech.observe("tip", beam.end)
    """

    point_syntax = "its .start, .end or .at(s)"

    def __init__(
        self,
        name: str,
        curve: PlaneCurve,
        section: Section | SectionLaw | Taper,
        elements: int | Sequence[float] | None = None,
        strain: str | None = None,
        elements_shape: str = "curved",
        continuity: str | None = None,
        nodes: int | None = None,
        quadrature: str | None = None,
        frame: str | None = None,
        velocity: tuple[float, float] | None = None,
        angular_velocity: float | None = None,
        kinematics: Callable[[str, Mesh, Any], Kinematics] | None = None,
        free_curve: PlaneCurve | None = None,
        formulation: str = _DEFAULT_FORMULATION,
    ) -> None:
        self.name = require_name("Beam", name)
        self.curve = require_curve(name, curve)
        self.section: Section | VaryingSection = require_section(name, section, curve.length)
        self.velocity = optional(require_point)(name, "velocity", velocity)
        self.angular_velocity = optional(require_finite)(name, "angular_velocity", angular_velocity)
        require_choice(name, "elements_shape", elements_shape, ("curved", "straight"))
        # Long elements are curved, and custom kinematics may assume cubic elements.
        is_local = as_text(continuity) == "local"
        is_special = elements_shape == "straight" or is_local or kinematics is not None
        self._has_moving_load = False  # set by parts that move along the beam
        self._has_chosen_mesh = elements is None and nodes is None and not is_special
        if self._has_chosen_mesh:
            self._requested_mesh = self._divide_mesh(())
        else:
            count, bounds = _parse_elements(name, elements, curve.length)
            nodes = require_count(name, "nodes", _DEFAULT_NODES if nodes is None else nodes)
            require_choice(name, "nodes", nodes, NODES)
            mesh = Mesh(curve, count, nodes, elements_shape, bounds=bounds)
            self._requested_mesh = intern_mesh(mesh)
        _require_mesh_memory(name, self.mesh)
        _require_valid_slenderness(name, self.section, self.length)
        self.mesh.require_resolved_curve(name)
        _warn_about_curvature(name, self.mesh, self.section)
        settings: dict[str, Any] = {
            "strain": strain,
            "continuity": continuity,
            "quadrature": quadrature,
            "frame": frame,
            "free_curve": free_curve,
        }
        self._formulation, self._make_kinematics = formulation, kinematics
        self._settings = {key: value for key, value in settings.items() if value is not None}
        _ = self.kinematics

    def __repr__(self) -> str:
        elements = format_count(self.mesh.elements, "element")
        return f"Beam(name={self.name!r}, {self.length:.6g} m in {elements})"

    # The first assembly replaces the values of the following properties. They are cached
    # properties because fingerprints of models omit these.

    @cached_property
    def mesh(self) -> Mesh:
        """Mesh of the beam; final after the first assembly, see `elements`."""
        return self._requested_mesh

    @cached_property
    def kinematics(self) -> Kinematics:
        """Motion and strains of the points of the beam on the present mesh."""
        part, formulation, settings = self.name, self._formulation, self._settings
        require_choice(part, "formulation", formulation, FORMULATIONS)
        if self._make_kinematics is not None:
            unused = [*settings, *(["formulation"] if formulation != _DEFAULT_FORMULATION else [])]
            if unused:
                raise BeamdaeError(
                    f"{part}: {' and '.join(unused)} must be omitted with custom kinematics, "
                    "which replaces the built-in formulations."
                )
            return create_custom_kinematics(part, self._make_kinematics, self.mesh, self.section)
        kinematics = _kinematics_type(formulation)
        supported = {field.name for field in fields(kinematics)}
        unsupported = [name for name in settings if name not in supported]
        if unsupported:
            raise BeamdaeError(
                f"{part}: {' and '.join(unsupported)} must be omitted with "
                f"formulation={formulation!r}; alternatively, use "
                f"formulation={_DEFAULT_FORMULATION!r}."
            )
        return kinematics(part, self.mesh, self.section, **settings)

    @cached_property
    def _has_final_mesh(self) -> bool:
        if self._has_chosen_mesh:
            return False
        # The mesh of custom kinematics is not changed, because they may assume equal elements.
        return self._requested_mesh.bounds is not None or self._make_kinematics is not None

    @cached_property
    def _stress_mesh(self) -> Mesh | None:
        """Mesh that determines the sections of `largest_stress`; None for the present mesh."""
        return None

    def _divide_mesh(self, arc_lengths: Iterable[float]) -> Mesh:
        """Return the mesh after the first assembly with attachments at `arc_lengths` [m].

        Elements also end at kinks of a taper and, if the program chooses the mesh, at jumps of the
        section and at kinks of the curve.
        """
        if self._has_final_mesh:
            return self.mesh
        stops = {*arc_lengths, *(self.section.kinks or ())}
        if self._has_chosen_mesh:
            stops |= {*self.section.jumps, *curve_breaks(self.curve)}
            return intern_mesh(choose_mesh(self.curve, sorted(stops), self._has_moving_load))
        return intern_mesh(self.mesh.with_ends_at(sorted(stops)))

    def _prepare(self, attached: Sequence[AttachedPart], has_fixed_coordinates: bool) -> bool:
        """Place element ends at attachments and kinks of the section, and make the mesh final.

        The mesh does not change if it is final already (after an earlier assembly, with given
        element ends, or with custom kinematics) or if `has_fixed_coordinates` is True. Warn if the
        section is higher than the curve is long (over three times, if other beams are joined), or a
        damping of more than 1 ms with two digits would give a metal cantilever of its length a
        damping ratio above 0.1.
        """
        sections = [x for x in attached if x.attachment.s is not None]
        last = self.mesh
        if not has_fixed_coordinates:
            mesh = self._divide_mesh(float(x.attachment.s or 0.0) for x in sections)
            if mesh is not self.mesh:
                set_fields(self, mesh=mesh)
                vars(self).pop("kinematics", None)
        set_fields(self, _has_final_mesh=True)
        _warn_about_units(self, attached)
        return self.mesh is not last

    @property
    def formulation(self) -> str:
        """Formulation of the kinematics; "custom" for custom kinematics."""
        return CUSTOM_FORMULATION if self._make_kinematics is not None else self._formulation

    def _with_mesh(self, mesh: Mesh, stress_mesh: Mesh | None = None) -> Beam:
        """Return a copy of the beam with another mesh.

        Assembly does not change this mesh if it has `bounds`, or the program chose that of this
        beam. `largest_stress` has the sections of this beam, also on another mesh.

        Parameters
        ----------
        mesh
            Mesh on the curve of the beam, in inertial axes.
        stress_mesh
            Mesh of this beam after its first assembly, see `_divide_mesh`. Defaults to its present
            mesh.
        """
        other = copy(self)
        if mesh is not self.mesh:
            other._stress_mesh = self._stress_mesh or stress_mesh or self.mesh
        for name in ("mesh", "kinematics", "_has_final_mesh"):
            vars(other).pop(name, None)
        other._requested_mesh = mesh
        if other._has_chosen_mesh:
            other._has_final_mesh = True
        return other

    def _prolongation_to(self, fine: Part) -> sp.csc_array:
        """Return the matrix that maps changes of coordinates to those on another mesh."""
        assert isinstance(fine, Beam)
        if fine.mesh is self.mesh:
            return super()._prolongation_to(fine)
        return prolongation_matrix(self.kinematics, fine.kinematics)

    def _with_exact_strains(self) -> Beam:
        """Return a copy with strain="exact" and the same coordinates.

        Beams that have them, and those with custom kinematics, are returned unchanged.
        """
        if self.formulation != _DEFAULT_FORMULATION:
            return self
        other, kinematics = copy(self), self.kinematics
        assert isinstance(kinematics, FloatingFrame)
        if kinematics.strain == "exact":
            return self
        vars(other).pop("kinematics", None)
        other._settings = {**self._settings, "strain": "exact"}
        return other

    def _with_free_curve(self, free_curve: PlaneCurve) -> Beam:
        """Return a copy of the beam with another stress-free shape, see `free_curve`.

        Raises
        ------
        BeamdaeError
            If the beam has custom kinematics, or the length of the curve does not fit.
        """
        if self._make_kinematics is not None:
            raise BeamdaeError(
                f"{self.name}: custom kinematics have no free_curve; use a built-in formulation."
            )
        other = copy(self)
        vars(other).pop("kinematics", None)
        other._settings = {**self._settings, "free_curve": free_curve}
        _ = other.kinematics
        return other

    @property
    def free_curve(self) -> PlaneCurve:
        """Stress-free shape; the reference curve unless `free_curve` was given."""
        return self._settings.get("free_curve", self.curve)

    @property
    def length(self) -> float:
        """Arc length of the reference curve [m]."""
        return self.curve.length

    @property
    def coordinates(self) -> tuple[Variable, ...]:
        """Name and unit of each coordinate."""
        return self.kinematics.coordinates

    @property
    def rigid_coordinate_count(self) -> int:
        """Number of leading coordinates of a rigid motion; 0 without a floating frame."""
        return self.kinematics.rigid_coordinate_count

    @property
    def frame_follows_section(self) -> bool:
        """True if the body has a floating frame that moves with one of its sections."""
        return self.kinematics.frame_follows_section

    @property
    def initial_position(self) -> Array:
        """Coordinates [m, rad] in the reference configuration, shape (n,)."""
        return self.kinematics.initial_position

    @property
    def initial_velocity(self) -> Array:
        """Initial rates of the coordinates [m/s, rad/s], shape (n,)."""
        velocity, angular_velocity = self.velocity or (0.0, 0.0), self.angular_velocity or 0.0
        return self.kinematics.initial_velocity(velocity, angular_velocity)

    @cached_property
    def outline(self) -> Array:
        """Points along the reference curve (k, 2) [m]."""
        return self._requested_mesh.outline

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Return the forces of inertia, elasticity, material damping and weight.

        `gravity` is the acceleration of gravity (2,) [m/s^2].
        """
        kernel, piece = self.kinematics.element.kernel(), Piece(self, self.kinematics.operator)
        return [ForceStatement(self.name, kernel, (piece,), self.kinematics.data(gravity))]

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """Return a drawing of `points` equidistant sections along the axis."""
        return Drawing("beam", [self.at(s) for s in np.linspace(0.0, self.length, points)])

    @property
    def start(self) -> Attachment:
        """Section at arc length 0."""
        return self.at(0.0)

    @property
    def end(self) -> Attachment:
        """Section at the full arc length."""
        return self.at(self.length)

    def at(self, s: float) -> Attachment:
        """Return the section at arc length `s`.

        Parameters
        ----------
        s
            Arc length [m], from 0 to `length`.

        Returns
        -------
        Attachment
            The section, for joints, loads and observables.

        Raises
        ------
        BeamdaeError
            If `s` is outside the beam.
        """
        s = self._require_arc_length(s)
        return BeamAttachment(self, s)

    @property
    def floating_frame(self) -> Attachment:
        """Floating frame, or reference frame of an exact beam, for `Mechanism.observe`.

        Raises
        ------
        BeamdaeError
            If custom kinematics have no frame.
        """
        return BeamAttachment(self, None)

    def _require_arc_length(self, s: float) -> float:
        s = require_finite(self.name, "arc length s", s)
        slack = ARC_LENGTH_TOLERANCE
        if not -slack * self.length <= s <= self.length * (1.0 + slack):
            length, given = format_distinct(self.length, s)
            raise BeamdaeError(
                f"{self.name}: arc length s must lie in [0, {length}] m, got {given} m."
            )
        return s

    @rebuilt_for_mesh
    def deformation(self, s: float, axes: str = "inertial") -> Quantity:
        """Return displacement and rotation at `s` relative to the undeformed beam in its frame.

        The undeformed beam moves with the frame: the floating frame, or `frame` of an exact beam.
        For a beam that turns, such as a connecting rod, use `axes="frame"`: for a straight beam
        with a chord frame, u is then the shortening and v the bending. In the inertial axes of the
        default, both contain shares of shortening and bending that change as the beam turns. For
        the displacement relative to a clamp, use `deflection`.

        Parameters
        ----------
        s
            Arc length [m]; not at an end of a beam with a chord frame, because the chord follows
            its ends.
        axes
            Axes of the displacement: "inertial", "frame" (the axes of the frame) or "local" (the
            tangent frame at `s` of the undeformed beam).

        Returns
        -------
        Quantity
            Columns u, v [m] and phi [rad].

        Raises
        ------
        BeamdaeError
            If `s` is at an end of a chord frame or outside the beam, `axes` is unknown, or custom
            kinematics have no frame.
        """
        require_choice(self.name, "axes", axes, ("inertial", "frame", "local"))
        deformation = self.kinematics.deformation(self._require_arc_length(s), axes)
        columns = (Variable("u", "m"), Variable("v", "m"), Variable("phi", "rad"))
        pieces = [Piece(self, deformation.operator)]
        return formula_quantity(columns, pieces, identity, [deformation.values])

    @rebuilt_for_mesh
    def deflection(self, s: float, reference: float = 0.0) -> Quantity:
        """Return displacement and rotation at `s` relative to the section at `reference`.

        The undeformed beam moves rigidly with the section at `reference`, for example at a clamp.
        The components refer to the axes of this section, which rotate with it.

        Parameters
        ----------
        s
            Arc length [m].
        reference
            Arc length of the reference section [m]. Defaults to the start of the beam.

        Returns
        -------
        Quantity
            Columns axial [m] (along the axis at `reference`), transverse [m] (along the left normal
            of this axis) and rotation [rad] (counter-clockwise).

        Raises
        ------
        BeamdaeError
            If an arc length is outside the beam.

        Examples
        --------
        >>> import beamdae as bd
        >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
        >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
        >>> blade = mech.add(bd.Beam("blade", bd.Line((0.0, 0.0), (1.0, 0.0)), strip))
        >>> clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), blade.start))
        >>> mech.observe("tip", blade.deflection(blade.length))
        >>> round(float(bd.equilibrium(mech).columns["tip.transverse [m]"][-1]), 4)
        -0.0343
        """
        columns = (Variable("axial", "m"), Variable("transverse", "m"), Variable("rotation", "rad"))
        quantity = relative_displacement(self.at(s), self.at(reference), axes="section")
        return replace(quantity, columns=columns)

    def strain(self, s: float, offset: float | str) -> Quantity:
        """Return the longitudinal strain of a fiber: its stress without damping, divided by E.

        The strain is eps11 + l kappa11 with the strains of the axis and the lever l of
        `stress_lever`, which is the offset of the fiber in beams without initial curvature. The
        strains follow from the section forces, interpolated to `s` between the stiffness quadrature
        points, where an element is most accurate. Where they jump, such as at a joint or load, the
        value is that just beyond `s`.

        Parameters
        ----------
        s
            Arc length [m].
        offset
            Distance of the fiber from the axis [m], positive to the left of the curve; or, if the
            section has a height, "top" (left surface) or "bottom" (right surface).

        Returns
        -------
        Quantity
            One column, the strain [-].

        Raises
        ------
        BeamdaeError
            If `s` is outside the beam, the fiber lies outside the section, the section has no
            height for "top" or "bottom", or it reaches the center of curvature.
        """
        x, lever = self._section_at(s), self.stress_lever(s, offset)
        return self._evaluate_strains(s, (Variable("", "-"),), fiber_strain, lever, x.EA, x.EI)

    def stress(self, s: float, offset: float | str) -> Quantity:
        """Return the longitudinal stress of a fiber, including material damping.

        The stress is E (strain + damping * strain rate) with the strain of `strain`.

        Parameters
        ----------
        s, offset
            See `strain`.

        Returns
        -------
        Quantity
            One column, the stress [Pa].

        Raises
        ------
        BeamdaeError
            See `strain`.
        """
        x = self._section_at(s)
        numbers = (self.stress_lever(s, offset), x.EA, x.EI, x.material.E)
        return self._evaluate_strains(s, (Variable("", "Pa"),), fiber_stress, *numbers)

    def largest_stress(
        self, s: Sequence[float] | None = None, exponent: float | None = None
    ) -> Quantity:
        """Return the largest longitudinal stress over the length of the beam, in magnitude.

        The stresses are those of `stress` in the outer fibers, top and bottom. Between the sections
        at `s`, they may be larger. The derivatives of the largest magnitude jump where another
        section becomes the largest one. With an exponent p, the quantity contains a smooth bound,
        too, for limits and objectives of optimizations: with the largest magnitude sigma_k of N
        sections,

            bound = (sum of sigma_k^p)^(1/p),    largest <= bound <= N^(1/p) largest.

        100 sections with equal stresses and p = 150 are 3 % below their limit.

        Parameters
        ----------
        s
            Arc lengths of the sections [m]. Defaults to both ends and the middle of each element
            of the mesh that the first assembly divides at attachments, see `elements`; elements of
            fewer than eight are divided further, into 16 intervals along the beam. At an element
            end, each of its two elements has a section, because stresses may jump there. If the
            cross-section varies, they are six times as many, and those nearest to kinks and
            narrow places are moved there; grooves shorter than 1/512 of the beam may be
            overlooked. Refined runs evaluate the same sections on all meshes.
        exponent
            The exponent p of a smooth bound, between 1 and 1000, such as 150; None for the largest
            stress alone. Larger exponents are closer to it, but the derivative then changes
            abruptly if another section becomes the largest.

        Returns
        -------
        Quantity
            Column largest [Pa], and with an exponent bound [Pa]: after
            `mech.observe("stress", ...)`, read `solution["stress.largest"]`.

        Raises
        ------
        BeamdaeError
            If an arc length is outside the beam, a section has no height or reaches the center of
            curvature, or `exponent` is invalid.

        Examples
        --------
        >>> import beamdae as bd
        >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
        >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
        >>> blade = mech.add(bd.Beam("blade", bd.Line((0.0, 0.0), (1.0, 0.0)), strip))
        >>> clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), blade.start))
        >>> mech.observe("stress", blade.largest_stress())
        >>> path = bd.equilibrium(mech)
        >>> print(f"{1e-6 * path.columns['stress.largest [Pa]'][-1]:.1f} MPa")
        57.7 MPa
        """
        arc_lengths = None
        if s is not None:
            entries = require_sequence(self.name, "s", s, "a list of arc lengths [m]")
            if not entries:
                raise BeamdaeError(f"{self.name}: s is empty; pass at least one arc length [m].")
            arc_lengths = tuple(self._require_arc_length(x) for x in entries)
        if exponent is not None:
            exponent = require_between(self.name, "exponent", exponent, 1.0, _MAX_EXPONENT)
        return self._evaluate_largest_stress(arc_lengths, exponent)

    @rebuilt_for_mesh
    def _evaluate_largest_stress(
        self, arc_lengths: tuple[float, ...] | None, exponent: float | None
    ) -> Quantity:
        """Do the work of `largest_stress` on the present mesh."""
        functions: list[Callable[..., Any]] = []
        # Sections of an element share its coordinates.
        operators: dict[int, sp.csr_array] = {}
        places, last = [], 0
        for s in self._stress_sections(arc_lengths):
            x, forces = self._section_at(s), self.kinematics.section_forces(s)
            if id(forces.operator) not in operators:
                operators[id(forces.operator)] = forces.operator
                last += forces.operator.shape[0]
            places.append((last - forces.operator.shape[0], last))
            levers = (self.stress_lever(s, "top"), self.stress_lever(s, "bottom"))
            functions += [forces.values, constant_formula(*levers, x.EA, x.EI, x.material.E)]
        kind = LargestStress(tuple(places), exponent)
        pieces = [Piece(self, x) for x in operators.values()]
        names = ("largest",) if exponent is None else ("largest", "bound")
        columns = [Variable(x, "Pa") for x in names]
        return formula_quantity(columns, pieces, kind, functions, is_magnitude=True)

    def _stress_sections(self, arc_lengths: tuple[float, ...] | None) -> tuple[float, ...]:
        """Return the arc lengths [m] of `largest_stress` on both sides of element ends.

        Default sections are denser if the cross-section varies; those nearest to its breaks are
        moved there, so that their number does not depend on kinks.
        """
        mesh = self._stress_mesh or self.mesh
        if arc_lengths is not None:
            return tuple(x for s in arc_lengths for x in mesh.sides_of(s))
        is_varying = isinstance(self.section, VaryingSection)
        least = _MIN_STRESS_INTERVALS * (STRESS_SECTIONS_OF_TAPERS if is_varying else 1)
        intervals = max(2, math.ceil(least / mesh.elements))
        places = mesh.with_divided_elements(intervals).element_bounds.copy()
        inner = np.arange(len(places)) % intervals > 0
        breaks = [s for s in self.section.breaks if not mesh.has_end_at(s)]
        for s in breaks[: np.count_nonzero(inner)]:
            nearest = int(np.argmin(np.where(inner, np.abs(places - s), np.inf)))
            places[nearest], inner[nearest] = s, False
        before = mesh.just_before(np.array(self.section.jumps)).tolist()
        at_sides = (x for s in places.tolist() for x in mesh.sides_of(s))
        return tuple(sorted({*at_sides, *before}))

    def section_forces(self, s: float) -> Quantity:
        """Return axial force, shear force and bending moment at `s`, computed from the strains.

        N = EA eps11, Q = GA 2 eps12 and M = EI kappa11 with the strains of the axis, plus the
        forces of material damping. For strains that assume moderate rotations phi in the floating
        frame, EA eps11 is the force along the undeformed axis, and N = EA eps11 + Q sin(phi). Where
        the section forces jump, such as at a joint or load, the values are those just beyond `s`. A
        positive M lengthens the left side of the beam.

        Parameters
        ----------
        s
            Arc length [m].

        Returns
        -------
        Quantity
            Columns N [N], Q [N] and M [N m].

        Raises
        ------
        BeamdaeError
            If `s` is outside the beam.
        """
        columns = (Variable("N", "N"), Variable("Q", "N"), Variable("M", "N m"))
        return self._evaluate_strains(s, columns, section_forces)

    def stress_lever(self, s: float, offset: float | str) -> float:
        """Return the lever [m] of a fiber for the curvature of the stress-free beam at `s`.

        See `Section.stress_lever`: the stress in the fiber is N / A + M lever / I.

        Parameters
        ----------
        s, offset
            See `strain`.

        Raises
        ------
        BeamdaeError
            See `strain`, or if the section reaches the center of curvature.
        """
        s = self._require_arc_length(s)
        return self.section.at(s).stress_lever(self.name, offset, self.free_curvature(s))

    def free_curvature(self, s: float) -> float:
        """Return the curvature of the stress-free beam at the arc length `s` [m], in 1/m."""
        free = self.free_curve
        return float(free.curvature(s * free.length / self.length))

    def _section_at(self, s: float) -> Section:
        return self.section.at(self._require_arc_length(s))

    @staticmethod
    def _of_strains(quantity: Quantity) -> Beam | None:
        """Return the beam if a quantity was computed from its strains."""
        recipe = quantity.recipe
        builds = Beam._evaluate_strains, Beam._evaluate_largest_stress
        return recipe.arguments[0] if recipe is not None and recipe.build in builds else None

    @staticmethod
    def _values_of_section_forces(quantity: Quantity, forces: Array, s: Sequence[float]) -> Array:
        """Return the columns of a quantity of strains for given section forces.

        Parameters
        ----------
        quantity
            A quantity of strains, see `_of_strains`.
        forces
            N [N], Q [N] and M [N m], (3, ..., sections).
        s
            Arc lengths of these sections [m]; they need not be those of the quantity.

        Returns
        -------
        ndarray
            Columns of each section (columns, ..., sections). Those of `largest_stress` are the
            largest magnitude in the section.
        """
        assert quantity.recipe is not None
        beam, _, *settings = quantity.recipe.arguments
        if section_forces in settings:
            return forces
        if quantity.recipe.build is Beam._evaluate_largest_stress:
            return np.array([beam._largest_fiber_stresses(forces, s)] * len(quantity.columns))
        _, kind, lever, *_ = settings
        return beam._fiber_values(forces, s, lever, kind is fiber_stress)[None]

    def _largest_fiber_stresses(
        self, forces: Array, s: Sequence[float], is_stress: bool = True
    ) -> Array:
        """Return the largest stress magnitudes [Pa], or strains, of the outer fibers of sections.

        `forces` are N [N], Q [N] and M [N m], (3, ..., sections), and `s` the arc lengths [m].
        """
        levers = [np.array([self.stress_lever(x, side) for x in s]) for side in ("top", "bottom")]
        return np.max([np.abs(self._fiber_values(forces, s, x, is_stress)) for x in levers], axis=0)

    def _fiber_values(
        self, forces: Array, s: Sequence[float], lever: Any, is_stress: bool
    ) -> Array:
        sections = [self.section.at(x) for x in s]
        EA, EI, modulus = np.array([(x.EA, x.EI, x.material.E) for x in sections]).T
        strain = strain_by_forces(forces, lever, EA, EI)
        return np.asarray(modulus * strain if is_stress else strain)

    @rebuilt_for_mesh
    def _evaluate_strains(
        self, s: float, columns: tuple[Variable, ...], kind: Callable[..., SX], *numbers: float
    ) -> Quantity:
        """Return the quantity that `kind` computes from the strains at `s` and `numbers`."""
        s = self._require_arc_length(s)
        forces = self.kinematics.section_forces(s)
        pieces = [Piece(self, forces.operator)]
        functions: list[Callable[..., Any]] = [forces.values]
        if numbers:
            functions.append(constant_formula(*numbers))
        return formula_quantity(columns, pieces, kind, functions, is_elastic=True)


class BeamAttachment(Attachment):
    """Section or floating frame of a beam, on the present mesh of the beam.

    Parameters
    ----------
    body
        The beam.
    s
        Arc length of the section [m]; None for the floating frame.
    """

    def __init__(self, body: Beam, s: float | None) -> None:
        set_fields(self, body=body, s=s, has_angle=True)
        at = self._material_point
        # Custom kinematics may return anything; attachments check their arguments.
        Attachment(body, at.reference_position, at.inclination, at.operator, at.motion, s=s)

    @property
    def _material_point(self) -> MaterialPoint:
        kinematics: Kinematics = self.body.kinematics
        return kinematics.floating_frame if self.s is None else kinematics.material_point(self.s)

    @property
    def point(self) -> tuple[float, float]:
        """Position (x, y) in the reference configuration [m]."""
        x, y = self._material_point.reference_position
        return float(x), float(y)

    @property
    def inclination(self) -> float:
        """Angle of the section or frame in the reference configuration [rad]."""
        return float(self._material_point.inclination)

    @property
    def operator(self) -> sp.csr_array:
        """Matrix that maps the beam coordinates to the local coordinates of `kinematics`."""
        return self._material_point.operator

    @property
    def kinematics(self) -> Callable[[SX], tuple[SX, SX]]:
        """Function of the local coordinates that returns position [m] and rotation [rad]."""
        return self._material_point.motion


def require_beam(part: str, value: Any) -> Beam:
    """Return `value` if it is a beam, or raise BeamdaeError."""
    if not isinstance(value, Beam):
        raise BeamdaeError(f"{part}: beam must be a Beam, got {short_repr(value)}.")
    return value


def beams_of(mechanism: Mechanism | None) -> list[Beam]:
    """Return the beams of a mechanism; none without a mechanism."""
    parts = () if mechanism is None else mechanism.parts.values()
    return [part for part in parts if isinstance(part, Beam)]


def _kinematics_type(formulation: str) -> type[FloatingFrame] | type[GeometricallyExact]:
    if formulation == _DEFAULT_FORMULATION:
        return FloatingFrame
    from beamdae.beams.exact import GeometricallyExact

    return GeometricallyExact


def _parse_elements(
    part: str, elements: Any, length: float
) -> tuple[int, tuple[float, ...] | None]:
    """Return the number of elements and the arc lengths of their ends [m] (None if not given)."""
    elements = _DEFAULT_ELEMENTS if elements is None else elements
    if as_real(elements) is not None:
        return require_count(part, "elements", elements), None
    what = "a number or the arc lengths of the element ends"
    bounds = np.array(
        [
            require_finite(part, "elements", s)
            for s in require_sequence(part, "elements", elements, what)
        ]
    )
    tolerance = ARC_LENGTH_TOLERANCE * length
    if (
        len(bounds) < 2
        or abs(bounds[0]) > tolerance
        or abs(bounds[-1] - length) > tolerance
        or not np.all(np.diff(bounds) > tolerance)
    ):
        raise BeamdaeError(
            f"{part}: the arc lengths in elements must ascend from 0 to {length:.6g} m, got "
            f"{short_repr(elements)}."
        )
    bounds[[0, -1]] = 0.0, length
    return len(bounds) - 1, tuple(bounds.tolist())


def _warn_about_units(beam: Beam, attached: Sequence[AttachedPart]) -> None:
    """Warn if the section is too high or its damping too large for any usual beam.

    The length is that of the whole curve, because other beams continue the segment of a curve.
    """
    curve = beam.curve
    while isinstance(curve, Segment):
        curve = curve.curve
    length = curve.length
    sections = [beam.section.at(s) for s in (0.0, 0.5 * beam.length, beam.length)]
    height = max(section.height or 0.0 for section in sections)
    bodies = (attachment.body for x in attached for attachment in x.part.attachments)
    is_piece = any(isinstance(body, Beam) and body is not beam for body in bodies)
    limit = _MAX_HEIGHT_TO_LENGTH_RATIO_OF_PIECES if is_piece else _MAX_HEIGHT_TO_LENGTH_RATIO
    if height > limit * length:
        warn_user(
            f"{beam.name}: the section is {height:.4g} m high, but the beam is only "
            f"{length:.4g} m long; exchange width and height, give sizes in meters, or model the "
            "part as a rigid body."
        )
    root = sections[0]
    frequency = _CANTILEVER_FREQUENCY * np.sqrt(root.EI / root.rhoA) / length**2
    ratio = np.pi * frequency * root.damping
    if (
        root.material.E >= _MIN_STIFFNESS_OF_METALS
        and root.damping > _MAX_DAMPING_OF_METALS
        and root.damping == float(f"{root.damping:.{_DIGITS_OF_RATIOS}g}")
        and ratio > _MAX_DAMPING_RATIO_OF_METALS
    ):
        warn_user(
            f"{beam.name}: `damping` is a time [s]; {root.damping:g} s gives a cantilever of this "
            f"section and length ({frequency:.3g} Hz) the damping ratio {ratio:.2g}. For the "
            "ratio z at the frequency f [Hz], use damping = z / (pi f)."
        )


def _warn_about_curvature(part: str, mesh: Mesh, section: Section | VaryingSection) -> None:
    if isinstance(section, Section):
        heights = np.array(section.height, float)
    else:
        s = mesh.gauss_arc_lengths(mesh.nodes)
        heights = np.array([section.at(x).height for x in s.tolist()], float)
    # Heights may be unknown.
    ratio = float(np.max(mesh.gauss_curvature * heights))
    if ratio > _MAX_CURVATURE_TIMES_HEIGHT:
        shape = "" if section.at(0.0).shapes else " and stresses assume a rectangular section"
        message = (
            f"{part}: the section height is {ratio:.2g} times the radius of "
            "curvature, so beam theory has an error of "
            f"{100.0 * _WINKLER_BACH_STIFFNESS * ratio**2:.1f} % in the bending "
            f"stiffness{shape}; reduce the height or the curvature."
        )
        warn_user(message)


def _require_valid_slenderness(part: str, section: Section | VaryingSection, length: float) -> None:
    samples = (
        [section]
        if isinstance(section, Section)
        else map(section.at, np.linspace(0.0, length, _GYRATION_SAMPLES))
    )
    for x in samples:
        gyration = math.sqrt(x.second_moment / x.area)
        if not _MIN_GYRATION_RATIO <= gyration / length <= _MAX_GYRATION_RATIO:
            raise BeamdaeError(
                f"{part}: second_moment {x.second_moment:g} m^4 and area {x.area:g} "
                f"m^2 give a radius of gyration of {gyration:.3g} m; this radius must "
                f"be {_MIN_GYRATION_RATIO:g} to {_MAX_GYRATION_RATIO:g} times the "
                f"length of {length:g} m."
            )


def _require_mesh_memory(part: str, mesh: Mesh) -> None:
    """Reject a mesh whose run would exceed the available memory, before arrays are allocated."""
    bytes_per_element = _BYTES_PER_ELEMENT_INTERVAL * (mesh.nodes - 1)
    needed_bytes = bytes_per_element * mesh.elements
    if needed_bytes < UNCHECKED_BYTES:
        return
    available = available_memory()
    if needed_bytes <= available:
        return
    remedy = f"use at most elements={int(available / bytes_per_element)}"
    require_memory(part, f"a run with elements={mesh.elements}", needed_bytes, remedy)
