"""Pictures of natural modes: shapes, moving pictures of one, and Campbell diagrams."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.analysis.linear_dynamics.campbell_diagram import Campbell
from beamdae.analysis.linear_dynamics.natural_modes import Modes
from beamdae.errors import BeamdaeError, require_count, short_repr
from beamdae.parts.mechanism import Mechanism
from beamdae.report.page.motion_player import animation
from beamdae.report.pictures.animation_files import FigureAnimation
from beamdae.report.pictures.figures import COLORS, disable_math_text, format_axis, wrap_title
from beamdae.report.scene.artists import SceneArtists, add_caption, create_bare_axis, padded_extent
from beamdae.report.scene.frame_export import export_frames
from beamdae.report.scene.mechanism_scene import build_scene, count_beam_sections
from beamdae.report.scene.outlines import outlines
from beamdae.report.scene.poses import CoordinatePoses, Poses, VibrationPoses
from beamdae.report.scene.scene import Scene
from beamdae.results.displays import Animation, Plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray

_PANELS, _COLUMNS = 12, 3
# Of the extent of the drawing: how far the largest displacement is drawn.
_AMPLITUDE = 0.12
# Multiples of the speed in a Campbell diagram.
_ORDERS = (1, 2, 3, 4)
# What a panel measures [inch], and for how long a period is shown [s].
_WIDTH, _LOWEST, _HIGHEST, _CAPTION, _PERIOD = 3.2, 0.8, 3.6, 0.35, 2.0


class _Shapes:
    """Scenes of modes about a state, each as large as can be seen."""

    def __init__(self, part: str, modes: Modes) -> None:
        self._modes, self._mechanism = modes, _of_mechanism(part, modes)
        self.still = self._scene(CoordinatePoses(self._mechanism, modes.q[None]), 1)
        low, high = self.still.extent()
        self._largest = _AMPLITUDE * (float(np.max(high - low)) or 1.0)

    def moved(self, k: int, phases: Array) -> Scene:
        """A mode at some phases of its period, a frame each."""
        shape = self._modes.shapes[k]
        return self._scene(self._vibrating(k, self._scale(k) * shape, phases), len(phases))

    def _vibrating(self, k: int, shape: Array, phases: Array) -> VibrationPoses:
        return VibrationPoses(self._mechanism, self._modes.q, shape, phases)

    def _scale(self, k: int) -> float:
        """How far its largest displacement is drawn, over what it is."""
        poses = self._vibrating(k, self._modes.shapes[k], np.array([0.0, 1.0, 1j]))
        drawn = outlines(self._mechanism, count_beam_sections(self._mechanism))
        found = [poses(drawing.places)[..., :2] for _, drawing in drawn]
        rest, real, imaginary = np.concatenate(found, axis=1)
        largest = float(np.max(np.hypot(real - rest, imaginary - rest)))
        return self._largest / largest if largest > 0.0 else 0.0

    def _scene(self, poses: Poses, frames: int) -> Scene:
        return build_scene(
            self._mechanism, poses, np.zeros(frames), left_out=lambda part: part.is_load
        )


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
    return Plot(create_modes_figure(modes))


def create_modes_figure(modes: Modes, title: str = "") -> Figure:
    """The shapes of modes as a figure."""
    shapes = _Shapes("draw_modes", modes)
    panels = [shapes.moved(k, np.ones(1)) for k in range(min(len(modes), _PANELS))]
    low, high = padded_extent([shapes.still, *panels])
    columns = min(len(panels), _COLUMNS)
    rows = math.ceil(len(panels) / columns)
    width, height = high - low
    own = float(np.clip(_WIDTH * height / width, _LOWEST, _HIGHEST)) + _CAPTION
    figure = _figure(
        (max(_WIDTH * columns, 5.0), own * rows + 0.5), title or f"modes about {modes.about}"
    )
    for k, scene in enumerate(panels):
        axis = figure.add_subplot(rows, columns, k + 1)
        axis.set_aspect("equal")
        axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axis.set_axis_off()
        SceneArtists(axis, shapes.still, pale=True)
        SceneArtists(axis, scene)
        axis.set_title(_told(modes, k), fontsize=9)
    disable_math_text(figure)
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
    shapes = _Shapes("animate_mode", modes)
    k = require_count("animate_mode", "mode", mode, most=len(modes)) - 1
    number = require_count("animate_mode", "frames", frames, least=2, most=500)
    # From rest on, as far as the shape is real.
    phases = np.exp(2j * np.pi * (np.arange(number) / number - 0.25))
    scene = shapes.moved(k, phases)
    if path is None:
        return _in_notebook(scene, number, modes, k)
    figure, axis = create_bare_axis(padded_extent([shapes.still, scene]))
    SceneArtists(axis, shapes.still, pale=True)
    add_caption(axis).set_text(f"mode {_told(modes, k)}")
    film = FigureAnimation(
        figure, SceneArtists(axis, scene).show, number, max(round(number / _PERIOD), 1)
    )
    return film.written("animate_mode", path)


def _in_notebook(scene: Scene, frames: int, modes: Modes, k: int) -> Animation:
    """A period, or two seconds of what has none."""
    frequency = float(modes.frequencies[k])
    period = 1.0 / frequency if frequency > 0.0 else _PERIOD
    low, high = scene.extent()
    width, height = (high - low).tolist()
    times = np.arange(frames) * period / frames
    shown_as = export_frames(scene, times)
    return animation(shown_as, (width, height), f"mode {_told(modes, k)}", period / _PERIOD, False)


def draw_campbell(found: Campbell) -> Plot:
    """Draw frequencies over the speed of rotation, with multiples of the speed.

    Parameters
    ----------
    found
        See `beamdae.campbell`.
    """
    return Plot(create_campbell_figure(found))


def create_campbell_figure(found: Campbell, title: str = "Campbell diagram") -> Figure:
    """A Campbell diagram as a figure."""
    if not isinstance(found, Campbell):
        raise BeamdaeError(
            f"draw_campbell: found must be what campbell gives, got {short_repr(found)}."
        )
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
    format_axis(axis, "", "frequency [Hz]")
    axis.set_ylim(0.0, highest)
    axis.set_xlabel("speed [rad/s]")
    disable_math_text(figure)
    return figure


def _of_mechanism(part: str, modes: Any) -> Mechanism:
    if not isinstance(modes, Modes):
        raise BeamdaeError(f"{part}: modes must be what modes gives, got {short_repr(modes)}.")
    if modes.mechanism is None or not len(modes):
        raise BeamdaeError(f"{part}: modes must be those of a mechanism, there is nothing to draw.")
    if not outlines(modes.mechanism, 2):
        raise BeamdaeError(f"{part}: modes must be those of parts that are drawn, there are none.")
    return modes.mechanism


def _told(modes: Modes, k: int) -> str:
    ratio = modes.damping_ratios[k]
    damped = f", damping {ratio:.2g}" if modes.kinds[k] == "vibration" and ratio else ""
    kind = f"{modes.frequencies[k]:.4g} Hz" if modes.frequencies[k] else modes.kinds[k]
    return f"{k + 1}: {kind}{damped}"


def _figure(size: tuple[float, float], title: str) -> Figure:
    # Here, for it takes longer to import than some commands to run.
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    figure.suptitle(wrap_title(title), fontsize=11)
    return figure
