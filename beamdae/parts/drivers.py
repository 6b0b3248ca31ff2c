"""Drivers: relative motions prescribed as laws of time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from beamdae.errors import BeamdaeError, keep
from beamdae.parts.attachments import require_angle, rotate
from beamdae.parts.guides import along, direction_of
from beamdae.parts.joints import JointByFormula
from beamdae.parts.laws import Law, as_law
from beamdae.symbolic.formulas import plain
from beamdae.symbolic.statements import SX, Named, Quantity


def _driven(time: SX, a: Any, b: Any, law: Callable[[SX], SX]) -> SX:
    return b[1] - a[1] - law(time)


def _travelled(time: SX, a: Any, b: Any, line: Callable[[], Any], law: Callable[[SX], SX]) -> SX:
    numbers = line()
    return ca.dot(rotate(a[1], numbers), b[0] - a[0]) - numbers[2] - law(time)


def at_start(law: Law) -> float:
    """A law at t = 0."""
    return float(ca.evalf(law(SX.zeros(2))))


@dataclass(frozen=True, eq=False)
class Driver(JointByFormula):
    """Prescribed relative angle: g = turn_b - turn_a - law(t), turns since the drawing [rad].

    A law that is not zero at the start turns the bodies out of the drawing before the run, with
    whatever is joined to them; `beamdae check` tells by how much.
    """

    law: Any = None
    _gap = staticmethod(_driven)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        if self.law is None:
            raise BeamdaeError(f"{self.name}: a driver needs law=, the angle [rad] over time.")
        _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The angle over time."""
        return (as_law(self.name, self.law),)

    @property
    def facts(self) -> Mapping[str, float]:
        """By how much it turns the bodies out of the drawing."""
        (law,) = self.laws
        return {"angle at the start, from the drawing [rad]": at_start(law)}

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """What each constraint holds."""
        return (Named("angle", "N m"),)

    @property
    def reactions(self) -> tuple[str, ...]:
        """What each multiplier is called as a reaction."""
        return ("M",)

    @property
    def drive(self) -> Quantity:
        """Moment M [N m] on the body of `b`, and the power [W] it brings in."""
        return self._drive(changes=True)

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (self.laws[0].formula,)


@dataclass(frozen=True, eq=False)
class TranslationalDriver(JointByFormula):
    """Prescribed travel: g = e . (r_b - r_a) - its value in the drawing - law(t) [m].

    e is `direction`, fixed to the body of `a`: with `a` on the ground a component of the position
    of `b`. The reaction F is the force on the body of `b` along e. What a law that is not zero at
    the start does is told at `Driver`.
    """

    law: Any = None
    direction: tuple[float, float] = (1.0, 0.0)
    _gap = staticmethod(_travelled)

    def __post_init__(self) -> None:
        super().__post_init__()
        keep(self, direction=direction_of(self.name, self.direction))
        if self.law is None:
            raise BeamdaeError(f"{self.name}: a driver needs law=, the travel [m] over time.")
        _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The travel over time."""
        return (as_law(self.name, self.law),)

    @property
    def facts(self) -> Mapping[str, float]:
        """By how much it moves the point out of the drawing."""
        return {"travel at the start, from the drawing [m]": at_start(self.laws[0])}

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """What each constraint holds."""
        return (Named("travel", "N"),)

    @property
    def reactions(self) -> tuple[str, ...]:
        """What each multiplier is called as a reaction."""
        return ("F",)

    @property
    def drive(self) -> Quantity:
        """Force F [N] on the body of `b` along the direction, and the power [W] it brings in."""
        return self._drive(changes=True)

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        line = plain(*along(self.direction, self.a, self.b))
        return (line, self.laws[0].formula)
