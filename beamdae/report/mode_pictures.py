"""Pictures of natural modes: shapes, moving pictures of one, and Campbell diagrams."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.analysis.campbell import Campbell
from beamdae.analysis.modes import Modes
from beamdae.equations.owners import positions
from beamdae.errors import BeamdaeError, count, shown
from beamdae.parts.mechanism import Mechanism
from beamdae.report.curves import Plot
from beamdae.report.motion import Animation, frame_of, look, moving_pictures
from beamdae.report.pictures import COLORS, as_written, dressed, wrapped
from beamdae.results.shapes import drawn_through, outlines

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray
Body = dict[str, Any]

_PANELS, _SECTIONS, _COLUMNS = 12, 41, 3
# Of the extent of the drawing: how far the largest displacement is drawn.
_AMPLITUDE = 0.12
# Step of the derivative of places by coordinates, in their natural sizes.
_STEP = 1e-5
# Multiples of the speed in a Campbell diagram.
_ORDERS = (1, 2, 3, 4)
# What a panel measures [inch], and for how long a period is shown [s].
_WIDTH, _LOWEST, _HIGHEST, _CAPTION, _PERIOD = 3.2, 0.8, 3.6, 0.35, 2.0
_STILL = {"color": "0.75", "zorder": 1}


class _Shapes(NamedTuple):
    """What is drawn of modes: kinds of parts, where their points begin, places and ways."""

    kinds: list[str]
    starts: list[int]
    rest: Array
    ways: Array

    def still(self) -> list[Body]:
        """The state they are about, but for the ground."""
        bodies = self._bodies(self.rest[None])
        return [{**body, "look": _STILL} for body in bodies if body["kind"] != "ground"]

    def moved(self, k: int, phases: Array) -> list[Body]:
        """A mode at some phases of its period, a frame each."""
        return self._bodies(self.rest + (self.ways[k] * phases[:, None, None]).real)

    def _bodies(self, places: Array) -> list[Body]:
        found = []
        for kind, (first, last) in zip(self.kinds, pairwise(self.starts), strict=True):
            points = first + np.array(drawn_through(kind, last - first))
            found.append({"kind": kind, "x": places[:, points, 0], "y": places[:, points, 1]})
        return found


def draw_modes(modes: Modes) -> Plot:
    """Draw the shapes of modes, twelve at most, over the state they are about.

    Displacements are linear in the shapes, and as large as can be seen.

    Parameters
    ----------
    modes
        Of a mechanism, see `beamdae.modes`.

    Returns
    -------
    Plot
        Shown by a notebook; `Plot.save` writes it to a file.

    Raises
    ------
    BeamdaeError
        If there is no mode, or the model has no parts that can be drawn.
    """
    return Plot(figure_of_modes(modes))


def figure_of_modes(modes: Modes, title: str = "") -> Figure:
    """The shapes of modes as a figure."""
    shapes = _shapes("draw_modes", modes)
    chosen = range(min(len(modes), _PANELS))
    still = shapes.still()
    panels = [shapes.moved(k, np.ones(1)) for k in chosen]
    low, high = frame_of([*still, *(body for bodies in panels for body in bodies)])
    columns = min(len(panels), _COLUMNS)
    rows = math.ceil(len(panels) / columns)
    width, height = high - low
    own = float(np.clip(_WIDTH * height / width, _LOWEST, _HIGHEST)) + _CAPTION
    figure = _figure(
        (max(_WIDTH * columns, 5.0), own * rows + 0.5), title or f"modes about {modes.about}"
    )
    for k, bodies in enumerate(panels):
        axis = figure.add_subplot(rows, columns, k + 1)
        axis.set_aspect("equal")
        axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axis.set_axis_off()
        for body in [*still, *bodies]:
            axis.plot(body["x"][0], body["y"][0], **look(body))
        axis.set_title(_told(modes, k), fontsize=9)
    as_written(figure)
    return figure


def animate_mode(
    modes: Modes, mode: int, path: str | Path | None = None, frames: int = 32
) -> Animation | Path:
    """Moving pictures of a period of a mode, damping left out: for a notebook, or as a file.

    Parameters
    ----------
    modes
        Of a mechanism, see `beamdae.modes`.
    mode
        Its number, from 1 on.
    path
        Of a GIF or MP4 file, see `beamdae.animate`. None: for a notebook.
    frames
        How many pictures a period.

    Raises
    ------
    BeamdaeError
        If there is no such mode, nothing can be drawn, or the file is of another kind or cannot be
        written.
    """
    shapes = _shapes("animate_mode", modes)
    k = count("animate_mode", "mode", mode, most=len(modes)) - 1
    number = count("animate_mode", "frames", frames, least=2, most=500)
    bodies = shapes.moved(k, np.exp(2j * np.pi * np.arange(number) / number))
    still = [
        {**body, "x": np.repeat(body["x"], number, 0), "y": np.repeat(body["y"], number, 0)}
        for body in shapes.still()
    ]
    captions = [f"mode {_told(modes, k)}"] * number
    rate = max(round(number / _PERIOD), 1)
    return moving_pictures("animate_mode", [*still, *bodies], captions, rate, path)


def draw_campbell(found: Campbell) -> Plot:
    """Draw frequencies over the speed of rotation, with multiples of the speed.

    Parameters
    ----------
    found
        See `beamdae.campbell`.
    """
    return Plot(figure_of_campbell(found))


def figure_of_campbell(found: Campbell, title: str = "Campbell diagram") -> Figure:
    """A Campbell diagram as a figure."""
    if not isinstance(found, Campbell):
        raise BeamdaeError(f"draw_campbell: found must be what campbell gives, got {shown(found)}.")
    figure = _figure((6.4, 4.8), f"{title}; dashed: multiples of the speed")
    axis = figure.add_subplot()
    order = np.argsort(found.speeds)
    speeds, frequencies = found.speeds[order], found.frequencies[order]
    highest = 1.05 * float(np.max(frequencies, initial=0.0)) or 1.0
    turns = np.abs(speeds) / (2.0 * np.pi)
    for multiple in _ORDERS:
        axis.plot(speeds, multiple * turns, color="0.6", lw=0.8, ls=(0, (4, 3)))
        if multiple * turns[-1] <= highest:
            at = (speeds[-1], multiple * turns[-1])
            axis.annotate(f" {multiple}", at, color="0.4", va="center")
    for k, values in enumerate(frequencies.T):
        axis.plot(speeds, values, color=COLORS[k % len(COLORS)], lw=1.4, marker=".", ms=4)
    dressed(axis, "", "frequency [Hz]")
    axis.set_ylim(0.0, highest)
    axis.set_xlabel("speed [rad/s]")
    as_written(figure)
    return figure


def _of_mechanism(part: str, modes: Any) -> Mechanism:
    if not isinstance(modes, Modes):
        raise BeamdaeError(f"{part}: modes must be what modes gives, got {shown(modes)}.")
    if modes.mechanism is None or not len(modes):
        raise BeamdaeError(f"{part}: modes must be those of a mechanism, there is nothing to draw.")
    return modes.mechanism


def _shapes(part: str, modes: Any) -> _Shapes:
    mechanism = _of_mechanism(part, modes)
    parts = outlines(mechanism, _SECTIONS)
    if not parts:
        raise BeamdaeError(f"{part}: modes must be those of parts that are drawn, there are none.")
    where = positions(mechanism, [place for _, x in parts for place in x.places])
    rest = where(modes.q[None]).reshape(-1, 2)
    ways = np.array([_way(where, modes.q, shape) for shape in modes.shapes])
    largest = np.max(np.hypot(*np.moveaxis(np.abs(ways), -1, 0)), axis=1)
    extent = float(np.max(np.ptp(rest, axis=0))) or 1.0
    ways *= (_AMPLITUDE * extent / np.where(largest > 0.0, largest, 1.0))[:, None, None]
    starts = np.cumsum([0, *(len(x.places) for _, x in parts)]).tolist()
    return _Shapes([x.kind for _, x in parts], starts, rest, ways)


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


def _figure(size: tuple[float, float], title: str) -> Figure:
    # Here, for it takes longer to import than some commands to run.
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    figure.suptitle(wrapped(title), fontsize=11)
    return figure
