"""Objective and constraints of a design as functions of the numbers in the parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import nnls

from beamdae.analysis.gradients.flat_model import FlatModel, flatten_model
from beamdae.analysis.gradients.gradients import DEFAULT_METHOD
from beamdae.analysis.gradients.objectives import AnalysisQuantity, Objective, Quantity
from beamdae.analysis.optimization.analyses import (
    Analysis,
    DesignModel,
    RunSettings,
    create_analysis,
)
from beamdae.analysis.optimization.quantities import (
    Limit,
    as_quantity,
)
from beamdae.analysis.parameter_bounds import LOG_ORIGIN, ParameterScales, read_bounds
from beamdae.errors import (
    BeamdaeError,
    list_first,
    require_sequence,
    short_repr,
)
from beamdae.integrators.integrator import Integrator
from beamdae.model_functions import transform_mechanisms
from beamdae.model_parameters import parse_unit, split_unit
from beamdae.simulation import silenced

Array = np.ndarray

_FAR = 1e3  # distance of bounds in steps of length 1


@dataclass(frozen=True)
class Linearization:
    """Scaled objective and margins of a design, linearized in the variables of the search.

    The gradient g of the objective and multipliers l >= 0 of the margins m with the Jacobian J
    bound the decrease of the linearized objective within a step d of length 1 that keeps the
    margins:

        -g d <= |g - J^T l| + l m    for all l >= 0.

    It is zero if and only if the conditions of Karush, Kuhn and Tucker hold; the multipliers
    minimize the sum of the squares of both terms (Lawson & Hanson, Solving Least Squares Problems,
    SIAM 1995, chapter 23, doi:10.1137/1.9781611971217).

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


# Violation of a limit, relative to the limit, up to which a design satisfies it.
FEASIBILITY_TOLERANCE = 1e-6
# First values below this ratio to their change over the size of the numbers are rounding errors.
_MIN_RELATIVE_VALUE = 1e-8
_MIN_LOGARITHMIC_RATIO = 0.5  # of a value to its limit, from which on margins are logarithms
_NAME = "optimize"
# Designs whose analyses are kept: the current one, the one of the last gradient and a trial.
_KEPT_DESIGNS = 3


