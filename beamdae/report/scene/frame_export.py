"""Export of scenes as plain data and arrays, for pages and notebook animations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError
from beamdae.report.scene.beam_colors import BeamColors, available_colors
from beamdae.report.scene.run_scene import (
    DEFAULT_FRAMES,
    build_run_scene,
    choose_run_scale,
    frame_times,
)
from beamdae.report.scene.scene import Glyph, MovingCurve, Scene, find_layer
from beamdae.results.solution import Solution

Array = np.ndarray

FRAMES_PER_PERIOD = 32  # of vibrations and periodic motions


def export_run_frames(
    solution: Solution, frames: int = DEFAULT_FRAMES, enlarges: bool = False
) -> dict[str, Any] | None:
    """Return the exported scene of a run, or None if nothing can be drawn; see `export_frames`.

    If `enlarges` is True, displacements that are too small to be visible are enlarged.
    """
    times = frame_times(solution, frames)
    try:
        scene = build_run_scene("animate", solution, times)
        scale = choose_run_scale(solution, times, scene) if enlarges else 1.0
        if scale != 1.0:
            scene = build_run_scene("animate", solution, times, scale=scale)
    except BeamdaeError:
        return None
    return export_frames(scene, times, available_colors(solution, times), scale)


def export_frames(
    scene: Scene, times: Array, colors: Sequence[BeamColors] = (), scale: float = 1.0
) -> dict[str, Any]:
    """Export a scene whose displacements are enlarged by the factor `scale`.

    Returns
    -------
    dict
        - "t": times [s].
        - "glyphs", from back to front: curves with "name", "kind", coordinates "x", "y" [m] of all
          frames, one after another, and the number of "points" per frame. A trail has a single
          list of points. Symbols, see `Symbol`, have "name", "kind", "at" and "to" (indices of
          poses), "along", and "points" with None at interruptions of the line. If the part is
          inactive at times, "absent" lists the frames without the symbol.
        - "poses": "x", "y" [m] and "turn" [rad] over the frames, or one value if it is constant.
        - "colors" of beams: "title", "limits", "scale" (colors at equally spaced values) and
          "values" by beam name, along the beam in all frames, one after another.
        - "extent": lower left and upper right corner of the scene [m].
        - "captions": factors by which displacements and section heights are enlarged.
    """
    glyphs = sorted(scene.glyphs, key=lambda glyph: find_layer(glyph.kind))
    captions = [f"displacements \u00d7 {scale:.4g}"] * (scale != 1.0)
    return {
        "t": times,
        "glyphs": [_export_glyph(glyph, scene) for glyph in glyphs],
        "poses": [
            {name: x[:1] if np.all(x == x[0]) else x for name, x in zip(_POSE, pose.T, strict=True)}
            for pose in scene.poses
        ],
        "colors": [
            {"title": x.title, "limits": x.limits, "scale": x.scale, "values": dict(x.values)}
            for x in colors
        ],
        "extent": [x.tolist() for x in scene.extent()],
        "captions": ", ".join(filter(None, [*captions, scene.caption])),
    }


_POSE = ("x", "y", "turn")


def _export_glyph(glyph: Glyph, scene: Scene) -> dict[str, Any]:
    data: dict[str, Any] = {"name": glyph.part, "kind": glyph.kind}
    if isinstance(glyph, MovingCurve):
        positions = glyph.positions[-1:] if glyph.kind == "trail" else glyph.positions
        return data | {"x": positions[..., 0], "y": positions[..., 1], "points": positions.shape[1]}
    if glyph.part in scene.absent:
        data["absent"] = np.flatnonzero(scene.absent[glyph.part]).tolist()
    points = [x.tolist() if np.isfinite(x).all() else None for x in glyph.points]
    return data | {"at": glyph.start, "to": glyph.end, "along": glyph.along, "points": points}
