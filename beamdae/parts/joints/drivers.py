"""Drivers: relative motions prescribed as laws of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca

from beamdae.errors import BeamdaeError, set_fields
from beamdae.parts.attachments import require_angle, rotate
from beamdae.parts.joints.guides import project_along, require_direction
from beamdae.parts.joints.joint import Joint
from beamdae.parts.joints.kinematic_constraint import PlacedPoint, PointFunction
from beamdae.parts.laws import Law, as_law
from beamdae.symbolic.statements import SX, Local, Quantity, Variable


@dataclass(frozen=True)
class _ReactionAndPower(PointFunction):
    """Reaction of a driver, and the power it brings in.

    Attributes
    ----------
    law_may_change
        An event may replace the law: then the power is that of the motion, not of the law.
    """

    law_may_change: bool

    def __call__(self, local: Local, *functions: Any) -> SX:
        g = self.evaluate(local, self.place_points(local, functions), functions)
        if self.law_may_change:
            rate = -ca.jtimes(g, local.q, local.v)
        else:
            rate = ca.jtimes(g, local.time, SX([1, 0]))
        return ca.vertcat(-local.lam, local.lam * rate)


class DrivenJoint(Joint):
    """Joint whose gap follows a law of time."""

    # A relative law may begin with any value: events may put another one in its place.
    is_relative: ClassVar[bool] = True

    @property
    def law_argument(self) -> Any:
        """Law as passed by the user: a number, a function of t or a `Law`."""
        raise NotImplementedError

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The law of the driver."""
        return (as_law(self.name, self.law_argument),)

    @property
    def drive(self) -> Quantity:
        """Reaction, force [N] or moment [N m], and power [W] that the driver brings in."""
        assert self.gap is not None
        gap = self._point_function(self.gap)
        build = _ReactionAndPower(gap.sizes, gap.n_parameters, gap.function, self.is_relative)
        return self.observe(build, (*self.reaction.columns, Variable("power", "W")))

    @property
    def _initial_value(self) -> float:
        return float(ca.evalf(self.laws[0](SX.zeros(2))))


@dataclass(frozen=True, eq=False)
class Driver(DrivenJoint):
    """Prescribed relative angle: g = rotation_b - rotation_a - law(t), since the drawing [rad].

    A law that is not zero at the start turns the bodies out of the drawing before the run, together
    with the bodies joined to them; `beamdae check` reports the angle. The reaction M is the moment
    on the body of `b`.

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
    symbol = "driver"
    multipliers = (Variable("angle", "N m"),)
    reactions = ("M",)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        if self.law is None:
            raise BeamdaeError(f"{self.name}: a driver needs law=, the angle [rad] over time.")
        _ = self.laws

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint, angle: SX) -> SX:
        """Return the difference between the relative rotation and the prescribed angle."""
        return b.rotation - a.rotation - angle

    @property
    def law_argument(self) -> Any:
        """The angle [rad] over time."""
        return self.law

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Name and unit of the driven angle."""
        return (Variable("angle", "rad"),)

    def with_constant_laws(self, values: Sequence[float]) -> Driver:
        """Return the same driver with a constant angle [rad]."""
        return replace(self, law=values[0])

    @property
    def facts(self) -> Mapping[str, float]:
        """Angle by which it turns the bodies out of the drawing at the start."""
        return {"angle at the start, from the drawing [rad]": self._initial_value}


@dataclass(frozen=True, eq=False)
class TranslationalDriver(DrivenJoint):
    """Prescribed travel: g = e . (r_b - r_a) - its value in the drawing - law(t) [m].

    e is `direction`, fixed to the body of `a`: with `a` on the ground a component of the position
    of `b`. The reaction F is the force on the body of `b` along e. A law that is not zero at the
    start moves the bodies out of the drawing, see `Driver`.
    """

    law: Any = None
    direction: tuple[float, float] = (1.0, 0.0)
    symbol = "translational driver"
    multipliers = (Variable("travel", "N"),)
    reactions = ("F",)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        set_fields(self, direction=require_direction(self.name, self.direction))
        if self.law is None:
            raise BeamdaeError(f"{self.name}: a driver needs law=, the travel [m] over time.")
        _ = self.laws

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Unit vector of the direction, and distance of the points along it in the drawing [m]."""
        return project_along(self.direction, self.a, self.b)

    @staticmethod
    def gap(
        t: SX, a: PlacedPoint, b: PlacedPoint, ex: SX, ey: SX, drawn_distance: SX, travel: SX
    ) -> SX:
        """Return the difference between the travel and the prescribed one."""
        distance = ca.dot(rotate(a.rotation, (ex, ey)), b.position - a.position)
        return distance - drawn_distance - travel

    @property
    def law_argument(self) -> Any:
        """The travel [m] over time."""
        return self.law

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Name and unit of the driven travel."""
        return (Variable("travel", "m"),)

    def with_constant_laws(self, values: Sequence[float]) -> TranslationalDriver:
        """Return the same driver with a constant travel [m]."""
        return replace(self, law=values[0])

    @property
    def facts(self) -> Mapping[str, float]:
        """Distance by which it moves the point out of the drawing at the start."""
        return {"travel at the start, from the drawing [m]": self._initial_value}
