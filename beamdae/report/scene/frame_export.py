"""The scene of a run as plain data, for the page of a study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError
from beamdae.report.scene.beam_colors import BeamColors, compute_beam_colors
from beamdae.report.scene.outlines import frame_times
from beamdae.report.scene.run_scene import build_run_scene
from beamdae.report.scene.scene import MovingCurve, Scene, Symbol
from beamdae.results.solution import Solution

Array = np.ndarray

# What the page offers as color, as far as sections know what it takes.
_COLORS = ("stress", "M")
_FRAMES, _DIGITS = 120, 5


def export_run_frames(solution: Solution) -> dict[str, Any] | None:
    """What is seen of a run over its frames, see `export_frames`; None if nothing is."""
    times = frame_times(solution, _FRAMES)
    try:
        scene = build_run_scene("animate", solution, times)
    except BeamdaeError:
        # Equations have no shape.
        return None
    return export_frames(scene, times, available_colors(solution, times))


def export_frames(scene: Scene, times: Array, colors: Sequence[BeamColors] = ()) -> dict[str, Any]:
    """A scene as plain data.

    Returns
    -------
    dict
        Times "t"; "bodies", curves of points that move each on its own: "name", "kind" and "x",
        "y" [m], a list of points for each frame, of trails one list and the number of "frames";
        "poses": "x", "y" [m] and "turn" [rad] over the frames, one value where it stays;
        "symbols" on them, see `Symbol`: "name", "kind", "at", "to", "along" and "points", None
        where a line breaks, and the frames in which it is "absent"; "colors" of beams: "title",
        "limits", "scale" (evenly spaced colors) and by beam "values", a list along it for each
        frame; "extent", the lower left and the upper right corner of all that is seen [m]. What is
        not seen in a frame is None there.
    """
    low, high = scene.extent()
    digits = _DIGITS - math.floor(math.log10(float(np.max(high - low)) or 1.0))
    return {
        "t": times.tolist(),
        "bodies": [_curve(x, digits) for x in scene.glyphs if isinstance(x, MovingCurve)],
        "poses": [_pose(pose, digits) for pose in scene.poses],
        "symbols": [_symbol(x, digits, scene) for x in scene.glyphs if isinstance(x, Symbol)],
        "colors": [_color(x) for x in colors],
        "extent": [low.tolist(), high.tolist()],
    }


def available_colors(solution: Solution, times: Array, first: Any = None) -> list[BeamColors]:
    """The colors a run may have, as far as sections know what they take; `first` is wanted."""
    found = [] if first is None else [compute_beam_colors("animate", solution, first, times)]
    for what in (x for x in _COLORS if x != first):
        try:
            found.append(compute_beam_colors("animate", solution, what, times))
        except BeamdaeError:
            # No beams, or one that does not know its height.
            continue
    return found


def _curve(curve: MovingCurve, digits: int) -> dict[str, Any]:
    trail = curve.kind == "trail"
    places = curve.places[-1:] if trail else curve.places
    x, y = np.moveaxis(np.round(places, digits), -1, 0)
    found = {"name": curve.part, "kind": curve.kind, "x": _listed(x), "y": _listed(y)}
    return found | ({"frames": len(curve.places)} if trail else {})


def _pose(pose: Array, digits: int) -> dict[str, Any]:
    axes = {"x": digits, "y": digits, "turn": _DIGITS}
    return {
        name: _once(np.round(values, kept))
        for (name, kept), values in zip(axes.items(), pose.T, strict=True)
    }


def _once(values: Array) -> list[Any]:
    return _listed(values[:1] if np.all(values == values[0]) else values)


def _listed(values: Array) -> list[Any]:
    """The values, None where nothing is seen."""
    found = values.astype(object)
    found[~np.isfinite(values)] = None
    return found.tolist()


def _symbol(symbol: Symbol, digits: int, scene: Scene) -> dict[str, Any]:
    share, arm = np.round(symbol.points[:, :1], _DIGITS), np.round(symbol.points[:, 1:], digits)
    points = np.hstack([share, arm])
    absent = scene.absent.get(symbol.part)
    gone = {} if absent is None else {"absent": np.flatnonzero(absent).tolist()}
    return gone | {
        "name": symbol.part,
        "kind": symbol.kind,
        "at": symbol.at,
        "to": symbol.to,
        "along": symbol.along,
        "points": [x.tolist() if np.isfinite(x).all() else None for x in points],
    }


def _color(colors: BeamColors) -> dict[str, Any]:
    digits = 3 - math.floor(math.log10(max(map(abs, colors.limits))))
    values = {part: np.round(x, digits).tolist() for part, x in colors.values.items()}
    return {
        "title": colors.title,
        "limits": list(colors.limits),
        "scale": list(colors.colors),
        "values": values,
    }
