"""Profile likelihoods of parameters.

Their intervals contain the values of a parameter for which the sum of squares, with all other
parameters fitted again, exceeds its minimum by at most the square of a quantile (Venzon &
Moolgavkar, Appl. Stat. 37 (1988) 87, doi:10.2307/2347496).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from beamdae import deferred
from beamdae.analysis.fit.problem import Evaluation, FitProblem, Scaling
from beamdae.analysis.fit.search import SearchResult, local_search
from beamdae.errors import format_message, require_count
from beamdae.read_only import read_only_data
from beamdae.results.displays import HasTable, Plot

Array = np.ndarray

# Distance between values, relative to the half width of the interval on this side.
_STEP = 0.35
# First distance, relative to the value, of parameters without a finite interval. It doubles.
_FIRST_RELATIVE_STEP = 0.05
# Decrease of the sum of squares below that of the fit, in units of the variance, that belongs to
# another minimum. Ends of searches are up to 0.1 standard deviations from their minimum.
MAX_DECREASE = 0.1
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
    others: Mapping[str, Array]
    # Reasons why the lower and the upper limit were not found.
    _reasons: tuple[str, ...]

    def __repr__(self) -> str:
        low, high = self.interval
        return f"<Profile likelihood of {self.name}: 95 % interval {low:.6g} to {high:.6g}>"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings if the fit is at no minimum, or if a limit of the interval was not found."""
        sides = zip(("lower", "upper"), self.interval, self._reasons, strict=True)
        sentences = [
            f"profile: no {side} limit of {self.name} was found{reason}."
            for side, limit, reason in sides
            if np.isinf(limit)
        ]
        best = int(np.argmin(self.increases))
        if self.increases[best] < -MAX_DECREASE:
            sentences.append(
                f"profile: the sum of squares at {self.name} = {self.values[best]:.6g} is lower "
                "than that of the fit, so that the interval is unreliable; repeat the fit from "
                "there (parameters=)."
            )
        return tuple(sentences)

    def table(self) -> pd.DataFrame:
        """Return a table with one row per value of the parameter, (j,).

        The columns are the value, "increase of chi-square" [-], and the other parameters, which are
        fitted again for this value, in the units of the model.
        """
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
        return deferred.module("report.result_displays").draw_result(self)


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
    k, bounds, start = problem.variables.index(name), scaling.bounds, best.evaluation
    free = np.arange(len(start.values)) != k

    def follow(side: int, half_width: float) -> _Side:
        """Fit the others at values on one side until the increase exceeds the threshold."""
        points, change, halvings = [(0.0, start)], np.zeros_like(start.values), 0
        is_finite, step = np.isfinite(half_width) and half_width > 0.0, half_width * _STEP
        if not is_finite:
            step = _FIRST_RELATIVE_STEP * (abs(float(start.values[k])) or 1.0)
        while len(points) <= max_points:
            before, last = points[-1][0], points[-1][1].values
            value = float(np.clip(last[k] + side * step, *(x[k] for x in bounds)))
            if value == last[k]:
                return _Side(points, value)  # The bound limits the interval.
            # Extrapolated, because the best values of the others depend almost linearly on it.
            first = np.clip(last + change, *bounds)
            first[k] = value
            increase, message = np.inf, ""
            try:
                x = scaling.variables(first)
                end = local_search(problem, scaling, x, _MAX_EVALUATIONS, free).evaluation
                increase = (end.chi_square - best.chi_square) / variance
            except (ValueError, ArithmeticError) as rejection:
                message = format_message(rejection)
            if increase > _MAX_OVERSHOOT * quantile**2 and halvings < _MAX_HALVINGS:
                # The best values of others reach bounds, or the sum of squares is no parabola.
                halvings, step = halvings + 1, 0.5 * step
                continue
            if message:
                reason = (
                    f" before runs fail next to {last[k]:.6g} ({message}); the interval reaches"
                )
                return _Side(points, side * np.inf, f"{reason} at least there")
            points.append((increase, end))
            if increase >= quantile**2:
                # The root of the increase, which is linear for a linear model, is interpolated.
                roots = np.sqrt(np.maximum([before, increase], 0.0))
                return _Side(points, float(np.interp(quantile, roots, [last[k], value])))
            change, step = end.values - last, step * (1.0 if is_finite else 2.0)
        return _Side(points, side * np.inf, "; increase max_points, or measure more")

    below, above = (follow(*x) for x in zip((-1, 1), half_widths.tolist(), strict=True))
    points = [*below.points[:0:-1], *above.points]
    table = np.array([x.estimates for _, x in points])
    return ProfileLikelihood(
        name,
        table[:, k],
        np.array([x for x, _ in points]),
        quantile**2,
        (below.limit, above.limit),
        {x: table[:, j] for j, x in enumerate(problem.estimated) if j != k},
        (below.reason, above.reason),
    )


class _Side(NamedTuple):
    """Increases and fits from the estimate on to one side, and the limit there or a reason."""

    points: list[tuple[float, Evaluation]]
    limit: float
    reason: str = ""