@dataclass(eq=False)
class Design:
    """Model at values of its parameters, with the analyses that its quantities need.

    Attributes
    ----------
    flat
        The model.
    analyses
        Analyses by their kind and arguments.
    values
        Values (1 + C,) of the objective and of the quantities of the C constraints.
    weights
        Derivatives of these values with respect to the results of the analyses.
    """

    flat: FlatModel
    analyses: dict[tuple[str, ...], Analysis]
    values: Array
    weights: list[dict[AnalysisQuantity, float]]

    @property
    def results(self) -> tuple[Any, ...]:
        """Results of the analyses."""
        return tuple(x.result for x in self.analyses.values() if x.result is not None)

    @cached_property
    def gradients(self) -> Array:
        """Gradients (1 + C, k) of the values with respect to the numbers of the model."""
        rows = []
        for weights in self.weights:
            with silenced():
                parts = [
                    self.analyses[key].gradient({x: weights[x] for x in leaves})
                    for key, leaves in group_by_analysis(weights).items()
                ]
            rows.append(np.sum(parts, axis=0))
            if not np.all(np.isfinite(rows[-1])):
                raise BeamdaeError(
                    f"{_NAME}: the gradient of {list_first([x.label for x in weights])} of "
                    f"{self.flat.name} is not finite; check the model and its functions near these "
                    "values of the parameters (a branch point needs an imperfection)."
                )
        return np.array(rows)

    def maximum_ratio(self, limit: Limit, value: float) -> float:
        """Return the ratio of a quantity of maxima to that of smooth maxima, the value; at least 1.

        It is 1 for lower limits of magnitudes, and for quantities without smooth maxima.
        """
        if min(limit.sign * value, limit.sign * limit.bound) <= 0.0:
            return 1.0
        quantity, maxima = limit.quantity, dict[AnalysisQuantity, float]()
        for key in {x.analysis for x in quantity.leaves}:
            analysis = self.analyses[key]
            maxima |= analysis.maxima() if analysis.maxima else analysis.values
        return max(1.0, quantity.differentiate(maxima)[0] / value)


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Objective and constraints as functions of the numbers in the parameters of a model.

    Attributes
    ----------
    flat
        The model at the first values of the parameters.
    objective, limits
        Objective and constraints.
    lower, upper
        Bounds (k,) of the numbers.
    settings
        Arguments of runs.
    scales
        Units (1 + C,) in which the objective and the limited quantities are near 1.
    ratios
        Ratios (C,) of maxima to their limited smooth maxima by which these are multiplied; 1 for
        other quantities.
    """

    flat: FlatModel
    objective: Quantity
    limits: tuple[Limit, ...]
    lower: Array
    upper: Array
    settings: RunSettings
    scales: Array
    ratios: Array
    _designs: dict[bytes, Design] = field(default_factory=dict)

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """The objective and the limited quantities."""
        return (self.objective, *(x.quantity for x in self.limits))

    @property
    def leaves(self) -> list[AnalysisQuantity]:
        """The results of analyses of which the quantities are functions."""
        return [leaf for quantity in self.quantities for leaf in quantity.leaves]

    @property
    def names(self) -> list[str]:
        """Names of the numbers, such as "E" and "thickness[3]"."""
        return list(self.flat.entries)

    @property
    def units(self) -> dict[str, str]:
        """Units of the numbers; "" if a unit is unknown."""
        described = self.flat.whole.parameter_info
        return {name: described[key].unit for name, (key, _) in self.flat.entries.items()}

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of runs and paths in the objective and the constraints."""
        names = (getattr(leaf, "column", "") for leaf in self.leaves)
        return tuple(dict.fromkeys(filter(None, names)))

    @cached_property
    def first(self) -> Array:
        """First values (k,) of the numbers."""
        return np.array(list(self.flat.parameters.values()))

    @cached_property
    def sizes(self) -> Array:
        """Sizes (k,) of the numbers: those of the parameters, at most those of the bounds."""
        keys = np.array([key for key, _ in self.flat.entries.values()])
        sizes = np.array([np.max(np.abs(self.first[keys == key])) for key in keys])
        ranges = self.upper - self.lower
        sizes = np.where(sizes > 0.0, np.minimum(sizes, ranges), ranges)
        return np.where(np.isfinite(sizes), sizes, 1.0)

    @cached_property
    def noise(self) -> Array:
        """Relative sizes (1 + C,) of jumps of the values between designs: `rtol` of runs, or 0.

        Values of runs with adaptive steps jump where the steps of two designs differ.
        """
        name, value = (self.settings.integrator or DEFAULT_METHOD).accuracy
        has_runs = [any(isinstance(y, Objective) for y in x.leaves) for x in self.quantities]
        return np.where(has_runs, value if name == "rtol" else 0.0, 0.0)

    @cached_property
    def variables(self) -> ParameterScales:
        """Variables of the search: like logarithms of numbers with a positive lower bound.

        Products of powers are linear in logarithms.
        """
        origins = np.where(self.lower > 0.0, LOG_ORIGIN, 0.0)
        return ParameterScales(self.first, self.sizes, origins, self.lower, self.upper)

    def scaled_by(self, first: Design) -> DesignProblem:
        """Scale the objective and quantities with limits of zero by the values of a design.

        Values that are rounding errors are replaced by changes over the sizes of the numbers.
        """
        is_missing = np.array([True, *(x.bound == 0.0 for x in self.limits)])
        changes = np.linalg.norm(first.gradients * self.sizes, axis=1)
        is_small = np.abs(first.values) <= _MIN_RELATIVE_VALUE * changes
        values = np.where(is_small, changes, np.abs(first.values))
        return replace(self, scales=np.where(is_missing & (values > 0.0), values, self.scales))

    @property
    def tolerances(self) -> Array:
        """Scaled violations (C,) up to which a limit is satisfied."""
        return np.maximum(FEASIBILITY_TOLERANCE, self.noise[1:])

    @property
    def _signs(self) -> Array:
        """1 for upper limits, -1 for lower ones, (C,)."""
        return np.array([x.sign for x in self.limits], float)

    def margins(self, values: Array) -> Array:
        """Return the scaled margins (C,) of the limits; negative if these are violated."""
        bounds = np.array([x.bound for x in self.limits])
        return self._signs * (bounds - self.ratios * values[1:]) / self.scales[1:]

    def violation(self, values: Array) -> float:
        """Return the largest violation, 0 within the tolerances, NaN for a failed design."""
        excess = -self.margins(values)
        return float(np.max(np.where(excess <= self.tolerances, 0.0, excess), initial=0.0))

    def log_margins(self, margins: Array) -> tuple[Array, Array]:
        """Return margins (C,) of which limits of magnitudes are logarithmic, and their slopes.

        Of a quantity whose magnitude r, relative to its limit, must not exceed 1, this is -ln(r)
        instead of 1 - r: stresses and deflections are nearly products of powers of thicknesses,
        whose logarithms are linear in those of the thicknesses. Below r = 1/2, the function
        continues as a straight line, because logarithms of small values diverge. The slopes are
        derivatives with respect to the margins.
        """
        least = _MIN_LOGARITHMIC_RATIO
        is_magnitude = self._signs * [x.bound for x in self.limits] > 0.0
        ratio = np.maximum(1.0 - margins, least)
        logarithms = (least - 1.0 + margins).clip(0.0) / least - np.log(ratio)
        return np.where(is_magnitude, logarithms, margins), np.where(is_magnitude, 1 / ratio, 1.0)

    def linearize(self, numbers: Array, values: Array) -> Linearization:
        """Return the functions of a design, linearized in the variables of the search.

        Raises
        ------
        BeamdaeError
            If quantities have no derivatives.
        """
        margins, slopes = self.log_margins(self.margins(values))
        scales, here = self.variables, self.variables.variables(numbers)
        rows = self.design(numbers).gradients * scales.derivatives(here) / self.scales[:, None]
        bounds = (limit - here for limit in scales.limits)
        factors = -slopes * self._signs * self.ratios
        return Linearization(rows[0], margins, factors[:, None] * rows[1:], *bounds)

    def starting_at(self, values: Array) -> DesignProblem:
        """Return the problem with other first values (k,) of the numbers."""
        return replace(self, flat=self._move(values))

    def units_of(self, analyses: Sequence[Any]) -> list[str]:
        """Return the units of the quantities, given the results of analyses; "" if unknown.

        Raises
        ------
        BeamdaeError
            If a limit is in a unit of another quantity.
        """
        known: dict[str, str] = {}
        if equations := next((x.equations for x in analyses if hasattr(x, "equations")), None):
            headers = [x for observable in equations.observables for x in observable.headers]
            known = {variable.name: variable.unit for variable in equations.coordinates}
            known |= {name: split_unit(x)[1] for x in headers for name in (x, split_unit(x)[0])}
        units = [quantity.find_unit(known) for quantity in self.quantities]
        for limit, unit in zip(self.limits, units[1:], strict=True):
            given, actual = parse_unit(limit.unit), parse_unit(unit)
            if limit.unit and (given is None or actual is None or given[1] != actual[1]):
                reason = f"is in {unit}" if unit else "has no known unit"
                raise BeamdaeError(
                    f"{_NAME}: the limit of {limit.quantity.label} is in {limit.unit}, but the "
                    f"quantity {reason}; give the limit as a number in SI units."
                )
        return units

    def parameters(self, values: Array) -> dict[str, Any]:
        """Return all parameters of the model for values (k,) of the numbers."""
        return self.flat.change(dict(zip(self.names, values.tolist(), strict=True)))

    def _move(self, values: Array) -> FlatModel:
        """Return the model with other values (k,) of the numbers."""
        return replace(
            self.flat, whole=replace(self.flat.whole, parameters=self.parameters(values))
        )

    def design(self, values: Array) -> Design:
        """Return the design with values (k,) of the numbers; the latest ones are stored.

        Raises
        ------
        BeamdaeError
            If an analysis fails.
        """
        key = values.tobytes()
        if key not in self._designs:
            design = self._analyze(self._move(values))
            while len(self._designs) >= _KEPT_DESIGNS:
                del self._designs[next(iter(self._designs))]
            self._designs[key] = design
        return self._designs[key]

    def repeat(
        self, values: Array, change: Callable[[Any], Any], integrator: Integrator | None
    ) -> Array:
        """Return the values (1 + C,) of a design after a change of its mechanism and integrator.

        Raises
        ------
        BeamdaeError
            If an analysis fails.
        """
        settings, flat = replace(self.settings, integrator=integrator), self._move(values)
        flat = replace(flat, whole=transform_mechanisms(flat.whole, change))
        return replace(self, settings=settings)._analyze(flat).values

    def _analyze(self, flat: FlatModel) -> Design:
        model, analyses = DesignModel(flat), dict[tuple[str, ...], Analysis]()
        results: dict[AnalysisQuantity, float] = {}
        with silenced():
            for key, group in group_by_analysis(self.leaves).items():
                analyses[key] = create_analysis(model, group, self.settings)
                results |= analyses[key].values
        numbers, weights = zip(*(x.differentiate(results) for x in self.quantities), strict=True)
        for quantity, number in zip(self.quantities, numbers, strict=True):
            if not np.isfinite(number):
                raise BeamdaeError(
                    f"{_NAME}: {quantity.label} of {flat.name} is {number:g} at these values "
                    "of the parameters; start from others (parameters={name: value}), or exclude "
                    "them by bounds=."
                )
        return Design(flat, analyses, np.array(numbers), list(weights))


