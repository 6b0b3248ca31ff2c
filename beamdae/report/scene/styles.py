"""How kinds of curves and symbols look."""

from __future__ import annotations

from typing import Any, NamedTuple

from beamdae.report.pictures.figures import COLORS

_BLUE, _ORANGE, _GREEN, _RED = COLORS[:4]
_CHAIN, _DOTS = (0, (6, 2, 1, 2)), (0, (1, 1.5))


class Look(NamedTuple):
    """Color, width [pt] and dashes of a line, what fills it, and what it lies over."""

    color: str
    width: float = 1.2
    dash: Any = "-"
    fill: str | None = None
    opacity: float = 1.0
    order: int = 3


LOOKS = {
    "ground": Look("0.5", 1.0, order=1),
    "guide": Look("0.55", 1.0, order=1),
    "surface": Look("0.45", 1.1, order=1),
    "gear": Look("0.4", 0.9, _CHAIN, order=1),
    "wheel": Look("0.3", 1.0, order=1),
    "trail": Look("0.45", 0.9, order=1),
    "rigid": Look(_ORANGE, 2.2, fill=_ORANGE, opacity=0.18, order=2),
    "beam": Look(_BLUE, 2.4, order=3),
    "link": Look("0.2", 1.2, _DOTS, order=3),
    "spring": Look(_GREEN, 1.3, order=3),
    "damper": Look("0.3", 1.3, order=3),
    "point": Look(_RED, 1.0, fill=_RED, order=4),
    "sleeve": Look("0.2", 1.1, fill="white", order=3),
    "joint": Look("0.2", 1.1, fill="white", order=5),
    "weld": Look("0.2", 1.1, fill="0.2", order=5),
    "skate": Look("0.2", 3.0, order=5),
    "contact": Look(_RED, 1.0, fill="white", order=5),
    "driver": Look("0.2", 1.3, order=5),
    "driver tip": Look("0.2", 1.0, fill="0.2", order=5),
    "load": Look(_RED, 1.5, order=6),
    "load tip": Look(_RED, 1.0, fill=_RED, order=6),
}
# Of what parts of the user's own draw.
OTHER = Look(_ORANGE, 1.2)


def look_of(kind: str) -> Look:
    """The look of a kind; of one that is not known that of a thin body."""
    return LOOKS.get(kind, OTHER)
