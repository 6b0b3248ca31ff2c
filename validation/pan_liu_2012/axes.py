"""The axes of the paper's figures, and what it takes for curves to fit one."""

from __future__ import annotations

from typing import Any

# (from, to, distance of the ticks)
FIGURE_5A = (-1.6e-4, 0.4e-4, 0.4e-4)
FIGURE_5B = (-0.5e-4, 0.1e-4, 0.1e-4)
FIGURE_5C = (-6.0, 6.0, 2.0)
FIGURE_6 = (-0.10, 0.10, 0.02)
FIGURE_7 = (-0.10, 0.12, 0.02)
FIGURE_9 = (-0.20, 0.20, 0.05)
FIGURE_10 = (-1.5, 1.5, 0.5)
Axis = tuple[float, float, float]


def fills(low: Any, high: Any, axis: Axis) -> Any:
    """Whether curves from `low` to `high` are what an axis was chosen for.

    Within it, by two percent of its length, and over at least 0.65 of it.
    """
    length = axis[1] - axis[0]
    within = (low >= axis[0] - 0.02 * length) & (high <= axis[1] + 0.02 * length)
    return within & (high - low >= 0.65 * length)