def create_problem(
    model: Any,
    objective: Any,
    by: Any,
    subject_to: Any,
    bounds: Any,
    parameters: Any,
    settings: RunSettings,
) -> DesignProblem:
    """Return the problem of `optimize` with these arguments.

    Raises
    ------
    BeamdaeError
        If an argument is invalid.
    """
    goal = as_quantity(f"{_NAME}: objective", objective)
    what = "a list of constraints such as at_most(quantity, limit)"
    given = [subject_to] if isinstance(subject_to, Limit) else subject_to
    limits = tuple(require_sequence(_NAME, "subject_to", given, what))
    for limit in limits:
        if not isinstance(limit, Limit):
            raise BeamdaeError(
                f"{_NAME}: subject_to must be {what}, got an entry {short_repr(limit)}."
            )
    flat = flatten_model(_NAME, model, by, parameters)
    keys = np.array([key for key, _ in flat.entries.values()])
    first = flat.unflatten(flat.parameters.values())
    units = {name: x.unit for name, x in flat.whole.parameter_info.items()}
    lower, upper = np.full((2, len(keys)), [[-np.inf], [np.inf]])
    for name, ends in read_bounds(_NAME, bounds, first, units).items():
        lower[keys == name], upper[keys == name] = ends
    scales = np.array([1.0, *(abs(x.bound) or 1.0 for x in limits)])
    ratios = np.ones(len(limits))
    return DesignProblem(flat, goal, limits, lower, upper, settings, scales, ratios)


def group_by_analysis(
    leaves: Iterable[AnalysisQuantity],
) -> dict[tuple[str, ...], list[AnalysisQuantity]]:
    """Return the quantities of each analysis."""
    groups: dict[tuple[str, ...], list[AnalysisQuantity]] = {}
    for leaf in leaves:
        groups.setdefault(leaf.analysis, []).append(leaf)
    return groups
