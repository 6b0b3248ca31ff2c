"""Kinds of formulas of geometrically exact beams: how their sections move, and what is seen of it.

The numbers of a formula are taken one by one: see `symbolic.formulas`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.beams.exact.element import NODE_SIZE
from beamdae.beams.strains import slice_column
from beamdae.parts.attachments import rotate
from beamdae.symbolic.statements import SX, Local


@dataclass(frozen=True)
class ExactSectionMotion:
    """Position and turn of a section between so many nodes.

    Numbers: its angle in the drawing, shape functions; and where it lies `apart` from the
    interpolated axis by how much in the drawing, which turns with it. Linear where it does not,
    such as at nodes.
    """

    nodes: int
    apart: bool

    @property
    def count(self) -> int:
        """How many numbers it takes."""
        return 1 + self.nodes + 2 * self.apart

    def __call__(self, q: SX, numbers: Any) -> tuple[SX, SX]:
        """From local coordinates."""
        at = ca.reshape(q, NODE_SIZE, self.nodes) @ slice_column(numbers, 1, self.nodes)
        turn = at[2] - numbers[0]
        place = at[:2]
        if self.apart:
            place += rotate(turn, slice_column(numbers, 1 + self.nodes, 2))
        return place, turn


def chord_motion(q: SX, numbers: Any) -> tuple[SX, SX]:
    """Position of the first of two nodes, and turn of the line to the second.

    Numbers: angle of the first section in the drawing, and the line there. Turns are counted on
    with those of the first section: the line may lie up to half a turn off where that carries it.
    """
    turn = q[2] - numbers[0]
    along = rotate(-turn, q[3:5] - q[:2])
    drawn = slice_column(numbers, 1, 2)
    across = drawn[0] * along[1] - drawn[1] * along[0]
    return q[:2], turn + ca.atan2(across, ca.dot(drawn, along))


@dataclass(frozen=True)
class ExactDeformation:
    """(u, v, phi) of a section, seen from a frame that rides on the beam, in some axes.

    Local coordinates: of the frame, and behind them of the section. Numbers: of the frame, of the
    section, from the frame to the section in the drawing, and the angles of both there.
    """

    frame: Any
    frame_size: int
    frame_count: int
    section: ExactSectionMotion
    axes: str

    def __call__(self, local: Local, numbers: Any) -> SX:
        """From local coordinates."""
        own, last = self.frame_count, self.frame_count + self.section.count
        origin, turn = self.frame(local.q[: self.frame_size], slice_column(numbers, 0, own))
        section = slice_column(numbers, own, self.section.count)
        place, turned = self.section(local.q[self.frame_size :], section)
        displacement = place - origin - rotate(turn, slice_column(numbers, last, 2))
        back = {
            "inertial": 0.0,
            "frame": -(turn + numbers[last + 2]),
            "local": -(turn + numbers[last + 3]),
        }[self.axes]
        return ca.vertcat(rotate(back, displacement), turned - turn)
