"""Animations of runs, played in notebooks or written to files."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError, require_count, require_positive
from beamdae.report.page.page_file import fill_template
from beamdae.report.pictures.figures import require_picture_path
from beamdae.report.pictures.scene_artists import (
    SceneArtists,
    add_caption,
    create_bare_axis,
    create_colormap,
    create_norm,
    padded_extent,
)
from beamdae.report.scene.run_scene import (
    available_colors,
    build_run_scene,
    export_frames,
    frame_times,
)
from beamdae.report.scene.scene import Scene
from beamdae.results.displays import ANIMATION_WIDTH, Animation
from beamdae.results.solution import Solution
from beamdae.results.storage.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray

_DEFAULT_RATE = 25  # frames per second
_MAX_RATE = 50  # frames per second; browsers do not show GIF files faster
_MIN_RATE = 0.1  # frames per second
_MIN_FRAMES = 2
MAX_FRAMES = 500
_COLOR_BAR_STRIP = 0.62  # height of the strip for the color bar below the picture [inch]
_RESOLUTION = 100  # [dots per inch]
_STYLES = ("page", "charts", "mechanism")
_SCRIPTS = ("data", "markers", "mechanism", "notebook_player")
# Size of the picture [units of the SVG view box]; must agree with script/mechanism.js.
_DRAWING_WIDTH = 420.0
_MIN_DRAWING_HEIGHT = 180.0
_MAX_DRAWING_HEIGHT = 400.0
_SCALE_BAR_HEIGHT = 16.0
_CONTROLS_HEIGHT = 150  # below the picture [pixels]
_MIN_EXTENT = 1e-300  # avoids division by zero [m]


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
    if scale is not None:
        scale = require_positive("animate", "scale", scale)
    scene = build_run_scene("animate", solution, times, trail, scale)
    if path is None:
        data = export_frames(scene, times, available_colors(solution, times, color))
        return build_motion_player(scene, data, "", speed, color is not None)
    colors = None if color is None else available_colors(solution, times, color)[0]
    figure, axis = create_bare_axis(
        padded_extent([scene]), 0.0 if colors is None else _COLOR_BAR_STRIP
    )
    artists, caption = SceneArtists(axis, scene, colors), add_caption(axis)
    if colors is not None:
        from matplotlib.cm import ScalarMappable

        height = float(figure.get_size_inches()[1])
        bar_axis = figure.add_axes((0.2, 0.36 / height, 0.6, 0.1 / height))
        mappable = ScalarMappable(create_norm(colors), create_colormap(colors))
        bar = figure.colorbar(mappable, cax=bar_axis, orientation="horizontal")
        bar.outline.set_visible(False)
        bar_axis.tick_params(labelsize=8, color="0.4", labelcolor="0.3", length=2)
        bar_axis.locator_params(nbins=6)
        bar_axis.set_title(colors.title, fontsize=8, color="0.3", pad=3)
    # Enough digits to distinguish the times of the frames.
    step = float(times[-1] - times[0]) / (len(times) - 1)
    digits = min(max(math.ceil(-math.log10(step)), 0), 9) if step > 0.0 else 3
    pace = "" if speed == 1.0 else f"{speed:.3g} of real time"
    suffix = "".join(f"   {x}" for x in (pace, scene.caption) if x)

    def show(frame: int) -> list[Any]:
        caption.set_text(f"t = {times[frame]:.{digits}f} s{suffix}")
        return [*artists.show(frame), caption]

    return save_animation("animate", path, figure, show, len(times), rate)


def save_animation(
    name: str, path: str | Path, figure: Figure, show: Callable[[int], Any], frames: int, rate: Any
) -> Path:
    """Write an animation to a file and return the path.

    Parameters
    ----------
    name
        Name of the calling function, used in error messages.
    path
        Path of the file, with the suffix .gif or .mp4.
    figure
        The figure with all its artists.
    show
        Function that updates the figure to a frame, given by its index.
    frames
        Number of frames.
    rate
        Frames per second.

    Raises
    ------
    BeamdaeError
        If the suffix is not .gif or .mp4, ffmpeg is missing for MP4, or the file cannot be written.
    """
    from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter

    kind = require_picture_path(name, path).suffix.lower()
    if kind not in (".gif", ".mp4"):
        raise BeamdaeError(f"{name}: path {path} must end in .gif or .mp4.")
    if kind == ".mp4" and not FFMpegWriter.isAvailable():
        raise BeamdaeError(
            f"{name}: MP4 files need the program ffmpeg, which was not found; install "
            "ffmpeg or write a GIF file."
        )
    writer = PillowWriter(rate) if kind == ".gif" else FFMpegWriter(rate)
    with atomic_write(Path(path)) as scratch:
        animation = FuncAnimation(figure, show, frames=frames, blit=False)
        # The writers select the format by the suffix.
        with_suffix = scratch.with_name(f"{scratch.name}{kind}")
        try:
            animation.save(str(with_suffix), writer=writer, dpi=_RESOLUTION)
            with_suffix.replace(scratch)
        finally:
            with_suffix.unlink(missing_ok=True)
    return Path(path)


def build_motion_player(
    scene: Scene, frames: Mapping[str, Any], caption: str, speed: float, colored: bool
) -> Animation:
    """Return an animation that plays exported frames in a notebook.

    Parameters
    ----------
    scene, frames
        The scene, and its frames from `beamdae.report.scene.run_scene.export_frames`.
    caption
        Text above the animation.
    speed
        Playback speed relative to real time.
    colored
        If true, beams are initially colored by the first color quantity.
    """
    data = {"frames": frames, "caption": caption, "speed": speed, "colored": colored}
    document = fill_template("notebook_player", _STYLES, _SCRIPTS, data)
    low, high = scene.extent()
    width, height = (high - low).tolist()
    height = _DRAWING_WIDTH * height / max(width, _MIN_EXTENT)
    height = min(max(height, _MIN_DRAWING_HEIGHT), _MAX_DRAWING_HEIGHT) + _SCALE_BAR_HEIGHT
    return Animation(document, round(height * ANIMATION_WIDTH / _DRAWING_WIDTH) + _CONTROLS_HEIGHT)
