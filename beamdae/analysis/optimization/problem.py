"""Objective and constraints of a design as scaled functions of the variables of a search."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.analysis.gradients.gradients import DEFAULT_METHOD, flatten_model
from beamdae.analysis.gradients.number_derivatives import FlatModel
from beamdae.analysis.gradients.objectives import SampleGrid, read_column
from beamdae.analysis.optimization.analyses import (
    Analysis,
    DesignModel,
    RunSettings,
    create_analysis,
)
from beamdae.analysis.optimization.quantities import (
    EQUILIBRIUM_PATH,
    MODES,
    PARAMETERS,
    AnalysisQuantity,
    LargestOf,
    Limit,
    Quantity,
    RunQuantity,
    as_quantity,
)
from beamdae.analysis.parameter_bounds import convert_bounds, require_bounds_around
from beamdae.beams.beam import beams_of
from beamdae.beams.section_samples import (
    KnownSections,
    keep_known_sections,
    list_known_sections,
    merge_known_sections,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    as_real,
    hold_messages,
    list_first,
    require_mapping,
    require_sequence,
    short_repr,
)
from beamdae.integrators.integrator import Integrator
from beamdae.model_parameters import parse_unit, split_unit
from beamdae.results.solution import Solution
from beamdae.simulation import skip_result_checks

Array = np.ndarray

_NAME = "optimize"
_MAX_NAMES = 3  # of quantities in a message
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
    leaf_values
        Values of the results of analyses of which the quantities are functions.
    sections
        Known stress sections with which the models were built, see `keep_known_sections`.
    """

    flat: FlatModel
    analyses: dict[tuple[str, ...], Analysis]
    values: Array
    weights: list[dict[AnalysisQuantity, float]]
    leaf_values: dict[AnalysisQuantity, float]
    sections: Mapping[str, KnownSections]

    @property
    def results(self) -> tuple[Any, ...]:
        """Results of the analyses."""
        return tuple(x.result for x in self.analyses.values() if x.result is not None)

    @cached_property
    def gradients(self) -> Array:
        """Gradients (1 + C, k) of the values with respect to the numbers of the model."""
        with (
            warnings.catch_warnings(),
            skip_result_checks(),
            keep_known_sections(self.sections),
        ):
            warnings.simplefilter("ignore", BeamdaeWarning)
            return np.array([self._gradient(weights) for weights in self.weights])

    def _gradient(self, weights: Mapping[AnalysisQuantity, float]) -> Array:
        groups = group_by_analysis(weights)
        result = sum(
            self.analyses[key].gradient({x: weights[x] for x in leaves})
            for key, leaves in groups.items()
        )
        gradient = np.asarray(result, float)
        if not np.all(np.isfinite(gradient)):
            labels = list_first([x.label for x in weights], _MAX_NAMES)
            raise BeamdaeError(
                f"{_NAME}: the gradient of {labels} of {self.flat.name} is not finite; check "
                "the model and its functions near these values of the parameters."
            )
        return gradient

    def maximum_ratio(self, limit: Limit, value: float) -> float:
        """Return the ratio of the maximum over the run to a limited smooth maximum, at least 1.

        It is 1 for limits of other quantities.
        """
        quantity = limit.quantity
        is_upper = min(limit.sign * value, limit.sign * limit.bound) > 0.0
        solution = next((x for x in self.results if isinstance(x, Solution)), None)
        if solution is None or not is_upper or not isinstance(quantity, (RunQuantity, LargestOf)):
            return 1.0
        largest = 0.0
        leaves = [x for x in quantity.leaves if isinstance(x, RunQuantity)]
        for factor, term in filter(None, (x.smooth_maximum for x in leaves)):
            run = solution.at_times(SampleGrid.of(solution.trajectory).t)
            largest = max(largest, float(np.max(np.abs(factor * read_column(run, term.column)[1]))))
        return max(1.0, largest / abs(value))


@dataclass(frozen=True)
class _FixedModel(FlatModel):
    """Model with the same mechanism for all values."""

    mechanism: Any

    def __call__(self, **values: float) -> Any:
        return self.mechanism


