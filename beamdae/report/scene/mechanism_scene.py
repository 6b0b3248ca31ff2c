"""Bodies as they are seen: beams along their axes, rigid bodies by their outlines."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.errors import BeamdaeError
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Drawing, Part
from beamdae.report.scene import elastic_symbols as elastic  # noqa: F401 (they register symbols)
from beamdae.report.scene import load_arrows as loads  # noqa: F401 (they register symbols)
from beamdae.report.scene.joint_symbols import symbol
from beamdae.report.scene.outlines import outlines
from beamdae.report.scene.poses import Poses
from beamdae.report.scene.scene import Scene, bounding_box
from beamdae.report.scene.scene_builder import Measure, SceneBuilder, circle

Array = np.ndarray

# Points a beam is drawn through: enough for a curve where it is as large as the picture.
SECTIONS = 49
# Of all beams of a mechanism together; each has some.
_MOST_SECTIONS, _LEAST_SECTIONS = 600, 9
# Of the extent of what is drawn.
_SYMBOL = 0.022
# Of the size of a symbol: a particle, which is seen around the pin of a joint.
_MASS = 0.42


def build_scene(
    mechanism: Mechanism,
    poses: Poses,
    times: Array,
    measure: Measure | None = None,
    left_out: Callable[[Part], bool] = lambda part: False,
    name: str = "draw",
) -> Scene:
    """What is seen of a mechanism in the frames that poses are of, see `SceneBuilder`.

    Parts that are no bodies are drawn unless `left_out`; `name` asks for it.

    Raises
    ------
    BeamdaeError
        If nothing of it can be drawn.
    """
    sketch = SceneBuilder(poses, times, measure)
    shown = [
        x for x in outlines(mechanism, count_beam_sections(mechanism)) if x[1].kind != "ground"
    ]
    lines = [sketch.through(drawing.places) for _, drawing in shown]
    others = [a for part in mechanism.parts.values() for a in part.attachments]
    points = [x.reshape(-1, 2) for x in lines]
    points += [sketch.pose(sketch.at(a))[:, :2] for a in others]
    if not points:
        raise BeamdaeError(f"{name}: the mechanism has no parts that could be drawn.")
    low, high = bounding_box(np.concatenate(points))
    sketch.size = _SYMBOL * (float(np.max(high - low)) or 1.0)
    for (body, drawing), line in zip(shown, lines, strict=True):
        sketch.part = body
        _body(drawing, line, sketch)
    bodies = {body for body, _ in shown}
    for part in mechanism.parts.values():
        if part.name not in bodies and not left_out(part):
            sketch.part = part.name
            symbol(part, sketch)
    return sketch.scene()


def count_beam_sections(mechanism: Mechanism) -> int:
    """How many sections beams are drawn through."""
    beams = sum(isinstance(part, Beam) for part in mechanism.parts.values())
    return int(np.clip(_MOST_SECTIONS // max(beams, 1), _LEAST_SECTIONS, SECTIONS))


def _body(drawing: Drawing, line: Array, sketch: SceneBuilder) -> None:
    if drawing.kind == "rigid" and len({id(place.body) for place in drawing.places}) == 1:
        _rigid(drawing.places, sketch)
    elif drawing.kind == "point":
        row = sketch.at(drawing.places[0])
        sketch.carried("point", row, circle(_MASS * sketch.size))
        sketch.name(row)
    else:
        sketch.curve(drawing.kind, line)
        sketch.name(sketch.at(drawing.places[len(drawing.places) // 2]))


def _rigid(places: Sequence[Attachment], sketch: SceneBuilder) -> None:
    """All points move with the first of them; outlines are closed."""
    row, points = sketch.at(places[0]), np.array([place.point for place in places])
    points = points - points[0]
    closed = points[[*range(len(points)), *([0] if len(points) > 2 else [])]]
    kind = "rigid" if len(points) > 1 else "joint"
    sketch.carried(kind, row, closed if len(points) > 1 else circle(0.28 * sketch.size))
    sketch.name(_middle(row, points.mean(axis=0), sketch))


def _middle(row: int, arm: Any, sketch: SceneBuilder) -> int:
    pose = sketch.pose(row).copy()
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    pose[:, 0] += c * arm[0] - s * arm[1]
    pose[:, 1] += s * arm[0] + c * arm[1]
    return sketch.follow(pose)
