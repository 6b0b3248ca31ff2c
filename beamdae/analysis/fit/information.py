"""Information of data on parameters: covariance and undetermined combinations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from beamdae.analysis.fit.problem import (
    MIN_SINGULAR_RATIO,
    Evaluation,
    FitProblem,
    Scaling,
)
from beamdae.analysis.fit.sensors import SCALE
from beamdae.read_only import read_only_data

Array = np.ndarray

# Combinations of relative changes of parameters with a larger standard deviation are undetermined.
MAX_RELATIVE_DEVIATION = 1.0
# Changes of parameters below this ratio to their first value are relative to the first value.
_MIN_RELATIVE_VALUE = 1e-3
# Parameters with smaller shares of a direction are not named.
_MIN_NAMED_SHARE = 0.05


@read_only_data
@dataclass(frozen=True, eq=False)
class Information:
    """Singular value decomposition of the Jacobian of the residuals.

    Attributes
    ----------
    jacobian
        Derivatives (n, k) of the residuals, in standard deviations, with respect to the parameters.
    sizes
        Sizes (k,) to which changes of the parameters are relative; 0 for fixed parameters.
    """

    jacobian: Array
    sizes: Array

    @cached_property
    def _decomposition(self) -> tuple[Array, Array]:
        # Rows of zeros complete the directions of few data.
        matrix = np.vstack([self.jacobian * self.sizes, np.zeros((len(self.sizes),) * 2)])
        return np.linalg.svd(matrix, full_matrices=False)[1:]

    @property
    def singular(self) -> Array:
        """Singular values (k,) for relative changes of the parameters, in descending order."""
        return self._decomposition[0]

    @property
    def directions(self) -> Array:
        """Orthonormal relative changes (k, k) of the parameters, one row per singular value."""
        return self._decomposition[1]

    @property
    def is_dependent(self) -> Array:
        """True (k,) for directions without an effect on the residuals."""
        return np.asarray(self.singular <= MIN_SINGULAR_RATIO * self.singular[0])

    @property
    def covariance(self) -> Array:
        """Covariance (k, k) of the parameters; undetermined ones have infinite variances."""
        with np.errstate(divide="ignore"):
            variances = np.where(self.is_dependent, 0.0, 1.0 / self.singular**2)
        covariance = (self.directions.T * variances) @ self.directions
        covariance *= np.outer(self.sizes, self.sizes)
        deviations = self.standard_deviations(np.eye(len(self.sizes)))
        covariance[np.diag_indices_from(covariance)] = deviations**2
        return np.asarray(covariance)

    def standard_deviations(self, derivatives: Array) -> Array:
        """Return the standard deviations (j,) of quantities with derivatives (j, k).

        They are infinite if a direction without an effect on the residuals changes the quantity.
        """
        along = (derivatives * self.sizes) @ self.directions.T
        largest = np.abs(along).max(axis=1, initial=0.0, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            terms = np.where(np.abs(along) > _MIN_NAMED_SHARE * largest, np.inf, 0.0)
            terms = np.where(self.is_dependent, terms, along / self.singular)
        return np.asarray(np.sqrt((terms**2).sum(axis=1)))

    def describe_undetermined(
        self, values: Mapping[str, float], units: Mapping[str, str]
    ) -> list[str]:
        """Return sentences on combinations of parameters that the data do not determine.

        Changes are relative to the values; those of parameters with another size have units.
        """
        sentences = []
        for s, direction, is_dependent in zip(
            self.singular, self.directions, self.is_dependent, strict=True
        ):
            if s * MAX_RELATIVE_DEVIATION >= 1.0 and not is_dependent:
                continue
            # The largest share is positive.
            largest = direction[np.argmax(np.abs(direction))]
            change = direction / largest * (0.01 if is_dependent else abs(largest) / s)
            shares = [
                f"{name} by {100.0 * x:+.3g} %"
                if size == abs(value)
                else f"{name} by {x * size:+.3g} {units[name]}".rstrip()
                for (name, value), size, x in zip(values.items(), self.sizes, change, strict=True)
                if abs(x) > _MIN_NAMED_SHARE * np.abs(change).max()
            ]
            effect = "lie within one standard deviation"
            effect = "do not change the fitted columns" if is_dependent else effect
            subject = "Changes of" if len(shares) == 1 else "Joint changes of"
            sentences.append(f"{subject} {', '.join(shares)} {effect}.")
        return sentences


def find_covariance(
    problem: FitProblem, scaling: Scaling, end: Evaluation, at_bounds: Array, sigma: float
) -> tuple[Information, Information, Array]:
    """Return the information on all estimates, that on free ones, and the covariance."""
    estimates, jacobian = end.estimates, end.jacobian / sigma
    # Changes are relative to the values, or to the first values near zero, or to typical sizes.
    typical = np.append(scaling.sizes, [x.size for x in problem.linear])
    has_size = np.isin(problem.estimated, [x.name for x in problem.sensors if x.kind != SCALE])
    is_small = has_size | (np.abs(estimates) < _MIN_RELATIVE_VALUE * typical)
    sizes = np.where(is_small, typical, np.abs(estimates))
    # The covariance of the others holds fixed what is at a bound or has no effect of its own.
    effects = np.linalg.norm(jacobian * np.maximum(sizes, typical), axis=0)
    is_fixed = effects * MAX_RELATIVE_DEVIATION < 1.0
    is_fixed[: len(at_bounds)] |= at_bounds
    whole, free = (Information(jacobian, x) for x in (sizes, np.where(is_fixed, 0.0, sizes)))
    covariance = free.covariance
    variances = np.where(is_fixed, np.diag(whole.covariance), np.diag(covariance))
    np.fill_diagonal(covariance, variances)
    return whole, free, covariance
