"""Points that slide along the deformed axis of a beam.

The axes of neighboring elements meet at small angles, but the second derivative of the constraint
requires a track with two continuous derivatives. The track consists of quintics between the nodes
of the beam. Slope and second derivative at a node are those of the quartic through the five nearest
nodes, or of the polynomial through all nodes if there are fewer than five. For equidistant nodes,
they are computed as central differences, with two points extrapolated beyond each end of the beam.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import Beam, require_beam
from beamdae.bounded_cache import array_bytes, bounded_cache
from beamdae.curves.plane_curves import PlaneCurve
from beamdae.errors import BeamdaeError, require_choice, require_name, set_fields
from beamdae.parts.attachments import Attachment, require_attachment
from beamdae.parts.events import Event
from beamdae.parts.joints.joint import meeting_tolerance
from beamdae.parts.joints.kinematic_constraint import load_columns, resolve_load
from beamdae.parts.part import Part
from beamdae.symbolic.formula import FormulaExpression, build_formula_kernel, constant_formula
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    Piece,
    Quantity,
    Variable,
    rebuilt_for_mesh,
)

Array = np.ndarray

# Largest memory of the cached weights of points, per function [bytes]. They grow with the square
# of the number of nodes: 1000 nodes take 8 and 48 MB, 200 nodes 0.3 and 2 MB.
_MAX_CACHED_BYTES = 8 * 2**20
_STENCIL_POINTS = 6  # on which a quintic depends
# Number of extrapolated points beyond each end.
_EXTRA_POINTS = 2
# Maximum number of nodes used for the extrapolation.
_MAX_EXTRAPOLATION_NODES = 5

# Samples and iterations of the search for the arc length nearest to a point.
_SEARCH_SAMPLES = 257
_SEARCH_ITERATIONS = 10

# All nodes of the beam are in one constraint kernel. Measured: a step with 30 elements takes 35
# times as long as with 16 elements, a step with 60 elements thousands of times as long.
MAX_ELEMENTS_WITH_SLIDER = 32

_SLIDER_OPERATOR = sp.eye_array(1, format="csr")


@cache
def _quintic_coefficients() -> Array:
    """Return the polynomial coefficients of the weights of six points, shape (power, point).

    The polynomials hold between the middle two points, where the parameter runs from 0 to 1.
    """
    first_difference = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
    second_difference = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0
    # Values, slopes and curvatures at the middle two points.
    f0, f1 = np.eye(_STENCIL_POINTS)[2:4]
    d0, d1, c0, c1 = (
        np.pad(x, pad) for x in (first_difference, second_difference) for pad in ((0, 1), (1, 0))
    )
    return _quintic(f0, f1, d0, d1, c0, c1)


def _quintic(f0: Array, f1: Array, d0: Array, d1: Array, c0: Array, c1: Array) -> Array:
    """Return the coefficients (power, ...) of a quintic from 0 to 1.

    The arguments are the values, slopes and second derivatives at 0 and 1.
    """
    rise = f1 - f0
    return np.array(
        [
            f0,
            d0,
            0.5 * c0,
            10.0 * rise - 6.0 * d0 - 4.0 * d1 - 1.5 * c0 + 0.5 * c1,
            -15.0 * rise + 8.0 * d0 + 7.0 * d1 + 1.5 * c0 - c1,
            6.0 * rise - 3.0 * (d0 + d1) - 0.5 * (c0 - c1),
        ]
    )


@bounded_cache(_MAX_CACHED_BYTES, array_bytes)
def _extension_matrix(count: int) -> Array:
    """Return the matrix that extends `count` points by two points at each end."""
    last = min(count, _MAX_EXTRAPOLATION_NODES)
    nodes = np.arange(last)
    matrix = np.zeros((count + 2 * _EXTRA_POINTS, count))
    matrix[_EXTRA_POINTS:-_EXTRA_POINTS] = np.eye(count)
    for k in range(_EXTRA_POINTS):
        x = k - _EXTRA_POINTS
        weights = [
            np.prod([(x - j) / (i - j) for j in range(last) if j != i], initial=1.0) for i in nodes
        ]
        matrix[k, :last] = weights
        matrix[-1 - k, -last:] = weights[::-1]
    return matrix


def _point_weights(x: SX) -> list[SX]:
    """Return the weights of six points at x, which runs from 0 to 1 between the middle two.

    Outside this interval, the curve continues along its tangent.
    """
    weights = []
    for c in _quintic_coefficients().T:
        slopes = c[1:] * np.arange(1.0, _STENCIL_POINTS)
        inside = sum((float(coefficient) * x**k for k, coefficient in enumerate(c)), SX(0))
        before = float(c[0]) + float(c[1]) * x
        after = float(c.sum()) + float(slopes.sum()) * (x - 1.0)
        weights.append(ca.if_else(x < 0.0, before, ca.if_else(x > 1.0, after, inside)))
    return weights


def interpolate_track(points: SX, along: SX) -> SX:
    """Return the point of the smooth curve through `points` (2, count) at the parameter `along`.

    `along` is 0 at the first and count - 1 at the last point; beyond them, the curve continues
    along its tangents.
    """
    count = points.shape[1]
    cell = ca.fmin(ca.fmax(ca.floor(along), 0.0), count - 2.0)
    is_in_cell = [cell == k for k in range(count - 1)]
    weights = SX.zeros(count + 2 * _EXTRA_POINTS)
    for i, weight in enumerate(_point_weights(along - cell)):
        for k, indicator in enumerate(is_in_cell):
            weights[k + i] += indicator * weight
    return points @ (ca.DM(_extension_matrix(count)).T @ weights)


def interpolate_uneven_track(points: SX, s: SX, nodes: tuple[float, ...]) -> SX:
    """Return the point of the smooth curve through `points` (2, count) at the arc length s [m].

    `nodes` are the ascending arc lengths of the points [m]. For equidistant nodes, this curve is
    the same as in `interpolate_track`.
    """
    weights = SX.zeros(len(nodes))
    cells = _uneven_coefficients(nodes)
    for k, coefficients in enumerate(cells):
        x = (s - nodes[k]) / (nodes[k + 1] - nodes[k])
        is_in_cell = (s >= nodes[k]) * (s < nodes[k + 1])
        weights += is_in_cell * sum(
            (ca.DM(c) * x**i for i, c in enumerate(coefficients)), SX.zeros(len(nodes))
        )
    # Outside the beam, the curve continues along its tangent.
    before = (s - nodes[0]) / (nodes[1] - nodes[0])
    weights += (s < nodes[0]) * (ca.DM(cells[0][0]) + ca.DM(cells[0][1]) * before)
    after = (s - nodes[-1]) / (nodes[-1] - nodes[-2])
    end_slope = np.arange(_STENCIL_POINTS) @ cells[-1]
    weights += (s >= nodes[-1]) * (ca.DM(cells[-1].sum(axis=0)) + ca.DM(end_slope) * after)
    return points @ weights


@bounded_cache(_MAX_CACHED_BYTES, array_bytes)
def _uneven_coefficients(nodes: tuple[float, ...]) -> Array:
    """Return the weights of all nodes as polynomials in each cell, (cell, power, node)."""
    s, count = np.array(nodes), len(nodes)
    width = min(count, _MAX_EXTRAPOLATION_NODES)
    first, second = np.zeros((2, count, count))
    for i in range(count):
        # The slope and curvature at a node are those of the polynomial through the nearest nodes.
        start = int(np.clip(i - width // 2, 0, count - width))
        near = slice(start, start + width)
        scale = s[near][-1] - s[near][0]
        powers = np.linalg.inv(np.vander((s[near] - s[i]) / scale, increasing=True))
        first[i, near] = powers[1] / scale
        if width > 2:
            second[i, near] = 2.0 * powers[2] / scale**2
    cells = []
    for k, h in enumerate(np.diff(s)):
        f0, f1 = np.eye(count)[k : k + 2]
        d0, d1 = first[k : k + 2] * h
        c0, c1 = second[k : k + 2] * h**2
        cells.append(_quintic(f0, f1, d0, d1, c0, c1))
    return np.array(cells)


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
class _TrackConstraint:
    """Kernel of the constraint r - r_track(s) = 0 on the position r of a sliding point.

    Local coordinates: coordinates of the point, coordinates of the nodes, and the arc length s.

    Attributes
    ----------
    sizes
        Numbers of local coordinates of the point and of each node.
    nodes
        Arc lengths of the nodes [m]; None if they are equidistant.
    """

    sizes: tuple[int, ...]
    nodes: tuple[float, ...] | None

    def __call__(self, local: Local, *functions: Callable[..., Any]) -> ConstraintKernel:
        position, *track = (x for x, _ in _evaluate_points(local, self.sizes, functions))
        spacing = functions[-1]()[0]
        point = _evaluate_track(track, local.q[-1], spacing, self.nodes)
        return ConstraintKernel(local, position - point)


@dataclass(frozen=True)
class _Reaction:
    """Reaction on the body of the sliding point, or on the beam at the contact point.

    Attributes
    ----------
    sizes, nodes
        As in `_TrackConstraint`.
    on_beam
        True for the reaction on the beam, False for the reaction on the body of the point.
    axes
        "inertial", or "body": the axes of the body, or along and across the track of the beam.
    has_angle
        True if the body of the point has an orientation, so that the reaction on the body includes
        a moment (zero).
    """

    sizes: tuple[int, ...]
    nodes: tuple[float, ...] | None
    on_beam: bool
    axes: str
    has_angle: bool

    def __call__(self, local: Local, *functions: Callable[..., Any]) -> SX:
        (_, rotation), *track = _evaluate_points(local, self.sizes, functions)
        if not self.on_beam:
            return resolve_load(self.axes, rotation, -local.lam, 0 if self.has_angle else None)
        spacing = functions[-1]()[0]
        point = _evaluate_track([x for x, _ in track], local.q[-1], spacing, self.nodes)
        slope = ca.jacobian(point, local.q[-1])
        return resolve_load(self.axes, ca.atan2(slope[1], slope[0]), local.lam)


def _evaluate_points(local: Local, sizes: tuple[int, ...], functions: Sequence[Any]) -> list[Any]:
    """Return (position, rotation) of the sliding point and of each node of the track."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [
        kinematics(local.q[first:last])
        for kinematics, (first, last) in zip(functions[:-1], pairwise(ends), strict=True)
    ]


