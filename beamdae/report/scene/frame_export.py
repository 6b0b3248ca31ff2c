"""Export of scenes as plain data, for pages and notebook animations."""

from __future__ import annotations

import math
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
from beamdae.report.scene.scene import MovingCurve, Scene, Symbol
from beamdae.results.solution import Solution

Array = np.ndarray

FRAMES_PER_PERIOD = 32  # of vibrations and periodic motions
_POSITION_DIGITS = 5  # of positions, relative to the extent of the scene
_FRACTION_DIGITS = 5  # of angles and fractions
_HEIGHT_DIGITS = 4  # of section heights
_COLOR_DIGITS = 3  # of color values, relative to the limit of their scale


def export_run_frames(
    solution: Solution, frames: int = DEFAULT_FRAMES, enlarges: bool = False
) -> dict[str, Any] | None:
    """Return the exported scene of a run, or None if nothing can be drawn; see `export_frames`.

    If `enlarges` is True, displacements that are too small to be visible are enlarged by the factor
    "scale".
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
    """Export a scene as lists and numbers, with None for invisible points.

    Returns
    -------
    dict
        - "t": times [s].
        - "bodies": curves with "name", "kind" and coordinates "x", "y" [m] as one list of points
          per frame. A trail has a single list and the number of "frames". Beams that are drawn
          with their "heights" have one height per point [m].
        - "poses": "x", "y" [m] and "turn" [rad] over the frames, or one value if it is constant.
        - "symbols", see `Symbol`: "name", "kind", "at" and "to" (indices of poses), "along", and
          "points" with None at interruptions of the line. If the part is inactive at times,
          "absent" lists the frames without the symbol.
        - "colors" of beams: "title", "limits", "scale" (colors at equally spaced values) and
          "values" by beam name, as one list along the beam per frame.
        - "extent": lower left and upper right corner of the scene [m].
        - "scale": factor by which displacements are enlarged, if it is not 1.
        - "heights": factor that makes the heights of beams visible, if they are drawn.
    """
    low, high = scene.extent()
    digits = _POSITION_DIGITS - math.floor(math.log10(float(np.max(high - low)) or 1.0))
    curves = [x for x in scene.glyphs if isinstance(x, MovingCurve)]
    symbols = [x for x in scene.glyphs if isinstance(x, Symbol)]
    return {
        "t": times.tolist(),
        "bodies": [_export_curve(curve, digits) for curve in curves],
        "poses": [_export_pose(pose, digits) for pose in scene.poses],
        "symbols": [_export_symbol(symbol, digits, scene) for symbol in symbols],
        "colors": [_export_colors(x) for x in colors],
        "extent": [low.tolist(), high.tolist()],
        **({"scale": scale} if scale != 1.0 else {}),
        **({"heights": scene.height_scale} if scene.has_heights else {}),
    }


def _export_curve(curve: MovingCurve, digits: int) -> dict[str, Any]:
    is_trail = curve.kind == "trail"
    positions = curve.positions[-1:] if is_trail else curve.positions
    x, y = np.moveaxis(np.round(positions, digits), -1, 0)
    data = {"name": curve.part, "kind": curve.kind, "x": _to_list(x), "y": _to_list(y)}
    if curve.heights is not None:
        data["heights"] = [float(f"{x:.{_HEIGHT_DIGITS}g}") for x in curve.heights]
    return data | ({"frames": len(curve.positions)} if is_trail else {})


def _export_pose(pose: Array, digits: int) -> dict[str, Any]:
    x, y, angle = pose.T
    return {
        "x": _to_short_list(np.round(x, digits)),
        "y": _to_short_list(np.round(y, digits)),
        "turn": _to_short_list(np.round(angle, _FRACTION_DIGITS)),
    }


def _to_short_list(values: Array) -> list[Any]:
    """Return the values as a list, or a list of the first value if all are equal."""
    return _to_list(values[:1] if np.all(values == values[0]) else values)


def _to_list(values: Array) -> list[Any]:
    """Return the values as a list, with None in place of non-finite numbers."""
    objects = values.astype(object)
    objects[~np.isfinite(values)] = None
    return objects.tolist()


def _export_symbol(symbol: Symbol, digits: int, scene: Scene) -> dict[str, Any]:
    share = np.round(symbol.points[:, :1], _FRACTION_DIGITS)
    points = np.hstack([share, np.round(symbol.points[:, 1:], digits)])
    absent = scene.absent.get(symbol.part)
    data = {} if absent is None else {"absent": np.flatnonzero(absent).tolist()}
    return data | {
        "name": symbol.part,
        "kind": symbol.kind,
        "at": symbol.start,
        "to": symbol.end,
        "along": symbol.along,
        "points": [x.tolist() if np.isfinite(x).all() else None for x in points],
    }


def _export_colors(colors: BeamColors) -> dict[str, Any]:
    digits = _COLOR_DIGITS - math.floor(math.log10(max(map(abs, colors.limits))))
    values = {part: np.round(x, digits).tolist() for part, x in colors.values.items()}
    return {
        "title": colors.title,
        "limits": list(colors.limits),
        "scale": list(colors.scale),
        "values": values,
    }
