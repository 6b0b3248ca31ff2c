"""Variables of the search of a fit: parameters on logarithmic or similar scales."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.analysis.fit.problem import FitProblem
from beamdae.analysis.parameter_bounds import read_bounds, spread_starts
from beamdae.errors import BeamdaeError, require_names, short_repr

Array = np.ndarray

# Logarithms of the ratios of the first value of a parameter to those about zero where its variable
# is linear, without `log` and with it.
_ORIGIN, _LOG_ORIGIN = 5.3, 30.0
# Distance from bounds at which a search begins, relative to their distance or to the first value.
_START_DISTANCE = 0.01


class Scaling:
    """Map between the variables x of the search and the values v of the parameters.

    Variables are 1 at first values v0. They are like logarithms, but linear through zero,
    1 + asinh(v / v0 sinh(c)) - c, within 1e-12 of v0 for parameters in `log`. Shifts and first
    values of zero are linear, 1 + (v - v0) / size.

    Attributes
    ----------
    first
        First variables (K,), inside the bounds.
    limits
        Lower and upper bounds of the variables, (K,) each.
    bounds
        Lower and upper bounds of the values, (K,) each.
    is_log
        True (K,) for parameters in `log`.
    sizes
        Absolute first values (K,), or typical sizes of shifts and of first values of zero.
    """

    def __init__(self, problem: FitProblem, bounds: Any, log: Any) -> None:
        names, values = problem.names, problem.first_values
        logarithmic = set(require_names("fit", "log", log, "a list of names of parameters"))
        for name in logarithmic - set(names):
            raise BeamdaeError(
                f"fit: log contains {short_repr(name)}, which is not in by; name one of "
                f"{', '.join(names)}."
            )
        first_values = dict(zip(names, values.tolist(), strict=False))
        limits = read_bounds("fit", bounds, first_values, problem.units)
        self.is_log = np.array([name in logarithmic for name in problem.variables])
        ends = [limits.get(x, (-np.inf, np.inf)) for x in names]
        ends += [x.bounds for x in problem.shifts]
        lower, upper = np.array([np.ravel(x) for x in ends]).T
        for k in np.flatnonzero(self.is_log):
            if not values[k] > 0.0:
                raise BeamdaeError(
                    f"fit: the first value of {names[k]} must be positive because it is in log, "
                    f"got {values[k]:g}; pass parameters={{{names[k]!r}: value}}."
                )
            if -np.inf < lower[k] < 0.0:
                raise BeamdaeError(
                    f"fit: the lower bound of {names[k]} must not be negative because it is in "
                    f"log, got {lower[k]:g}; raise the bound, or remove {names[k]} from log."
                )
        lower = np.where(self.is_log, np.maximum(lower, 0.0), lower)
        self.bounds = lower, upper
        self._values = values
        self._is_linear = (values == 0.0) | (np.arange(len(values)) >= len(names))
        sizes = [*np.ones(len(names)), *(x.size for x in problem.shifts)]
        self.sizes = np.where(self._is_linear, sizes, np.abs(values))
        self._origins = np.where(self.is_log, _LOG_ORIGIN, _ORIGIN)
        self.limits = self.variables(lower), self.variables(upper)
        self.first = self.start(values)

    def start(self, values: Array) -> Array:
        """Return the variables at which a search from values (K,) begins, inside the bounds."""
        return self.inside(self.variables(values))

    def inside(self, x: Array) -> Array:
        """Return variables (K,) inside the bounds: searches do not continue from a bound."""
        lower, upper = self.limits
        distance = _START_DISTANCE * np.minimum(upper - lower, 1.0)
        return np.clip(x, lower + distance, upper - distance)

    def spread(self, count: int, seed: int) -> Array:
        """Return values (count, K) distributed evenly between bounds, or between their logarithms.

        See `spread_starts`.
        """
        points = spread_starts(*self.ranges, count, seed)
        return np.where(self.is_log, np.exp(np.where(self.is_log, points, 0.0)), points)

    @property
    def ranges(self) -> tuple[Array, Array]:
        """Ends (K,) between which starts are distributed: bounds, or their logarithms in `log`."""
        with np.errstate(divide="ignore"):
            lower, upper = (np.where(self.is_log, np.log(np.abs(x)), x) for x in self.bounds)
        return lower, upper

    def variables(self, values: Array) -> Array:
        """Return the variables of values (K,)."""
        ratio = np.sinh(self._origins) * values / self.sizes
        logarithm = np.arcsinh(ratio) - np.sign(self._values) * self._origins
        linear = (values - self._values) / self.sizes
        return 1.0 + np.where(self._is_linear, linear, logarithm)

    def values(self, x: Array) -> Array:
        """Return the values of the parameters at x."""
        values = self._values + self.sizes * (x - 1.0)
        values = np.where(self._is_linear, values, self.sizes * self._ratio(np.sinh, x))
        # Bounds are exact, as values at which profiles end.
        for limit, bound in zip(self.limits, self.bounds, strict=True):
            values = np.where(x == limit, bound, values)
        return values

    def derivatives(self, x: Array) -> Array:
        """Return the derivatives of the values with respect to x, (K,)."""
        return self.sizes * np.where(self._is_linear, 1.0, self._ratio(np.cosh, x))

    def _ratio(self, function: Any, x: Array) -> Array:
        # Long steps overflow: models reject infinite values.
        with np.errstate(over="ignore"):
            changed = function(x - 1.0 + np.sign(self._values) * self._origins)
            return np.asarray(changed / np.sinh(self._origins))
