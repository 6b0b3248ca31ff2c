"""Poses of attachments: in the reference configuration, at given coordinates, in a mode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.results.section_forces.section_motions import (
    evaluate_sections,
    position_and_angle,
)

Array = np.ndarray

# Step of the central differences, for a mode shape whose largest component is 1.
_DIFFERENCE_STEP = 1e-5
_SMALLEST_SHAPE = 1e-300  # avoids division by zero for a mode without motion


class Poses(Protocol):
    """Map from attachments to x, y [m] and rotation from the reference configuration [rad]."""

    def __call__(self, attachments: Sequence[Attachment]) -> Array:
        """Return the poses, (frames, attachments, 3)."""


def reference_poses(attachments: Sequence[Attachment]) -> Array:
    """Return the poses (1, attachments, 3) in the reference configuration."""
    poses = [[(*attachment.point, 0.0) for attachment in attachments]]
    return np.array(poses, float).reshape(1, -1, 3)


class CoordinatePoses:
    """Poses of a mechanism at given coordinates, one frame per row.

    Parameters
    ----------
    mechanism
        The mechanism.
    q
        Coordinates (frames, n) of the mechanism.
    """

    def __init__(self, mechanism: Mechanism, q: Array) -> None:
        self._coordinates, self._q = map_coordinates(mechanism), q

    def __call__(self, attachments: Sequence[Attachment]) -> Array:
        """Return the poses, (frames, attachments, 3)."""
        poses = np.repeat(reference_poses(attachments), len(self._q), axis=0)
        bodies: dict[int, list[int]] = {}
        for k, attachment in enumerate(attachments):
            # Attachments without coordinates stay at their reference position.
            if attachment.size:
                bodies.setdefault(id(attachment.body), []).append(k)
        for members in bodies.values():
            q = self._q[:, self._coordinates.slice_of(attachments[members[0]].body)]
            functions = [
                (attachments[k].operator, attachments[k].checked_kinematics) for k in members
            ]
            at_rest = np.zeros_like(q)
            poses[:, members] = evaluate_sections(
                position_and_angle, functions, q, at_rest, at_rest
            )
        return poses


class EnlargedPoses:
    """Poses whose differences from the first frame are multiplied by a factor."""

    def __init__(self, poses: Poses, scale: float) -> None:
        self._poses, self._scale = poses, scale

    def __call__(self, attachments: Sequence[Attachment]) -> Array:
        """Return the poses, (frames, attachments, 3)."""
        return enlarge(self._poses(attachments), self._scale)


def enlarge(values: Array, scale: float) -> Array:
    """Return values whose differences from the first entry are multiplied by `scale`."""
    return values[:1] + scale * (values - values[:1])


class VibrationPoses:
    """Poses of a small vibration about a state, one frame per phase.

    The pose p(q) of an attachment becomes p(q) + Re(phase * dp/dq . shape).

    Parameters
    ----------
    mechanism
        The mechanism.
    q
        Coordinates (n,) of the state.
    shape
        Complex mode shape (n,).
    phases
        Complex phases, one per frame.
    """

    def __init__(self, mechanism: Mechanism, q: Array, shape: Array, phases: Array) -> None:
        self._step = _DIFFERENCE_STEP / max(float(np.max(np.abs(shape))), _SMALLEST_SHAPE)
        ends = [self._step * s for s in (shape.real, -shape.real, shape.imag, -shape.imag)]
        self._displaced = CoordinatePoses(mechanism, np.concatenate([q[None], q + ends]))
        self._phases = phases

    def __call__(self, attachments: Sequence[Attachment]) -> Array:
        """Return the poses, (frames, attachments, 3)."""
        rest, *ends = self._displaced(attachments)
        slope = (ends[0] - ends[1] + 1j * (ends[2] - ends[3])) / (2.0 * self._step)
        return rest + (slope * self._phases[:, None, None]).real
