"""How kinds of curves and symbols look."""

from __future__ import annotations

from typing import Any, NamedTuple

from beamdae.report.pictures.figures import COLORS

_BLUE, _ORANGE, _GREEN, _RED = COLORS[:4]
_CHAIN, _DOTS = (0, (6, 2, 1, 2)), (0, (1, 1.5))


class LineStyle(NamedTuple):
    """Color, width [pt] and dashes of a line, what fills it, and what it lies over."""

    color: str
    width: float = 1.2
    dash: Any = "-"
    fill: str | None = None
    opacity: float = 1.0
    order: int = 3


STYLES = {
    "ground": LineStyle("0.5", 1.0, order=1),
    "guide": LineStyle("0.55", 1.0, order=1),
    "surface": LineStyle("0.45", 1.1, order=1),
    "gear": LineStyle("0.4", 0.9, _CHAIN, order=1),
    "wheel": LineStyle("0.3", 1.0, order=1),
    "trail": LineStyle("0.45", 0.9, order=1),
    "rigid": LineStyle(_ORANGE, 2.2, fill=_ORANGE, opacity=0.18, order=2),
    "beam": LineStyle(_BLUE, 2.4, order=3),
    "link": LineStyle("0.2", 1.2, _DOTS, order=3),
    "spring": LineStyle(_GREEN, 1.3, order=3),
    "damper": LineStyle("0.3", 1.3, order=3),
    "point": LineStyle(_RED, 1.0, fill=_RED, order=4),
    "sleeve": LineStyle("0.2", 1.1, fill="white", order=3),
    "joint": LineStyle("0.2", 1.1, fill="white", order=5),
    "weld": LineStyle("0.2", 1.1, fill="0.2", order=5),
    "skate": LineStyle("0.2", 3.0, order=5),
    "contact": LineStyle(_RED, 1.0, fill="white", order=5),
    "driver": LineStyle("0.2", 1.3, order=5),
    "driver tip": LineStyle("0.2", 1.0, fill="0.2", order=5),
    "load": LineStyle(_RED, 1.5, order=6),
    "load tip": LineStyle(_RED, 1.0, fill=_RED, order=6),
}
# Of what parts of the user's own draw.
OTHER = LineStyle(_ORANGE, 1.2)


def find_style(kind: str) -> LineStyle:
    """The look of a kind; of one that is not known that of a thin body."""
    return STYLES.get(kind, OTHER)
