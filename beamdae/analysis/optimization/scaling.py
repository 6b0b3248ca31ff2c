"""Scaled functions of the variables of a search, from the values of designs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from beamdae.analysis.optimization.optimality import Linearization
from beamdae.analysis.optimization.problem import Design, DesignProblem

Array = np.ndarray

# Violation of a limit, relative to the limit, up to which a design satisfies it.
FEASIBILITY_TOLERANCE = 1e-6
# First values below this ratio to their change over the size of the numbers are rounding errors.
_MIN_RELATIVE_VALUE = 1e-8
_MIN_LOGARITHMIC_RATIO = 0.5  # of a value to its limit, from which on margins are logarithms


@dataclass(frozen=True, eq=False)
class ScaledProblem:
    """Problem in units in which its objective and its limits are near 1.

    Attributes
    ----------
    problem
        The problem.
    scales
        Units (1 + C,) of the objective and of the limited quantities.
    ratios
        Ratios (C,) of maxima to their limited smooth maxima by which these are multiplied; 1 for
        other quantities.
    """

    problem: DesignProblem
    scales: Array
    ratios: Array

    @classmethod
    def of(cls, problem: DesignProblem) -> ScaledProblem:
        """Return a problem whose limited quantities are in units of their limits."""
        scales = np.array([1.0, *(abs(x.bound) or 1.0 for x in problem.limits)])
        return cls(problem, scales, np.ones(len(problem.limits)))

    def scaled_by(self, first: Design) -> ScaledProblem:
        """Scale the objective and quantities with limits of zero by the values of a design.

        Values that are rounding errors are replaced by changes over the sizes of the numbers.
        """
        is_missing = np.array([True, *(x.bound == 0.0 for x in self.problem.limits)])
        changes = np.linalg.norm(first.gradients * self.problem.sizes, axis=1)
        is_small = np.abs(first.values) <= _MIN_RELATIVE_VALUE * changes
        values = np.where(is_small, changes, np.abs(first.values))
        return replace(self, scales=np.where(is_missing & (values > 0.0), values, self.scales))

    @property
    def tolerances(self) -> Array:
        """Scaled violations (C,) up to which a limit is satisfied."""
        return np.maximum(FEASIBILITY_TOLERANCE, self.problem.noise[1:])

    @property
    def signs(self) -> Array:
        """Derivatives (C,) of the excesses by values, both in units: 1 for upper limits, or -1."""
        return np.array([x.sign for x in self.problem.limits], float)

    def objective(self, values: Array) -> float:
        """Return the scaled objective for values (1 + C,) of a design."""
        return float(values[0] / self.scales[0])

    def margins(self, values: Array) -> Array:
        """Return the scaled margins (C,) of the limits; negative if these are violated."""
        bounds = np.array([x.bound for x in self.problem.limits])
        return self.signs * (bounds - self.ratios * values[1:]) / self.scales[1:]

    def violation(self, values: Array) -> float:
        """Return the largest violation, 0 within the tolerances, NaN for a failed design."""
        excess = -self.margins(values)
        return float(np.max(np.where(excess <= self.tolerances, 0.0, excess), initial=0.0))

    def log_margins(self, values: Array) -> tuple[Array, Array]:
        """Return the margins (C,) of which limits of magnitudes are logarithmic, and their slopes.

        Of a quantity whose magnitude r, relative to its limit, must not exceed 1, this is -ln(r)
        instead of 1 - r: stresses and deflections are nearly products of powers of thicknesses,
        whose logarithms are linear in those of the thicknesses. Below r = 1/2, the function
        continues as a straight line, because logarithms of small values diverge. The slopes are
        derivatives with respect to the margins.
        """
        margins, least = self.margins(values), _MIN_LOGARITHMIC_RATIO
        is_magnitude = self.signs * [x.bound for x in self.problem.limits] > 0.0
        ratio = np.maximum(1.0 - margins, least)
        logarithms = (least - 1.0 + margins).clip(0.0) / least - np.log(ratio)
        return np.where(is_magnitude, logarithms, margins), np.where(is_magnitude, 1 / ratio, 1.0)

    def linearize(self, numbers: Array, values: Array, is_logarithmic: bool) -> Linearization:
        """Return the functions of a design, linearized in the variables of the search.

        Raises
        ------
        BeamdaeError
            If quantities have no derivatives.
        """
        problem = self.problem
        rows = problem.design(numbers).gradients * problem.rates(numbers) / self.scales[:, None]
        margins, slopes = self.margins(values), np.ones(len(self.ratios))
        if is_logarithmic:
            margins, slopes = self.log_margins(values)
        here = problem.variables(numbers)
        bounds = (problem.variables(x) - here for x in (problem.lower, problem.upper))
        factors = -slopes * self.signs * self.ratios
        return Linearization(rows[0], margins, factors[:, None] * rows[1:], *bounds)
