"""Animations of runs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import require_count, require_positive
from beamdae.report.page.motion_player import build_motion_player
from beamdae.report.pictures.animation_files import save_animation
from beamdae.report.pictures.scene_artists import (
    SceneArtists,
    add_caption,
    create_bare_axis,
    create_colormap,
    create_norm,
    padded_extent,
)
from beamdae.report.scene.beam_colors import BeamColors, available_colors
from beamdae.report.scene.frame_export import export_frames
from beamdae.report.scene.run_scene import build_run_scene, choose_run_scale, frame_times
from beamdae.report.scene.scene import Scene
from beamdae.results.displays import Animation
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray

_DEFAULT_RATE = 25  # frames per second
_MAX_RATE = 50  # frames per second; browsers do not show GIF files faster
_MIN_RATE = 0.1  # frames per second
_MIN_FRAMES = 2
MAX_FRAMES = 500
_COLOR_BAR_STRIP = 0.62  # height of the strip for the color bar below the picture [inch]


def animate(
    solution: Solution,
    path: str | Path | None = None,
    speed: float = 1.0,
    frames: int | None = None,
    color: str | None = None,
    trail: Any = False,
    scale: float | None = None,
) -> Animation | Path:
    """Return the animation of a run, or write it; see `Solution.animate`."""
    t = frame_times(solution, 2)
    speed = require_positive("animate", "speed", speed)
    duration = float(t[-1] - t[0]) / speed
    number = round(np.clip(_DEFAULT_RATE * duration, _MIN_FRAMES, MAX_FRAMES))
    if frames is not None:
        number = require_count("animate", "frames", frames, _MIN_FRAMES, MAX_FRAMES)
    rate = 1.0
    if duration > 0.0:
        rate = float(np.clip((number - 1) / duration, _MIN_RATE, _MAX_RATE))
    times = frame_times(solution, number)
    factor = 1.0 if scale is None else require_positive("animate", "scale", scale)
    scene = build_run_scene("animate", solution, times, trail, factor)
    if scale is None and (factor := choose_run_scale(solution, times, scene)) != 1.0:
        scene = build_run_scene("animate", solution, times, trail, factor)
    if path is None:
        data = export_frames(scene, times, available_colors(solution, times, color), factor)
        low, high = scene.extent()
        width, height = (high - low).tolist()
        return build_motion_player(data, (width, height), "", speed, color is not None)
    colors = None if color is None else available_colors(solution, times, color)[0]
    captions = _format_captions(times, speed, factor, scene.caption)
    return _save(path, scene, colors, captions, rate)


def _format_captions(times: Array, speed: float, scale: float, heights: str) -> list[str]:
    """Return captions with the times of the frames, with enough digits to distinguish them."""
    step = float(times[-1] - times[0]) / (len(times) - 1)
    digits = min(max(math.ceil(-math.log10(step)), 0), 9) if step > 0.0 else 3
    suffix = "" if speed == 1.0 else f"   {speed:.3g} of real time"
    suffix += "" if scale == 1.0 else f"   displacements \u00d7 {scale:.4g}"
    suffix += f"   {heights}" if heights else ""
    return [f"t = {time:.{digits}f} s{suffix}" for time in times]


def _save(
    path: str | Path, scene: Scene, colors: BeamColors | None, captions: list[str], rate: float
) -> Path:
    strip = 0.0 if colors is None else _COLOR_BAR_STRIP
    figure, axis = create_bare_axis(padded_extent([scene]), strip)
    artists, caption = SceneArtists(axis, scene, colors), add_caption(axis)
    if colors is not None:
        _add_color_bar(figure, colors)

    def show(frame: int) -> list[Any]:
        caption.set_text(captions[frame])
        return [*artists.show(frame), caption]

    return save_animation("animate", path, figure, show, len(captions), rate)


def _add_color_bar(figure: Figure, colors: BeamColors) -> None:
    from matplotlib.cm import ScalarMappable

    height = float(figure.get_size_inches()[1])
    axis = figure.add_axes((0.2, 0.36 / height, 0.6, 0.1 / height))
    scale = ScalarMappable(create_norm(colors), create_colormap(colors))
    bar = figure.colorbar(scale, cax=axis, orientation="horizontal")
    bar.outline.set_visible(False)
    axis.tick_params(labelsize=8, color="0.4", labelcolor="0.3", length=2)
    axis.locator_params(nbins=6)
    axis.set_title(colors.title, fontsize=8, color="0.3", pad=3)
