"""Variables of the search of a fit: parameters on logarithmic or similar scales."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.analysis.fit.problem import FitProblem
from beamdae.analysis.parameter_bounds import (
    LOG_ORIGIN,
    ParameterScales,
    draw_starts,
    read_bounds,
)
from beamdae.errors import BeamdaeError, require_names, short_repr

Array = np.ndarray

# Logarithm of the ratio of the first value of a parameter that is not in `log` to those about zero
# where its variable is linear.
_ORIGIN = 5.3


class Scaling(ParameterScales):
    """Scales of the parameters (K,) of a fit; shifts and first values of zero are linear.

    `is_log` is True (K,) for parameters in `log`.
    """

    def __init__(self, problem: FitProblem, bounds: Any, log: Any) -> None:
        self._names, values, shifts = problem.variables, problem.first_values, problem.shifts
        first = dict(zip(problem.names, values.tolist(), strict=False))
        logarithmic = set(require_names("fit", "log", log, "a list of names of parameters"))
        ends = read_bounds("fit", bounds, first, problem.units) | {x.name: x.bounds for x in shifts}
        pairs = [np.ravel(ends.get(x, (-np.inf, np.inf))) for x in self._names]
        lower, upper = np.array(pairs).T
        for name in logarithmic:
            if name not in first:
                raise BeamdaeError(
                    f"fit: log contains {short_repr(name)}, which is not in by; name one of "
                    f"{', '.join(first)}."
                )
            low = float(lower[self._names.index(name)])
            if first[name] <= 0.0 or -np.inf < low < 0.0:
                raise BeamdaeError(
                    f"fit: the first value of {name} must be positive and its lower bound not "
                    f"negative because it is in log, got {first[name]:g} and {low:g}; pass others, "
                    f"or remove {name} from log."
                )
        self.is_log = np.isin(self._names, list(logarithmic))
        lower = np.where(self.is_log, np.maximum(lower, 0.0), lower)
        is_linear = (values == 0.0) | (np.arange(len(values)) >= len(first))
        origins = np.where(is_linear, 0.0, np.where(self.is_log, LOG_ORIGIN, _ORIGIN))
        sizes = np.array([*[1.0] * len(first), *(x.size for x in shifts)])
        super().__init__(values, sizes, origins, lower, upper)

    def draw_starts(self, count: int, seed: int) -> Array:
        """Return first values (count, K) of further searches; see `draw_starts`."""
        return draw_starts("fit", self._names, *self.bounds, count, seed, self.is_log)
