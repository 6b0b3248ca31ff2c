"""What can be observed of attachments: their motion, and how they move relative to each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, short_repr
from beamdae.parts.attachments import Attachment, require_angle, require_attachment, rotate
from beamdae.symbolic.formulas import (
    MAX_SHARED_KERNELS,
    Formula,
    FormulaExpression,
    constant_formula,
)
from beamdae.symbolic.statements import SX, Local, Named, Quantity


def motion_quantity(attachment: Attachment) -> Quantity:
    """Position, angle and their rates of an attachment, in the inertial frame."""
    has_angle = _turns(attachment)
    place = [Named("x", "m"), Named("y", "m"), *([Named("angle", "rad")] if has_angle else [])]
    columns = (*place, *(column.rate for column in place))
    kind = _section_motion if has_angle else _point_motion
    inclination = constant_formula(attachment.inclination)
    values, data = FormulaExpression.of(
        kind, (attachment.checked_kinematics, *([inclination] if has_angle else []))
    )
    return Quantity(columns, (attachment.piece,), values, data)


def as_quantity(name: str, what: Attachment | Quantity) -> Quantity:
    """What is to be observed: the motion of an attachment, or any other quantity."""
    quantity = motion_quantity(what) if isinstance(what, Attachment) else what
    if not isinstance(quantity, Quantity):
        raise BeamdaeError(
            f"{name}: only attachments and quantities such as beam.strain(s=, offset=) can be "
            f"observed, got {short_repr(what)}."
        )
    return quantity


def _turns(attachment: Attachment) -> bool:
    moved = attachment.checked_kinematics
    if isinstance(moved, Formula):
        return _kind_turns(moved.kind, attachment.size, len(moved.numbers))
    return _depends(moved, attachment.size)


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def _kind_turns(kind: Callable[..., Any], size: int, numbers: int) -> bool:
    return _depends(Formula(kind, SX.sym("numbers", numbers)), size)


def _depends(moved: Callable[[SX], tuple[SX, SX]], size: int) -> bool:
    return not SX(moved(SX.sym("q", size))[1]).is_constant()


def _point_motion(local: Local, on: Any) -> SX:
    place, _ = on(local.q)
    return ca.vertcat(place, local.dot(place))


def _section_motion(local: Local, on: Any, inclination: Callable[[], Any]) -> SX:
    place, turn = on(local.q)
    place = ca.vertcat(place, inclination()[0] + turn)
    return ca.vertcat(place, local.dot(place))


@dataclass(frozen=True)
class _Relative:
    """How far one point is from where the other carries it by an arm; `size` is of the former."""

    size: int

    def __call__(self, local: Local, of: Any, on: Any, arm: Callable[[], Any]) -> SX:
        (place, turn), (root, turned) = of(local.q[: self.size]), on(local.q[self.size :])
        return ca.vertcat(place - (root + rotate(turned, arm())), turn - turned)


def relative_displacement(of: Attachment, on: Attachment) -> Quantity:
    """How far the point `of` is from where the body of `on` would carry it if it were rigid.

    Columns u, v [m], components in the inertial frame, and phi [rad], the turn of the section `of`
    relative to that of `on`. With `on` the root of a beam it is the deformation seen from there,
    also across several beams welded together.
    """
    require_attachment("relative_displacement", "of", of)
    require_attachment("relative_displacement", "on", on)
    require_angle("relative_displacement", of)
    require_angle("relative_displacement", on)
    arm = constant_formula(*np.subtract(of.point, on.point).tolist())
    columns = (Named("u", "m"), Named("v", "m"), Named("phi", "rad"))
    values, data = FormulaExpression.of(
        _Relative(of.size), (of.checked_kinematics, on.checked_kinematics, arm)
    )
    return Quantity(columns, (of.piece, on.piece), values, data)
