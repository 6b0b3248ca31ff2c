"""Events: what a run watches for, and what it does then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from beamdae.errors import BeamdaeError, require_choice, require_finite, set_fields, short_repr
from beamdae.parts.joints.drivers import Driven, Driver, TranslationalDriver
from beamdae.parts.joints.joint import Joint, JointByFormula
from beamdae.parts.laws import Law, as_law
from beamdae.parts.part import Part, require_name
from beamdae.symbolic.statements import Quantity

# Signs of the rate at which a quantity goes through its value; 0: either.
DIRECTIONS = {"up": 1, "down": -1, "both": 0}


@dataclass(frozen=True)
class Switch:
    """Joints and forces, by name, that become active or inactive.

    Attributes
    ----------
    on, off
        Which become active, and which inactive.
    as_is
        Those of the former that hold what they find.
    laws
        Laws of the time since the event [s] that some of those follow from there on.
    """

    on: tuple[str, ...] = ()
    off: tuple[str, ...] = ()
    as_is: tuple[str, ...] = ()
    laws: tuple[tuple[str, Law], ...] = ()


@dataclass(frozen=True, eq=False)
class Impact:
    """Velocities that change at once, by Newton's restitution, see `impact`."""

    on: Joint | Quantity
    restitution: float


Action = Switch | Impact


def activate(*parts: Part, as_is: bool = False) -> Switch:
    """Have joints and forces act from an event on, as `do` of it.

    A joint has to be closed where it becomes active. With `as_is` it holds what it finds: a driver
    goes on from the angle or travel reached, a link keeps the length it has, a guide the offset, a
    gear the phase; a weld or a hinge holds the point of `b` where it is on the body of `a`. Then
    `reaction` is the force at the point of `b`; `reaction_on("a")` is without its moment about the
    point of `a`.
    """
    names = _names("activate", parts)
    if require_choice("activate", "as_is", as_is, (True, False)):
        for part in parts:
            if not isinstance(part, JointByFormula):
                raise BeamdaeError(
                    f"{part.name}: it cannot hold what it finds, as_is=True is for joints that "
                    f"hold angles, travels or points, got {short_repr(part)}."
                )
        return Switch(on=names, as_is=names)
    return Switch(on=names)


def deactivate(*parts: Part) -> Switch:
    """Have joints and forces act no longer from an event on, as `do` of it."""
    return Switch(off=_names("deactivate", parts))


def change_law(driver: Driver | TranslationalDriver, law: Any) -> Switch:
    """Have a driver follow another law from an event on, as `do` of it.

    Parameters
    ----------
    driver
        An inactive one becomes active.
    law
        Angle [rad] or travel [m] since the event, a law of the time since the event [s]: it goes on
        from what the driver has reached, whatever law(0) is. 0 holds it there. A rate at 0 that is
        not that of the motion changes velocities at once, by impulses that are told.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> disk = mech.add(bd.RigidBody.disk("disk", center=(0, 0), radius=0.1, mass=1.0))
    >>> hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0, 0), disk.at(0, 0)))
    >>> drive = bd.Driver("drive", mech.ground.at(0, 0), disk.at(0, 0), law=bd.run_up(5.0, 1.0))
    >>> drive = mech.add(drive)
    >>> mech.observe("disk", disk.at(0, 0))
    >>> slower = bd.piecewise((1.0, lambda t: 5.0 * t - 2.0 * t**2), lambda t: 2.0 + t)
    >>> event = mech.when("disk.angle", 6.0, "up", bd.change_law(drive, slower), name="slower")
    """
    if not (isinstance(driver, Driven) and driver.is_relative):
        raise BeamdaeError(
            "change_law: it is for a Driver or a TranslationalDriver, whose law is relative, got "
            f"{short_repr(driver)}."
        )
    law = as_law(f"change_law of {driver.name}", law)
    return Switch(on=(driver.name,), as_is=(driver.name,), laws=((driver.name, law),))


