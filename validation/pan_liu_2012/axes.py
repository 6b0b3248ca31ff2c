"""The axes of the paper's figures, and what it takes for curves to fit one."""

from __future__ import annotations

from typing import Any

import numpy as np

# (from, to, distance of the ticks)
FIGURE_5A = (-1.6e-4, 0.4e-4, 0.4e-4)
FIGURE_5B = (-0.5e-4, 0.1e-4, 0.1e-4)
FIGURE_5C = (-6.0, 6.0, 2.0)
FIGURE_6 = (-0.10, 0.10, 0.02)
FIGURE_7 = (-0.10, 0.12, 0.02)
FIGURE_9 = (-0.20, 0.20, 0.05)
FIGURE_10 = (-1.5, 1.5, 0.5)
Axis = tuple[float, float, float]

# Of the length of an axis: what is seen in the figure, and what curves should cover.
VISIBLE, COVERED = 0.02, 0.65
VISIBLE_TEXT = f"visible: over {VISIBLE:.0%} of the length of the figure's axis"
FILLS_TEXT = f"within the axis, by {VISIBLE:.0%} of its length, and over at least {COVERED:g} of it"


def fills(low: Any, high: Any, axis: Axis) -> Any:
    """Whether curves from `low` to `high` are what an axis was chosen for.

    Within it, but for what is not visible, and over at least 0.65 of it.
    """
    length = axis[1] - axis[0]
    inside = (low >= axis[0] - VISIBLE * length) & (high <= axis[1] + VISIBLE * length)
    return inside & (high - low >= COVERED * length)


def seen(one: Any, other: Any, axis: Axis) -> np.ndarray:
    """Difference of two curves over the length of the axis they are drawn to."""
    return np.abs(np.asarray(one) - np.asarray(other)) / (axis[1] - axis[0])
