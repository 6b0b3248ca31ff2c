"""Which parts of a mechanism are drawn through which points, and when those of a run are."""

from __future__ import annotations

import numpy as np

from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Drawing, Part
from beamdae.results.solution import Solution

Array = np.ndarray


def frame_times(solution: Solution, frames: int = 120) -> Array:
    """Equally spaced times of a run, as far as it got [s]."""
    start = solution.trajectory.intervals[0].t[0]
    return np.linspace(start, solution.trajectory.end, frames)


def outlines(mechanism: Mechanism, points: int) -> list[tuple[str, Drawing]]:
    """Parts that are drawn, the ground first, by name; a beam through so many sections."""
    parts = list(mechanism.parts.values())
    drawn = [(p.name, p.draw(_attached(parts, p), points)) for p in (mechanism.ground, *parts)]
    return [(name, drawing) for name, drawing in drawn if drawing is not None and drawing.places]


def _attached(parts: list[Part], body: Part) -> list[Attachment]:
    """Points of the body that parts refer to, each once."""
    found = [a for part in parts for a in part.attachments if a.body is body]
    return list({attachment.point: attachment for attachment in found}.values())
