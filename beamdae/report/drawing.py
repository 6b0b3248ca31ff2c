"""A mechanism as it is drawn, before anything is run."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError, shown
from beamdae.parts.mechanism import Mechanism
from beamdae.report import pictures
from beamdae.report.curves import Plot
from beamdae.report.letters import shortened
from beamdae.report.pen import Pen
from beamdae.report.symbols import symbol
from beamdae.results.shapes import drawn_through, outlines

Array = np.ndarray
# Name, kind and points (k, 2) of a part.
Outline = tuple[str, str, Array]

_POINTS = 41
_WIDTH, _HEIGHT = 8.0, (2.5, 8.0)
# Of the size of the drawing: a symbol, and how near names share a place.
_SYMBOL, _NEAR = 0.022, 0.035
_MARGIN = 0.09
_MOST = 30


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
        raise BeamdaeError(f"draw: expected a mechanism, got {shown(mechanism)}.")
    bodies = _bodies(mechanism)
    low, high = _corners(mechanism, bodies)
    figure, axis = _canvas(high - low)
    size = float(np.max(high - low))
    pen = Pen(axis, _SYMBOL * size)
    for body in bodies:
        _body(*body, pen)
    drawn = {name for name, _, _ in bodies}
    for part in mechanism.parts.values():
        if part.name not in drawn:
            symbol(part, pen)
    if np.any(mechanism.gravity):
        _gravity(mechanism.gravity, low, high, pen)
    _names(pen, _NEAR * size)
    axis.margins(_MARGIN)
    pictures.as_written(figure)
    return Plot(figure)


def _bodies(mechanism: Mechanism) -> list[Outline]:
    """What has a shape, its kind and the points it is drawn through."""
    found = []
    for name, drawing in outlines(mechanism, _POINTS):
        if drawing.kind != "ground":
            points = np.array([place.point for place in drawing.places])
            found.append((name, drawing.kind, points[drawn_through(drawing.kind, len(points))]))
    return found


def _corners(mechanism: Mechanism, bodies: list[Outline]) -> tuple[Array, Array]:
    points = [points for _, _, points in bodies]
    points += [
        np.reshape(a.point, (1, 2)) for part in mechanism.parts.values() for a in part.attachments
    ]
    if not points:
        raise BeamdaeError("draw: the mechanism has no parts that could be drawn.")
    every = np.concatenate(points)
    low, high = every.min(axis=0), every.max(axis=0)
    if not np.any(high > low):
        return low - 0.5, high + 0.5
    return low, high


def _canvas(extent: Array) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = extent / np.max(extent)
    tall = float(np.clip(_WIDTH * (height + 0.25) / (width + 0.25), *_HEIGHT))
    figure = Figure(figsize=(_WIDTH, tall), layout="constrained")
    FigureCanvasAgg(figure)
    axis = figure.add_subplot()
    axis.set_aspect("equal", adjustable="datalim")
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.tick_params(labelsize=9)
    axis.grid(color="0.93", lw=0.6)
    axis.set_axisbelow(True)
    return figure, axis


def _body(name: str, kind: str, points: Array, pen: Pen) -> None:
    if kind == "point":
        pen.dot(points[0], "o", ms=8, mfc=pictures.COLORS[3], color=pictures.COLORS[3])
        pen.name(points[0], name)
        return
    color = pictures.COLORS[0] if kind == "beam" else pictures.COLORS[1]
    pen.line(points, color=color, lw=2.2 if kind == "beam" else 3.0, zorder=2)
    pen.name(points[len(points) // 2] if kind == "beam" else points.mean(axis=0), name)


def _gravity(gravity: Array, low: Array, high: Array, pen: Pen) -> None:
    """An arrow in the corner above, with its size."""
    along = gravity / np.hypot(*gravity)
    middle = np.array([high[0] + 3.0 * pen.size, high[1]])
    pen.arrow(middle - 2.0 * pen.size * along, middle + 2.0 * pen.size * along, color="0.55")
    pen.name(middle, f"{np.hypot(*gravity):g} m/s²")


def _names(pen: Pen, near: float) -> None:
    """Names beside their places, those of one place below each other."""
    groups: list[tuple[Array, list[str]]] = []
    for place, text in pen.names:
        at = np.array(place, float)
        for other, texts in groups:
            if np.hypot(*(at - other)) < near:
                texts.append(text)
                break
        else:
            groups.append((at, [text]))
    for at, texts in groups:
        pen.axis.annotate(
            "\n".join(shortened(text, _MOST) for text in texts),
            (float(at[0]), float(at[1])),
            xytext=(7.0, 6.0),
            textcoords="offset points",
            fontsize=8,
            color="0.25",
            parse_math=False,
            bbox={"fc": "white", "ec": "none", "alpha": 0.65, "pad": 0.5},
            zorder=6,
        )