class DesignProblem:
    """Objective and constraints as functions of scaled variables.

    Attributes
    ----------
    flat
        The model at the first values of the parameters.
    objective, limits
        Objective and constraints.
    quantities
        The objective and the constrained quantities.
    first, lower, upper
        First values of the numbers in the parameters, and their bounds, (k,).
    sizes
        Sizes (k,) of the numbers.
    sections
        Known stress sections with which designs are built; their own ones if it is empty.
    """

    def __init__(
        self,
        model: Any,
        objective: Any,
        by: Any,
        subject_to: Any,
        bounds: Any,
        parameters: Any,
        settings: RunSettings,
    ) -> None:
        self.objective: Quantity = as_quantity(f"{_NAME}: objective", objective)
        limits = [subject_to] if isinstance(subject_to, Limit) else subject_to
        what = "a list of constraints such as at_most(quantity, limit)"
        self.limits: tuple[Limit, ...] = tuple(require_sequence(_NAME, "subject_to", limits, what))
        for limit in self.limits:
            if not isinstance(limit, Limit):
                raise BeamdaeError(
                    f"{_NAME}: subject_to must be {what}, got an entry {short_repr(limit)}."
                )
        self.quantities: Sequence[Quantity] = (self.objective, *(x.quantity for x in self.limits))
        self.flat = flatten_model(_NAME, model, by, parameters)
        self._settings = settings
        self.first = np.array(list(self.flat.values.values()))
        self.lower, self.upper = self._read_bounds(bounds)
        self.sizes = self._choose_sizes()
        self._designs: dict[bytes, Design] = {}
        self.sections: Mapping[str, KnownSections] = {}

    @property
    def names(self) -> list[str]:
        """Names of the numbers, such as "E" and "thickness[3]"."""
        return list(self.flat.entries)

    @property
    def units(self) -> dict[str, str]:
        """Units of the numbers; "" if a unit is unknown."""
        described = self.flat.model.parameter_info
        return {name: described[key].unit for name, (key, _) in self.flat.entries.items()}

    def units_of(self, analyses: Sequence[Any]) -> list[str]:
        """Return the units of the quantities, given the results of analyses; "" if unknown."""
        equations = next((x.equations for x in analyses if hasattr(x, "equations")), None)
        known = {} if equations is None else list_column_units(equations)
        return [quantity.find_unit(known) for quantity in self.quantities]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of runs and paths in the objective and the constraints."""
        leaves = (leaf for quantity in self.quantities for leaf in quantity.leaves)
        terms = (
            term
            for x in leaves
            for _, term in (x.objective.terms if isinstance(x, RunQuantity) else [(1.0, x)])
        )
        names = (getattr(term, "column", None) for term in terms)
        return tuple(dict.fromkeys(x for x in names if isinstance(x, str)))

    @property
    def noise(self) -> Array:
        """Relative sizes (1 + C,) of jumps of the values between designs: `rtol` of runs, or 0.

        Values of runs with adaptive steps jump where the steps of two designs differ.
        """
        name, value = (self._settings.integrator or DEFAULT_METHOD).accuracy
        has_runs = [any(isinstance(y, RunQuantity) for y in x.leaves) for x in self.quantities]
        return np.where(has_runs, value if name == "rtol" else 0.0, 0.0)

    def variables(self, numbers: Array) -> Array:
        """Return the variables (k,) of the search for values (k,) of the numbers.

        These are logarithms of numbers with a positive lower bound, in which products of powers
        are linear, and otherwise the numbers relative to their sizes.
        """
        is_logarithmic = self.lower > 0.0
        result = numbers / self.sizes
        result[is_logarithmic] = np.log(numbers[is_logarithmic])
        return result

    def numbers(self, variables: Array) -> Array:
        """Return the values (k,) of the numbers, within their bounds, for variables (k,)."""
        is_logarithmic = self.lower > 0.0
        result = self.sizes * variables
        result[is_logarithmic] = np.exp(variables[is_logarithmic])
        return np.clip(result, self.lower, self.upper)

    def rates(self, numbers: Array) -> Array:
        """Return the derivatives (k,) of the numbers with respect to the variables."""
        return np.where(self.lower > 0.0, numbers, self.sizes)

    def starting_at(self, values: Array) -> DesignProblem:
        """Return the problem with other first values (k,) of the numbers."""
        other = self.with_sections({})
        other.flat = replace(self.flat, parameters=self.parameters(values))
        other.first = values
        other.sizes = other._choose_sizes()
        return other

    def with_sections(self, sections: Mapping[str, KnownSections]) -> DesignProblem:
        """Return the problem with other stress sections and without stored designs."""
        other = copy.copy(self)
        other._designs, other.sections = {}, sections
        return other

    def with_sections_of(self, design: Design, is_added: bool = False) -> DesignProblem:
        """Return the problem with the stress sections of a design, or with these and its own ones.

        Bounds of stresses jump where the number of sections changes. Additional sections only make
        the bounds larger.
        """
        results = [x for x in design.results if hasattr(x, "equations")]
        beams = [x for result in results for x in beams_of(result.equations.mechanism)]
        sections = list_known_sections({x.name: x.section for x in beams})
        if is_added:
            for name, known in sections.items():
                sections[name] = merge_known_sections(known, self.sections.get(name, {}))
        other = self.with_sections(sections)
        if not is_added:
            other._designs[np.array(list(design.flat.values.values())).tobytes()] = design
        return other

    def require_units(self, analyses: Sequence[Any]) -> None:
        """Reject limits in units of other quantities, given the results of analyses."""
        for limit, unit in zip(self.limits, self.units_of(analyses)[1:], strict=True):
            given, known = parse_unit(limit.unit), parse_unit(unit)
            if limit.unit and (given is None or known is None or given[1] != known[1]):
                problem = f"is in {unit}" if unit else "has no known unit"
                raise BeamdaeError(
                    f"{_NAME}: the limit of {limit.quantity.label} is in {limit.unit}, but the "
                    f"quantity {problem}; give the limit as a number in SI units."
                )

    def parameters(self, values: Array) -> dict[str, Any]:
        """Return all parameters of the model for values (k,) of the numbers."""
        return self.flat.change(dict(zip(self.names, values.tolist(), strict=True)))

    def design(self, values: Array) -> Design:
        """Return the design with values (k,) of the numbers; the latest ones are stored.

        Raises
        ------
        BeamdaeError
            If an analysis fails.
        """
        key = values.tobytes()
        if key not in self._designs:
            design = self._analyze(values)
            while len(self._designs) >= _KEPT_DESIGNS:
                del self._designs[next(iter(self._designs))]
            self._designs[key] = design
        return self._designs[key]

    def repeat(self, values: Array, mechanism: Any, integrator: Integrator | None) -> Array:
        """Return the values (1 + C,) of a design with another mechanism and integrator.

        Raises
        ------
        BeamdaeError
            If an analysis fails.
        """
        other = self.with_sections(self.sections)
        flat = self.flat
        other.flat = _FixedModel(flat.model, flat.parameters, flat.entries, mechanism)
        other._settings = replace(self._settings, integrator=integrator)
        with skip_result_checks():
            return other._analyze(values).values

    def start_of(self, equations: EquationsOfMotion) -> Any:
        """Return the start of the runs and equilibria of a design."""
        mechanism = equations.mechanism
        assert mechanism is not None
        return mechanism.start if self._settings.start is None else self._settings.start

    def _analyze(self, values: Array) -> Design:
        model = DesignModel(replace(self.flat, parameters=self.parameters(values)))
        leaves = [leaf for quantity in self.quantities for leaf in quantity.leaves]
        analyses: dict[tuple[str, ...], Analysis] = {}
        results: dict[AnalysisQuantity, float] = {}
        with warnings.catch_warnings(), keep_known_sections(self.sections):
            # The result evaluates the warnings of the best design; those of the first one are
            # issued if its analysis fails.
            warnings.simplefilter("ignore", BeamdaeWarning)
            is_first = np.array_equal(values, self.first)
            for key, group in group_by_analysis(leaves).items():
                with nullcontext() if is_first else skip_result_checks():
                    analyses[key] = create_analysis(model, group, self._settings)
                # Functions of parameters may contain analyses.
                with skip_result_checks():
                    results |= {leaf: analyses[key].value(leaf) for leaf in group}
        numbers, weights = zip(*(x.evaluate(results) for x in self.quantities), strict=True)
        for quantity, number in zip(self.quantities, numbers, strict=True):
            if not np.isfinite(number):
                raise BeamdaeError(
                    f"{_NAME}: {quantity.label} of {model.flat.name} is {number:g} at these values "
                    "of the parameters; start from others (parameters={name: value}), or exclude "
                    "them by bounds=."
                )
        values = np.array(numbers)
        return Design(model.flat, analyses, values, list(weights), results, self.sections)

    def checked_results(self, design: Design) -> tuple[tuple[Any, ...], tuple[str, ...]]:
        """Return the results of a design with all their warnings, and those of the user's code.

        Equilibria and modes are computed again with the checks that other designs omit, and so are
        those that functions of parameters and the model function contain.
        """
        model, groups = DesignModel(design.flat), group_by_analysis(design.leaf_values)
        analyses = dict(design.analyses)
        with hold_messages() as messages, keep_known_sections(design.sections):
            _ = model.mechanism
            for leaf in groups.get((PARAMETERS,), ()):
                design.analyses[leaf.analysis].value(leaf)
        with warnings.catch_warnings(), keep_known_sections(design.sections):
            warnings.simplefilter("ignore", BeamdaeWarning)
            for key in (x for x in groups if x[0] in (EQUILIBRIUM_PATH, MODES)):
                analyses[key] = create_analysis(model, groups[key], self._settings)
        return replace(design, analyses=analyses).results, tuple(messages)

    def _read_bounds(self, bounds: Any) -> tuple[Array, Array]:
        """Return lower and upper bounds of the numbers."""
        given = {} if bounds is None else bounds
        given = require_mapping(_NAME, "bounds", given, "a dict of (lower, upper) by name")
        keys = np.array([key for key, _ in self.flat.entries.values()])
        lower, upper = np.full((2, len(self.first)), [[-np.inf], [np.inf]])
        for name, value in given.items():
            rows = keys == name
            if not np.any(rows):
                raise BeamdaeError(
                    f"{_NAME}: bounds contains {short_repr(name)}, which is not in by; name one of "
                    f"{', '.join(dict.fromkeys(keys.tolist()))}."
                )
            pair = convert_bounds(_NAME, name, value, self.flat.model.parameter_info[name].unit)
            for limits, bound in zip((lower, upper), pair, strict=True):
                limits[rows] = _read_bound(name, bound, int(rows.sum()))
            first = self.flat.parameters[name]
            require_bounds_around(_NAME, name, first, lower[rows], upper[rows], value)
        return lower, upper

    def _choose_sizes(self) -> Array:
        """Return the size of each number: that of its parameter, at most that of its bounds."""
        keys = np.array([key for key, _ in self.flat.entries.values()])
        sizes = np.array([np.max(np.abs(self.first[keys == key])) for key in keys])
        ranges = self.upper - self.lower
        sizes = np.where(sizes > 0.0, np.minimum(sizes, ranges), ranges)
        return np.where(np.isfinite(sizes), sizes, 1.0)


def group_by_analysis(leaves: Any) -> dict[tuple[str, ...], list[AnalysisQuantity]]:
    """Return the quantities of each analysis."""
    groups: dict[tuple[str, ...], list[AnalysisQuantity]] = {}
    for leaf in leaves:
        groups.setdefault(leaf.analysis, []).append(leaf)
    return groups


def list_column_units(equations: EquationsOfMotion) -> dict[str, str]:
    """Return the units of coordinates and observed columns by name and by header."""
    headers = [x for observable in equations.observables for x in observable.headers]
    units = {variable.name: variable.unit for variable in equations.coordinates}
    return units | {name: split_unit(x)[1] for x in headers for name in (x, split_unit(x)[0])}


def _read_bound(name: str, bound: Any, count: int) -> Array:
    """Return a bound of all numbers of a parameter."""
    entries = [bound] * count if as_real(bound) is not None else bound
    what = "a number, or one per entry"
    numbers = [as_real(x) for x in require_sequence(_NAME, f"a bound of {name}", entries, what)]
    if len(numbers) != count or any(x is None or np.isnan(x) for x in numbers):
        raise BeamdaeError(
            f"{_NAME}: a bound of {name} must be {what} ({count}), got {short_repr(bound)}."
        )
    return np.array(numbers, float)


def parameter_values(flat: FlatModel, values: Array) -> Mapping[str, Any]:
    """Return values (k,) of numbers by parameter: floats, or tuples for lists of floats."""
    result: dict[str, Any] = {}
    for (key, k), value in zip(flat.entries.values(), values.tolist(), strict=True):
        if k is None:
            result[key] = value
        else:
            result.setdefault(key, []).append(value)
    return {key: x if isinstance(x, float) else tuple(x) for key, x in result.items()}
