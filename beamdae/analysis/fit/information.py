"""Information of data on parameters: covariance and undetermined combinations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from beamdae.analysis.fit.problem import MIN_SINGULAR_RATIO, column_lengths
from beamdae.read_only import read_only_data

Array = np.ndarray

# Combinations of relative changes of parameters with a larger standard deviation are undetermined.
MAX_RELATIVE_DEVIATION = 1.0
# Singular values of the Jacobian with columns of unit length at which two estimates have a
# correlation of 0.99: s^2 = 1 - 0.99.
_MIN_INDEPENDENCE = 0.1
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
        _, singular, directions = np.linalg.svd(self.jacobian * self.sizes, full_matrices=False)
        return singular, directions

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
        # Parameters that take part in a direction without any effect are undetermined.
        shares = np.abs(self.directions[self.is_dependent]).max(axis=0, initial=0.0)
        for k in np.flatnonzero((shares > _MIN_NAMED_SHARE) & (self.sizes != 0.0)):
            covariance[k, k] = np.inf
        return np.asarray(covariance * np.outer(self.sizes, self.sizes))

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
        self, values: Mapping[str, float], units: Mapping[str, str], free: Information
    ) -> list[str]:
        """Return sentences on combinations of parameters that the data do not determine.

        Changes are relative to the values; those of parameters with another size have units.
        Correlations are those of `free`, in which some parameters are fixed.
        """
        sentences, named = [], []
        for s, direction, dependent in zip(
            self.singular, self.directions, self.is_dependent, strict=True
        ):
            if not dependent and s * MAX_RELATIVE_DEVIATION >= 1.0:
                continue
            # The largest share is positive.
            largest = direction[np.argmax(np.abs(direction))]
            change = direction / largest * (0.01 if dependent else abs(largest) / s)
            is_named = np.abs(direction / largest) > _MIN_NAMED_SHARE
            named.append(is_named)
            shares = [
                f"{name} by {100.0 * x:+.3g} %"
                if size == abs(value)
                else f"{name} by {x * size:+.3g} {units[name]}".rstrip()
                for (name, value), size, x, is_in in zip(
                    values.items(), self.sizes, change, is_named, strict=True
                )
                if is_in
            ]
            subject = "Changes of" if len(shares) == 1 else "Joint changes of"
            effect = "do not change the fitted columns"
            effect = effect if dependent else "lie within one standard deviation"
            sentences.append(f"{subject} {', '.join(shares)} {effect}.")
        for members, factor in free._correlated():
            if not any(np.all(x[members]) for x in named):
                *others, last = (x for x, is_in in zip(values, members, strict=True) if is_in)
                sentences.append(
                    f"The data hardly distinguish the effects of {', '.join(others)} and {last}: "
                    f"their standard deviations are up to {factor:.2g} times as large as if the "
                    "others were known."
                )
        return sentences

    def nonlinear(self) -> Array:
        """Return True (k,) for correlated parameters whose intervals may be far from linear.

        A change by one standard deviation d, relative to the parameter, changes the residuals by
        the ratio r of d to the deviation with all others known. Their curvature is about d r.
        """
        variances = np.diag(self.covariance) / np.where(self.sizes, self.sizes, 1.0) ** 2
        # Infinite intervals hold.
        variances = np.where(np.isfinite(variances), variances, 0.0)
        effects = np.sum((self.jacobian * self.sizes) ** 2, axis=0)
        is_correlated = np.zeros(len(self.sizes), bool)
        for members, _ in self._correlated():
            is_correlated |= members
        curvature = variances * np.sqrt(effects)
        return np.asarray(is_correlated & (curvature > MAX_RELATIVE_DEVIATION))

    def _correlated(self) -> list[tuple[Array, float]]:
        """Return the members (k,) of combinations with nearly dependent effects, and a factor.

        By this factor, at most, the standard deviation of a member with the others unknown is
        larger than with these known.
        """
        jacobian = self.jacobian * self.sizes
        lengths = column_lengths(jacobian)
        # The direction of a negligible effect is arbitrary.
        has_effect = np.linalg.norm(jacobian, axis=0) * MAX_RELATIVE_DEVIATION >= 1.0
        effects = jacobian / lengths * has_effect
        _, singular, directions = np.linalg.svd(effects, full_matrices=False)
        groups = []
        for s, direction in zip(singular, np.abs(directions), strict=True):
            members = has_effect & (direction > _MIN_NAMED_SHARE * direction.max())
            if s < _MIN_INDEPENDENCE and members.sum() > 1:
                inverse = np.linalg.pinv(effects[:, members], rcond=MIN_SINGULAR_RATIO)
                groups.append((members, float(np.linalg.norm(inverse, axis=1).max())))
        return groups
