"""Loads: forces and moments as laws of time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import keep, one_of, pair
from beamdae.parts.attachments import (
    Attachment,
    require_angle,
    require_attachment,
    require_movable,
    rotate,
)
from beamdae.parts.laws import Law, as_law
from beamdae.parts.part import Part, require_name
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local


def _load(part: str, on: Attachment, local: Local, work: SX, load: SX) -> ForceStatement:
    """Statement of the generalized force `load` that does work on the rate of `work`."""
    force = -ca.jtimes(work, local.q, load, True)
    power = ca.dot(local.dot(work), load)
    kernel = ForceKernel(local, force, powers=ca.vertcat(power, 0))
    return ForceStatement(part, kernel, (on.piece,), np.zeros((0, 1)))


@dataclass(frozen=True, eq=False)
class Force(Part):
    """Force (Fx, Fy) [N] on an attachment.

    Parameters
    ----------
    name
        Unique name.
    on
        Where it acts.
    law
        Pair of laws: numbers, functions of t or `Law`s.
    axes
        "inertial" (a dead load) or "body" (turning with the section it acts on).
    """

    name: str
    on: Attachment
    law: Any
    axes: str = "inertial"

    def __post_init__(self) -> None:
        keep(self, name=require_name("Force", self.name))
        require_movable(self.name, require_attachment(self.name, "on", self.on))
        keep(
            self,
            law=pair(self.name, "law", self.law, "a pair of laws (Fx, Fy)"),
            axes=one_of(self.name, "axes", self.axes, ("inertial", "body")),
        )
        _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Both components over time."""
        return tuple(as_law(self.name, component) for component in self.law)

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The load."""
        local = Local(self.on.size)
        load = ca.vertcat(*(law(local.time) for law in self.laws))
        if self.axes == "body":
            load = rotate(self.on.turn(local.q), load)
        return [_load(self.name, self.on, local, self.on.position(local.q), load)]


@dataclass(frozen=True, eq=False)
class Moment(Part):
    """Moment [N m], counter-clockwise positive, on an attachment; `law` a number or law of t."""

    name: str
    on: Attachment
    law: Any

    def __post_init__(self) -> None:
        keep(self, name=require_name("Moment", self.name))
        require_movable(self.name, require_attachment(self.name, "on", self.on))
        require_angle(self.name, self.on)
        _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The moment over time."""
        return (as_law(self.name, self.law),)

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The load."""
        local = Local(self.on.size)
        (law,) = self.laws
        return [_load(self.name, self.on, local, self.on.turn(local.q), law(local.time))]
