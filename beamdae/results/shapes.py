"""Shapes of a mechanism over time, for an animation."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from beamdae.equations.owners import positions
from beamdae.errors import BeamdaeError, count
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Drawing, Part
from beamdae.results.solution import Solution

Array = np.ndarray


def frame_times(solution: Solution, frames: int = 120) -> Array:
    """Equally spaced times of a run, as far as it got: those of the frames of `shapes` [s]."""
    start = solution.trajectory.intervals[0].t[0]
    return np.linspace(start, solution.trajectory.end, count("shapes", "frames", frames))


def shapes(
    mechanism: Mechanism, solution: Solution, frames: int = 120, points: int = 13
) -> list[dict[str, Any]]:
    """Where the parts of a mechanism are in each frame.

    Parameters
    ----------
    mechanism
        The simulated one.
    solution
        A run of it.
    frames
        Number of times, see `frame_times`.
    points
        Number of sections a beam is drawn through.

    Returns
    -------
    list of dict
        One a part that is drawn (`Part.draw`), the ground first: "name", "kind" ("ground", "beam",
        "rigid", "point") and "x", "y" [m], a list of points for each frame.

    Raises
    ------
    BeamdaeError
        If the solution is that of another mechanism.
    """
    parts = list(mechanism.parts.values())
    names = tuple(f"{part.name}.{c.name}" for part in parts for c in part.coordinates)
    if solution.equations.q_names != names:
        raise BeamdaeError("shapes: the solution is not one of this mechanism.")
    shown = outlines(mechanism, count("shapes", "points", points))
    function = positions(mechanism, [place for _, drawing in shown for place in drawing.places])
    _, state = solution.trajectory.at(frame_times(solution, frames))
    found = function(state.q)
    x, y = found[:, ::2], found[:, 1::2]
    ends = np.cumsum([0, *(len(drawing.places) for _, drawing in shown)]).tolist()
    return [
        {
            "name": name,
            "kind": drawing.kind,
            "x": x[:, first:last].tolist(),
            "y": y[:, first:last].tolist(),
        }
        for (name, drawing), (first, last) in zip(shown, pairwise(ends), strict=True)
    ]


def outlines(mechanism: Mechanism, points: int) -> list[tuple[str, Drawing]]:
    """Parts that are drawn, the ground first, by name; a beam through so many sections."""
    parts = list(mechanism.parts.values())
    drawn = [(p.name, p.draw(_attached(parts, p), points)) for p in (mechanism.ground, *parts)]
    return [(name, drawing) for name, drawing in drawn if drawing is not None and drawing.places]


def drawn_through(kind: str, count: int) -> list[int]:
    """Which of the points of a part its line goes through: outlines of rigid bodies are closed."""
    return [*range(count), *([0] if kind == "rigid" and count > 2 else [])]


def _attached(parts: list[Part], body: Part) -> list[Attachment]:
    """Points of the body that parts refer to, each once."""
    found = [a for part in parts for a in part.attachments if a.body is body]
    return list({attachment.point: attachment for attachment in found}.values())
