"""Result of an optimization: the best design, its constraints and all evaluated designs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae import deferred
from beamdae.analysis.optimization.problem import DesignProblem
from beamdae.analysis.optimization.quantities import EquilibriumErrors, EquilibriumValue
from beamdae.analysis.optimization.search import EQUAL_RATIO, SearchResult
from beamdae.analysis.parameter_bounds import describe_ends
from beamdae.errors import format_count, format_percent, list_first
from beamdae.interrupts import acknowledge
from beamdae.model_parameters import format_with_unit
from beamdae.read_only import read_only_data
from beamdae.results.columns import remove_unit
from beamdae.results.displays import HasCsv, HasPage
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

    from beamdae.parts.mechanism import Mechanism

Array = np.ndarray

# Distance from a bound, in sizes of the number, up to which a number is at it.
_BOUND_DISTANCE = 1e-4


class Constraint(NamedTuple):
    """Constraint at the end of an optimization.

    Attributes
    ----------
    name
        The quantity and its limit.
    value
        Value of the quantity. A limited `SmoothMaximum` is multiplied by the ratio of the maximum
        over the run to it, so that it is this maximum up to 0.1 %.
    limit
        The limit.
    margin
        Distance from the limit in the unit of the quantity; negative if the limit is violated.
    multiplier
        Lagrange multiplier: decrease of the objective per unit by which the limit is relaxed. It is
        0 if the limit does not affect the design, and NaN if the search was interrupted.
    relative_margin
        Margin divided by the magnitude of the limit: 0 if it is below the tolerance of the search,
        1e-6, and NaN if the limit is 0 and the value is not.
    unit
        Unit of the value, the limit and the margin; "" if it is unknown.
    """

    name: str
    value: float
    limit: float
    margin: float
    multiplier: float
    relative_margin: float
    unit: str

    @property
    def comparison(self) -> str:
        """Comparison of the value with the limit: "at its limit" or the margin."""
        if self.relative_margin == 0.0:
            return "at its limit"
        word = "margin" if self.margin > 0.0 else "violated by"
        if self.limit == 0.0:
            return f"{word} {format_with_unit(float(f'{abs(self.margin):.3g}'), self.unit)}"
        return f"{word} {format_percent(abs(self.relative_margin), 3)} of the limit"


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class Optimization(HasCsv, HasPage):
    """Best design of a search, with all evaluated designs; see `optimize`.

    `to_csv` writes `history`.

    Attributes
    ----------
    parameters
        Values of the parameters in `by`: floats, or tuples for lists of floats.
    objective
        Value of the objective.
    constraints
        The constraints with their margins and multipliers.
    status
        Status and reason of the end of the search: "ok" if it converged, "limited" if it ended
        before convergence or if no design satisfies the constraints, "failed" if analyses failed,
        and "interrupted".
    at_bounds
        Names of the numbers at a bound or within 0.1 % of it, such as "thickness[3]"; see
        `bound_notes`.
    evaluations
        Number of evaluated designs of the best search, including those whose analyses failed.
    residual
        Decrease of the linearized objective within a step of one size of the numbers, relative to
        that without constraints and bounds, and at least to 0.1 times the first value.
        It is 0 at an exact optimum, and NaN if the search was interrupted.
    analyses
        Results of the analyses of the best design: `Solution`, `Equilibrium` and `Modes`.
    first_analyses
        Results of the analyses of the first design.
    model
        Name and all parameters of the model of the best design.
    warnings
        Sentences on `errors` above 4 %, and the warnings of `analyses`.
    """

    parameters: Mapping[str, Any]
    objective: float
    constraints: tuple[Constraint, ...]
    status: Status
    at_bounds: tuple[str, ...]
    evaluations: int
    residual: float
    analyses: tuple[Any, ...] = field(repr=False)
    first_analyses: tuple[Any, ...] = field(repr=False)
    model: Mapping[str, Any] = field(repr=False)
    warnings: tuple[str, ...]
    _search: SearchResult = field(repr=False)
    _starts: list[dict[str, Any]] | None = field(repr=False)

    def __repr__(self) -> str:
        notes = self.bound_notes
        bounds = f"; {list_first(notes)}" if notes else ""
        count = len(self.constraints)
        limits = f", {format_count(count, 'constraint')}" if count else ""
        return (
            f"<Optimization: {self.status.sentence}; objective {self.objective_text}{limits}, "
            f"{format_count(self.evaluations, 'evaluation')}{bounds}>"
            + "".join(f" {x}" for x in self.warnings)
        )

    @property
    def bound_notes(self) -> tuple[str, ...]:
        """Notes such as "height is at its lower limit 0.005 m" for the numbers in `at_bounds`."""
        problem, notes = self._problem, []
        for name, side in _find_active(problem, self._search.best.numbers).items():
            bounds = problem.lower if side == "lower" else problem.upper
            bound = float(bounds[problem.names.index(name)])
            limit = format_with_unit(bound, problem.units[name])
            notes.append(f"{name} is at its {side} limit {limit}")
        return tuple(notes)

    @cached_property
    def errors(self) -> Any:
        """Errors of the objective and of the limited quantities at the best design, see `Errors`.

        They are relative to the larger one of the value and the limit.
        """
        return deferred.module("accuracy.derivatives").measure_design(self._search)

    @property
    def solution(self) -> Solution | None:
        """The run of the best design; None if no quantity needs a run."""
        return next((x for x in self.analyses if isinstance(x, Solution)), None)

    def table(self) -> pd.DataFrame:
        """Return first and final values, bounds and units of the numbers in parameters, by name.

        The unit is "" if it is unknown.
        """
        import pandas as pd

        problem, search = self._problem, self._search
        columns = {
            "first value": search.trials[0].numbers,
            "value": search.best.numbers,
            "lower bound": problem.lower,
            "upper bound": problem.upper,
            "at bound": np.isin(problem.names, self.at_bounds),
            "unit": list(problem.units.values()),
        }
        return pd.DataFrame(columns, index=problem.names)

    def constraint_table(self) -> pd.DataFrame:
        """Return the constraints, one row each."""
        import pandas as pd

        return pd.DataFrame(self.constraints, columns=list(Constraint._fields))

    def history(self) -> pd.DataFrame:
        """Return all evaluated designs in their order.

        The columns are "objective", "violation" (largest violation of a limit, relative to it), the
        constrained quantities, the numbers in the parameters, and "failure" (the reason if an
        analysis failed, whose values are NaN). A limited `SmoothMaximum` is multiplied by the ratio
        of the maximum over the run to it, both of the best design.
        """
        import pandas as pd

        search, measure = self._search, self._problem.violation
        values = np.array([x.values for x in search.trials])
        limited = pd.DataFrame(values[:, 1:] * search.problem.ratios, columns=self._limit_names)
        numbers = pd.DataFrame([x.numbers for x in search.trials], columns=self._problem.names)
        violations = [math.nan if x.failure else measure(x.values) for x in search.trials]
        first = pd.DataFrame({"objective": values[:, 0], "violation": violations})
        failures = [x.failure for x in search.trials]
        return pd.concat([first, limited, numbers], axis=1).assign(failure=failures)

    @property
    def starts(self) -> pd.DataFrame | None:
        """Table of all searches with first and last values, objective, violation and status.

        None without the argument `starts` of `optimize`.
        """
        import pandas as pd

        if self._starts is None:
            return None
        names = self._problem.names
        columns = ["status", "reason", "objective", "violation", "evaluations", *names]
        return pd.DataFrame(self._starts, columns=[*(f"first {x}" for x in names), *columns])

    def describe_starts(self) -> str:
        """Return how many of several searches end at the best objective, or "" of one search.

        Others have an objective that differs by over 0.1 %, or violate a constraint.
        """
        table = self.starts
        if table is None:
            return ""
        ends = table["objective"][table["violation"] == 0.0].to_numpy(float)
        if not len(ends):
            return f"none of {len(table)} searches ends at a design that satisfies the constraints"
        limit = ends.min() + EQUAL_RATIO * np.abs(ends).max()
        return describe_ends(ends, len(table), limit, "objective", self.units["objective"])

    @property
    def objective_label(self) -> str:
        """Name of the objective, such as "tip.y at equilibrium"."""
        return self._problem.objective.label

    @property
    def objective_text(self) -> str:
        """Value of the objective with its unit, such as "0.2279 kg"."""
        return format_with_unit(self.objective, self.units["objective"])

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of runs and paths in the objective and the constraints."""
        return self._problem.columns

    @property
    def observed(self) -> dict[str, Array]:
        """Columns of the best design by header, of observables in objective and constraints."""
        names = [remove_unit(name) for name in self.columns]
        owners = {name.rpartition(".")[0] or name for name in names}
        return {
            header: values
            for analysis in self.analyses
            for header, values in getattr(analysis, "columns", {}).items()
            if owners & {remove_unit(header), remove_unit(header).rpartition(".")[0]}
        }

    @property
    def units(self) -> dict[str, str]:
        """Units of the parameters and of the columns of `history`; "" if a unit is unknown."""
        names = ("objective", *self._limit_names)
        return dict(zip(names, self._search.units, strict=True)) | self._problem.units

    @property
    def max_evaluations(self) -> int:
        """Maximum number of evaluated designs, as given."""
        return self._search.max_evaluations

    @property
    def best_number(self) -> int:
        """Number of the best design in `history`, from 1."""
        return 1 + self._search.trials.index(self._search.best)

    def mechanism(self, is_best: bool = True) -> Mechanism:
        """Return the mechanism of the best or of the first design."""
        trial = self._search.best if is_best else self._search.trials[0]
        return self._problem.flat.whole(**self._problem.parameters(trial.numbers))

    @property
    def _written_table(self) -> pd.DataFrame:
        return self.history()

    @property
    def _problem(self) -> DesignProblem:
        return self._search.problem

    @property
    def _limit_names(self) -> list[str]:
        return [f"{k}: {x.quantity.label}" for k, x in enumerate(self._problem.limits, 1)]


