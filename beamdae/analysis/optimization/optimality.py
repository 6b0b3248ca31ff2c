"""Conditions of first order of a design, by linear programs within steps of one size.

The decrease of the linearized objective within a box is a measure of criticality: it is zero if and
only if the conditions of Karush, Kuhn and Tucker hold (Conn, Gould & Toint, Trust-Region Methods,
SIAM 2000, section 12.1.4, doi:10.1137/1.9780898719857). The dual variables are the multipliers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linprog

Array = np.ndarray

# Tolerances of linear programs, the smallest of HiGHS: those of searches are 1e-7 by default.
_OPTIONS: dict[str, Any] = {
    "primal_feasibility_tolerance": 1e-10,
    "dual_feasibility_tolerance": 1e-10,
}
# Relative decrease of the violation below which no step reduces it.
_MIN_RELATIVE_DECREASE = 1e-3


@dataclass(frozen=True)
class Linearization:
    """Scaled objective and margins of a design, linearized in the variables of the search.

    Attributes
    ----------
    gradient
        Gradient (k,) of the objective.
    margins, jacobian
        Margins (C,) of the limits, negative if these are violated, and their derivatives (C, k).
    lower, upper
        Distances (k,) to the bounds, not positive and not negative.
    """

    gradient: Array
    margins: Array
    jacobian: Array
    lower: Array
    upper: Array

    @property
    def box(self) -> Array:
        """Bounds (k, 2) of equal steps with the length of one size, within the bounds."""
        step = 1.0 / np.sqrt(len(self.gradient))
        return np.stack([np.clip(self.lower, -step, 0.0), np.clip(self.upper, 0.0, step)], axis=1)

    @property
    def free_decrease(self) -> float:
        """Decrease of the objective within the box without margins and bounds."""
        return float(np.sum(np.abs(self.gradient)) / np.sqrt(len(self.gradient)))


def measure_decrease(point: Linearization) -> tuple[float, Array]:
    """Return the possible decrease of the objective and the multipliers (C,) of the limits.

    Limits that are violated need not be satisfied, but must not become worse.
    """
    margins = np.maximum(point.margins, 0.0)
    value, multipliers = _minimize(point.gradient, point.jacobian, margins, point.box, 0.0)
    return max(0.0, -value), multipliers


def find_blocking(point: Linearization) -> Array:
    """Return True (C,) for limits that contradict each other or the bounds near a design.

    There are none if a step within the box reduces the largest violation.
    """
    violation = float(np.max(-point.margins))
    # The last variable is the remaining share of the violation.
    cost = np.append(np.zeros(len(point.gradient)), 1.0)
    matrix = np.hstack([point.jacobian, np.full((len(point.margins), 1), violation)])
    box = np.vstack([point.box, [0.0, np.inf]])
    share, weights = _minimize(cost, matrix, point.margins, box, 1.0)
    return (weights > 0.0) & (share >= 1.0 - _MIN_RELATIVE_DECREASE)


def _minimize(
    cost: Array, matrix: Array, margins: Array, box: Array, rest: float
) -> tuple[float, Array]:
    """Return the least cost x with margins + matrix x >= 0 in a box, and the dual variables.

    `rest` is the cost without a step, which is feasible.
    """
    size = float(np.max(np.abs(cost))) or 1.0
    rows = np.max(np.abs(matrix), axis=1, initial=0.0)
    rows[rows == 0.0] = 1.0
    # Larger margins cannot become zero in a box of at most one.
    distances = np.minimum(margins / rows, len(cost) + 1.0)
    program = linprog(cost / size, -matrix / rows[:, None], distances, bounds=box, options=_OPTIONS)
    if program.fun is None:
        # Rounding errors of rows with only this feasible step exceed the tolerances.
        return rest, np.zeros(len(margins))
    return size * float(program.fun), -size * np.asarray(program.ineqlin.marginals) / rows
