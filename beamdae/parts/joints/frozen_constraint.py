"""Joints that hold what an event finds, in place of what is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.joints.joint import JointByFormula, Revolute, Weld, _Gap, _Held
from beamdae.parts.laws import Law
from beamdae.parts.part import Part
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formulas import MOST_KINDS, Combined, combined_kernel, plain
from beamdae.symbolic.statements import SX, ConstraintStatement, Local, Named

Array = np.ndarray


@dataclass(frozen=True)
class Held:
    """What a joint holds since an event had it hold what it found.

    Attributes
    ----------
    found
        By how much what it holds is off its own formula.
    event, since
        The event whose law it follows, if one gave it another than its own, and when that was [s].
    """

    found: tuple[float, ...]
    event: str = ""
    since: float = 0.0


def _carrier(joint: JointByFormula) -> int | None:
    """Which of its points carries the first two numbers in axes that turn with it, if one does."""
    if not isinstance(joint, (Revolute, Weld)):
        return None
    return 0 if joint.a.has_angle else 1


@dataclass(frozen=True)
class _Shifted:
    """A gap less so many numbers, the first two in axes of the point `carrier`, if there is one."""

    gap: Any
    carrier: int | None
    count: int

    def __call__(self, time: SX, *given: Any) -> SX:
        *own, numbers = given
        found = ca.vertcat(*(numbers()[k] for k in range(self.count)))
        if self.carrier is not None:
            found = ca.vertcat(rotate(own[self.carrier][1], found), found[2:])
        return self.gap(time, *own) - found


@dataclass(frozen=True)
class _Found(_Gap):
    """The numbers at which the shifted gap is closed."""

    carrier: int | None

    def __call__(self, local: Local, *functions: Any) -> SX:
        points = self.points(local, functions)
        gap = self.gap(local.time, *points, *self.own(functions))
        if self.carrier is None:
            return gap
        return ca.vertcat(rotate(-points[self.carrier][1], gap), gap[2:])


@lru_cache(maxsize=MOST_KINDS)
def _evaluated(found: Combined, size: int, n_data: int) -> RowFunction:
    local = Local(size, n_data)
    inputs = [local.time, local.q, local.data]
    return RowFunction(ca.Function("found", inputs, [ca.densify(found(local))]))


def found_by(
    joint: JointByFormula, law: Law | None, time: Array, local: Array
) -> tuple[float, ...]:
    """What a joint finds at time = (t, branch) and the local coordinates of its points.

    `law` is what it is to follow from there on, if that is not its own.
    """
    combined, data = Combined.of(
        _Found(joint._sizes, joint._gap, _carrier(joint)), _functions(joint, law)
    )
    values = _evaluated(combined, len(local), len(data))(time[None], local[None], data)
    return tuple(values[0].tolist())


def _functions(joint: JointByFormula, law: Law | None) -> tuple[Any, ...]:
    """The formulas of a joint; the law of a driver is the last of them."""
    own = joint._functions
    return own if law is None else (*own[:-1], law.formula)


@dataclass(frozen=True, eq=False)
class AsFound(Part):
    """A joint that holds what was `found`, by a `law` that is not its own if there is one."""

    joint: JointByFormula
    found: tuple[float, ...]
    law: Law | None = None

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the joint."""
        return self.joint.name

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """Those of the joint."""
        return self.joint.attachments

    @property
    def laws(self) -> tuple[Law, ...]:
        """Those of the joint."""
        return self.joint.laws if self.law is None else (self.law,)

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """Those of the joint."""
        return self.joint.multipliers

    def constraints(self) -> list[ConstraintStatement]:
        """The constraint as a local statement."""
        joint, sizes = self.joint, self.joint._sizes
        shifted = _Shifted(joint._gap, _carrier(joint), len(self.found))
        functions = [*_functions(joint, self.law), plain(*self.found)]
        kernel, data = combined_kernel(
            _Held(sizes, shifted), functions, sum(sizes), len(self.multipliers)
        )
        return [ConstraintStatement(self.name, kernel, joint._pieces, self.multipliers, data)]
