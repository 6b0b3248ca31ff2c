"""The scaled optimization problem, with one computation of values and gradients per design."""

from __future__ import annotations

import copy
import time as clock
import warnings
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from beamdae.analysis.gradients.gradients import DEFAULT_METHOD, flatten_model
from beamdae.analysis.gradients.number_derivatives import FlatModel
from beamdae.analysis.gradients.objectives import SampleGrid, SmoothMaximum, read_column
from beamdae.analysis.optimization.analyses import (
    Analysis,
    DesignModel,
    EquilibriumAnalysis,
    ModeAnalysis,
    RunSettings,
    analysis_key,
    create_analysis,
)
from beamdae.analysis.optimization.quantities import (
    AnalysisQuantity,
    LargestOf,
    Limit,
    ParameterFunction,
    Quantity,
    RunQuantity,
    as_quantity,
    find_unit,
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
    kind_of_message,
    list_first,
    require_mapping,
    require_sequence,
    short_repr,
)
from beamdae.integrators.integrator import Integrator
from beamdae.model_parameters import parse_unit, split_unit
from beamdae.results.solution import Solution
from beamdae.simulation import as_equations, skip_result_checks

Array = np.ndarray

_NAME = "optimize"
_MAX_NAMES = 3  # of quantities in a message
# Designs whose analyses are kept: the current one, the one of the last gradient and a trial.
_KEPT_DESIGNS = 3
# A limit that is exceeded by more than this, relative to the limit, is violated.
FEASIBILITY_TOLERANCE = 1e-6
# Quantities whose limits are those of maxima over the run.
_SMOOTH_QUANTITIES = (RunQuantity, LargestOf)


@dataclass(eq=False)
class Design:
    """Model at values of its parameters, with the analyses that its quantities need.

    Attributes
    ----------
    flat
        The model.
    analyses
        Analyses by their key.
    values
        Values (1 + C,) of the objective and of the quantities of the C constraints.
    leaf_values
        Values of the results of analyses of which the quantities are functions.
    sections
        Known stress sections with which the models were built, see `keep_known_sections`.
    wall_time
        Duration of the analyses [s].
    """

    flat: FlatModel
    analyses: dict[tuple[Any, ...], Analysis]
    values: Array
    leaf_values: dict[AnalysisQuantity, float]
    sections: Mapping[str, KnownSections]
    wall_time: float
    _weights: list[dict[AnalysisQuantity, float]]
    _gradients: dict[int, Array] = field(default_factory=dict)

    @property
    def results(self) -> tuple[Any, ...]:
        """Results of the analyses."""
        return tuple(x.result for x in self.analyses.values() if x.result is not None)

    def maximum_ratios(self, limits: Sequence[Limit]) -> Array:
        """Return the ratios (C,) of maxima over the run to their limited smooth maxima.

        They are at least 1, and 1 for limits of other quantities.
        """
        ratios = np.ones(len(limits))
        solution = next((x for x in self.results if isinstance(x, Solution)), None)
        run = None
        for k, (limit, value) in enumerate(zip(limits, self.values[1:].tolist(), strict=True)):
            quantity = limit.quantity
            is_upper = min(limit.sign * value, limit.sign * limit.bound) > 0.0
            if solution is None or not is_upper or not isinstance(quantity, _SMOOTH_QUANTITIES):
                continue
            for leaf in quantity.leaves:
                terms = leaf.objective.terms if isinstance(leaf, RunQuantity) else ()
                if len(terms) == 1 and isinstance(terms[0][1], SmoothMaximum):
                    factor, term = terms[0]
                    run = run or solution.at_times(SampleGrid.of(solution.trajectory).t)
                    largest = float(np.max(np.abs(factor * read_column(run, term.column)[1])))
                    ratios[k] = max(ratios[k], largest / abs(value))
        return ratios

    def gradient(self, index: int) -> Array:
        """Return the gradient (k,) of a value with respect to the numbers of the model."""
        if index not in self._gradients:
            by_analysis: dict[tuple[Any, ...], dict[AnalysisQuantity, float]] = {}
            for quantity, weight in self._weights[index].items():
                by_analysis.setdefault(analysis_key(quantity), {})[quantity] = weight
            with (
                warnings.catch_warnings(),
                skip_result_checks(),
                keep_known_sections(self.sections),
            ):
                warnings.simplefilter("ignore", BeamdaeWarning)
                total = sum(self.analyses[key].gradient(x) for key, x in by_analysis.items())
            gradient = np.asarray(total, float)
            if not np.all(np.isfinite(gradient)):
                labels = list_first([x.label for x in self._weights[index]], _MAX_NAMES)
                raise BeamdaeError(
                    f"{_NAME}: the gradient of {labels} of {self.flat.name} is not finite; check "
                    "the model and its functions near these values of the parameters."
                )
            self._gradients[index] = gradient
        return self._gradients[index]


@dataclass(frozen=True)
class _FixedModel(FlatModel):
    """Model with the same mechanism for all values."""

    mechanism: Any

    def __call__(self, **values: float) -> Any:
        return self.mechanism


