"""Rigid links without mass."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, keep, positive
from beamdae.parts.drivers import at_start
from beamdae.parts.joints import JointByFormula, allowed_gap
from beamdae.parts.laws import Law, as_law
from beamdae.symbolic.statements import SX, Named, Quantity


def _linked(time: SX, a: Any, b: Any, law: Callable[[SX], SX]) -> SX:
    length = law(time)
    return (length**2 - ca.sumsqr(b[0] - a[0])) / (2.0 * length)


@dataclass(frozen=True, eq=False)
class Distance(JointByFormula):
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
    """

    length: Any = None
    _gap = staticmethod(_linked)

    def __post_init__(self) -> None:
        super().__post_init__()
        drawn = self._drawn
        if drawn <= allowed_gap(self.a, self.b):
            raise BeamdaeError(
                f"{self.name}: a link needs two points that lie apart in the reference drawing, "
                f"{self.a} and {self.b} do not; join them by a Revolute."
            )
        law = self.length
        if not (isinstance(law, Law) or callable(law) or law is None):
            keep(self, length=positive(self.name, "length", law))
            if abs(self.length - drawn) > allowed_gap(self.a, self.b):
                raise BeamdaeError(
                    f"{self.name}: length must be that of the reference drawing, {drawn:.6g} m, "
                    f"or a law of time, got {self.length:.6g}."
                )
        positive(self.name, "length at t = 0", at_start(self.laws[0]))

    @property
    def _drawn(self) -> float:
        return float(np.hypot(*np.subtract(self.b.point, self.a.point)))

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The length over time."""
        return (as_law(self.name, self._drawn if self.length is None else self.length),)

    @property
    def facts(self) -> Mapping[str, float]:
        """By how much it is longer than drawn at the start."""
        return {"length at the start, beyond the drawing [m]": at_start(self.laws[0]) - self._drawn}

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """What each constraint holds."""
        return (Named("length", "N"),)

    @property
    def reactions(self) -> tuple[str, ...]:
        """What each multiplier is called as a reaction."""
        return ("F",)

    @property
    def drive(self) -> Quantity:
        """Tension F [N], and the power [W] that the law of its length brings in."""
        return self._drive(changes=False)

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (self.laws[0].formula,)
