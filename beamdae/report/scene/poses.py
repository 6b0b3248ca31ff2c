"""Where points of bodies are: in the reference drawing, at rows of coordinates, in a mode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.results.section_forces.section_motions import SectionFunction, evaluate_sections, position_and_angle

Array = np.ndarray

# Step of the derivative of places by coordinates, in their natural sizes.
_STEP = 1e-5


class Poses(Protocol):
    """Places -> (frames, places, 3): x, y [m] and turn since the drawing [rad]."""

    def __call__(self, places: Sequence[Attachment]) -> Array:
        """Where they are."""


def reference_poses(places: Sequence[Attachment]) -> Array:
    """One frame: the reference drawing."""
    return np.array([[(*place.point, 0.0) for place in places]], float).reshape(1, -1, 3)


class CoordinatePoses:
    """A frame for each row of coordinates of a mechanism."""

    def __init__(self, mechanism: Mechanism, q: Array) -> None:
        self._owners, self._q = map_coordinates(mechanism), q

    def __call__(self, places: Sequence[Attachment]) -> Array:
        """Where they are."""
        found = np.repeat(reference_poses(places), len(self._q), axis=0)
        bodies: dict[int, list[int]] = {}
        for k, place in enumerate(places):
            # What has no coordinates stays where it is drawn.
            if place.size:
                bodies.setdefault(id(place.body), []).append(k)
        for members in bodies.values():
            q = self._q[:, self._owners.slice(places[members[0]].body)]
            at = [SectionFunction(places[k].operator, places[k].moved) for k in members]
            still = np.zeros_like(q)
            found[:, members] = evaluate_sections(position_and_angle, at, q, still, still)
        return found


class VibrationPoses:
    """Frames of small motions about a state: its poses and Re(phase d/dq poses . shape) more."""

    def __init__(self, mechanism: Mechanism, q: Array, shape: Array, phases: Array) -> None:
        self._step = _STEP / max(float(np.max(np.abs(shape))), 1e-300)
        ends = [self._step * s for s in (shape.real, -shape.real, shape.imag, -shape.imag)]
        self._moved, self._phases = (
            CoordinatePoses(mechanism, np.concatenate([q[None], q + ends])),
            phases,
        )

    def __call__(self, places: Sequence[Attachment]) -> Array:
        """Where they are."""
        rest, *found = self._moved(places)
        way = (found[0] - found[1] + 1j * (found[2] - found[3])) / (2.0 * self._step)
        return rest + (way * self._phases[:, None, None]).real