def create_optimization(
    search: SearchResult, starts: list[dict[str, Any]] | None = None
) -> Optimization:
    """Return the result of a search, with the analyses of its best design.

    `starts` are the rows of the table of several searches, of which this is the best one.
    """
    problem, best, errors = search.problem, search.best, None
    design, warnings = problem.design(best.numbers), list[str]()
    if not search.was_ended:
        try:
            errors = deferred.module("accuracy.derivatives").measure_design(search)
            warnings = [*errors.sentences(), *_list_warnings(problem, design.results)]
        except KeyboardInterrupt:
            acknowledge()
            sentence = "interrupted while the best design was checked"
            search = replace(search, status=Status("interrupted", sentence))
    is_active = np.abs(problem.margins(best.values)) <= problem.tolerances
    values, constraints = (problem.ratios * best.values[1:]).tolist(), []
    for k, (limit, value) in enumerate(zip(problem.limits, values, strict=True)):
        margin, size = limit.margin(value), abs(limit.bound)
        relative = 0.0 if is_active[k] else margin / size if size else math.nan
        numbers = value, limit.bound, margin, float(search.multipliers[k]), relative
        constraints.append(Constraint(limit.label, *numbers, search.units[1 + k]))
    optimization = Optimization(
        problem.flat.unflatten(best.numbers.tolist()),
        float(best.values[0]),
        tuple(constraints),
        search.status,
        tuple(_find_active(problem, best.numbers)),
        len(search.trials),
        search.residual,
        design.results,
        search.first_analyses,
        {"name": problem.flat.name, "parameters": dict(design.flat.whole.parameters)},
        tuple(dict.fromkeys(warnings)),
        # Stored analyses need much memory.
        replace(search, problem=replace(problem, _designs={})),
        starts,
    )
    if errors is not None:
        vars(optimization)["errors"] = errors
    return optimization


