"""Formulas of beams in a floating frame: motion of sections and of the frame.

Each function or class is a kind of a `Formula`; see `symbolic.formula`.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from beamdae.beams.floating_frame.element import (
    FRAME_SIZE,
    ORIGIN,
    PHI,
    THETA,
    AxisMotion,
    rotation_matrix,
)
from beamdae.symbolic.statements import SX


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
