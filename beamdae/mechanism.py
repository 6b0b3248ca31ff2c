"""What the user builds: named parts, joined and observed; knows nothing of time stepping."""

from __future__ import annotations

from typing import Any, TypeVar

import casadi as ca
import numpy as np

from beamdae.bodies import Attachment, Ground, require_name
from beamdae.errors import BeamdaeError, nearest, point
from beamdae.joints import Joint
from beamdae.laws import Law
from beamdae.statements import SX, Local, Quantity

P = TypeVar("P")


class Mechanism:
    """Ordered, uniquely named parts under uniform gravity.

    Parameters
    ----------
    gravity
        Acceleration of gravity (gx, gy) [m/s^2].

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> bob = mech.add(bd.RigidBody("bob", mass=1.0, inertia=0.1, center=(1.0, 0.0)))
    >>> hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    """

    def __init__(self, gravity: tuple[float, float] = (0.0, 0.0)) -> None:
        self.gravity = np.array(point("Mechanism", "gravity", gravity))
        self.ground = Ground()
        self.parts: dict[str, Any] = {}
        self.observables: dict[str, Quantity] = {}

    def add(self, part: P) -> P:
        """Add a body, joint, point mass or load and return it.

        Raises
        ------
        BeamdaeError
            If the name is taken or an attachment's body has not been added.
        """
        name = getattr(part, "name", None)
        states = ("coordinate_names", "force_statements", "constraint_statement")
        if name is None or isinstance(part, Ground) or not any(hasattr(part, s) for s in states):
            raise BeamdaeError(f"Mechanism: only parts can be added, got {part!r}.")
        if name in self.parts or name == self.ground.name:
            raise BeamdaeError(f"Mechanism: the name {name!r} is taken, every part needs its own.")
        for attachment in _attachments(part):
            self._require_body(name, attachment)
        self.parts[name] = part
        return part

    def observe(self, name: str, what: Attachment | Quantity) -> None:
        """Add columns to the results: the motion of an attachment, or any other quantity.

        An attachment gives name.x [m], name.y [m], name.angle [rad] and their rates.
        """
        require_name("Mechanism.observe", name)
        if name in self.observables or name in ("t", "energy"):
            raise BeamdaeError(f"Mechanism: the observable name {name!r} is taken.")
        quantity = motion(what) if isinstance(what, Attachment) else what
        if not isinstance(quantity, Quantity):
            raise BeamdaeError(
                f"{name}: only attachments and quantities such as beam.strain(s=, offset=) can be "
                f"observed, got {what!r}."
            )
        for piece in quantity.pieces:
            self._require_member(name, piece.owner)
        if quantity.joint is not None and not isinstance(self.parts.get(quantity.joint), Joint):
            raise BeamdaeError(f"{name}: the joint {quantity.joint!r} must be added first.")
        self.observables[name] = quantity

    def part(self, name: str) -> Any:
        """The part of that name."""
        if name not in self.parts:
            raise BeamdaeError(f"Mechanism: no part {name!r}{nearest(name, self.parts)}.")
        return self.parts[name]

    @property
    def joints(self) -> list[Joint]:
        """The joints in the order they were added."""
        return [part for part in self.parts.values() if isinstance(part, Joint)]

    @property
    def laws(self) -> list[Law]:
        """All laws of time of drivers and loads."""
        return [law for part in self.parts.values() for law in getattr(part, "laws", ())]

    def _require_body(self, part: str, attachment: Attachment) -> None:
        self._require_member(part, attachment.body)

    def _require_member(self, part: str, body: Any) -> None:
        if body is self.ground or any(body is other for other in self.parts.values()):
            return
        whose = "another mechanism's ground" if isinstance(body, Ground) else f"{body.name!r}"
        raise BeamdaeError(
            f"{part}: it refers to {whose}, which must be added to this mechanism first."
        )


def _attachments(part: Any) -> list[Attachment]:
    candidates = (getattr(part, field, None) for field in ("a", "b", "on"))
    return [c for c in candidates if isinstance(c, Attachment)]


def motion(attachment: Attachment) -> Quantity:
    """Position, angle and their rates of an attachment, in the inertial frame."""
    has_angle = not SX(attachment.turn(SX.sym("q", attachment.size))).is_constant()
    columns = [("x", "m"), ("y", "m"), ("x_dot", "m/s"), ("y_dot", "m/s")]
    if has_angle:
        columns.insert(2, ("angle", "rad"))
        columns.append(("angle_dot", "rad/s"))

    def expression(local: Local) -> SX:
        place = attachment.position(local.q)
        if has_angle:
            place = ca.vertcat(place, attachment.inclination + attachment.turn(local.q))
        return ca.vertcat(place, local.dot(place))

    return Quantity(tuple(columns), (attachment.piece,), expression)
