"""Blades that do not slip sideways."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.errors import require_choice, require_name, set_fields
from beamdae.parts.attachments import (
    Attachment,
    require_angle,
    require_attachment,
    require_movable,
    rotate,
)
from beamdae.parts.joints.guides import left_normal
from beamdae.parts.joints.joint import load_columns, resolve_load
from beamdae.parts.part import Part
from beamdae.symbolic.formulas import FormulaExpression, build_formula_kernel, constant_formula
from beamdae.symbolic.statements import (
    SX,
    ConstraintStatement,
    Local,
    Named,
    NonholonomicKernel,
    Quantity,
)


def _skating(local: Local, on: Any, normal: Callable[[], Any]) -> NonholonomicKernel:
    place, turn = on(local.q)
    return NonholonomicKernel(local, ca.dot(rotate(turn, normal()), local.dot(place)))


def _side_force(local: Local) -> SX:
    return -local.lam


@dataclass(frozen=True)
class _SkateReaction:
    axes: str

    def __call__(self, local: Local, on: Any, normal: Callable[[], Any]) -> SX:
        _, turn = on(local.q)
        return resolve_load(self.axes, turn, -local.lam * rotate(turn, normal()), 0)


@dataclass(frozen=True, eq=False)
class Skate(Part):
    """A blade (knife edge) at `on`: its point does not move across `direction`.

    The direction is given in the drawing and turns with the body; n is its left normal. The
    constraint n . v = 0 is nonholonomic: it takes away a motion, but no place the body can get to.
    The reaction F is the force on the body along n.

    Parameters
    ----------
    name, on
        Unique name, and where the blade is.
    direction
        Of the blade in the drawing.
    """

    name: str
    on: Attachment
    direction: tuple[float, float] = (1.0, 0.0)

    multipliers = (Named("side", "N"),)

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("Skate", self.name))
        require_movable(self.name, require_attachment(self.name, "on", self.on))
        require_angle(self.name, self.on)
        _ = left_normal(self.name, self.direction)

    @property
    def reaction(self) -> Quantity:
        """Force [N] on the body along the left normal of the blade."""
        held, _ = FormulaExpression.of(_side_force, ())
        return Quantity((Named("F", "N"),), (), held, joint=self.name)

    def reaction_on(self, place: str = "on", axes: str = "inertial") -> Quantity:
        """Force Fx, Fy [N] and moment M [N m] on the body, at the blade: M is zero.

        Parameters
        ----------
        place
            "on", the only one there is.
        axes
            "inertial", or "body": those of the drawing as the body turns them.
        """
        require_choice(self.name, "place", place, ("on",))
        require_choice(self.name, "axes", axes, ("inertial", "body"))
        values, data = FormulaExpression.of(_SkateReaction(axes), self._functions)
        return Quantity(load_columns(self.on), (self.on.piece,), values, data, joint=self.name)

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        return (
            self.on.checked_kinematics,
            constant_formula(*left_normal(self.name, self.direction)),
        )

    def constraints(self) -> list[ConstraintStatement]:
        """The constraint as a local statement."""
        kernel, data = build_formula_kernel(_skating, self._functions, self.on.size, 1)
        return [ConstraintStatement(self.name, kernel, (self.on.piece,), self.multipliers, data)]
