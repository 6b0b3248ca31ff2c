"""Kinds of formulas of beams: how sections in a floating frame move, and what is observed of them.

The numbers of a formula are taken one by one: see `symbolic.formulas`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.beams.floating_frame.element import FRAME_SIZE, NODE_SIZE, AxisMotion, rotation_matrix
from beamdae.beams.strains import slice_column
from beamdae.parts.attachments import rotate
from beamdae.symbolic.statements import SX, Local


@dataclass(frozen=True)
class SectionMotion:
    """Position and turn of a section between so many nodes.

    Numbers: undeformed place in the frame, cosine and sine of the angle of the axis there, angle of
    the frame in the drawing, shape functions.
    """

    nodes: int

    def __call__(self, q: SX, numbers: Any) -> tuple[SX, SX]:
        """From local coordinates."""
        axis, row = AxisMotion(q), slice_column(numbers, 5, self.nodes)
        to_frame = rotation_matrix(numbers[2], numbers[3])
        turn = q[2] - numbers[4] + axis.rotation(row)
        return axis.position(row, slice_column(numbers, 0, 2), to_frame), turn


def frame_motion(q: SX, angle: Any) -> tuple[SX, SX]:
    """Position and turn of the frame; its number is its angle in the drawing."""
    return q[:2], q[2] - angle[0]


@dataclass(frozen=True)
class FloatingFrameDeformation:
    """(u, v, phi) of a section in some axes; numbers: angle of its axis, shape functions."""

    nodes: int
    axes: str

    def __call__(self, local: Local, numbers: Any) -> SX:
        """From local coordinates."""
        row = slice_column(numbers, 1, self.nodes)
        nodal = ca.reshape(local.q[FRAME_SIZE:], NODE_SIZE, self.nodes) @ row
        angle = numbers[0]
        turn = {"inertial": local.q[2] + angle, "frame": angle, "local": 0.0}[self.axes]
        return ca.vertcat(rotate(turn, nodal), nodal[2])