def _evaluate_track(points: list[SX], s: SX, spacing: Any, nodes: tuple[float, ...] | None) -> SX:
    """Return the point of the track at the arc length s [m]; `nodes` as in `_TrackConstraint`."""
    if nodes is None:
        return interpolate_track(ca.horzcat(*points), s / spacing)
    return interpolate_uneven_track(ca.horzcat(*points), s, nodes)


def _reaction(local: Local) -> SX:
    return -local.lam


def _slider_arc_length(local: Local) -> SX:
    return local.q


def _arc_length_and_rate(local: Local) -> SX:
    return ca.vertcat(local.q, local.v)


@dataclass(frozen=True, eq=False)
class SlidingOnBeam(Part):
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
    name: str
    a: Attachment
    beam: Beam
    ends: str = "record"

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("SlidingOnBeam", self.name))
        require_choice(self.name, "ends", self.ends, ("record", "stop"))
        require_attachment(self.name, "first attachment", self.a)
        require_beam(self.name, self.beam).has_moving_load = True
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
        values, _ = FormulaExpression.of(_arc_length_and_rate, ())
        return Quantity(columns, (Piece(self, _SLIDER_OPERATOR),), values)

    @property
    def reaction(self) -> Quantity:
        """Force (Fx, Fy) [N] of the beam on the body of `a`, in inertial axes."""
        columns = (Variable("Fx", "N"), Variable("Fy", "N"))
        values, _ = FormulaExpression.of(_reaction, ())
        return Quantity(columns, (), values, joint=self.name, joint_part=self)

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
        require_choice(self.name, "axes", axes, ("inertial", "body"))
        on_beam, sizes = place == "beam", self._sizes
        values, data = FormulaExpression.of(
            _Reaction(sizes, self._nodes, on_beam, axes, self.a.has_angle), self._functions
        )
        columns = load_columns(self.a)[: 2 if on_beam else None]
        return Quantity(columns, self._pieces, values, data, joint=self.name, joint_part=self)

    @property
    def events(self) -> tuple[Event, ...]:
        """Events that occur when the point passes an end of the beam."""
        values, _ = FormulaExpression.of(_slider_arc_length, ())
        s = Quantity((Variable("", "m"),), (Piece(self, _SLIDER_OPERATOR),), values)
        ends = {"start": 0.0, "end": self.beam.length}
        return tuple(
            Event(s, crosses, "both", self.ends, f"{self.name} at the {end} of {self.beam.name}")
            for end, crosses in ends.items()
        )

    @property
    def _points(self) -> tuple[Attachment, ...]:
        """The sliding point, then the nodes of the beam."""
        return (self.a, *(self.beam.at(s) for s in self.beam.mesh.node_arc_lengths.tolist()))

    @property
    def _nodes(self) -> tuple[float, ...] | None:
        """Arc lengths of the nodes [m]; None if they are equidistant."""
        mesh = self.beam.mesh
        return None if mesh.has_equidistant_nodes else tuple(mesh.node_arc_lengths.tolist())

    @property
    def _sizes(self) -> tuple[int, ...]:
        return tuple(point.size for point in self._points)

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        """Kinematics of the points, then the formula of the node spacing."""
        spacing = constant_formula(self.beam.length / (self.beam.mesh.node_count - 1))
        return (*(point.checked_kinematics for point in self._points), spacing)

    @property
    def _pieces(self) -> tuple[Piece, ...]:
        return (*(point.piece for point in self._points), Piece(self, _SLIDER_OPERATOR))

    @property
    def load_distribution(self) -> str:
        """Distribution "shares": the nodes share the reaction."""
        return "shares"

    def constraints(self) -> list[ConstraintStatement]:
        """Return the two constraint equations, x and y.

        Raises
        ------
        BeamdaeError
            If the beam has more than 32 elements.
        """
        # Assembly may have added elements since the construction.
        self._require_few_elements()
        sizes = self._sizes
        kernel, data = build_formula_kernel(
            _TrackConstraint(sizes, self._nodes), self._functions, sum(sizes) + 1, 2
        )
        multipliers = (Variable("x", "N"), Variable("y", "N"))
        return [ConstraintStatement(self.name, kernel, self._pieces, multipliers, data)]
