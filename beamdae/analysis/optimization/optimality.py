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

    def measure_decrease(self) -> tuple[float, Array]:
        """Return the possible decrease of the objective and the multipliers (C,) of the limits.

        Limits that are violated need not be satisfied, but must not become worse.
        """
        unit, margins = np.eye(len(self.gradient)), np.maximum(self.margins, 0.0)
        # Bounds that are far away, or infinite, have no effect.
        distances = np.concatenate([margins, -self.lower, self.upper]).clip(max=_FAR)
        rows = np.vstack([np.hstack([self.jacobian.T, unit, -unit]), distances])
        multipliers, _ = nnls(rows, np.append(self.gradient, 0.0), maxiter=100 * len(distances))
        *slope, gap = rows @ multipliers
        decrease = float(np.linalg.norm(self.gradient - slope) + gap)
        return decrease, multipliers[: len(margins)]
