"""Profile likelihoods: the best sum of squares as a function of one parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from beamdae.analysis.fit.problem import FitProblem, Scaling
from beamdae.analysis.fit.search import SearchResult, search
from beamdae.errors import format_message, require_count
from beamdae.read_only import read_only_data
from beamdae.results.displays import HasTable, Plot, load_views

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Distance between values, relative to the half width of the interval on this side.
_STEP = 0.35
# First distance, relative to the value, of parameters without a finite interval. It doubles.
_FIRST_RELATIVE_STEP = 0.05
# Decrease of the sum of squares below that of the fit, in units of the variance, that belongs to
# another minimum. Ends of searches are up to 0.1 standard deviations from their minimum.
_MAX_DECREASE = 0.1
# More points mean that the sum of squares hardly depends on the parameter.
_MAX_POINTS = 1000
# Increases at the first value beyond a limit, relative to the threshold, for which the limit may be
# interpolated.
_MAX_OVERSHOOT = 2.0
# Times that a step is halved to approach values that the model rejects, or a limit.
_MAX_HALVINGS = 6
# Evaluations of each fit of the other parameters, at most. It starts at the neighboring value.
_MAX_EVALUATIONS = 20


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class ProfileLikelihood(HasTable):
    """Profile likelihood of a parameter; see `Fit.profile`.

    Attributes
    ----------
    name
        Name of the parameter.
    values
        Values of the parameter (j,), ascending.
    increases
        Increase (j,) of the sum of squares over its minimum, with all other parameters fitted; in
        units of the variance of the errors if `sigma` was estimated. About the square of the
        distance from the estimate in standard deviations.
    threshold
        Increase at the limits of the 95 % interval.
    interval
        Limits of the 95 % interval: a bound of the parameter if the interval reaches it, infinite
        if no limit was found.
    others
        Values (j,) of the other parameters by name.
    """

    name: str
    values: Array
    increases: Array
    threshold: float
    interval: tuple[float, float]
    others: Mapping[str, Array] = field(repr=False)
    # Last values that the model accepts, and its messages, by side.
    _failures: Mapping[str, tuple[float, str]] = field(default_factory=dict, repr=False)
    # Reason why the search of the fit ended before a minimum, or "".
    _fit_failure: str = field(default="", repr=False)

    def __repr__(self) -> str:
        low, high = self.interval
        return f"<Profile likelihood of {self.name}: 95 % interval {low:.6g} to {high:.6g}>"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings if the fit is at no minimum, or if a limit of the interval was not found."""
        sentences = []
        best = int(np.argmin(self.increases))
        if self._fit_failure:
            sentences.append(
                f"profile: the fit did not converge ({self._fit_failure}), so that increases are "
                "not those over a minimum and the interval is unreliable; repeat the fit first."
            )
        elif self.increases[best] < -_MAX_DECREASE:
            sentences.append(
                f"profile: the sum of squares at {self.name} = {self.values[best]:.6g} is lower "
                "than that of the fit, so that the interval is unreliable; repeat the fit from "
                "there (parameters=)."
            )
        limits = dict(zip(("lower", "upper"), self.interval, strict=True))
        sides = [side for side, limit in limits.items() if np.isinf(limit)]
        sentences += [
            f"profile: no {side} limit of {self.name} was found before runs fail next to "
            f"{self._failures[side][0]:.6g} ({self._failures[side][1]}); the interval reaches at "
            "least there."
            for side in sides
            if side in self._failures
        ]
        others = [side for side in sides if side not in self._failures]
        if others:
            sentences.append(
                f"profile: no {' and no '.join(others)} limit of {self.name} was found; increase "
                "max_points, or measure more."
            )
        return tuple(sentences)

    def table(self) -> pd.DataFrame:
        """Return a table with one row per value of the parameter, (j,).

        The columns are the value, "increase of chi-square" [-], and the other parameters, which are
        fitted again for this value, in the units of the model.
        """
        import pandas as pd

        return pd.DataFrame(
            {self.name: self.values, "increase of chi-square": self.increases, **self.others}
        )

    def plot(self) -> Plot:
        """Plot the increase of the sum of squares over the parameter, with the threshold.

        Returns
        -------
        Plot
            The figure, displayed by a notebook; `Plot.save` writes it to a file.
        """
        return load_views().plot_profile(self)


