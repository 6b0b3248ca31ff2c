"""What drawings are drawn with: lines, arrows, dots and supports in sizes of the symbols."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.report.pictures import COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = np.ndarray
Place = Sequence[float] | Array

JOINT, SPRING, LOAD = "0.2", COLORS[2], COLORS[3]


@dataclass
class Pen:
    """Draws on an axis in sizes of the symbols, and remembers what it was to name.

    Attributes
    ----------
    axis
        Of the picture.
    size
        Of a symbol [m].
    names
        Place and text of each name.
    """

    axis: Axes
    size: float
    names: list[tuple[Place, str]] = field(default_factory=list)

    def name(self, at: Place, text: str) -> None:
        """Have a name beside a place."""
        self.names.append((at, text))

    def line(self, points: Iterable[Place], **style: Any) -> None:
        """Lines through points."""
        x, y = np.array([tuple(p) for p in points], float).T
        self.axis.plot(x, y, **{"color": JOINT, "lw": 1.2, "solid_capstyle": "round", **style})

    def arrow(self, start: Place, end: Place, **style: Any) -> None:
        """An arrow."""
        look = {"arrowstyle": "-|>", "color": LOAD, "lw": 1.4, "shrinkA": 0.0, "shrinkB": 0.0}
        (x, y), (from_x, from_y) = (map(float, at) for at in (end, start))
        self.axis.annotate("", (x, y), (from_x, from_y), arrowprops={**look, **style})
        # An annotation does not widen what is seen.
        self.axis.plot([from_x, x], [from_y, y], alpha=0.0)

    def turn(self, at: Place, size: float, sign: float = 1.0, **style: Any) -> None:
        """An arrow around a place, counter-clockwise for a positive sign."""
        angles = sign * np.linspace(-0.25 * math.pi, 1.15 * math.pi, 30)
        arc = np.array(at) + size * np.array([np.cos(angles), np.sin(angles)]).T
        self.line(arc[:-3], **{"color": LOAD, "lw": 1.4, **style})
        self.arrow(arc[-4], arc[-1], **style)

    def circle(self, at: Place, radius: float, **style: Any) -> None:
        """A circle."""
        angles = np.linspace(0.0, 2.0 * math.pi, 60)
        self.line(np.array(at) + radius * np.array([np.cos(angles), np.sin(angles)]).T, **style)

    def dot(self, at: Place, marker: str, **style: Any) -> None:
        """A marker of matplotlib."""
        look = {"marker": marker, "ms": 6, "color": JOINT, "mfc": "white", "ls": "none"}
        self.axis.plot(*([float(x)] for x in at), **{**look, "zorder": 5, **style})

    def support(self, at: Place) -> None:
        """The ground under a place."""
        x, y = map(float, at)
        half, below = 0.9 * self.size, y - 1.1 * self.size
        self.line([(x, y), (x - 0.7 * half, below), (x + 0.7 * half, below), (x, y)], color="0.5")
        self.line([(x - 1.2 * half, below), (x + 1.2 * half, below)], color="0.5")
        for k in range(5):
            foot = x + (k - 1.8) * 0.55 * half
            hatch = [(foot, below), (foot - 0.35 * half, below - 0.35 * half)]
            self.line(hatch, color="0.5", lw=0.8)
