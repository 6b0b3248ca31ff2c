"""Pictures of natural modes: shapes, an animation of one, and Campbell diagrams."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.analysis.campbell import Campbell
from beamdae.analysis.modes import Modes
from beamdae.equations.owners import positions
from beamdae.errors import BeamdaeError, count, may_be_path, shown
from beamdae.report.pictures import COLORS, saved, wrapped
from beamdae.results.files import replacing
from beamdae.results.shapes import outlines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = np.ndarray

_PANELS, _SECTIONS = 12, 41
# Of the extent of the drawing: how far the largest displacement is drawn.
_AMPLITUDE = 0.12
# Step of the derivative of places by coordinates, in their natural sizes.
_STEP = 1e-5
# Multiples of the speed in a Campbell diagram.
_ORDERS = (1, 2, 3, 4)


class _Drawn(NamedTuple):
    """What is drawn of modes: kinds of parts, where their points begin, places and ways."""

    kinds: Sequence[str]
    starts: Sequence[int]
    rest: Array
    ways: Array


def draw_modes(modes: Modes, path: str | Path, title: str = "") -> Path:
    """Draw the shapes of modes, twelve at most, over the state they are about.

    Displacements are linear in the shapes, and as large as can be seen.

    Parameters
    ----------
    modes
        Of a mechanism, see `beamdae.modes`.
    path
        Of the PNG (or PDF, SVG) file to be written.

    Raises
    ------
    BeamdaeError
        If the model has no parts that can be drawn, or the file cannot be written.
    """
    drawn, target = _drawn("draw_modes", modes), _path("draw_modes", path)
    chosen = range(min(len(modes), _PANELS))
    figure, axes = _panels(len(chosen), title or f"modes about {modes.about}")
    for axis, k in zip(axes, chosen, strict=True):
        _draw(axis, drawn, np.zeros_like(drawn.rest), "0.75")
        _draw(axis, drawn, drawn.ways[k].real, COLORS[0])
        axis.set_title(_told(modes, k), fontsize=9)
    return saved(figure, target)


def animate_mode(modes: Modes, mode: int, path: str | Path, frames: int = 32) -> Path:
    """Write a period of a mode as an animated GIF, damping left out.

    Parameters
    ----------
    modes, path
        See `draw_modes`.
    mode
        Its number, from 1 on.
    frames
        How many pictures a period.
    """
    from matplotlib.animation import FuncAnimation, PillowWriter

    drawn, target = _drawn("animate_mode", modes), _path("animate_mode", path)
    k = count("animate_mode", "mode", mode, most=len(modes)) - 1
    number = count("animate_mode", "frames", frames, least=2, most=1000)
    figure, (axis,) = _panels(1, f"mode {_told(modes, k)}, about {modes.about}")
    reach = np.abs(drawn.ways[k])
    _limit(axis, drawn.rest - reach, drawn.rest + reach)
    _draw(axis, drawn, np.zeros_like(drawn.rest), "0.75")
    still = len(axis.lines)

    def frame(step: int) -> list[Any]:
        for line in axis.lines[still:]:
            line.remove()
        phase = np.exp(2j * np.pi * step / number)
        _draw(axis, drawn, (drawn.ways[k] * phase).real, COLORS[0])
        return list(axis.lines)

    made = FuncAnimation(figure, frame, frames=number, init_func=lambda: [])
    with replacing(target) as scratch:
        # By its name it would not be known for a GIF.
        written = scratch.with_name(f"{scratch.name}.gif")
        made.save(written, writer=PillowWriter(fps=16), dpi=100)
        written.replace(scratch)
    return target


def draw_campbell(found: Campbell, path: str | Path, title: str = "Campbell diagram") -> Path:
    """Draw frequencies over the speed of rotation, with multiples of the speed."""
    if not isinstance(found, Campbell):
        raise BeamdaeError(f"draw_campbell: expected what campbell gives, got {shown(found)}.")
    target = _path("draw_campbell", path)
    figure, (axis,) = _panels(1, title, equal=False)
    order = np.argsort(found.speeds)
    speeds, frequencies = found.speeds[order], found.frequencies[order]
    for k, values in enumerate(frequencies.T):
        axis.plot(speeds, values, color=COLORS[k % len(COLORS)], lw=1.4, marker=".", ms=4)
    highest = 1.05 * float(np.max(frequencies, initial=0.0)) or 1.0
    for multiple in _ORDERS:
        line = multiple * np.abs(speeds) / (2.0 * np.pi)
        axis.plot(speeds, line, color="0.6", lw=0.8, ls=(0, (4, 3)))
    axis.set_ylim(0.0, highest)
    axis.set_xlabel("speed [rad/s]")
    axis.set_ylabel("frequency [Hz]")
    axis.grid(color="0.9", lw=0.6)
    return saved(figure, target)


def _path(part: str, path: Any) -> Path:
    text = str(path) if isinstance(path, (str, Path)) else ""
    if not (may_be_path(text) and Path(text).name):
        raise BeamdaeError(f"{part}: path must be that of a file, got {shown(path)}.")
    return Path(text)


def _drawn(part: str, modes: Any) -> _Drawn:
    if not isinstance(modes, Modes):
        raise BeamdaeError(f"{part}: expected what modes gives, got {shown(modes)}.")
    if modes.mechanism is None or not len(modes):
        raise BeamdaeError(f"{part}: there is nothing to draw, it needs modes of a mechanism.")
    parts = outlines(modes.mechanism, _SECTIONS)
    where = positions(modes.mechanism, [place for _, x in parts for place in x.places])
    rest = where(modes.q[None]).reshape(-1, 2)
    ways = np.array([_way(where, modes.q, shape) for shape in modes.shapes])
    largest = np.max(np.hypot(*np.moveaxis(np.abs(ways), -1, 0)), axis=1)
    extent = float(np.max(np.ptp(rest, axis=0))) or 1.0
    ways *= (_AMPLITUDE * extent / np.where(largest > 0.0, largest, 1.0))[:, None, None]
    starts = np.cumsum([0, *(len(x.places) for _, x in parts)]).tolist()
    return _Drawn([x.kind for _, x in parts], starts, rest, ways)


def _way(where: Any, q: Array, shape: Array) -> Array:
    """Displacements (points, 2) complex of the points in a shape."""
    step = _STEP / max(float(np.max(np.abs(shape))), 1e-300)
    ends = [step * s for s in (shape.real, -shape.real, shape.imag, -shape.imag)]
    found = where(q + np.array(ends)).reshape(4, -1, 2)
    return (found[0] - found[1] + 1j * (found[2] - found[3])) / (2.0 * step)


def _told(modes: Modes, k: int) -> str:
    ratio = modes.damping_ratios[k]
    damped = f", damping {ratio:.2g}" if modes.kinds[k] == "vibration" and ratio else ""
    kind = f"{modes.frequencies[k]:.4g} Hz" if modes.frequencies[k] else modes.kinds[k]
    return f"{k + 1}: {kind}{damped}"


def _draw(axis: Axes, drawn: _Drawn, way: Array, color: str) -> None:
    for kind, (first, last) in zip(drawn.kinds, pairwise(drawn.starts), strict=True):
        x, y = (drawn.rest + way)[first:last].T
        if kind == "ground":
            axis.plot(x, y, ls="", marker="^", ms=4, color="0.5")
        elif last - first == 1:
            axis.plot(x, y, ls="", marker="o", ms=3, color=color)
        else:
            axis.plot(x, y, lw=1.4 if kind == "beam" else 2.2, color=color)


def _limit(axis: Axes, low: Array, high: Array) -> None:
    for limit, k in ((axis.set_xlim, 0), (axis.set_ylim, 1)):
        first, last = float(np.min(low[:, k])), float(np.max(high[:, k]))
        room = 0.05 * (last - first) or 1.0
        limit(first - room, last + room)


def _panels(panels: int, title: str, equal: bool = True) -> tuple[Figure, list[Axes]]:
    # Here, for it takes longer to import than some commands to run.
    from matplotlib.figure import Figure

    columns = min(panels, 3)
    rows = math.ceil(panels / columns)
    size = (3.2 * columns + 0.6, 2.4 * rows + 0.8) if panels > 1 else (6.4, 4.8)
    figure = Figure(figsize=size, layout="constrained")
    axes = [figure.add_subplot(rows, columns, k + 1) for k in range(panels)]
    for axis in axes:
        if equal:
            axis.set_aspect("equal", adjustable="datalim")
            axis.tick_params(labelsize=7)
        axis.spines[["top", "right"]].set_visible(False)
    figure.suptitle(wrapped(title), fontsize=11)
    return figure, axes
