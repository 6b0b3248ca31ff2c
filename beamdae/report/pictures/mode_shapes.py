"""Figures and animations of natural modes, and Campbell diagrams."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.analysis.linear_dynamics.campbell_diagram import Campbell
from beamdae.analysis.linear_dynamics.natural_modes import Modes
from beamdae.analysis.statics.linear_buckling import Buckling
from beamdae.errors import BeamdaeError, require_count
from beamdae.report.pictures.animations import MAX_FRAMES, build_motion_player, save_animation
from beamdae.report.pictures.figures import (
    COLORS,
    MAX_PANELS,
    Panel,
    disable_math_text,
    draw_panels,
    wrap_title,
)
from beamdae.report.pictures.scene_artists import (
    SceneArtists,
    add_caption,
    create_bare_axis,
    padded_extent,
    show_region,
)
from beamdae.report.scene.mechanism_scene import (
    build_scene,
    collect_drawings,
    coordinate_poses,
    count_beam_sections,
    vibration_poses,
)
from beamdae.report.scene.run_scene import FRAMES_PER_PERIOD, export_frames
from beamdae.report.scene.scene import Poses, Scene
from beamdae.results.displays import Animation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray

_MAX_COLUMNS = 3
# Largest displacement of a displayed mode, relative to the extent of the mechanism.
_RELATIVE_AMPLITUDE = 0.12
# Width and limits of the height of a panel, and height of its title [inch].
_PANEL_WIDTH = 3.2
_MIN_PANEL_HEIGHT = 0.8
_MAX_PANEL_HEIGHT = 3.6
_PANEL_TITLE_HEIGHT = 0.35
# Campbell diagrams show all modes unless the highest one exceeds this multiple of the first mode
# above the excitations.
_MAX_FREQUENCY_SHARE = 2.0
_CAMPBELL_SIZE = (6.4, 4.8)  # [inch]
_FREE_MOTION_RATE = 1e-9  # growth rate of free motions by rounding, relative to the fastest mode
_DISPLAYED_PERIOD = 2.0  # duration of one period in an animation [s]


class ModeScenes:
    """Scenes of modes about a state, all scaled to the same largest displacement."""

    def __init__(self, name: str, modes: Modes | Buckling) -> None:
        if modes.mechanism is None or not len(modes):
            raise BeamdaeError(
                f"{name}: there are no modes, or the modes belong to a system without a mechanism; "
                "only modes of mechanisms can be drawn."
            )
        if not collect_drawings(modes.mechanism, 2):
            raise BeamdaeError(f"{name}: the mechanism has no parts that can be drawn; add a body.")
        self._modes, self._mechanism = modes, modes.mechanism
        self.rest = self._build(coordinate_poses(self._mechanism, modes.q[None]), 1)
        low, high = self.rest.extent()
        self._amplitude = _RELATIVE_AMPLITUDE * (float(np.max(high - low)) or 1.0)

    def vibrating(self, k: int, phases: Array) -> Scene:
        """Return the scene of mode `k`, with one frame per complex phase."""
        mechanism, q, shape = self._mechanism, self._modes.q, self._modes.shapes[k]
        poses = vibration_poses(mechanism, q, shape, np.array([0.0, 1.0, 1j]))
        drawings = collect_drawings(mechanism, count_beam_sections(mechanism))
        positions = [poses(drawing.places)[..., :2] for _, drawing in drawings]
        rest, real, imaginary = np.concatenate(positions, axis=1)
        largest = float(np.max(np.hypot(real - rest, imaginary - rest)))
        scale = self._amplitude / largest if largest > 0.0 else 0.0
        return self._build(vibration_poses(mechanism, q, scale * shape, phases), len(phases))

    def _build(self, poses: Poses, frames: int) -> Scene:
        return build_scene(
            self._mechanism, poses, np.zeros(frames), is_hidden=lambda part: part.is_load
        )


def export_modes(
    modes: Modes | Buckling, numbers: Sequence[int], phases: Sequence[complex] | None = None
) -> list[dict[str, Any] | None]:
    """Return one period of each of some modes as exported frames; None if nothing can be drawn.

    The first frame, which pages show first and print, is at the largest displacement, or has the
    complex phase of `phases`.
    """
    try:
        scenes = ModeScenes("page", modes)
    except BeamdaeError:
        return [None] * len(numbers)
    shares = np.linspace(0.0, 1.0, FRAMES_PER_PERIOD + 1)
    period = np.exp(2j * np.pi * shares)
    return [
        export_frames(scenes.vibrating(number, period * phase), shares)
        for number, phase in zip(numbers, phases or [1.0] * len(numbers), strict=True)
    ]


def create_modes_figure(modes: Modes | Buckling, title: str = "") -> Figure | None:
    """Create a figure with up to twelve mode shapes; see `HasModeShapes.plot`."""
    # Imported here because importing Matplotlib takes longer than some commands.
    from matplotlib.figure import Figure

    if modes.mechanism is None or not len(modes):
        return None
    scenes = ModeScenes("plot", modes)
    panels = [scenes.vibrating(k, np.ones(1)) for k in range(min(len(modes), MAX_PANELS))]
    corners = low, high = padded_extent([scenes.rest, *panels])
    columns = min(len(panels), _MAX_COLUMNS)
    rows = math.ceil(len(panels) / columns)
    width, height = high - low
    panel_height = float(
        np.clip(_PANEL_WIDTH * height / width, _MIN_PANEL_HEIGHT, _MAX_PANEL_HEIGHT)
    )
    size = (max(_PANEL_WIDTH * columns, 5.0), (panel_height + _PANEL_TITLE_HEIGHT) * rows + 0.5)
    heights = scenes.rest.caption
    title = title or f"modes about {modes.about}"
    figure = Figure(figsize=size, layout="constrained")
    figure.suptitle(wrap_title(f"{title}, {heights}" if heights else title), fontsize=11)
    for k, scene in enumerate(panels):
        axis = figure.add_subplot(rows, columns, k + 1)
        show_region(axis, corners)
        SceneArtists(axis, scenes.rest, is_pale=True)
        SceneArtists(axis, scene)
        axis.set_title(modes.describe(k), fontsize=9)
    disable_math_text(figure)
    return figure


def animate_mode(
    modes: Modes | Buckling, mode: int, path: str | Path | None = None, frames: int = 32
) -> Animation | Path:
    """Return the animation of a mode, or write it; see `Modes.animate`."""
    scenes = ModeScenes("animate", modes)
    k = require_count("animate", "mode", mode, most=len(modes)) - 1
    number = require_count("animate", "frames", frames, least=2, most=MAX_FRAMES)
    # With this phase, a real mode shape starts from zero displacement.
    phases = np.exp(2j * np.pi * (np.arange(number) / number - 0.25))
    scene, caption = scenes.vibrating(k, phases), f"mode {modes.describe(k)}"
    if path is None:
        frequency = float(modes.frequencies[k]) if isinstance(modes, Modes) else 0.0
        period = 1.0 / frequency if frequency > 0.0 else _DISPLAYED_PERIOD
        data = export_frames(scene, np.arange(number) * period / number)
        return build_motion_player(scene, data, caption, period / _DISPLAYED_PERIOD, False)
    figure, axis = create_bare_axis(padded_extent([scenes.rest, scene]))
    SceneArtists(axis, scenes.rest, is_pale=True)
    add_caption(axis).set_text(caption)
    artists, rate = SceneArtists(axis, scene), max(round(number / _DISPLAYED_PERIOD), 1)
    return save_animation("animate", path, figure, artists.show, number, rate)


def choose_frequency_limit(diagram: Campbell) -> float:
    """Return the largest frequency [Hz] that pictures of a Campbell diagram show.

    It is that of the excitations and of the first mode above them if other modes have more than
    twice this frequency, and the largest one otherwise.
    """
    highest = float(np.max(diagram.frequencies, initial=0.0))
    fastest = float(np.max(np.abs(diagram.speeds), initial=0.0))
    excitation = max(diagram.multiples, default=0) * fastest / (2.0 * np.pi)
    above = diagram.frequencies[:, np.min(diagram.frequencies, axis=0) > excitation]
    if not excitation or not above.size:
        return highest
    limit = float(np.min(np.max(above, axis=0)))
    return limit if highest > _MAX_FREQUENCY_SHARE * limit else highest


def find_overdamped(diagram: Campbell) -> Array:
    """Return a mask (k,) of the modes that decay without vibrating at all speeds."""
    noise = _FREE_MOTION_RATE * float(np.max(np.abs(diagram.eigenvalues), initial=0.0))
    return np.all((diagram.frequencies == 0.0) & (diagram.eigenvalues.real < -noise), axis=0)


def describe_hidden_modes(diagram: Campbell) -> str:
    """Return the names of the modes above the largest frequency shown, or an empty text."""
    lowest = np.min(diagram.frequencies, axis=0)
    numbers = np.flatnonzero(lowest > choose_frequency_limit(diagram)) + 1
    if not len(numbers):
        return ""
    if len(numbers) > 1 and len(numbers) == numbers[-1] - numbers[0] + 1:
        return f"modes {numbers[0]} to {numbers[-1]}"
    return f"mode{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"


def create_campbell_figure(diagram: Campbell, title: str = "") -> Figure:
    """Create the figure of a Campbell diagram."""
    order = np.argsort(diagram.speeds)
    speeds = diagram.speeds[order] / diagram.speed_factor
    frequencies = diagram.frequencies[order]
    highest = 1.05 * choose_frequency_limit(diagram) or 1.0
    revolutions = np.abs(diagram.speeds[order]) / (2.0 * np.pi)
    guides = {n: n * revolutions for n in diagram.multiples}
    guide = {"color": "0.6", "lw": 0.8, "ls": (0, (4, 3))}
    lines: list[tuple[Any, Any, dict[str, Any]]] = [(speeds, x, guide) for x in guides.values()]
    is_hidden = find_overdamped(diagram) | (np.min(frequencies, axis=0) > highest)
    entries = {}
    for k in np.flatnonzero(~is_hidden).tolist():
        entries[f"mode {k + 1}"] = {
            "color": COLORS[k % len(COLORS)],
            "lw": 1.4,
            "marker": ".",
            "ms": 4,
        }
        lines.append((speeds, frequencies[:, k], entries[f"mode {k + 1}"]))
    resonances = diagram.resonances()[["speed [rad/s]", "frequency [Hz]"]].to_numpy(float)
    circles = {"color": "0.2", "mfc": "none", "ls": "", "marker": "o", "ms": 7}
    lines.append((*(resonances / [diagram.speed_factor, 1.0]).T, circles))
    hidden = describe_hidden_modes(diagram)
    panel = Panel(
        f"higher frequencies: {hidden}" if hidden else "",
        "frequency [Hz]",
        lines,
        (f"speed [{diagram.speed_unit}]", ""),
    )
    heading = f"{title or 'Campbell diagram'}; dashed: multiples of the speed, circles: resonances"
    figure = draw_panels([panel], heading, entries, x_label=None)
    figure.set_size_inches(_CAMPBELL_SIZE)
    (axis,) = figure.axes
    axis.set_ylim(0.0, highest)
    for multiple, line in guides.items():
        # Where the line leaves the picture, if it is in it.
        for k in np.flatnonzero(line <= highest)[-1:].tolist():
            axis.annotate(f"{multiple}\u00d7", (speeds[k], line[k]), color="0.4", **_LABEL)
    return figure


_LABEL: dict[str, Any] = {
    "xytext": (-3.0, 3.0),
    "textcoords": "offset points",
    "ha": "right",
    "fontsize": 8,
    "parse_math": False,
}
