"""Attachments: material points of bodies, where parts meet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import scipy.sparse as sp

from beamdae.errors import BeamdaeError
from beamdae.symbolic.statements import SX, Piece


@dataclass(frozen=True, eq=False, repr=False)
class Attachment:
    """A material point of a body, named by where it sits in the reference drawing.

    Attributes
    ----------
    body
        The body it belongs to.
    point
        Its place (x, y) in the reference drawing [m].
    inclination
        Angle of the section (or the body) there in the reference drawing [rad].
    operator
        Rows that pick its local coordinates from those of the body.
    kinematics
        Local coordinates -> (position in the inertial frame, turn since the reference drawing).
    has_angle
        Whether it turns; a particle does not.
    """

    body: Any
    point: tuple[float, float]
    inclination: float
    operator: sp.csr_array
    kinematics: Callable[[SX], tuple[SX, SX]]
    has_angle: bool = True

    @property
    def size(self) -> int:
        """Number of local coordinates."""
        return self.operator.shape[0]

    @property
    def piece(self) -> Piece:
        """Where the local coordinates come from."""
        return Piece(self.body, self.operator)

    def position(self, q: SX) -> SX:
        """Position (x, y) in the inertial frame [m] from the local coordinates."""
        return self.kinematics(q)[0]

    def turn(self, q: SX) -> SX:
        """Rotation of the section since the reference drawing [rad] from the local coordinates."""
        return self.kinematics(q)[1]

    def __repr__(self) -> str:
        return f"{self.body.name} at ({self.point[0]:.6g}, {self.point[1]:.6g})"


def require_attachment(part: str, name: str, value: Any) -> Attachment:
    """Return `value` if it is an attachment."""
    if not isinstance(value, Attachment):
        raise BeamdaeError(f"{part}: {name} must be an attachment such as beam.end, got {value!r}.")
    return value


def require_angle(part: str, attachment: Attachment) -> None:
    """Refuse a particle where an angle is held, driven or loaded."""
    if not attachment.has_angle:
        raise BeamdaeError(f"{part}: {attachment} is a particle and has no angle.")


def rotate(angle: Any, vector: Any) -> SX:
    """The plane vector turned by `angle` [rad]."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(c * vector[0] - s * vector[1], s * vector[0] + c * vector[1])
