"""Formulas of geometrically exact beams: motion of sections and of the chord, deformation.

Each function or class is a kind of a `Formula`; see `symbolic.formula`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.beams.strains import slice_column
from beamdae.parts.attachments import rotate
from beamdae.symbolic.statements import SX, Local


@dataclass(frozen=True)
class ExactSectionMotion:
    """Position and rotation of a section from (x, y, psi) there.

    `numbers` begin with the angle of the section in the reference configuration. With an offset,
    they also contain the vector (x, y) from the interpolated axis to the section in the reference
    configuration; this vector rotates with the section. Without an offset, for example at nodes,
    the motion is linear in the coordinates.
    """

    has_offset: bool

    def __call__(self, q: SX, numbers: Any) -> tuple[SX, SX]:
        """Return position and rotation."""
        rotation, position = q[2] - numbers[0], q[:2]
        if self.has_offset:
            position += rotate(rotation, slice_column(numbers, 1, 2))
        return position, rotation


def chord_motion(q: SX, numbers: Any) -> tuple[SX, SX]:
    """Return the position of the first of two nodes and the rotation of the chord between them.

    `numbers` are the angle of the first section and the vector (x, y) of the chord in the reference
    configuration. The rotation is continuous while the chord deviates by less than half a
    revolution from a chord that rotates rigidly with the first section.
    """
    section_rotation = q[2] - numbers[0]
    along = rotate(-section_rotation, q[3:5] - q[:2])
    chord = slice_column(numbers, 1, 2)
    across = chord[0] * along[1] - chord[1] * along[0]
    return q[:2], section_rotation + ca.atan2(across, ca.dot(chord, along))


@dataclass(frozen=True)
class ExactDeformation:
    """Deformation (u, v, phi) of a section relative to a reference frame, in the axes `axes`.

    The local coordinates are the coordinates of the frame, then those of the section. `numbers` are
    the numbers of the frame motion and of the section motion, the vector (x, y) from the frame to
    the section and the angles of frame and section, all in the reference configuration.
    """

    frame: Any
    frame_size: int
    frame_count: int
    section: Any
    section_count: int
    axes: str

    def __call__(self, local: Local, numbers: Any) -> SX:
        """Return (u, v, phi) from local coordinates."""
        offset_first = self.frame_count + self.section_count
        frame_numbers = slice_column(numbers, 0, self.frame_count)
        section_numbers = slice_column(numbers, self.frame_count, self.section_count)
        offset = slice_column(numbers, offset_first, 2)
        frame_angle, section_angle = (numbers[offset_first + k] for k in (2, 3))

        origin, frame_rotation = self.frame(local.q[: self.frame_size], frame_numbers)
        position, section_rotation = self.section(local.q[self.frame_size :], section_numbers)
        displacement = position - origin - rotate(frame_rotation, offset)
        to_axes = {
            "inertial": 0.0,
            "frame": -(frame_rotation + frame_angle),
            "local": -(frame_rotation + section_angle),
        }[self.axes]
        return ca.vertcat(rotate(to_axes, displacement), section_rotation - frame_rotation)
