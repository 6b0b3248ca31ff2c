"""The motion of a mechanism: moving pictures, and where it was at some times as one drawing."""

from __future__ import annotations

import html
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError, require_count, require_positive, short_repr
from beamdae.report.page.motion_player import animation
from beamdae.report.pictures.animation_files import FigureAnimation
from beamdae.report.scene.artists import SceneArtists, add_caption, create_bare_axis, padded_extent
from beamdae.report.scene.beam_colors import BeamColors, compute_beam_colors
from beamdae.report.scene.frame_export import available_colors, export_frames
from beamdae.report.scene.line_styles import find_style
from beamdae.report.scene.outlines import frame_times
from beamdae.report.scene.run_scene import build_run_scene
from beamdae.report.scene.scene import Scene
from beamdae.results.displays import Animation
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray

# No browser shows GIFs faster.
_FRAMES_PER_SECOND, _FASTEST = 25, 50
_FEWEST, _MOST = 2, 500
# The strip of the color bar below the picture [inch].
_BAR = 0.62
_THUMBNAIL, _TIMES = 160.0, 6


def animate(
    solution: Solution,
    path: str | Path | None = None,
    speed: float = 1.0,
    frames: int | None = None,
    color: str | None = None,
    trail: Any = False,
) -> Animation | Path:
    """Moving pictures of a run: for a notebook, or as a file.

    Bodies are drawn with joints, guides, springs, dampers, contacts and loads as `draw` has them;
    an arrow is as long as its load is of the largest one it is in the run.

    Parameters
    ----------
    path
        Of a GIF or MP4 file, by its suffix; MP4 needs the program ffmpeg. None: for a notebook.
    speed
        Seconds of the motion in one second.
    frames
        How many pictures; default 25 a second.
    color
        What beams bear as color: "strain" or "stress", the largest in size over each section, or
        the section forces "N", "Q" or "M". The scale is that of the whole run.
    trail
        Whether observed points leave a line behind them; or the names of those that do.

    Raises
    ------
    BeamdaeError
        If the run is not one of a mechanism, it has no such color or point, or the file is of
        another kind or cannot be written.
    """
    if not isinstance(solution, Solution):
        raise BeamdaeError(f"animate: solution must be that of a run, got {short_repr(solution)}.")
    t = frame_times(solution, 2)
    speed = require_positive("animate", "speed", speed)
    lasts = float(t[-1] - t[0]) / speed
    number = round(np.clip(_FRAMES_PER_SECOND * lasts, _FEWEST, _MOST))
    if frames is not None:
        number = require_count("animate", "frames", frames, _FEWEST, _MOST)
    rate = float(np.clip((number - 1) / lasts, 0.1, _FASTEST)) if lasts > 0.0 else 1.0
    times = frame_times(solution, number)
    scene = build_run_scene("animate", solution, times, trail)
    if path is None:
        frames_shown = export_frames(scene, times, available_colors(solution, times, color))
        low, high = scene.extent()
        width, height = (high - low).tolist()
        return animation(frames_shown, (width, height), "", speed, color is not None)
    colors = None if color is None else compute_beam_colors("animate", solution, color, times)
    return _film(scene, colors, _captions(times, speed), rate).written("animate", path)


def _captions(times: Array, speed: float) -> list[str]:
    """Times in as many digits as tell frames apart."""
    step = float(times[-1] - times[0]) / (len(times) - 1)
    digits = min(max(math.ceil(-math.log10(step)), 0), 9) if step > 0.0 else 3
    slowed = "" if speed == 1.0 else f"   {speed:.3g} of real time"
    return [f"t = {time:.{digits}f} s{slowed}" for time in times]


def _film(
    scene: Scene, colors: BeamColors | None, captions: list[str], rate: float
) -> FigureAnimation:
    figure, axis = create_bare_axis(padded_extent([scene]), 0.0 if colors is None else _BAR)
    stage, told = SceneArtists(axis, scene, colors), add_caption(axis)
    if colors is not None:
        _color_bar(figure, colors)

    def show(frame: int) -> list[Any]:
        told.set_text(captions[frame])
        return [*stage.show(frame), told]

    return FigureAnimation(figure, show, len(captions), rate)


def _color_bar(figure: Figure, colors: BeamColors) -> None:
    from matplotlib.cm import ScalarMappable

    tall = float(figure.get_size_inches()[1])
    axis = figure.add_axes((0.2, 0.36 / tall, 0.6, 0.1 / tall))
    scale = ScalarMappable(colors.norm, colors.colormap)
    bar = figure.colorbar(scale, cax=axis, orientation="horizontal")
    bar.outline.set_visible(False)
    axis.tick_params(labelsize=8, color="0.4", labelcolor="0.3", length=2)
    axis.locator_params(nbins=6)
    axis.set_title(colors.title, fontsize=8, color="0.3", pad=3)


def draw_thumbnail(solution: Solution) -> str:
    """Where the mechanism was at some times of a run, the last in full color, as SVG."""
    times = frame_times(solution, _TIMES)
    scene = build_run_scene("animate", solution, times, left_out=lambda part: True)
    low, high = padded_extent([scene])
    width, height = high - low
    scale = _THUMBNAIL / max(width, height)
    drawn = []
    for k in range(_TIMES):
        shade = 1.0 if k == _TIMES - 1 else 0.15 + 0.35 * k / _TIMES
        for glyph, line in scene.lines():
            x, y = scale * (line[k, :, 0] - low[0]), scale * (high[1] - line[k, :, 1])
            color = find_style(glyph.kind).color
            if glyph.kind == "point":
                drawn.append(
                    f'<circle cx="{np.mean(x[:-1]):.1f}" cy="{np.mean(y[:-1]):.1f}" r="3" '
                    f'fill="{color}" opacity="{shade:.2f}"/>'
                )
                continue
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
            drawn.append(
                f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2" '
                f'stroke-linecap="round" opacity="{shade:.2f}"/>'
            )
    told = html.escape(", ".join(glyph.part for glyph in scene.glyphs))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{scale * width:.0f}" '
        f'height="{scale * height:.0f}" role="img" aria-label="{told}">{"".join(drawn)}</svg>'
    )
