"""Loads: forces and moments on attachments that follow time laws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import require_choice, require_name, require_pair, set_fields
from beamdae.parts.attachments import (
    Attachment,
    require_angle,
    require_attachment,
    require_movable,
    rotate,
)
from beamdae.parts.forces.load_observables import LoadedPoint, ObservableLoad
from beamdae.parts.laws import Law, as_law
from beamdae.symbolic.formula import build_formula_kernel
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Variable


def load_kernel(local: Local, placement: SX, load: SX) -> ForceKernel:
    """Return the kernel of a load that does work on a placement (positions or angles)."""
    force = -ca.jtimes(placement, local.q, load, True)
    power = ca.dot(local.dot(placement), load)
    return ForceKernel(local, force, powers=ca.vertcat(power, 0))


def dead_load(local: Local, on: Any, *laws: Callable[[SX], SX]) -> ForceKernel:
    """Return the kernel of a force whose components in inertial axes follow the laws."""
    position, _ = on(local.q)
    return load_kernel(local, position, ca.vertcat(*(law(local.time) for law in laws)))


def _follower_load(local: Local, on: Any, *laws: Callable[[SX], SX]) -> ForceKernel:
    position, rotation = on(local.q)
    return load_kernel(
        local, position, rotate(rotation, ca.vertcat(*(law(local.time) for law in laws)))
    )


def _moment_load(local: Local, on: Any, law: Callable[[SX], SX]) -> ForceKernel:
    return load_kernel(local, on(local.q)[1], law(local.time))


@dataclass(frozen=True)
class _MotorLoad:
    """Moment between two points, of which the first has `size` local coordinates."""

    size: int

    def __call__(
        self, local: Local, on: Any, reaction_on: Any, law: Callable[[SX], SX]
    ) -> ForceKernel:
        rotation = on(local.q[: self.size])[1] - reaction_on(local.q[self.size :])[1]
        return load_kernel(local, rotation, law(local.time))


def load_statement(
    part: str, on: Sequence[Attachment], kind: Callable[..., ForceKernel], laws: Sequence[Law]
) -> ForceStatement:
    """Return the statement of a load on attachments; `kind` builds the kernel from the laws."""
    functions = (*(x.checked_kinematics for x in on), *(law.formula for law in laws))
    kernel, data = build_formula_kernel(kind, functions, sum(x.size for x in on))
    return ForceStatement(part, kernel, tuple(x.piece for x in on), data)


@dataclass(frozen=True, eq=False)
class Force(ObservableLoad):
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
    is_load = True
    name: str
    on: Attachment
    law: Any
    axes: str = "inertial"

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("Force", self.name))
        require_movable(self.name, require_attachment(self.name, "on", self.on))
        set_fields(
            self,
            law=require_pair(self.name, "law", self.law, "a pair of laws (Fx, Fy)"),
            axes=require_choice(self.name, "axes", self.axes, ("inertial", "body")),
        )
        _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Time laws of both components."""
        return tuple(as_law(self.name, component) for component in self.law)

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Names and units of both components."""
        return (Variable("Fx", "N"), Variable("Fy", "N"))

    def with_constant_laws(self, values: Sequence[float]) -> Force:
        """Return a copy of the force with constant components [N]."""
        return replace(self, law=tuple(values))

    @property
    def loaded_points(self) -> dict[str, LoadedPoint]:
        """The attachment, by the name "on"."""
        return {"on": LoadedPoint(self.on, 0)}

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """Return the force as one statement."""
        return [load_statement(self.name, (self.on,), self._kind, self.laws)]

    @property
    def _kind(self) -> Callable[..., ForceKernel]:
        return {"inertial": dead_load, "body": _follower_load}[self.axes]


@dataclass(frozen=True, eq=False)
class Moment(ObservableLoad):
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
    is_load = True
    name: str
    on: Attachment
    law: Any
    reaction_on: Attachment | None = None

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("Moment", self.name))
        require_movable(self.name, require_attachment(self.name, "on", self.on))
        if self.reaction_on is not None:
            require_attachment(self.name, "reaction_on", self.reaction_on)
        for attachment in self._points:
            require_angle(self.name, attachment)
        _ = self.laws

    @property
    def _points(self) -> tuple[Attachment, ...]:
        return (self.on,) if self.reaction_on is None else (self.on, self.reaction_on)

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
        return (Variable("M", "N m"),)

    def with_constant_laws(self, values: Sequence[float]) -> Moment:
        """Return a copy of the load with a constant moment [N m]."""
        return replace(self, law=values[0])

    @property
    def loaded_points(self) -> dict[str, LoadedPoint]:
        """The attachments, by the names "on" and "reaction_on"."""
        names = ("on", "reaction_on")
        return {
            name: LoadedPoint(x, k)
            for k, (name, x) in enumerate(zip(names, self._points, strict=False))
        }

    @property
    def observed_points(self) -> tuple[str, ...]:
        """The point "on"."""
        return ("on",)

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """Return the moment, and the opposite one, as one statement."""
        return [load_statement(self.name, self._points, self._kind, self.laws)]

    @property
    def _kind(self) -> Callable[..., ForceKernel]:
        return _moment_load if self.reaction_on is None else _MotorLoad(self.on.size)
