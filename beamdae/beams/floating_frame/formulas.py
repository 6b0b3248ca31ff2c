"""Formulas of beams in a floating frame: motion of sections and of the frame, deformation.

Each function or class is a kind of a `Formula`; see `symbolic.formula`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.beams.floating_frame.element import (
    FRAME_SIZE,
    NODE_SIZE,
    ORIGIN,
    PHI,
    THETA,
    AxisMotion,
    rotation_matrix,
)
from beamdae.beams.strains import slice_column
from beamdae.parts.attachments import rotate
from beamdae.symbolic.statements import SX, Local


def section_motion(q: SX, numbers: Any) -> tuple[SX, SX]:
    """Return position and rotation of a section from (x0, y0, theta, u, v, phi).

    `numbers` are the undeformed position (x, y) in the frame, the cosine and sine of the axis angle
    at this position, and the angle of the frame in the reference configuration.
    """
    x, y, cosine, sine, frame_angle = (numbers[k] for k in range(5))
    position = AxisMotion(q).position(ca.vertcat(x, y), rotation_matrix(cosine, sine))
    return position, q[THETA] - frame_angle + q[FRAME_SIZE + PHI]


def frame_motion(q: SX, frame_angle: Any) -> tuple[SX, SX]:
    """Return position and rotation of the frame.

    `frame_angle[0]` is the angle of the frame in the reference configuration [rad].
    """
    return q[ORIGIN], q[THETA] - frame_angle[0]


@dataclass(frozen=True)
class FloatingFrameDeformation:
    """Deformation (u, v, phi) of a section in the axes `axes`.

    `numbers` are the angle of the undeformed axis in the frame and the shape functions.
    """

    nodes: int
    axes: str

    def __call__(self, local: Local, numbers: Any) -> SX:
        """Return (u, v, phi) from local coordinates."""
        row = slice_column(numbers, 1, self.nodes)
        nodal = ca.reshape(local.q[FRAME_SIZE:], NODE_SIZE, self.nodes) @ row
        axis_angle = numbers[0]
        angle = {
            "inertial": local.q[THETA] + axis_angle,
            "frame": axis_angle,
            "local": 0.0,
        }[self.axes]
        return ca.vertcat(rotate(angle, nodal), nodal[PHI])