class DesignProblem:
    """Objective and constraints as functions of scaled variables x near 0 or 1.

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
        Sizes (k,) of the numbers: values = sizes * x.
    build_warnings
        Kinds of the warnings that the first model issued; see `kind_of_message`.
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
        self.flat = flatten_model(_NAME, model, by, parameters)
        self._settings = settings
        self.first = np.array(list(self.flat.values.values()))
        self.lower, self.upper = self._read_bounds(bounds)
        self.sizes = self._choose_sizes()
        self._designs: dict[bytes, Design] = {}
        self._sections: dict[str, KnownSections] = {}
        self.build_warnings: set[str] = set()
        self._unit_errors: list[BeamdaeError] = []
        self._require_units()
        quantities = (self.objective, *(limit.quantity for limit in self.limits))
        self.quantities: Sequence[Quantity] = quantities

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
        return [find_unit(quantity, known) or "" for quantity in self.quantities]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of runs and paths in the objective and the constraints."""
        names: dict[str, None] = {}
        for leaf in (leaf for quantity in self.quantities for leaf in quantity.leaves):
            terms = leaf.objective.terms if isinstance(leaf, RunQuantity) else ((1.0, leaf),)
            columns = (getattr(term, "column", None) for _, term in terms)
            names |= dict.fromkeys(x for x in columns if isinstance(x, str))
        return tuple(names)

    @property
    def integrator(self) -> Integrator:
        """Integrator of the runs."""
        return self._settings.integrator or DEFAULT_METHOD

    @property
    def noise(self) -> Array:
        """Relative sizes (1 + C,) of jumps of the values between designs: `rtol` of runs, or 0.

        Values of runs with adaptive steps jump where the steps of two designs differ.
        """
        name, value = self.integrator.accuracy
        has_runs = [any(isinstance(y, RunQuantity) for y in x.leaves) for x in self.quantities]
        return np.where(has_runs, value if name == "rtol" else 0.0, 0.0)

    def starting_at(self, values: Array) -> DesignProblem:
        """Return the problem with other first values (k,) of the numbers."""
        other = self.without_designs()
        other.flat = replace(self.flat, parameters=self.parameters(values))
        other.first = values
        other.sizes = other._choose_sizes()
        return other

    def without_designs(self) -> DesignProblem:
        """Return the problem without stored analyses, which need much memory."""
        other = copy.copy(self)
        other._designs, other._sections = {}, {}
        return other

    def _require_units(self) -> None:
        """Reject limits in a unit of another quantity."""
        limits = [limit for limit in self.limits if limit.unit]
        if not limits:
            return
        equations = as_equations(_NAME, self.flat.model(**self.flat.parameters))
        self.build_warnings.update(map(kind_of_message, equations.build_warnings))
        units = list_column_units(equations)
        for limit in limits:
            unit = find_unit(limit.quantity, units)
            given, known = parse_unit(limit.unit), parse_unit(unit or "")
            if given is None or known is None or given[1] != known[1]:
                problem = f"is in {unit}" if unit else "has no known unit"
                error = BeamdaeError(
                    f"{_NAME}: the limit of {limit.quantity.label} is in {limit.unit}, but the "
                    f"quantity {problem}; give the limit as a number in SI units."
                )
                if unit:
                    raise error
                self._unit_errors.append(error)

    def require_known_units(self) -> None:
        """Reject limits with units of quantities without one, after names have been checked."""
        for error in self._unit_errors:
            raise error

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

    def design_with_own_sections(self, values: Array) -> Design | None:
        """Return a design whose stress sections are not kept, see `keep_sections`.

        Return None if none are kept.

        Raises
        ------
        BeamdaeError
            If an analysis fails.
        """
        return self.without_designs()._analyze(values) if self._sections else None

    def keep_sections(self, design: Design, numbers: Array, is_added: bool = False) -> None:
        """Let further designs have the stress sections of a design with values (k,) of the numbers.

        Bounds of stresses jump where the number of sections changes. If `is_added`, keep the
        present ones too, also for this design.
        """
        results = [x for x in design.results if hasattr(x, "equations")]
        beams = [x for result in results for x in beams_of(result.equations.mechanism)]
        sections = list_known_sections({x.name: x.section for x in beams})
        self._designs = {} if is_added else {numbers.tobytes(): design}
        if is_added:
            for name, known in sections.items():
                sections[name] = merge_known_sections(known, self._sections.get(name, {}))
        self._sections = sections

    def release_sections(self) -> None:
        """Let designs have their own stress sections."""
        self._designs, self._sections = {}, {}

    def repeat(self, values: Array, mechanism: Any, integrator: Integrator | None) -> Array:
        """Return the values (1 + C,) of a design with another mechanism and integrator.

        Raises
        ------
        BeamdaeError
            If an analysis fails.
        """
        other = self.without_designs()
        flat = self.flat
        other.flat = _FixedModel(flat.model, flat.parameters, flat.entries, mechanism)
        other._settings = replace(self._settings, integrator=integrator)
        other._sections = dict(self.design(values).sections)
        with skip_result_checks():
            return other._analyze(values).values

    def start_of(self, equations: EquationsOfMotion) -> Any:
        """Return the start of the runs and equilibria of a design."""
        mechanism = equations.mechanism
        assert mechanism is not None
        return mechanism.start if self._settings.start is None else self._settings.start

    def _analyze(self, values: Array) -> Design:
        begin = clock.perf_counter()
        flat = replace(self.flat, parameters=self.parameters(values))
        model = DesignModel(flat)
        analyses: dict[tuple[Any, ...], Analysis] = {}
        results: dict[AnalysisQuantity, float] = {}
        with warnings.catch_warnings(), keep_known_sections(self._sections):
            # The result evaluates the warnings of the best design; those of the first one are
            # issued if its analysis fails.
            warnings.simplefilter("ignore", BeamdaeWarning)
            is_first = np.array_equal(values, self.first)
            for key, leaves in self._group_leaves().items():
                with nullcontext() if is_first else skip_result_checks():
                    analysis = create_analysis(model, leaves, self._settings)
                analyses[key] = analysis
                # Functions of parameters may contain analyses.
                with skip_result_checks():
                    results |= {leaf: analysis.value(leaf) for leaf in leaves}
        combined = [quantity.combine(results) for quantity in self.quantities]
        numbers = np.array([value for value, _ in combined])
        if not np.all(np.isfinite(numbers)):
            index = int(np.argmin(np.isfinite(numbers)))
            raise BeamdaeError(
                f"{_NAME}: {self.quantities[index].label} of {flat.name} is {numbers[index]:g} at "
                "these values of the parameters; start from others (parameters={name: value}), or "
                "exclude them by bounds=."
            )
        weights = [x for _, x in combined]
        duration = clock.perf_counter() - begin
        return Design(flat, analyses, numbers, results, self._sections, duration, weights)

    def _group_leaves(self) -> dict[tuple[Any, ...], list[AnalysisQuantity]]:
        """Return the quantities of each analysis."""
        groups: dict[tuple[Any, ...], list[AnalysisQuantity]] = {}
        for quantity in self.quantities:
            for leaf in quantity.leaves:
                groups.setdefault(analysis_key(leaf), []).append(leaf)
        return groups

    def checked_results(self, design: Design) -> tuple[tuple[Any, ...], tuple[str, ...]]:
        """Return the results of a design with all their warnings, and those of the user's code.

        Equilibria and modes are computed again with the checks that other designs omit, and so are
        those that functions of parameters and the model function contain.
        """
        model, groups = DesignModel(design.flat), self._group_leaves()
        analyses = dict(design.analyses)
        with hold_messages() as messages, keep_known_sections(design.sections):
            _ = model.mechanism
            for key, leaf in ((key, x) for key, leaves in groups.items() for x in leaves):
                if isinstance(leaf, ParameterFunction):
                    design.analyses[key].value(leaf)
        with warnings.catch_warnings(), keep_known_sections(design.sections):
            warnings.simplefilter("ignore", BeamdaeWarning)
            for key, analysis in design.analyses.items():
                if isinstance(analysis, (EquilibriumAnalysis, ModeAnalysis)):
                    analyses[key] = create_analysis(model, groups[key], self._settings)
        return replace(design, analyses=analyses).results, tuple(messages)

    def _read_bounds(self, bounds: Any) -> tuple[Array, Array]:
        """Return lower and upper bounds of the numbers."""
        given = {} if bounds is None else bounds
        given = require_mapping(_NAME, "bounds", given, "a dict of (lower, upper) by name")
        parameters = dict.fromkeys(key for key, _ in self.flat.entries.values())
        for name in given:
            if name not in parameters:
                raise BeamdaeError(
                    f"{_NAME}: bounds contains {short_repr(name)}, which is not in by; name one of "
                    f"{', '.join(parameters)}."
                )
        lower, upper = np.full((2, len(self.first)), [[-np.inf], [np.inf]])
        keys = np.array([key for key, _ in self.flat.entries.values()])
        for name, value in given.items():
            unit = self.flat.model.parameter_info[name].unit
            pair = convert_bounds(_NAME, name, value, unit)
            rows = keys == name
            for limits, bound in zip((lower, upper), pair, strict=True):
                limits[rows] = _read_bound(name, bound, int(rows.sum()))
            first = self.flat.parameters[name]
            require_bounds_around(_NAME, name, first, lower[rows], upper[rows], value)
        return lower, upper

    def _choose_sizes(self) -> Array:
        """Return the size of each number: that of its parameter, at most that of its bounds."""
        keys = np.array([key for key, _ in self.flat.entries.values()])
        sizes = np.zeros(len(self.first))
        for key in set(keys.tolist()):
            rows = keys == key
            sizes[rows] = np.max(np.abs(self.first[rows]))
        ranges = self.upper - self.lower
        sizes = np.where(sizes > 0.0, np.minimum(sizes, ranges), ranges)
        return np.where(np.isfinite(sizes), sizes, 1.0)


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
