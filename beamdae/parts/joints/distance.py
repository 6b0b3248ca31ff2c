"""Rigid links without mass."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, require_positive, set_fields
from beamdae.parts.joints.drivers import Driven
from beamdae.parts.joints.joint import meeting_tolerance
from beamdae.parts.laws import Law
from beamdae.symbolic.statements import SX, Named


def _linked(time: SX, a: Any, b: Any, law: Callable[[SX], SX]) -> SX:
    length = law(time)
    return (length**2 - ca.sumsqr(b[0] - a[0])) / (2.0 * length)


@dataclass(frozen=True, eq=False)
class Distance(Driven):
    """A rigid link without mass between two points: g = (L^2 - |r_b - r_a|^2) / (2 L).

    Parameters
    ----------
    name
        Unique name.
    a, b
        The points; particles and the ground, too.
    length
        None: as drawn. A number [m], which has to be that of the drawing, or a law of time: one
        that starts elsewhere moves the bodies out of the drawing before the run, as `Driver` does.

    The reaction F is the force in the link, tension positive.

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
    multipliers = (Named("length", "N"),)
    reactions = ("F",)
    _gap = staticmethod(_linked)

    def __post_init__(self) -> None:
        super().__post_init__()
        drawn = self._drawn
        if drawn <= meeting_tolerance(self.a, self.b):
            raise BeamdaeError(
                f"{self.name}: a link needs two points that lie apart in the reference drawing, "
                f"{self.a} and {self.b} do not; join them by a Revolute."
            )
        law = self.length
        if not (isinstance(law, Law) or callable(law) or law is None):
            set_fields(self, length=require_positive(self.name, "length", law))
            if abs(self.length - drawn) > meeting_tolerance(self.a, self.b):
                raise BeamdaeError(
                    f"{self.name}: length must be that of the reference drawing, {drawn:.6g} m, "
                    f"or a law of time, got {self.length:.6g}."
                )
        require_positive(self.name, "length at t = 0", self._at_start)

    @property
    def _drawn(self) -> float:
        return float(np.hypot(*np.subtract(self.b.point, self.a.point)))

    @property
    def _followed(self) -> Any:
        return self._drawn if self.length is None else self.length

    @property
    def facts(self) -> Mapping[str, float]:
        """By how much it is longer than drawn at the start."""
        return {"length at the start, beyond the drawing [m]": self._at_start - self._drawn}
