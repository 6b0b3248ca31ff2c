"""Loads: forces and moments on attachments that follow time laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from beamdae.errors import choice_of, convert_fields, optional, require_pair, set_fields
from beamdae.parts.attachments import (
    Attachment,
    require_angle,
    require_attachment,
    require_movable,
    rotate,
)
from beamdae.parts.forces.point_force import ForceFormula, PointForce
from beamdae.parts.laws import Law, as_law
from beamdae.parts.point_parts import FORCE, MOMENT, PlacedPoint
from beamdae.symbolic.statements import SX, ForceKernel, Local, Variable


def load_kernel(local: Local, placement: SX, load: SX) -> ForceKernel:
    """Return the kernel of a load that does work on a placement (positions or angles)."""
    force = -ca.jtimes(placement, local.q, load, True)
    power = ca.dot(local.dot(placement), load)
    return ForceKernel(local, force, powers=ca.vertcat(power, 0))


@dataclass(frozen=True)
class _ForceFormula:
    """Force with components in `axes` that follow the laws."""

    axes: str

    def __call__(
        self, local: Local, points: Sequence[PlacedPoint], *laws: Callable[[SX], SX]
    ) -> tuple[ForceKernel, Mapping[str, SX]]:
        (on,) = points
        load = ca.vertcat(*(law(local.time) for law in laws))
        load = rotate(on.rotation, load) if self.axes == "body" else load
        return load_kernel(local, on.position, load), {}


def _moment_formula(
    local: Local, points: Sequence[PlacedPoint], law: Callable[[SX], SX]
) -> tuple[ForceKernel, Mapping[str, SX]]:
    rotation = points[0].rotation - sum(point.rotation for point in points[1:])
    return load_kernel(local, rotation, law(local.time)), {}


class _Load(PointForce):
    """Load that follows time laws."""

    is_load = True
    name: str
    law: Any

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        return tuple(law.formula for law in self.laws)


@dataclass(frozen=True, eq=False)
class Force(_Load):
    """Force on an attachment with components (Fx, Fy) [N] that follow time laws.

    Parameters
    ----------
    name
        Unique name.
    on
        Attachment on which the load acts.
    law
        Pair of laws (Fx, Fy) [N]: numbers, functions of t [s] or `Law`s.
    axes
        "inertial" (default) for a dead load, or "body" for a follower load. The axes of a follower
        load rotate with the body or section; in the reference configuration, they are the inertial
        axes.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `on` is not an attachment or belongs to the ground, `law` is not a
        pair of valid laws, or `axes` is unknown.

    Examples
    --------
    >>> import beamdae as bd
    >>> ball = bd.PointMass("ball", 0.2, at=(0.0, 1.0))
    >>> push = bd.Force("push", ball.point, (bd.sine(2.0, frequency=5.0), 0.0))
    """

    symbol = "force"
    name: str
    on: Attachment
    law: Any
    axes: str = "inertial"

    def __post_init__(self) -> None:
        convert_fields(self, on=require_movable, axes=choice_of("inertial", "body"))
        law = require_pair(self.name, "law", self.law, "a pair of laws (Fx, Fy)")
        set_fields(self, law=law)
        _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Time laws of both components."""
        return tuple(as_law(self.name, component) for component in self.law)

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Names and units of both components."""
        return FORCE

    @property
    def points(self) -> dict[str, Attachment]:
        """The attachment, by the name "on"."""
        return {"on": self.on}

    @property
    def _formula(self) -> ForceFormula:
        return _ForceFormula(self.axes)


@dataclass(frozen=True, eq=False)
class Moment(_Load):
    """Moment [N m] on a body, or between two bodies; counter-clockwise is positive.

    Parameters
    ----------
    name
        Unique name.
    on
        Attachment on which the load acts.
    law
        Moment [N m]: a number, a function of t [s] or a `Law`.
    reaction_on
        Attachment on which the opposite moment acts, as that of a motor on its housing. Defaults to
        none, so that the moment acts from outside.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `on` is not an attachment, belongs to the ground or is a particle,
        `reaction_on` is not an attachment or is a particle, or `law` is invalid.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> base = mech.add(bd.RigidBody("base", mass=2.0, inertia=0.1, center=(0.0, 0.0)))
    >>> arm = mech.add(bd.RigidBody("arm", mass=0.5, inertia=0.02, center=(0.3, 0.0)))
    >>> hinge = mech.add(bd.Revolute("hinge", base.at(0.0, 0.0), arm.at(0.0, 0.0)))
    >>> motor = bd.Moment("motor", arm.at(0.0, 0.0), 0.2, reaction_on=base.at(0.0, 0.0))
    """

    symbol = "moment"
    name: str
    on: Attachment
    law: Any
    reaction_on: Attachment | None = None

    def __post_init__(self) -> None:
        convert_fields(self, on=require_movable, reaction_on=optional(require_attachment))
        for attachment in self.points.values():
            require_angle(self.name, attachment)
        _ = self.laws

    @property
    def points(self) -> dict[str, Attachment]:
        """The attachments, by the names "on" and "reaction_on"."""
        on = {"on": self.on}
        return on if self.reaction_on is None else {**on, "reaction_on": self.reaction_on}

    @property
    def acts_between_attachments(self) -> bool:
        """True if the opposite moment acts on a second point."""
        return self.reaction_on is not None

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Time law of the moment, as a tuple of one entry."""
        return (as_law(self.name, self.law),)

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Name and unit of the moment."""
        return (MOMENT,)

    @property
    def _observed_points(self) -> tuple[str, ...]:
        """The point "on"."""
        return ("on",)

    @property
    def _formula(self) -> ForceFormula:
        return _moment_formula
