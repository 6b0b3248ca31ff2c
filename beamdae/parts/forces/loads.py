"""Loads: forces and moments as laws of time."""

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
from beamdae.parts.laws import Law, as_law
from beamdae.parts.part import Part
from beamdae.symbolic.formulas import build_formula_kernel
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Named


def load_kernel(local: Local, work: SX, load: SX) -> ForceKernel:
    """The generalized force `load` that does work on the rate of `work`."""
    force = -ca.jtimes(work, local.q, load, True)
    power = ca.dot(local.dot(work), load)
    return ForceKernel(local, force, powers=ca.vertcat(power, 0))


def dead_load(local: Local, on: Any, *laws: Callable[[SX], SX]) -> ForceKernel:
    """A force of these components in the inertial frame."""
    place, _ = on(local.q)
    return load_kernel(local, place, ca.vertcat(*(law(local.time) for law in laws)))


def _follower_load(local: Local, on: Any, *laws: Callable[[SX], SX]) -> ForceKernel:
    place, turn = on(local.q)
    return load_kernel(local, place, rotate(turn, ca.vertcat(*(law(local.time) for law in laws))))


def _moment_load(local: Local, on: Any, law: Callable[[SX], SX]) -> ForceKernel:
    return load_kernel(local, on(local.q)[1], law(local.time))


def load_statement(
    part: str, on: Attachment, kind: Callable[..., ForceKernel], laws: Sequence[Law]
) -> ForceStatement:
    """A load of some kind on an attachment, of these laws of time."""
    functions = (on.checked_kinematics, *(law.formula for law in laws))
    kernel, data = build_formula_kernel(kind, functions, on.size)
    return ForceStatement(part, kernel, (on.piece,), data)


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
        """Both components over time."""
        return tuple(as_law(self.name, component) for component in self.law)

    @property
    def inputs(self) -> tuple[Named, ...]:
        """Both components."""
        return (Named("Fx", "N"), Named("Fy", "N"))

    def with_constant_laws(self, values: Sequence[float]) -> Force:
        """The same with these components."""
        return replace(self, law=tuple(values))

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The load."""
        kind = {"inertial": dead_load, "body": _follower_load}[self.axes]
        return [load_statement(self.name, self.on, kind, self.laws)]


@dataclass(frozen=True, eq=False)
class Moment(Part):
    """Moment [N m], counter-clockwise positive, on an attachment; `law` a number or law of t."""

    symbol = "moment"
    is_load = True
    name: str
    on: Attachment
    law: Any

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("Moment", self.name))
        require_movable(self.name, require_attachment(self.name, "on", self.on))
        require_angle(self.name, self.on)
        _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The moment over time."""
        return (as_law(self.name, self.law),)

    @property
    def inputs(self) -> tuple[Named, ...]:
        """The moment."""
        return (Named("M", "N m"),)

    def with_constant_laws(self, values: Sequence[float]) -> Moment:
        """The same with this moment."""
        return replace(self, law=values[0])

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The load."""
        return [load_statement(self.name, self.on, _moment_load, self.laws)]
