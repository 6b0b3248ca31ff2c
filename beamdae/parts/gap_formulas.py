"""What joints hold, and what follows from it, as formulas of where their points are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from beamdae.parts.attachments import rotate
from beamdae.symbolic.statements import SX, ConstraintKernel, Local


@dataclass(frozen=True)
class Gap:
    """What a joint holds, as a formula of where its points are.

    Attributes
    ----------
    sizes
        Numbers of local coordinates of the points.
    gap
        (time, *points moved, *further formulas) -> g, a point moved being its position and turn.
    """

    sizes: tuple[int, ...]
    gap: Callable[..., SX]

    def points(self, local: Local, functions: Sequence[Any]) -> list[Any]:
        """All points, moved by the first of the functions."""
        ends = np.cumsum([0, *self.sizes]).tolist()
        return [
            on(local.q[first:last])
            for on, (first, last) in zip(functions, pairwise(ends), strict=False)
        ]

    def own(self, functions: Sequence[Any]) -> Sequence[Any]:
        """The further formulas."""
        return functions[len(self.sizes) :]


class HeldGap(Gap):
    """The kernel of a gap."""

    def __call__(self, local: Local, *functions: Any) -> ConstraintKernel:
        """Of local symbols."""
        points = self.points(local, functions)
        return ConstraintKernel(local, self.gap(local.time, *points, *self.own(functions)))


@dataclass(frozen=True)
class ReactionOn(Gap):
    """Force and moment at one of the points: what does the work of the multipliers there."""

    which: int
    axes: str
    has_angle: bool

    def __call__(self, local: Local, *functions: Any) -> SX:
        """(Fx, Fy, M), or without M."""
        found = self.points(local, functions)
        free = SX.sym("point", 3)
        place, turn = found[self.which]
        moved = [*found[: self.which], (free[:2], free[2]), *found[self.which + 1 :]]
        g = self.gap(local.time, *moved, *self.own(functions))
        load = -ca.jtimes(g, free, local.lam, True)
        load = ca.densify(ca.substitute(load, free, ca.vertcat(place, turn)))
        force = rotate(-turn, load[:2]) if self.axes == "body" else load[:2]
        return ca.vertcat(force, load[2]) if self.has_angle else force


@dataclass(frozen=True)
class Drive(Gap):
    """What a law of time takes to be followed, and its power.

    Attributes
    ----------
    changes
        Whether events may have it follow another law: then its power is that of how it moves.
    """

    changes: bool

    def __call__(self, local: Local, *functions: Any) -> SX:
        """(force or moment, power)."""
        g = self.gap(local.time, *self.points(local, functions), *self.own(functions))
        if self.changes:
            rate = -ca.jtimes(g, local.q, local.v)
        else:
            rate = ca.jtimes(g, local.time, SX([1, 0]))
        return ca.vertcat(-local.lam, local.lam * rate)
