"""Joints with a time law: drivers, and massless links."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    format_distinct,
    require_positive,
    set_fields,
)
from beamdae.parts.attachments import require_direction, rotate
from beamdae.parts.joints.guides import project_along
from beamdae.parts.joints.joint import GapFormula, Joint, meeting_tolerance
from beamdae.parts.laws import Law, as_law
from beamdae.parts.part import PlacedPoint
from beamdae.symbolic.signals import find_signals, with_references
from beamdae.symbolic.statements import SX, Local, Quantity, Variable, rebuilt_for_mesh


@dataclass(frozen=True)
class _ReactionAndPower:
    """Reaction of a driver, and power supplied by the driver.

    Attributes
    ----------
    gap
        The gap.
    law_may_change
        True if an event may replace the law; the power is then computed from the motion.
    """

    gap: GapFormula
    law_may_change: bool

    def __call__(self, local: Local, *arguments: Any) -> SX:
        g = self.gap(local, *arguments)
        if self.law_may_change:
            rate = -ca.jtimes(g, local.q, local.v)
        else:
            rate = ca.jtimes(g, local.time, SX([1, 0]))
        return ca.vertcat(-local.lam, local.lam * rate)


class DrivenJoint(Joint):
    """Joint with a gap function that depends on one time law."""

    # Events may replace a relative law, because such a law may begin with any value.
    is_relative: ClassVar[bool] = True
    _driven: ClassVar[tuple[Variable, ...]] = ()

    law: Any

    @property
    def _law_argument(self) -> Any:
        """Law as passed by the user: a number, a function of t or a `Law`."""
        return self.law

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Time law of the joint, as a tuple of one entry."""
        return (as_law(self.name, self._law_argument),)

    @property
    @rebuilt_for_mesh
    def drive(self) -> Quantity:
        """Reaction (force [N] or moment [N m]) and power [W] supplied by the driver."""
        gap = self._gap_formula
        assert gap is not None
        # The law of an input is not part of the formula.
        law_may_change = self.is_relative or bool(find_signals(self.laws[0](SX.zeros(2))))
        build = _ReactionAndPower(gap, law_may_change)
        return self._observe(build, (*self.reaction.columns, Variable("power", "W")))

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Name and unit of the driven value; empty if the law is not relative."""
        return self._driven

    def _require_law(self) -> None:
        (driven,) = self._driven
        if self._law_argument is None:
            raise BeamdaeError(
                f"{self.name}: law= is missing; pass the {driven.name} [{driven.unit}] as a "
                "function of time."
            )
        _ = self.laws

    @property
    def _initial_value(self) -> float:
        return float(ca.evalf(with_references(self.laws[0](SX.zeros(2)))))


@dataclass(frozen=True, eq=False)
class Driver(DrivenJoint):
    """Prescribed relative angle: g = rotation_b - rotation_a - law(t) [rad].

    Rotations are measured from the reference configuration. If the law is not zero at the start,
    the bodies are moved before the run, so that all joints are closed; `beamdae check` reports the
    initial angle. The reaction M is the moment on the body of `b`.

    Parameters
    ----------
    name
        Unique name.
    a, b
        Any points of two different bodies, one of which may be the ground; neither may be a
        particle. The bearing is a separate joint.
    law
        Angle [rad]: a function of t [s], a `Law`, or a number, which holds it. For a constant
        speed, pass `lambda t: speed * t`; `run_up` begins at rest.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment or is a particle, both belong to the
        same body, or `law` is missing or invalid.

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
    _with_angle = ("a", "b")
    symbol = "driver"
    _driven = (Variable("angle", "rad"),)
    multipliers = (Variable("angle", "N m"),)
    reactions = ("M",)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_law()

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint, angle: SX) -> SX:
        """Return the relative rotation minus the prescribed angle [rad]."""
        return b.rotation - a.rotation - angle


@dataclass(frozen=True, eq=False)
class TranslationalDriver(DrivenJoint):
    """Prescribed travel: g = e . (r_b - r_a) - d0 - law(t) [m].

    e is the unit vector of `direction`, fixed to the body of `a`; r_a and r_b are the positions of
    the points, and d0 is the value of e . (r_b - r_a) in the reference configuration. With `a` on
    the ground, g prescribes a component of the position of `b`. The reaction F is the force on the
    body of `b` along e. If the law is not zero at the start, the bodies are moved before the run;
    see `Driver`.

    Parameters
    ----------
    name
        Unique name.
    a, b
        Points of two different bodies, one of which may be the ground. `a` must not be a particle.
        Guides are separate joints.
    law
        Travel [m]: a number, a function of t [s] or a `Law`.
    direction
        Direction (x, y) of positive travel in the reference configuration, of any length but zero.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment, both belong to the same body, `a` is
        a particle, `direction` is not a nonzero vector, or `law` is missing or invalid.
    """

    law: Any = None
    direction: tuple[float, float] = (1.0, 0.0)
    _with_angle = ("a",)
    symbol = "translational driver"
    _driven = (Variable("travel", "m"),)
    multipliers = (Variable("travel", "N"),)
    reactions = ("F",)

    def __post_init__(self) -> None:
        super().__post_init__()
        convert_fields(self, direction=require_direction)
        self._require_law()

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Unit vector of the direction, and reference distance of the points along it [m]."""
        return project_along(self.direction, self.a, self.b)

    @staticmethod
    def gap(
        t: SX, a: PlacedPoint, b: PlacedPoint, ex: SX, ey: SX, reference_distance: SX, travel: SX
    ) -> SX:
        """Return the travel minus the prescribed travel [m]."""
        distance = ca.dot(rotate(a.rotation, (ex, ey)), b.position - a.position)
        return distance - reference_distance - travel


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
