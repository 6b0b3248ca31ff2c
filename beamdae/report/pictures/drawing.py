"""A mechanism as it is drawn, before anything is run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError, short_repr
from beamdae.parts.mechanism import Mechanism
from beamdae.report.pictures import figures as pictures
from beamdae.report.pictures.label_placement import place_names
from beamdae.report.scene import poses
from beamdae.report.scene.artists import SceneArtists
from beamdae.report.scene.mechanism_scene import build_scene
from beamdae.report.scene.scene import Scene
from beamdae.report.text import shorten_text
from beamdae.results.displays import Plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray

_WIDTH, _HEIGHT = 8.0, (2.5, 8.0)
# For the numbers of the axes: on the left, below, on the right and above [inch].
_AROUND = (0.8, 0.5, 0.2, 0.22)
# Of the size of the drawing: how near names share a place, and what is free around it.
_NEAR, _MARGIN = 0.012, 0.09
_MOST = 30
# Points of a line that names do not cover, and lines they may cover.
_DENSE = 120
_COVERED = ("guide", "surface", "gear")


def draw(mechanism: Mechanism) -> Plot:
    """Draw a mechanism as it is stated: bodies, joints, supports, springs and loads by name.

    It is the reference drawing; a start elsewhere is not looked for. Bodies are drawn through the
    points other parts refer to, beams along their axis, forces as arrows of one length in their
    direction at t = 0 (or soon after, where they begin with nothing).

    Returns
    -------
    Plot
        Shown by a notebook; `Plot.save` writes it to a file.

    Raises
    ------
    BeamdaeError
        If it is no mechanism, or there is nothing to draw.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> bob = mech.add(bd.RigidBody("bob", mass=1.0, inertia=0.1, center=(1.0, 0.0)))
    >>> hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    >>> path = mech.draw().save("pendulum.svg")
    """
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(f"draw: expected a mechanism, got {short_repr(mechanism)}.")
    return Plot(create_drawing(mechanism))


def create_drawing(mechanism: Mechanism, size: tuple[float, float] | None = None) -> Figure:
    """The drawing as a figure of a size [inch], by default one that fits."""
    scene = build_scene(mechanism, poses.reference_poses, np.zeros(1))
    low, high = scene.extent()
    figure, axis = _canvas(high - low, size)
    SceneArtists(axis, scene)
    names = _names(scene, _NEAR * float(np.max(high - low)))
    if np.any(mechanism.gravity):
        names.append(_gravity(mechanism.gravity, low, high, scene.size, axis))
        high = np.add(high, (4.0 * scene.size, 0.0))
    axis.dataLim.set_points(np.array([low, high]))
    axis.margins(_MARGIN)
    axis.autoscale_view()
    place_names(axis, names, _dense(scene))
    pictures.disable_math_text(figure)
    return figure


def _canvas(extent: Array, size: tuple[float, float] | None) -> tuple[Figure, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = extent / np.max(extent)
    tall = float(np.clip(_WIDTH * (height + 0.25) / (width + 0.25), *_HEIGHT))
    wide, tall = size or (_WIDTH, tall)
    figure = Figure(figsize=(wide, tall))
    FigureCanvasAgg(figure)
    left, below, right, above = _AROUND
    room = (1.0 - (left + right) / wide, 1.0 - (below + above) / tall)
    axis = figure.add_axes((left / wide, below / tall, *room))
    axis.set_aspect("equal", adjustable="datalim")
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.tick_params(labelsize=9)
    axis.grid(color="0.93", lw=0.6)
    axis.set_axisbelow(True)
    return figure, axis


def _gravity(gravity: Array, low: Array, high: Array, size: float, axis: Any) -> tuple[Array, str]:
    """An arrow in the corner above, with its size."""
    along = gravity / np.hypot(*gravity)
    middle = np.array([high[0] + 3.0 * size, high[1]])
    start, end = middle - 2.0 * size * along, middle + 2.0 * size * along
    look = {"arrowstyle": "-|>", "color": "0.55", "lw": 1.4, "shrinkA": 0.0, "shrinkB": 0.0}
    axis.annotate("", tuple(end.tolist()), tuple(start.tolist()), arrowprops=look)
    return middle, f"{np.hypot(*gravity):g} m/s²"


def _names(scene: Scene, near: float) -> list[tuple[Array, str]]:
    """Names and their places, those of one place below each other."""
    groups: list[tuple[Array, list[str]]] = []
    for row, text in scene.names:
        at = scene.poses[row, 0, :2]
        for other, texts in groups:
            if np.hypot(*(at - other)) < near:
                texts.append(shorten_text(text, _MOST))
                break
        else:
            groups.append((at, [shorten_text(text, _MOST)]))
    return [(at, "\n".join(texts)) for at, texts in groups]


def _dense(scene: Scene) -> Array:
    """Points along all lines but those of guides and surfaces, near to each other."""
    found = []
    for glyph, line in scene.lines():
        if glyph.kind not in _COVERED:
            points = line[0][np.isfinite(line[0]).all(axis=1)]
            at = np.linspace(0.0, len(points) - 1.0, max(len(points), _DENSE))
            found.append(np.stack([np.interp(at, range(len(points)), x) for x in points.T], axis=1))
    return np.concatenate(found)
