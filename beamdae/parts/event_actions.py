"""Actions of events: switching of joints and forces, change of a driver law, impact."""

from __future__ import annotations

from typing import Any

from beamdae.errors import BeamdaeError, require_between, require_choice, short_repr
from beamdae.parts.events import Impact, Switch
from beamdae.parts.joints.drivers import DrivenJoint, Driver, TranslationalDriver
from beamdae.parts.joints.joint import Joint, KinematicConstraint
from beamdae.parts.laws import as_law
from beamdae.parts.part import Part
from beamdae.symbolic.statements import Quantity


def activate(*parts: Part, as_is: bool = False) -> Switch:
    """Return an action that activates joints and forces, for the argument `do` of an event.

    A joint must be closed when it becomes active. With `as_is`, the joint instead keeps the gap it
    has at the event: a driver continues from the angle or travel it has reached, a link keeps its
    length, a guide its offset, a gear its phase; a weld or a hinge keeps the position of point `b`
    on the body of `a` (if `a` is a particle, of `a` on the body of `b`), and a weld also keeps the
    relative angle. The force of a weld or a hinge with such a gap acts at point `b` (if `a` is a
    particle, at `a`), and `reaction_on` does not include the moment of this force about the other
    point.

    Parameters
    ----------
    *parts
        Joints and forces.
    as_is
        If True, the joints keep the gaps that they have at the event (distances or angles).

    Returns
    -------
    Switch
        The action.

    Raises
    ------
    BeamdaeError
        If there is no argument or an argument is not a part, `as_is` is not a bool, or `as_is` is
        True and a part has no gap.
    """
    names = name_parts("activate", parts)
    if require_choice("activate", "as_is", as_is, (True, False)):
        for part in parts:
            if not isinstance(part, KinematicConstraint) or part.gap is None or part.coordinates:
                raise BeamdaeError(
                    f"{part.name}: as_is=True requires a joint with a gap of positions "
                    f"or angles, got {short_repr(part)}; omit as_is=True for other parts."
                )
        return Switch(on=names, as_is=names, parts=parts)
    return Switch(on=names, parts=parts)


def deactivate(*parts: Part) -> Switch:
    """Return an action that deactivates joints and forces, for the argument `do` of an event.

    Parameters
    ----------
    *parts
        Joints and forces.

    Returns
    -------
    Switch
        The action.

    Raises
    ------
    BeamdaeError
        If there is no argument, or an argument is not a part.
    """
    return Switch(off=name_parts("deactivate", parts), parts=parts)


def change_law(driver: Driver | TranslationalDriver, law: Any) -> Switch:
    """Return an action that changes the law of a driver, for the argument `do` of an event.

    Parameters
    ----------
    driver
        The driver. An inactive driver becomes active.
    law
        Angle [rad] or travel [m] as a function of the time t since the event [s]: a number, a
        function or a `Law`. The driver moves by law(t) - law(0) from the angle or travel at the
        event; a constant law holds this angle or travel. If the initial rate of the law differs
        from the rate of the motion, velocities jump, and `Solution.events` lists the impulses.

    Returns
    -------
    Switch
        The action.

    Raises
    ------
    BeamdaeError
        If `driver` is neither a `Driver` nor a `TranslationalDriver`, or `law` is invalid.

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
            "change_law: driver must be a Driver or a TranslationalDriver, got "
            f"{short_repr(driver)}."
        )
    law = as_law(f"change_law of {driver.name}", law)
    names = (driver.name,)
    return Switch(on=names, as_is=names, laws=((driver.name, law),), parts=(driver,))


def impact(on: Joint | Quantity, restitution: float = 1.0) -> Impact:
    """Return an action that applies an impact, for the argument `do` of an event.

    By Newton's law of restitution, the rate of the gap after the impact is minus `restitution`
    times the rate before it. The velocities v- before and v+ after the impact and the impulses P
    satisfy M (v+ - v-) = -G^T P, where M is the mass matrix and G the Jacobian of the active joints
    and of the joint `on` or, if `on` is a gap, of minus the gap: positive impulses open the gap.
    The active joints stay closed. There is no friction. The lost energy is part of the dissipated
    energy, and `Solution.events` lists the impulses.

    Parameters
    ----------
    on
        Gap that closes, as a quantity with one column that depends only on positions, such as
        `surface.gap(point)`, or an inactive joint that acts as a stop. There is no impact while a
        gap opens; a joint rebounds from either side.
    restitution
        Coefficient of restitution, 0 (plastic) to 1 (elastic).

    Returns
    -------
    Impact
        The action.

    Raises
    ------
    BeamdaeError
        If `on` is neither a joint nor a quantity with one column, `on` is the reaction of a joint,
        or `restitution` is outside [0, 1].

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
                "impact: a gap must be a quantity with one column that depends on "
                "positions, such as surface.gap(point), got "
                f"{', '.join(x.header for x in on.columns)}."
            )
    elif not isinstance(on, Joint):
        raise BeamdaeError(
            f"impact: on must be a gap, such as surface.gap(point), or a joint, "
            f"got {short_repr(on)}."
        )
    return Impact(on, require_between("impact", "restitution", restitution, 0.0, 1.0))


def name_parts(call: str, parts: tuple[Any, ...]) -> tuple[str, ...]:
    """Return the names of joints and forces, the arguments of `call`."""
    if not parts:
        raise BeamdaeError(f"{call}: expected joints and forces, got none; pass at least one part.")
    for part in parts:
        if not isinstance(part, Part):
            raise BeamdaeError(f"{call}: expected joints and forces, got {short_repr(part)}.")
    return tuple(part.name for part in parts)
