"""Points that slide along the deformed axis of a beam.

The axes of neighboring elements meet at small angles, but the second derivative of the constraint
requires a track with two continuous derivatives. The track consists of quintics between the nodes
of the beam. Slope and second derivative at a node are those of the quartic through the five nearest
nodes, or of the polynomial through all nodes if there are fewer than five.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import Beam, require_beam
from beamdae.curves.plane_curves import PlaneCurve
from beamdae.errors import BeamdaeError, choice_of, convert_fields, require_choice
from beamdae.parts.attachments import Attachment, require_attachment, rotate
from beamdae.parts.events import Event
from beamdae.parts.joints.joint import GapFormula, KinematicConstraint, meeting_tolerance
from beamdae.parts.part import FORCE, PlacedPoint
from beamdae.symbolic.formula import Formula
from beamdae.symbolic.statements import (
    SX,
    ConstraintStatement,
    Local,
    Piece,
    Quantity,
    Variable,
    formula_quantity,
    rebuilt_for_mesh,
)

Array = np.ndarray

_STENCIL_NODES = 5  # of slopes and second derivatives at a node
_DIGITS_OF_PLACES = 12
# Coefficients (power, datum) of the quintic from 0 to 1 with given values (2), slopes (2) and
# second derivatives (2) at its ends.
_QUINTIC = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.5, 0.0],
        [-10.0, 10.0, -6.0, -4.0, -1.5, 0.5],
        [15.0, -15.0, 8.0, 7.0, 1.5, -1.0],
        [-6.0, 6.0, -3.0, -3.0, -0.5, 0.5],
    ]
)

# Samples and iterations of the search for the arc length nearest to a point.
_SEARCH_SAMPLES = 257
_SEARCH_ITERATIONS = 10

# All nodes of the beam are in one constraint kernel. Measured: a step with 30 elements takes 35
# times as long as with 16 elements, a step with 60 elements thousands of times as long.
MAX_ELEMENTS_WITH_SLIDER = 32

_SLIDER_OPERATOR = sp.eye_array(1, format="csr")


@lru_cache(maxsize=32)
def _difference_matrices(nodes: tuple[float, ...]) -> tuple[ca.DM, ca.DM]:
    """Return the matrices of slopes and second derivatives at nodes, (count, count) each.

    They are those of the polynomial through the five nearest nodes.
    """
    s, count = np.array(nodes), len(nodes)
    width = min(count, _STENCIL_NODES)
    first, second = np.zeros((2, count, count))
    for i in range(count):
        start = int(np.clip(i - width // 2, 0, count - width))
        near = slice(start, start + width)
        scale = s[near][-1] - s[near][0]
        powers = np.linalg.inv(np.vander((s[near] - s[i]) / scale, increasing=True))
        first[i, near] = powers[1] / scale
        if width > 2:
            second[i, near] = 2.0 * powers[2] / scale**2
    return ca.sparsify(ca.DM(first)), ca.sparsify(ca.DM(second))


def interpolate_track(points: SX, s: SX, nodes: tuple[float, ...]) -> SX:
    """Return the point at `s` of the smooth curve through `points` (2, count) at `nodes`."""
    passed = [SX(1), *(s >= x for x in nodes[1:-1]), SX(0)]
    is_in_cell = ca.vertcat(*(here - later for here, later in pairwise(passed)))
    before, after = ca.vertcat(is_in_cell, 0), ca.vertcat(0, is_in_cell)
    start = ca.dot(is_in_cell, ca.DM(nodes[:-1]))
    length = ca.dot(is_in_cell, ca.DM(np.diff(nodes)))
    x = (s - start) / length
    inside = ca.fmin(ca.fmax(x, 0.0), 1.0)
    basis = sum((ca.DM(row) * inside**k for k, row in enumerate(_QUINTIC)), SX.zeros(6))
    # Outside the beam, the curve continues along its tangent.
    basis[2] += ca.fmin(x, 0.0)
    basis[3] += ca.fmax(x - 1.0, 0.0)
    at_nodes = [basis[k] * before + basis[k + 1] * after for k in (0, 2, 4)]
    first, second = _difference_matrices(nodes)
    slopes, curvatures = length * at_nodes[1], length**2 * at_nodes[2]
    return points @ (at_nodes[0] + first.T @ slopes + second.T @ curvatures)


def nearest_arc_length(curve: PlaneCurve, position: tuple[float, float]) -> float:
    """Return the arc length [m] of the point of a curve that is nearest to `position`.

    The position must lie on the curve or close to it.
    """
    samples = np.linspace(0.0, curve.length, _SEARCH_SAMPLES)
    s = float(samples[np.argmin(np.linalg.norm(curve.point(samples) - position, axis=1))])
    for _ in range(_SEARCH_ITERATIONS):
        angle = float(curve.tangent_angle(s))
        ahead = np.subtract(position, curve.point(s)) @ (np.cos(angle), np.sin(angle))
        s = float(np.clip(s + ahead, 0.0, curve.length))
    return s


@dataclass(frozen=True)
class _TrackGap:
    """Distance of a sliding point from the track through nodes, whose places are fractions."""

    nodes: tuple[float, ...]

    def __call__(self, t: SX, a: PlacedPoint, *others: Any) -> SX:
        *track, along, length = others
        points = ca.horzcat(*(x.position for x in track))
        return a.position - interpolate_track(points, along.position[0] / length, self.nodes)


@dataclass(frozen=True)
class _ReactionOnBeam:
    """Reaction on the beam at the contact point, in "inertial" axes or those of the track."""

    gap: GapFormula
    axes: str

    def __call__(self, local: Local, *arguments: Any) -> SX:
        if self.axes == "inertial":
            return local.lam
        slope = -ca.jacobian(self.gap(local, *arguments), local.q[-1])
        return rotate(-ca.atan2(slope[1], slope[0]), local.lam)


def _place_on_line(q: SX, numbers: Any) -> tuple[SX, SX]:
    return ca.vertcat(q, 0), SX(0)


def _slider_arc_length(local: Local) -> SX:
    return local.q


def _arc_length_and_rate(local: Local) -> SX:
    return ca.vertcat(local.q, local.v)


@dataclass(frozen=True, eq=False)
class SlidingOnBeam(KinematicConstraint):
    """Frictionless joint of a point that slides along a deformed beam: g = r_a - r_beam(s).

    The joint adds the coordinate s [m], the arc length of the undeformed beam at the point. This
    coordinate has no inertia; its initial value follows from the reference configuration. The
    reaction is normal to the track, a smooth curve through the nodes of the beam with two
    continuous derivatives. Beyond the ends of the beam, the track continues along its tangent;
    passing an end is an event.

    Parameters
    ----------
    name
        Unique name.
    a
        Attachment of another part; it must lie on the axis of the beam in the reference
        configuration.
    beam
        The beam, of at most 32 elements, including those that assembly adds at attachments.
    ends
        Action when the point passes an end: "record" the event and continue (default), or "stop"
        the run.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` is not an attachment, `beam` is not a Beam, `ends` is unknown, the
        point belongs to the beam itself or does not lie on its axis, or the beam has more than 32
        elements.

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    >>> beam = bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip)
    >>> bead = bd.PointMass("bead", 0.1, at=(0.25, 0.0))
    >>> slider = bd.SlidingOnBeam("slider", bead.point, beam)
    """

    symbol = "sleeve"
    moves_along_beam = True
    multipliers = (Variable("x", "N"), Variable("y", "N"))
    reactions = ("Fx", "Fy")
    name: str
    a: Attachment
    beam: Beam
    ends: str = "record"
    load_distribution = "shares"

    def __post_init__(self) -> None:
        convert_fields(self, ends=choice_of("record", "stop"))
        require_attachment(self.name, "first attachment", self.a)
        require_beam(self.name, self.beam)._has_moving_load = True
        if self.a.body is self.beam:
            raise BeamdaeError(
                f"{self.name}: the point must belong to a body other than the beam, got {self.a}."
            )
        self._require_few_elements()
        section = self.beam.at(self._initial_arc_length)
        gap = float(np.hypot(*np.subtract(section.point, self.a.point)))
        if gap > meeting_tolerance(self.a, section):
            raise BeamdaeError(
                f"{self.name}: the point must lie on the beam in the reference "
                f"configuration, but {self.a} is {gap:.6g} m off the axis of "
                f"{self.beam.name}."
            )

    def _require_few_elements(self) -> None:
        if self.beam.mesh.elements > MAX_ELEMENTS_WITH_SLIDER:
            raise BeamdaeError(
                f"{self.name}: the beam must have at most {MAX_ELEMENTS_WITH_SLIDER} elements, "
                f"but {self.beam.name} has {self.beam.mesh.elements} (assembly adds elements at "
                "attachments); use fewer elements, with up to 4 nodes each."
            )

    @cached_property
    def _initial_arc_length(self) -> float:
        return nearest_arc_length(self.beam.curve, self.a.point)

    @property
    def coordinates(self) -> tuple[Variable, ...]:
        """Name and unit of the arc length of the point."""
        return (Variable("s", "m"),)

    @property
    def initial_position(self) -> Array:
        """Arc length [m] of the point in the reference configuration, shape (1,)."""
        return np.array([self._initial_arc_length])

    @property
    def initial_velocity(self) -> Array:
        """Zero, shape (1,); the consistent initial value follows from the velocity of the point."""
        return np.zeros(1)

    @property
    def outline(self) -> Array:
        """Points (k, 2) of the beam in the reference configuration [m]."""
        return self.beam.outline

    @property
    def s(self) -> Quantity:
        """Arc length s of the point [m], and its rate [m/s]."""
        columns = (Variable("", "m"), Variable("rate", "m/s"))
        return formula_quantity(columns, [Piece(self, _SLIDER_OPERATOR)], _arc_length_and_rate)

    @rebuilt_for_mesh
    def reaction_on(self, place: str = "a", axes: str = "inertial") -> Quantity:
        """Return the reaction on the body of `a` or on the beam.

        Parameters
        ----------
        place
            "a" (default) for the body of `a`, or "beam" for the beam at the position of the point.
        axes
            "inertial" (default), or "body": axes that rotate with the body of `a`; for the beam,
            along the track and its left normal.

        Returns
        -------
        Quantity
            Columns Fx, Fy [N]. For "a", also M [N m] if the body of `a` can rotate; the moment is
            always zero.

        Raises
        ------
        BeamdaeError
            If `place` or `axes` is unknown.
        """
        require_choice(self.name, "place", place, ("a", "beam"))
        if place == "a":
            return super().reaction_on("a", axes)
        require_choice(self.name, "axes", axes, ("inertial", "body"))
        gap = self._gap_formula
        assert gap is not None
        return self._observe(_ReactionOnBeam(gap, axes), FORCE)

    @property
    def events(self) -> tuple[Event, ...]:
        """Events that occur when the point passes an end of the beam."""
        pieces = [Piece(self, _SLIDER_OPERATOR)]
        s = formula_quantity([Variable("", "m")], pieces, _slider_arc_length)
        ends = {"start": 0.0, "end": self.beam.length}
        return tuple(
            Event(s, crosses, "both", self.ends, f"{self.name} at the {end} of {self.beam.name}")
            for end, crosses in ends.items()
        )

    @property
    def points(self) -> dict[str, Attachment]:
        """The sliding point, the nodes of the beam, and the arc length as a place on a line."""
        nodes = self.beam.mesh.node_arc_lengths.tolist()
        along = Attachment(self, self.a.point, 0.0, _SLIDER_OPERATOR, Formula(_place_on_line))
        return {
            "a": self.a,
            **{f"node {k}": self.beam.at(s) for k, s in enumerate(nodes)},
            "s": along,
        }

    @property
    def gap(self) -> _TrackGap:  # type: ignore[override]
        """Gap function, on the present mesh of the beam."""
        # Rounded, so that kernels do not depend on the length of the beam.
        places = np.round(self.beam.mesh.node_arc_lengths / self.beam.length, _DIGITS_OF_PLACES)
        return _TrackGap(tuple(places.tolist()))

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Length of the beam [m]."""
        return (self.beam.length,)

    def constraints(self) -> list[ConstraintStatement]:
        """Return the two constraint equations, x and y.

        Raises
        ------
        BeamdaeError
            If the beam has more than 32 elements.
        """
        # Assembly may have added elements since the construction.
        self._require_few_elements()
        return super().constraints()
