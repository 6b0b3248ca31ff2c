"""Drivers: relative motions prescribed as laws of time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca

from beamdae.errors import BeamdaeError, set_fields
from beamdae.parts.attachments import require_angle, rotate
from beamdae.parts.joints.guides import along, direction_of
from beamdae.parts.joints.joint import Drive, JointByFormula
from beamdae.parts.laws import Law, as_law
from beamdae.symbolic.formulas import FormulaExpression, constant_formula
from beamdae.symbolic.statements import SX, Named, Quantity


def _driven(time: SX, a: Any, b: Any, law: Callable[[SX], SX]) -> SX:
    return b[1] - a[1] - law(time)


def _travelled(time: SX, a: Any, b: Any, line: Callable[[], Any], law: Callable[[SX], SX]) -> SX:
    numbers = line()
    return ca.dot(rotate(a[1], numbers), b[0] - a[0]) - numbers[2] - law(time)


class Driven(JointByFormula):
    """A joint that follows a law of time, which is the last of its formulas."""

    # Whether its law may begin anywhere, so that an event may have it follow another one.
    is_relative: ClassVar[bool] = True

    @property
    def _followed(self) -> Any:
        """The law, as it was given."""
        raise NotImplementedError

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The law it follows."""
        return (as_law(self.name, self._followed),)

    @property
    def drive(self) -> Quantity:
        """The reaction, force [N] or moment [N m], and the power [W] that the law brings in."""
        values, data = FormulaExpression.of(
            Drive(self._sizes, self._gap, self.is_relative), self._functions
        )
        columns = (*self.reaction.columns, Named("power", "W"))
        return Quantity(columns, self._pieces, values, data, joint=self.name)

    @property
    def _at_start(self) -> float:
        """The law at t = 0."""
        return float(ca.evalf(self.laws[0](SX.zeros(2))))

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (self.laws[0].formula,)


@dataclass(frozen=True, eq=False)
class Driver(Driven):
    """Prescribed relative angle: g = turn_b - turn_a - law(t), turns since the drawing [rad].

    A law that is not zero at the start turns the bodies out of the drawing before the run, with
    whatever is joined to them; `beamdae check` tells by how much.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> crank = mech.add(bd.RigidBody("crank", mass=1.0, inertia=0.02, center=(0.1, 0.0)))
    >>> shaft = mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)
    >>> hinge = mech.add(bd.Revolute("bearing", *shaft))
    >>> motor = mech.add(bd.Driver("motor", *shaft, bd.run_up(speed=6.0, duration=0.5)))
    >>> mech.observe("motor", motor.drive)
    """

    law: Any = None
    multipliers = (Named("angle", "N m"),)
    reactions = ("M",)
    _gap = staticmethod(_driven)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        if self.law is None:
            raise BeamdaeError(f"{self.name}: a driver needs law=, the angle [rad] over time.")
        _ = self.laws

    @property
    def _followed(self) -> Any:
        return self.law

    @property
    def inputs(self) -> tuple[Named, ...]:
        """The angle."""
        return (Named("angle", "rad"),)

    def with_constant_laws(self, values: Sequence[float]) -> Driver:
        """The same, held there."""
        return replace(self, law=values[0])

    @property
    def facts(self) -> Mapping[str, float]:
        """By how much it turns the bodies out of the drawing."""
        return {"angle at the start, from the drawing [rad]": self._at_start}


@dataclass(frozen=True, eq=False)
class TranslationalDriver(Driven):
    """Prescribed travel: g = e . (r_b - r_a) - its value in the drawing - law(t) [m].

    e is `direction`, fixed to the body of `a`: with `a` on the ground a component of the position
    of `b`. The reaction F is the force on the body of `b` along e. What a law that is not zero at
    the start does is told at `Driver`.
    """

    law: Any = None
    direction: tuple[float, float] = (1.0, 0.0)
    multipliers = (Named("travel", "N"),)
    reactions = ("F",)
    _gap = staticmethod(_travelled)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        set_fields(self, direction=direction_of(self.name, self.direction))
        if self.law is None:
            raise BeamdaeError(f"{self.name}: a driver needs law=, the travel [m] over time.")
        _ = self.laws

    @property
    def _followed(self) -> Any:
        return self.law

    @property
    def inputs(self) -> tuple[Named, ...]:
        """The travel."""
        return (Named("travel", "m"),)

    def with_constant_laws(self, values: Sequence[float]) -> TranslationalDriver:
        """The same, held there."""
        return replace(self, law=values[0])

    @property
    def facts(self) -> Mapping[str, float]:
        """By how much it moves the point out of the drawing."""
        return {"travel at the start, from the drawing [m]": self._at_start}

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (constant_formula(*along(self.direction, self.a, self.b)), *super()._own)
