"""Scaled functions of the variables of a search, from the values of designs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from beamdae.analysis.optimization.optimality import Linearization
from beamdae.analysis.optimization.problem import Design, DesignProblem
from beamdae.analysis.optimization.search_result import Trial

Array = np.ndarray

# Violation of a limit, relative to the limit, up to which a design satisfies it.
FEASIBILITY_TOLERANCE = 1e-6
# First values below this ratio to their change over the size of the numbers are rounding errors.
_MIN_RELATIVE_VALUE = 1e-8
_MIN_LOGARITHMIC_RATIO = 0.5  # of a value to its limit, from which on margins are logarithms


class Scaling:
    """Units of the objective and of the limited quantities, and margins of the limits.

    Attributes
    ----------
    scales
        Units (1 + C,) of the objective and of the limited quantities.
    ratios
        Factors (C,) of limited smooth maxima, 1 for other quantities.
    tolerances
        Scaled violations (C,) up to which a limit is satisfied.
    """

    def __init__(self, problem: DesignProblem) -> None:
        self._limits = problem.limits
        self.scales = np.array([1.0, *(abs(x.bound) or 1.0 for x in problem.limits)])
        self.ratios = np.ones(len(problem.limits))
        self.tolerances = np.maximum(FEASIBILITY_TOLERANCE, problem.noise[1:])

    def scale_to(self, first: Design, sizes: Array) -> None:
        """Scale the objective and limits of zero by the values of a design; others by their bounds.

        Values that are rounding errors are replaced by changes over the sizes (k,) of the numbers.
        """
        is_missing = np.array([True, *(x.bound == 0.0 for x in self._limits)])
        changes = np.linalg.norm(first.gradients * sizes, axis=1)
        is_small = np.abs(first.values) <= _MIN_RELATIVE_VALUE * changes
        values = np.where(is_small, changes, np.abs(first.values))
        self.scales = np.where(is_missing & (values > 0.0), values, self.scales)

    def margins(self, values: Array) -> Array:
        """Return the scaled margins (C,) of the constraints for values (1 + C,) of a design."""
        rows = zip(self._limits, self.ratios.tolist(), values[1:].tolist(), strict=True)
        margins = [limit.margin(ratio * value) for limit, ratio, value in rows]
        return np.array(margins) / self.scales[1:]

    def transform(self, values: Array, of_violation: bool) -> tuple[Array, Array]:
        """Return the margins (C,) that the solver sees, and their derivatives by scaled margins.

        Of a quantity whose magnitude r, relative to its limit, must not exceed 1, this is -ln(r)
        instead of 1 - r: stresses and deflections are nearly products of powers of thicknesses,
        whose logarithms are linear in those of the thicknesses. Below r = 1/2, the function
        continues as a straight line, because logarithms of small values diverge. Violations are
        minimized as they are.
        """
        margins, limits = self.margins(values), self._limits
        is_magnitude = np.array([limit.sign * limit.bound > 0.0 for limit in limits], bool)
        is_magnitude &= not of_violation
        ratio = np.maximum(1.0 - margins, _MIN_LOGARITHMIC_RATIO)
        line = (_MIN_LOGARITHMIC_RATIO - (1.0 - margins)).clip(0.0) / _MIN_LOGARITHMIC_RATIO
        transformed = np.where(is_magnitude, line - np.log(ratio), margins)
        return transformed, np.where(is_magnitude, 1.0 / ratio, 1.0)

    def rate(self, trial: Trial) -> Trial:
        """Return a design with its violation by the present ratios of maxima."""
        if trial.failure:
            return trial
        excess = -self.margins(trial.values)
        violation = np.max(excess[excess > self.tolerances], initial=0.0)
        return replace(trial, violation=float(violation))

    def linearize(self, problem: DesignProblem, trial: Trial, of_violation: bool) -> Linearization:
        """Return the linearized functions of a design; see `transform`.

        Raises
        ------
        BeamdaeError
            If quantities have no derivatives.
        """
        rates = problem.design(trial.numbers).gradients * problem.rates(trial.numbers)
        rows = rates / self.scales[:, None]
        margins, slopes = self.transform(trial.values, of_violation)
        signs = self.ratios * [limit.sign for limit in self._limits]
        bounds = (problem.variables(x) for x in (problem.lower, problem.upper))
        distances = (x - problem.variables(trial.numbers) for x in bounds)
        return Linearization(rows[0], margins, -(slopes * signs)[:, None] * rows[1:], *distances)