def trace_profile(
    problem: FitProblem,
    scaling: Scaling,
    best: SearchResult,
    name: str,
    half_widths: Array,
    variance: float,
    quantile: float,
    max_points: int,
) -> ProfileLikelihood:
    """Return the profile likelihood of a variable.

    Parameters
    ----------
    problem, scaling, best
        The problem, its variables and the result of its search.
    name
        Name of the variable.
    half_widths
        Widths (2,) of the interval of the linearized fit below and above the estimate, which may
        be infinite.
    variance
        Variance of the errors in units of the residuals.
    quantile
        Half width of 95 % intervals in standard deviations.
    max_points
        Maximum number of values on each side, at most 1000.
    """
    max_points = require_count("profile", "max_points", max_points, most=_MAX_POINTS)
    k = problem.variables.index(name)
    names = (*problem.variables, *problem.coefficients)
    free = ~np.isin(problem.variables, [name])
    threshold = quantile**2
    estimate = best.evaluation.values
    lower, upper = (x[k] for x in scaling.bounds)

    def point(result: SearchResult) -> tuple[float, float, Array]:
        evaluation = result.evaluation
        increase = (result.chi_square - best.chi_square) / variance
        all_values = np.concatenate([evaluation.values, evaluation.coefficients])
        return float(evaluation.values[k]), increase, all_values

    center = point(best)
    branches = []
    limits = []
    failures: dict[str, tuple[float, str]] = {}
    sides = ("lower", -1.0, lower), ("upper", 1.0, upper)
    for (label, side, bound), half_width in zip(sides, half_widths.tolist(), strict=True):
        halvings = 0
        points, last, change = [center], estimate, np.zeros_like(estimate)
        step = half_width * _STEP
        if not np.isfinite(step) or step == 0.0:
            step = _FIRST_RELATIVE_STEP * (abs(estimate[k]) or 1.0)
        limit = side * np.inf
        while len(points) <= max_points:
            value = points[-1][0] + side * step
            value = max(value, bound) if side < 0.0 else min(value, bound)
            if value == points[-1][0]:
                # At the bound, which limits the interval.
                limit = bound
                break
            # Extrapolated, because the best values of the others depend almost linearly on it.
            first = np.clip(last + change, *scaling.bounds)
            first[k] = value
            try:
                result = search(problem, scaling, scaling.variables(first), _MAX_EVALUATIONS, free)
            except (ValueError, ArithmeticError) as rejection:
                # The model rejects the value.
                halvings += 1
                if halvings > _MAX_HALVINGS:
                    failures[label] = points[-1][0], format_message(rejection)
                    break
                step *= 0.5
                continue
            reached = point(result)
            if reached[1] > _MAX_OVERSHOOT * threshold and halvings < _MAX_HALVINGS:
                # The best values of others reach bounds, or the sum of squares is no parabola.
                halvings += 1
                step *= 0.5
                continue
            change, last = result.evaluation.values - last, result.evaluation.values
            points.append(reached)
            if points[-1][1] >= threshold:
                limit = _cross(points[-2], points[-1], threshold)
                break
            if not np.isfinite(half_width):
                step *= 2.0
        branches.append(points[1:])
        limits.append(float(limit))
    rows = [*branches[0][::-1], center, *branches[1]]
    table = np.array([row[2] for row in rows])
    return ProfileLikelihood(
        name,
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]),
        threshold,
        (limits[0], limits[1]),
        {other: table[:, j] for j, other in enumerate(names) if other != name},
        failures,
        "" if best.status.success else best.status.sentence,
    )


def _cross(
    before: tuple[float, float, Array], after: tuple[float, float, Array], threshold: float
) -> float:
    """Return the value at which the increase is at the threshold.

    The root of the increase, which is linear for a linear model, is interpolated.
    """
    roots = np.sqrt(np.maximum([before[1], after[1]], 0.0))
    return float(np.interp(np.sqrt(threshold), roots, [before[0], after[0]]))
