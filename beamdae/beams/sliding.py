"""Points that slide along the deformed axis of a beam."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import Beam
from beamdae.curves.plane_curves import PlaneCurve
from beamdae.errors import BeamdaeError, require_choice, require_name, set_fields, short_repr
from beamdae.parts.attachments import Attachment, require_attachment
from beamdae.parts.events import Event
from beamdae.parts.joints.joint import meeting_tolerance
from beamdae.parts.joints.kinematic_constraint import load_columns, resolve_load
from beamdae.parts.part import Part
from beamdae.symbolic.formulas import FormulaExpression, build_formula_kernel, constant_formula
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    Named,
    Piece,
    Quantity,
)

Array = np.ndarray

# Points that the slopes and curvatures of one between two of them are taken from.
_STENCIL_POINTS = 6
_EXTRA_POINTS = 2
_SEARCH_SAMPLES = 257


@cache
def _quintic_coefficients() -> Array:
    """Coefficients of the share of each of six points, (power, point), between the middle two."""
    slope = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
    bend = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0
    f0, f1 = np.eye(_STENCIL_POINTS)[2:4]
    d0, d1, c0, c1 = (np.pad(x, pad) for x in (slope, bend) for pad in ((0, 1), (1, 0)))
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


@cache
def _extension_matrix(count: int) -> Array:
    """From so many points to these and two more at either end, (count + 4, count)."""
    last = min(count, 5)
    at = np.arange(last)
    found = np.zeros((count + 2 * _EXTRA_POINTS, count))
    found[_EXTRA_POINTS:-_EXTRA_POINTS] = np.eye(count)
    for k in range(_EXTRA_POINTS):
        where = k - _EXTRA_POINTS
        share = [
            np.prod([(where - j) / (i - j) for j in range(last) if j != i], initial=1.0) for i in at
        ]
        found[k, :last] = share
        found[-1 - k, -last:] = share[::-1]
    return found


def _point_weights(at: SX) -> list[SX]:
    """Of the six points, at 0 to 1 between the middle two; beyond that along the tangent."""
    found = []
    for c in _quintic_coefficients().T:
        slopes = c[1:] * np.arange(1.0, _STENCIL_POINTS)
        inside = sum((float(x) * at**k for k, x in enumerate(c)), SX(0))
        before = float(c[0]) + float(c[1]) * at
        after = float(c.sum()) + float(slopes.sum()) * (at - 1.0)
        found.append(ca.if_else(at < 0.0, before, ca.if_else(at > 1.0, after, inside)))
    return found


def interpolate_track(points: SX, along: SX) -> SX:
    """The curve through `points` (2, count), at `along` from 0 to count - 1."""
    count = points.shape[1]
    cell = ca.fmin(ca.fmax(ca.floor(along), 0.0), count - 2.0)
    here = [cell == k for k in range(count - 1)]
    weights = SX.zeros(count + 2 * _EXTRA_POINTS)
    for i, share in enumerate(_point_weights(along - cell)):
        for k, chosen in enumerate(here):
            weights[k + i] += chosen * share
    return points @ (ca.DM(_extension_matrix(count)).T @ weights)


def nearest_arc_length(curve: PlaneCurve, place: tuple[float, float]) -> float:
    """Arc length [m] of the point of a curve that is nearest to a place on it, or near it."""
    samples = np.linspace(0.0, curve.length, _SEARCH_SAMPLES)
    s = float(samples[np.argmin(np.linalg.norm(curve.point(samples) - place, axis=1))])
    for _ in range(10):
        angle = float(curve.tangent_angle(s))
        ahead = np.subtract(place, curve.point(s)) @ (np.cos(angle), np.sin(angle))
        s = float(np.clip(s + ahead, 0.0, curve.length))
    return s


# Its one kernel has all nodes of the beam: with 30 elements a step takes 35 times as long as with
# 16, with 60 thousands of times.
_MAX_ELEMENTS = 32
_SLIDER_OPERATOR = sp.eye_array(1, format="csr")


@dataclass(frozen=True)
class _TrackConstraint:
    """The kernel of a point on the curve through others; the last coordinate of all is s.

    `sizes` are the numbers of local coordinates of the point and of those of the curve.
    """

    sizes: tuple[int, ...]

    def __call__(self, local: Local, *functions: Callable[..., Any]) -> ConstraintKernel:
        place, *track = (at for at, _ in _evaluate_points(local, self.sizes, functions))
        along = local.q[-1] / functions[-1]()[0]
        return ConstraintKernel(local, place - interpolate_track(ca.horzcat(*track), along))


@dataclass(frozen=True)
class _Reaction:
    """Force, and moment, on the point or on the beam where the point is.

    Attributes
    ----------
    sizes
        As of the kernel.
    on_beam
        Which of the two is asked for.
    axes
        Inertial ones, or those of the body; on the beam along and across its axis.
    has_angle
        Whether the body of the point turns.
    """

    sizes: tuple[int, ...]
    on_beam: bool
    axes: str
    has_angle: bool

    def __call__(self, local: Local, *functions: Callable[..., Any]) -> SX:
        place, *track = _evaluate_points(local, self.sizes, functions)
        if not self.on_beam:
            return resolve_load(self.axes, place[1], -local.lam, 0 if self.has_angle else None)
        spacing = functions[-1]()[0]
        at = interpolate_track(ca.horzcat(*(x for x, _ in track)), local.q[-1] / spacing)
        slope = ca.jacobian(at, local.q[-1])
        return resolve_load(self.axes, ca.atan2(slope[1], slope[0]), local.lam)


def _evaluate_points(local: Local, sizes: tuple[int, ...], functions: Sequence[Any]) -> list[Any]:
    """The point and those of the curve, as they have moved."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [
        at(local.q[first:last])
        for at, (first, last) in zip(functions[:-1], pairwise(ends), strict=True)
    ]


