"""Conditions of first order of a design, by nonnegative least squares.

The gradient g of the objective and multipliers l >= 0 of the margins m with the Jacobian J bound
the decrease of the linearized objective within a step d of length 1 that keeps the margins:

    -g d <= |g - J^T l| + l m    for all l >= 0.

It is zero if and only if the conditions of Karush, Kuhn and Tucker hold; the multipliers minimize
the sum of the squares of both terms (Lawson & Hanson, Solving Least Squares Problems, SIAM 1995,
chapter 23, doi:10.1137/1.9781611971217).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

Array = np.ndarray

# Decrease of the violation within a step of length 1, relative to the violation, below which no
# step reduces it.
_MIN_RELATIVE_DECREASE = 1e-2
_MIN_SHARE = 1e-3  # of the multiplier of a limit that blocks in the sum of all
_FAR = 1e3  # distance of bounds in steps of length 1


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

    def _balance(self, target: Array, margins: Array, total: float) -> tuple[float, Array]:
        """Return the bound of the decrease along a target (k,), and the multipliers (C,).

        `total` is the sum of the multipliers of the limits if it is not zero.
        """
        unit, count = np.eye(len(target)), len(margins)
        # Bounds that are far away, or infinite, have no effect.
        distances = np.concatenate([margins, -self.lower, self.upper]).clip(max=_FAR)
        columns = np.hstack([self.jacobian.T, unit, -unit])
        sums = bool(total) * (np.arange(len(distances)) < count)
        rows = np.vstack([columns, distances, sums])
        multipliers, _ = nnls(rows, np.append(target, [0.0, total]), maxiter=100 * len(distances))
        slope, gap, size = np.split(rows @ multipliers, [len(target), len(target) + 1])
        decrease = float(np.linalg.norm(target - slope) + gap[0])
        return decrease / (float(size[0]) if total else 1.0), multipliers[:count]

    def measure_decrease(self) -> tuple[float, Array]:
        """Return the possible decrease of the objective and the multipliers (C,) of the limits.

        Limits that are violated need not be satisfied, but must not become worse.
        """
        return self._balance(self.gradient, np.maximum(self.margins, 0.0), 0.0)

    def find_blocking(self) -> Array:
        """Return True (C,) for limits that contradict each other or the bounds near a design.

        There are none if a step of length 1 reduces the largest violation.
        """
        violation = float(np.max(-self.margins))
        nothing = np.zeros(len(self.gradient))
        decrease, multipliers = self._balance(nothing, self.margins + violation, 1.0)
        is_stuck = decrease <= _MIN_RELATIVE_DECREASE * violation
        return is_stuck & (multipliers > _MIN_SHARE)