def impact(on: Joint | Quantity, restitution: float = 1.0) -> Impact:
    """Throw back what meets, as `do` of an event: velocities change at once.

    By Newton's law of restitution the rate of the gap after the impact is -`restitution` times the
    one before. Velocities and impulses P solve M (v+ - v-) = -G^T P with all active joints, which
    hold theirs; without friction. The energy it takes is booked as dissipated, impulses are told in
    `Solution.events`.

    Parameters
    ----------
    on
        A gap that closes, a quantity of one column such as `surface.gap(point)`: nothing happens
        where it opens. Or a joint that is inactive, a stop: what it would hold is thrown back, from
        either side.
    restitution
        From 0, nothing comes back, to 1, without loss.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    >>> gap = bd.LineSurface(mech.ground.at(0.0, 0.0)).gap(ball.point)
    >>> bounce = mech.when(gap, 0.0, "down", bd.impact(gap, restitution=0.8), name="bounce")
    """
    if isinstance(on, Quantity):
        if len(on.columns) != 1 or on.joint is not None:
            raise BeamdaeError(
                "impact: a gap must be a quantity of one column that follows from positions, such "
                f"as surface.gap(point), got {', '.join(x.header for x in on.columns)}."
            )
    elif not isinstance(on, Joint):
        raise BeamdaeError(
            f"impact: it must be on a gap, such as surface.gap(point), or on a joint, "
            f"got {short_repr(on)}."
        )
    restitution = require_finite("impact", "restitution", restitution)
    if not 0.0 <= restitution <= 1.0:
        raise BeamdaeError(f"impact: restitution must lie in [0, 1], got {restitution:g}.")
    return Impact(on, restitution)


def _names(what: str, parts: tuple[Any, ...]) -> tuple[str, ...]:
    for part in parts:
        if not isinstance(part, Part):
            raise BeamdaeError(f"{what}: expected joints and forces, got {short_repr(part)}.")
    return tuple(part.name for part in parts)


def switches_of(do: Any) -> tuple[Switch, ...]:
    """The switches among what an event does."""
    return tuple(x for x in do if isinstance(x, Switch)) if isinstance(do, tuple) else ()


def impacts_of(do: Any) -> tuple[Impact, ...]:
    """The impacts among what an event does."""
    return tuple(x for x in do if isinstance(x, Impact)) if isinstance(do, tuple) else ()


@dataclass(frozen=True, eq=False)
class Event:
    """A quantity goes through a value, in a direction.

    A quantity that touches its value and turns back, that begins with it, or that keeps it, does
    not cross it.

    Parameters
    ----------
    what
        An observed column, such as "tip.y", or a quantity of one column.
    crosses
        The value [unit of the column].
    direction
        "up", "down" or "both".
    do
        "stop": the run ends there; "record": it goes on; activate(part, ...),
        deactivate(part, ...), change_law(driver, law), impact(gap) or a list of these: it goes on
        with these joints and forces, or without, and with other velocities. A joint that becomes
        active is closed there, or holds what it finds; velocities change at once to what it allows,
        by impulses told in `Solution.events`, and the energy this takes counts as dissipated.
    name
        What it is called in results; default: what crosses which value.
    """

    what: Any
    crosses: float = 0.0
    direction: str = "both"
    do: Any = "stop"
    name: str | None = None

    def __post_init__(self) -> None:
        part = "event" if self.name is None else require_name("event", self.name)
        if not isinstance(self.what, (str, Quantity)):
            raise BeamdaeError(
                f"{part}: it must watch an observed column, named such as 'tip.y', or a quantity "
                f"of one column, got {short_repr(self.what)}."
            )
        crosses = require_finite(part, "crosses", self.crosses)
        if self.name is None and not isinstance(self.what, str):
            raise BeamdaeError("event: one that watches a quantity needs a name=.")
        require_choice(part, "direction", self.direction, tuple(DIRECTIONS))
        do = (self.do,) if isinstance(self.do, Action) else self.do
        if isinstance(do, (list, tuple)) and do and all(isinstance(x, Action) for x in do):
            set_fields(self, do=tuple(do))
        elif not (isinstance(self.do, str) and self.do in ("stop", "record")):
            raise BeamdaeError(
                f"{part}: do must be 'stop', 'record', activate(...), deactivate(...), "
                f"change_law(...) or impact(...), got {short_repr(self.do)}."
            )
        named = f"{self.what} crosses {crosses:g}" if self.name is None else self.name
        set_fields(self, crosses=crosses, name=named)