def _list_warnings(problem: DesignProblem, results: Sequence[Any]) -> Iterator[str]:
    """Yield the warnings of analyses.

    Those about the output rows and errors of runs are omitted, because quantities are integrals
    over the steps whose errors are measured; and those about ends of paths, beyond critical loads,
    if no quantity uses ends.
    """
    uses_ends = any(isinstance(x, (EquilibriumValue, EquilibriumErrors)) for x in problem.leaves)
    for result in results:
        if isinstance(result, Solution):
            yield from (x for x in result.model_warnings if x not in result.row_warnings)
        else:
            omitted = "" if uses_ends else getattr(result, "instability", "")
            yield from (x for x in result.warnings if x != omitted)


def _find_active(problem: DesignProblem, numbers: Array) -> dict[str, str]:
    """Return "lower" or "upper" by name of the numbers at a bound."""
    sides: dict[str, str] = {}
    for side, bounds in (("lower", problem.lower), ("upper", problem.upper)):
        limits = np.maximum(_BOUND_DISTANCE * problem.sizes, EQUAL_RATIO * np.abs(bounds))
        is_near = np.isfinite(bounds) & (np.abs(numbers - bounds) <= limits)
        sides |= dict.fromkeys(np.array(problem.names)[is_near].tolist(), side)
    return sides
