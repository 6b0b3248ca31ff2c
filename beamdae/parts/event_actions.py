"""Actions of events: switch parts, change the law of a driver, throw back what meets."""

from __future__ import annotations

from typing import Any

from beamdae.errors import BeamdaeError, require_choice, require_finite, short_repr
from beamdae.parts.events import Impact, Switch
from beamdae.parts.joints.drivers import DrivenJoint, Driver, TranslationalDriver
from beamdae.parts.joints.joint import Joint
from beamdae.parts.joints.kinematic_constraint import KinematicConstraint
from beamdae.parts.laws import as_law
from beamdae.parts.part import Part
from beamdae.symbolic.statements import Quantity


def activate(*parts: Part, as_is: bool = False) -> Switch:
    """Have joints and forces act from an event on, as `do` of it.

    A joint has to be closed where it becomes active. With `as_is` it holds what it finds: a driver
    goes on from the angle or travel reached, a link keeps the length it has, a guide the offset, a
    gear the phase; a weld or a hinge holds the point of `b` where it is on the body of `a`. Then
    `reaction` is the force at the point of `b`; `reaction_on("a")` is without its moment about the
    point of `a`.
    """
    names = _part_names("activate", parts)
    if require_choice("activate", "as_is", as_is, (True, False)):
        for part in parts:
            if not isinstance(part, KinematicConstraint) or part.gap is None:
                raise BeamdaeError(
                    f"{part.name}: it cannot hold what it finds, as_is=True is for joints that "
                    f"hold angles, travels or points, got {short_repr(part)}."
                )
        return Switch(on=names, as_is=names)
    return Switch(on=names)


def deactivate(*parts: Part) -> Switch:
    """Have joints and forces act no longer from an event on, as `do` of it."""
    return Switch(off=_part_names("deactivate", parts))


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
    if not (isinstance(driver, DrivenJoint) and driver.is_relative):
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


def _part_names(what: str, parts: tuple[Any, ...]) -> tuple[str, ...]:
    for part in parts:
        if not isinstance(part, Part):
            raise BeamdaeError(f"{what}: expected joints and forces, got {short_repr(part)}.")
    return tuple(part.name for part in parts)
