"""Massless rigid links."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    format_distinct,
    require_positive,
    set_fields,
)
from beamdae.parts.joints.drivers import DrivenJoint
from beamdae.parts.joints.joint import meeting_tolerance
from beamdae.parts.laws import Law
from beamdae.parts.point_parts import PlacedPoint
from beamdae.symbolic.statements import SX, Variable


@dataclass(frozen=True, eq=False)
class Distance(DrivenJoint):
    """Rigid massless link between two points: g = (L^2 - |r_b - r_a|^2) / (2 L).

    L is the length, and r_a and r_b are the positions of the points. The reaction F is the force in
    the link; tension is positive.

    Parameters
    ----------
    name
        Unique name.
    a, b
        The points, which may belong to particles or the ground.
    length
        Length [m], a number or a time law. Defaults to the distance in the reference configuration,
        which a number must match. A law with a different initial value moves the bodies out of the
        reference configuration before the run, as in `Driver`.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment, both belong to the same body, the
        points coincide in the reference configuration, `length` is a number other than their
        distance, or `length` is an invalid law or a law whose initial value is not positive.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> bob = mech.add(bd.PointMass("bob", 1.0, at=(0.6, -0.8)))
    >>> rod = mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), bob.point))
    >>> mech.observe("rod", rod.reaction)
    """

    is_relative = False
    length: Any = None
    symbol = "link"
    multipliers = (Variable("length", "N"),)
    reactions = ("F",)

    def __post_init__(self) -> None:
        super().__post_init__()
        reference_length = self._reference_length
        tolerance = meeting_tolerance(self.a, self.b)
        if reference_length <= tolerance:
            raise BeamdaeError(
                f"{self.name}: {self.a} and {self.b} coincide in the reference "
                "configuration, but a link requires a positive length; join the "
                "points by a Revolute."
            )
        length = self.length
        if not (isinstance(length, Law) or callable(length) or length is None):
            set_fields(self, length=require_positive(self.name, "length", length))
            if abs(self.length - reference_length) > tolerance:
                drawn, given = format_distinct(reference_length, self.length)
                raise BeamdaeError(
                    f"{self.name}: length must equal the distance in the reference configuration "
                    f"({drawn} m) or be a time law, got {given} m."
                )
        require_positive(self.name, "length at t = 0", self._initial_value)

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint, length: SX) -> SX:
        """Return the prescribed length minus the distance of the points [m], to first order."""
        return (length**2 - ca.sumsqr(b.position - a.position)) / (2.0 * length)

    def gap_size(self, gap: float, t: float) -> float:
        """Return the difference [m] of distance and length at a value of `gap` and a time [s]."""
        length = self.laws[0].at(t)
        return abs(length - math.sqrt(max(length**2 - 2.0 * length * gap, 0.0)))

    @property
    def _law_argument(self) -> Any:
        """Length [m], a number or a time law."""
        return self._reference_length if self.length is None else self.length

    @property
    def _reference_length(self) -> float:
        return float(np.hypot(*np.subtract(self.b.point, self.a.point)))
