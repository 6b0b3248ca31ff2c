"""What the user builds: named parts, joined and observed; knows nothing of time stepping."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

from beamdae.errors import BeamdaeError, nearest, point
from beamdae.parts.bodies import Attachment, Ground, require_name
from beamdae.parts.joints import Joint
from beamdae.parts.laws import Law
from beamdae.parts.observables import motion
from beamdae.symbolic.statements import Quantity

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
        for body in _bodies(part):
            self._require_member(name, body)
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

    def _require_member(self, part: str, body: Any) -> None:
        if body is self.ground or any(body is other for other in self.parts.values()):
            return
        whose = "another mechanism's ground" if isinstance(body, Ground) else f"{body.name!r}"
        raise BeamdaeError(
            f"{part}: it refers to {whose}, which must be added to this mechanism first."
        )


def _bodies(part: Any) -> list[Any]:
    """The bodies a part refers to: those of its attachments, or the beam it acts on."""
    fields = [getattr(part, field, None) for field in ("a", "b", "on")]
    bodies = [field.body for field in fields if isinstance(field, Attachment)]
    return bodies + ([part.beam] if hasattr(part, "beam") else [])
