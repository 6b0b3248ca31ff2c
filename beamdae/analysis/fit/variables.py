"""Variables of the search of a fit: parameters on logarithmic or similar scales."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.analysis.fit.problem import FitProblem
from beamdae.analysis.parameter_bounds import read_bounds, spread_starts
from beamdae.errors import BeamdaeError, require_names, short_repr

Array = np.ndarray

# Logarithm of the ratio of the first value of a parameter to those about zero where its variable is
# linear.
_LOG_ORIGIN = 5.3
# Distance from bounds at which a search begins, relative to their distance or to the first value.
_START_DISTANCE = 0.01


class Scaling:
    """Map between the variables x of the search and the values of the parameters.

    Variables are 1 at first values v0. They are 1 + log(v / v0) for parameters in `log`,
    1 + (v - v0) / size for shifts and first values of zero, and otherwise like logarithms, but
    linear through zero: 1 + asinh(v / v0 sinh(c)) - c.

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
        shifts = problem.sensors.shifts
        lower, upper = np.full((2, len(values)), [[-np.inf], [np.inf]])
        for k, shift in enumerate(shifts, len(names)):
            lower[k], upper[k] = shift.bounds
        for k, name in enumerate(names):
            first = float(values[k])
            if self.is_log[k]:
                lower[k] = 0.0
                if not first > 0.0:
                    raise BeamdaeError(
                        f"fit: the first value of {name} must be positive because it is in log, "
                        f"got {first:g}; pass parameters={{{name!r}: value}}."
                    )
            if name not in limits:
                continue
            least, most = (float(x[0]) for x in limits[name])
            if self.is_log[k] and -np.inf < least < 0.0:
                raise BeamdaeError(
                    f"fit: the lower bound of {name} must not be negative because it is in log, "
                    f"got {least:g}; raise the bound, or remove {name} from log."
                )
            lower[k], upper[k] = max(lower[k], least), most
        self.bounds = lower, upper
        self._values = values
        self._is_linear = (values == 0.0) | (np.arange(len(values)) >= len(names))
        sizes = [*np.ones(len(names)), *(x.size for x in shifts)]
        self.sizes = np.where(self._is_linear, sizes, np.abs(values))
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

    def distances(self, values: Array) -> tuple[Array, Array]:
        """Return the distances (K,) of values from their bounds, in first values or variables."""
        x = self.variables(values)
        below, above = (np.abs(values - bound) / self.sizes for bound in self.bounds)
        return np.minimum(below, x - self.limits[0]), np.minimum(above, self.limits[1] - x)

    def spread(self, count: int, seed: int) -> Array:
        """Return values (count, K) distributed evenly between bounds, or between their logarithms.

        See `spread_starts`.
        """
        with np.errstate(divide="ignore"):
            lower, upper = (np.where(self.is_log, np.log(np.abs(x)), x) for x in self.bounds)
        points = spread_starts(lower, upper, count, seed)
        return np.where(self.is_log, np.exp(np.where(self.is_log, points, 0.0)), points)

    def variables(self, values: Array) -> Array:
        """Return the variables of values (K,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(self._is_linear, values - self._values, values) / self.sizes
            logarithm = np.log(ratio)
        signed = np.arcsinh(np.sinh(_LOG_ORIGIN) * ratio) - np.sign(self._values) * _LOG_ORIGIN
        return 1.0 + np.where(self._is_linear, ratio, np.where(self.is_log, logarithm, signed))

    def values(self, x: Array) -> Array:
        """Return the values of the parameters at x."""
        ratio, _ = self._ratio(x)
        values = np.where(self._is_linear, self._values, 0.0) + self.sizes * ratio
        # Bounds are exact, as values at which profiles end.
        for limit, bound in zip(self.limits, self.bounds, strict=True):
            values = np.where(x == limit, bound, values)
        return values

    def derivatives(self, x: Array) -> Array:
        """Return the derivatives of the values with respect to x, (K,)."""
        return self.sizes * self._ratio(x)[1]

    def _ratio(self, x: Array) -> tuple[Array, Array]:
        """Return ratios of values to their sizes, and the derivatives of these."""
        change = x - 1.0
        # Long steps overflow: models reject infinite values.
        with np.errstate(over="ignore"):
            logarithm = np.exp(np.where(self.is_log, change, 0.0))
            shifted = change + np.sign(self._values) * _LOG_ORIGIN
            signed, slope = (f(shifted) / np.sinh(_LOG_ORIGIN) for f in (np.sinh, np.cosh))
        ratio = np.where(self._is_linear, change, np.where(self.is_log, logarithm, signed))
        slope = np.where(self._is_linear, 1.0, np.where(self.is_log, logarithm, slope))
        return ratio, slope