def _reaction(local: Local) -> SX:
    return -local.lam


def _slider_arc_length(local: Local) -> SX:
    return local.q


def _arc_length_and_rate(local: Local) -> SX:
    return ca.vertcat(local.q, local.v)


@dataclass(frozen=True, eq=False)
class SlidingOnBeam(Part):
    """A point that slides along the deformed axis of a beam: g = r_a - r_beam(s).

    Its coordinate s [m] is the arc length of the undeformed beam at which the point is; it has no
    mass and starts where the drawing has it. Without friction: the reaction Fx, Fy is the force on
    the body of `a` and normal to the axis, which is the smooth curve through the nodes of the beam
    with two continuous derivatives. Beyond an end of the beam the point goes on along the tangent
    there; that it passes an end is among the events of a run.

    Parameters
    ----------
    name
        Unique name.
    a
        The point, of a body, a particle or another beam; it has to lie on the beam as drawn.
    beam
        What it slides along.
    ends
        What becomes of a run where the point passes an end: "record", it goes on, or "stop".

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    >>> beam = bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip)
    >>> bead = bd.PointMass("bead", 0.1, at=(0.25, 0.0))
    >>> slider = bd.SlidingOnBeam("slider", bead.point, beam)
    """

    symbol = "sleeve"
    name: str
    a: Attachment
    beam: Beam
    ends: str = "record"

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("SlidingOnBeam", self.name))
        require_choice(self.name, "ends", self.ends, ("record", "stop"))
        require_attachment(self.name, "first attachment", self.a)
        if not isinstance(self.beam, Beam):
            raise BeamdaeError(f"{self.name}: beam must be a Beam, got {short_repr(self.beam)}.")
        if self.a.body is self.beam:
            raise BeamdaeError(
                f"{self.name}: the point must be one of another body than the beam, got {self.a}."
            )
        if self.beam.mesh.elements > _MAX_ELEMENTS:
            raise BeamdaeError(
                f"{self.name}: it slides along beams of at most {_MAX_ELEMENTS} elements, "
                f"{self.beam.name} has {self.beam.mesh.elements}; cubic elements need few of them."
            )
        here = self.beam.at(self._start)
        gap = float(np.hypot(*np.subtract(here.point, self.a.point)))
        if gap > meeting_tolerance(self.a, here):
            raise BeamdaeError(
                f"{self.name}: the point must lie on the beam in the reference drawing, but "
                f"{self.a} is {gap:.6g} m off the axis of {self.beam.name}."
            )

    @cached_property
    def _start(self) -> float:
        return nearest_arc_length(self.beam.curve, self.a.point)

    @property
    def coordinates(self) -> tuple[Named, ...]:
        """The arc length of the point."""
        return (Named("s", "m"),)

    @property
    def initial_position(self) -> Array:
        """Where the point is drawn."""
        return np.array([self._start])

    @property
    def initial_velocity(self) -> Array:
        """None of its own: it follows from that of the point."""
        return np.zeros(1)

    @property
    def outline(self) -> Array:
        """The beam, on which the point is at home."""
        return self.beam.outline

    @property
    def s(self) -> Quantity:
        """Arc length s [m] of the point, and its rate."""
        s = Named("", "m")
        values, _ = FormulaExpression.of(_arc_length_and_rate, ())
        return Quantity((s, Named("rate", "m/s")), (Piece(self, _SLIDER_OPERATOR),), values)

    @property
    def reaction(self) -> Quantity:
        """Force (Fx, Fy) [N] of the beam on the body of `a`, inertial components."""
        columns = (Named("Fx", "N"), Named("Fy", "N"))
        values, _ = FormulaExpression.of(_reaction, ())
        return Quantity(columns, (), values, joint=self.name)

    def reaction_on(self, place: str = "a", axes: str = "inertial") -> Quantity:
        """Force Fx, Fy [N] on the body of `a`, with a moment M of zero if it turns, or on the beam.

        Parameters
        ----------
        place
            "a", or "beam": where the point is.
        axes
            "inertial", or "body": those of the drawing as the body of `a` turns them; on the beam
            along its axis and to the left of it.
        """
        require_choice(self.name, "place", place, ("a", "beam"))
        require_choice(self.name, "axes", axes, ("inertial", "body"))
        points, functions = self._points, self._functions
        on_beam, sizes = place == "beam", tuple(at.size for at in points)
        values, data = FormulaExpression.of(
            _Reaction(sizes, on_beam, axes, self.a.has_angle), functions
        )
        columns = load_columns(self.a)[: 2 if on_beam else None]
        return Quantity(columns, self._pieces, values, data, joint=self.name)

    @property
    def events(self) -> tuple[Event, ...]:
        """The point passes an end of the beam."""
        values, _ = FormulaExpression.of(_slider_arc_length, ())
        s = Quantity((Named("", "m"),), (Piece(self, _SLIDER_OPERATOR),), values)
        ends = {"start": 0.0, "end": self.beam.length}
        return tuple(
            Event(s, crosses, "both", self.ends, f"{self.name} at the {end} of {self.beam.name}")
            for end, crosses in ends.items()
        )

    @cached_property
    def _points(self) -> tuple[Attachment, ...]:
        """The point, and those of the axis."""
        return (self.a, *(self.beam.at(s) for s in self.beam.mesh.node_arc_lengths.tolist()))

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        spacing = constant_formula(self.beam.length / (self.beam.mesh.node_count - 1))
        return (*(at.checked_kinematics for at in self._points), spacing)

    @property
    def _pieces(self) -> tuple[Piece, ...]:
        return (*(at.piece for at in self._points), Piece(self, _SLIDER_OPERATOR))

    @property
    def load_distribution(self) -> str:
        """Between the nodes that have shares of its reaction."""
        return "shares"

    def constraints(self) -> list[ConstraintStatement]:
        """The constraint as a local statement."""
        sizes = tuple(at.size for at in self._points)
        kernel, data = build_formula_kernel(
            _TrackConstraint(sizes), self._functions, sum(sizes) + 1, 2
        )
        multipliers = (Named("x", "N"), Named("y", "N"))
        return [ConstraintStatement(self.name, kernel, self._pieces, multipliers, data)]
