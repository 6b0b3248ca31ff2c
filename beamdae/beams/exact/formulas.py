"""Formulas of geometrically exact beams: motion of sections and of the chord.

Each function or class is a kind of a `Formula`; see `symbolic.formula`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.beams.strains import slice_column
from beamdae.parts.attachments import rotate
from beamdae.symbolic.statements import SX


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
