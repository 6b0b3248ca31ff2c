"""Points that slide along the deformed axis of a beam."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import Beam
from beamdae.beams.track import nearest_arc_length, track_point
from beamdae.errors import BeamdaeError, keep, shown
from beamdae.parts.attachments import Attachment, require_attachment
from beamdae.parts.joints import allowed_gap
from beamdae.parts.part import Part, require_name
from beamdae.symbolic.formulas import Combined, combined_kernel, plain
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

_OWN = sp.eye_array(1, format="csr")


@dataclass(frozen=True)
class _OnTrack:
    """The kernel of a point on the curve through others; the last coordinate of all is s.

    `sizes` are the numbers of local coordinates of the point and of those of the curve.
    """

    sizes: tuple[int, ...]

    def __call__(self, local: Local, *functions: Callable[..., Any]) -> ConstraintKernel:
        *points, spacing = functions
        ends = np.cumsum([0, *self.sizes]).tolist()
        place, *track = (
            at(local.q[first:last])[0]
            for at, (first, last) in zip(points, pairwise(ends), strict=True)
        )
        along = local.q[-1] / spacing()[0]
        return ConstraintKernel(local, place - track_point(ca.horzcat(*track), along))


def _reaction(local: Local) -> SX:
    return -local.lam


def _arc_length(local: Local) -> SX:
    return ca.vertcat(local.q, local.v)


@dataclass(frozen=True, eq=False)
class SlidingOnBeam(Part):
    """A point that slides along the deformed axis of a beam: g = r_a - r_beam(s).

    Its coordinate s [m] is the arc length of the undeformed beam at which the point is; it has no
    mass and starts where the drawing has it. Without friction: the reaction Fx, Fy is the force on
    the body of `a` and normal to the axis, which is the smooth curve through the nodes of the beam
    with two continuous derivatives. Beyond an end of the beam the point goes on along the tangent
    there.

    Parameters
    ----------
    name
        Unique name.
    a
        The point, of a body, a particle or another beam; it has to lie on the beam as drawn.
    beam
        What it slides along.
    """

    name: str
    a: Attachment
    beam: Beam

    def __post_init__(self) -> None:
        keep(self, name=require_name("SlidingOnBeam", self.name))
        require_attachment(self.name, "first attachment", self.a)
        if not isinstance(self.beam, Beam):
            raise BeamdaeError(f"{self.name}: beam must be a Beam, got {shown(self.beam)}.")
        if self.a.body is self.beam:
            raise BeamdaeError(
                f"{self.name}: the point must be one of another body than the beam, got {self.a}."
            )
        here = self.beam.at(self._start)
        gap = float(np.hypot(*np.subtract(here.point, self.a.point)))
        if gap > allowed_gap(self.a, here):
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
        values, _ = Combined.of(_arc_length, ())
        return Quantity((s, Named("rate", "m/s")), (Piece(self, _OWN),), values)

    @property
    def reaction(self) -> Quantity:
        """Force (Fx, Fy) [N] of the beam on the body of `a`, inertial components."""
        columns = (Named("Fx", "N"), Named("Fy", "N"))
        values, _ = Combined.of(_reaction, ())
        return Quantity(columns, (), values, joint=self.name)

    @property
    def acting(self) -> str:
        """Between the nodes that have shares of its reaction."""
        return "shares"

    def constraints(self) -> list[ConstraintStatement]:
        """The constraint as a local statement."""
        mesh = self.beam.mesh
        points = [self.a, *(self.beam.at(s) for s in mesh.node_arc_lengths.tolist())]
        sizes = tuple(at.size for at in points)
        spacing = plain(self.beam.length / (mesh.node_count - 1))
        functions: list[Callable[..., Any]] = [*(at.moved for at in points), spacing]
        kernel, data = combined_kernel(_OnTrack(sizes), functions, sum(sizes) + 1, 2)
        pieces = (*(at.piece for at in points), Piece(self, _OWN))
        multipliers = (Named("x", "N"), Named("y", "N"))
        return [ConstraintStatement(self.name, kernel, pieces, multipliers, data)]
