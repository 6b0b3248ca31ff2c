"""The motion of a mechanism: moving pictures, and where it was at some times as one drawing."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError, count, positive, shown
from beamdae.report.curves import picture_path
from beamdae.report.pictures import COLORS
from beamdae.results.files import replacing
from beamdae.results.shapes import drawn_through, frame_times, shapes
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    from matplotlib.animation import AbstractMovieWriter, FuncAnimation

Array = np.ndarray
Body = dict[str, Any]

_FRAMES_PER_SECOND, _FASTEST = 25, 100
_FEWEST, _MOST = 2, 500
# Of the size of what is drawn, left free around it.
_MARGIN = 0.05
_THUMBNAIL = 160.0
_TIMES = 6
_WIDTHS = {"beam": 2.0, "rigid": 2.5, "ground": 1.0}


@dataclass(frozen=True)
class Animation:
    """Moving pictures a notebook shows."""

    page: str

    def _repr_html_(self) -> str:
        return self.page


def animate(
    solution: Solution,
    path: str | Path | None = None,
    speed: float = 1.0,
    frames: int | None = None,
) -> Animation | Path:
    """Moving pictures of a run: for a notebook, or as a file.

    Parameters
    ----------
    path
        Of a GIF or MP4 file, by its suffix; MP4 needs the program ffmpeg. None: for a notebook.
    speed
        Seconds of the motion in one second.
    frames
        How many pictures; default 25 a second.

    Raises
    ------
    BeamdaeError
        If the run is not one of a mechanism, the file is of another kind or cannot be written.
    """
    if not isinstance(solution, Solution):
        raise BeamdaeError(f"animate: solution must be that of a run, got {shown(solution)}.")
    t = frame_times(solution, 2)
    speed = positive("animate", "speed", speed)
    lasts = float(t[-1] - t[0]) / speed
    least, most = _FEWEST, _MOST
    number = round(np.clip(_FRAMES_PER_SECOND * lasts, least, most))
    if frames is not None:
        number = count("animate", "frames", frames, least, most)
    rate = round(np.clip((number - 1) / lasts, 1, _FASTEST)) if lasts > 0.0 else 1
    captions = [f"t = {time:.3g} s" for time in frame_times(solution, number)]
    return moving_pictures("animate", _bodies(solution, number), captions, rate, path)


def moving_pictures(
    name: str, bodies: Sequence[Body], captions: Sequence[str], rate: int, path: Any = None
) -> Animation | Path:
    """Moving pictures of bodies, a caption each, so many a second; `name` asks for them.

    Bodies are as `beamdae.results.shapes.shapes` has them, with a "look" that may differ.
    """
    if path is None:
        moving = _moving(bodies, captions, 1000 // rate)
        return Animation(moving.to_jshtml(fps=rate, embed_frames=True))
    kind = _kind(name, path)
    writer = _writer(name, kind, rate)
    with replacing(Path(path)) as scratch:
        # Its writers go by the suffix.
        named = scratch.with_name(f"{scratch.name}.{kind}")
        try:
            _moving(bodies, captions, 1000 // rate).save(str(named), writer=writer, dpi=100)
            named.replace(scratch)
        finally:
            named.unlink(missing_ok=True)
    return Path(path)


def _kind(name: str, path: Any) -> str:
    kind = picture_path(name, path).suffix.lower().removeprefix(".")
    if kind not in ("gif", "mp4"):
        raise BeamdaeError(f"{name}: path {path} must end in .gif or .mp4.")
    return kind


def _writer(name: str, kind: str, rate: int) -> AbstractMovieWriter:
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if kind == "gif":
        return PillowWriter(fps=rate)
    if not FFMpegWriter.isAvailable():
        raise BeamdaeError(f"{name}: MP4 files need the program ffmpeg, which is not there.")
    return FFMpegWriter(fps=rate)


def _moving(bodies: Sequence[Body], captions: Sequence[str], interval: int) -> FuncAnimation:
    from matplotlib.animation import FuncAnimation
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    low, high = frame_of(bodies)
    width, height = high - low
    size = 6.0 / max(width, height)
    figure = Figure(figsize=(max(size * width, 2.0), max(size * height, 1.5)))
    FigureCanvasAgg(figure)
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set_aspect("equal")
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axis.set_axis_off()
    lines = [axis.plot([], [], **look(body))[0] for body in bodies]
    caption = axis.text(0.02, 0.98, "", transform=axis.transAxes, va="top", color="0.4", fontsize=9)

    def draw(k: int) -> list[Any]:
        for line, body in zip(lines, bodies, strict=True):
            line.set_data(body["x"][k], body["y"][k])
        caption.set_text(captions[k])
        return [*lines, caption]

    return FuncAnimation(figure, draw, frames=len(captions), interval=interval, blit=False)


def look(body: Body) -> dict[str, Any]:
    """How matplotlib draws a body, by its kind."""
    # A body that is held at one point alone is drawn as that.
    if body["kind"] in ("point", "ground") or len(body["x"][0]) == 1:
        color = "0.55" if body["kind"] == "ground" else COLORS[3]
        mark = "^" if body["kind"] == "ground" else "o"
        found: dict[str, Any] = {"color": color, "marker": mark, "ls": "none", "ms": 6}
    else:
        color = COLORS[0] if body["kind"] == "beam" else COLORS[1]
        width = _WIDTHS.get(body["kind"], 1.2)
        found = {"color": color, "lw": width, "solid_capstyle": "round"}
    return found | body.get("look", {})


def _bodies(solution: Solution, frames: int) -> list[Body]:
    mechanism = solution.equations.mechanism
    if mechanism is None:
        raise BeamdaeError("animate: the run is not one of a mechanism, there is nothing to draw.")
    found = shapes(mechanism, solution, frames)
    for body in found:
        order = drawn_through(body["kind"], len(body["x"][0]))
        body |= {axis: [[row[k] for k in order] for row in body[axis]] for axis in "xy"}
    return found


def frame_of(bodies: Sequence[Body]) -> tuple[Array, Array]:
    """The corners of what is seen."""
    if not bodies:
        raise BeamdaeError("animate: no part of the mechanism has anything to draw.")
    points = np.array(
        [
            (x, y)
            for body in bodies
            for at in zip(body["x"], body["y"], strict=True)
            for x, y in zip(*at, strict=True)
        ]
    )
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.max(high - low)) or 1.0
    middle = (low + high) / 2.0
    half = np.maximum((high - low) / 2.0, 0.1 * size) + _MARGIN * size
    return middle - half, middle + half


def thumbnail(solution: Solution) -> str:
    """Where the mechanism was at some times of a run, the last in full color, as SVG."""
    bodies = [body for body in _bodies(solution, _TIMES) if body["kind"] != "ground"]
    low, high = frame_of(bodies)
    width, height = high - low
    scale = _THUMBNAIL / max(width, height)
    drawn = []
    for k in range(_TIMES):
        shade = 1.0 if k == _TIMES - 1 else 0.15 + 0.35 * k / _TIMES
        for body in bodies:
            x = scale * (np.array(body["x"][k]) - low[0])
            y = scale * (high[1] - np.array(body["y"][k]))
            color = look(body)["color"]
            if body["kind"] == "point":
                drawn += [
                    f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3" fill="{color}" '
                    f'opacity="{shade:.2f}"/>'
                    for a, b in zip(x, y, strict=True)
                ]
                continue
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
            drawn.append(
                f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2" '
                f'stroke-linecap="round" opacity="{shade:.2f}"/>'
            )
    told = html.escape(", ".join(body["name"] for body in bodies))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{scale * width:.0f}" '
        f'height="{scale * height:.0f}" role="img" aria-label="{told}">{"".join(drawn)}</svg>'
    )
