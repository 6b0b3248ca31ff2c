"""Result of an optimization: the best design, its constraints and all evaluated designs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae import deferred
from beamdae.analysis.gradients.objectives import SmoothMaximum
from beamdae.analysis.optimization.problem import (
    FEASIBILITY_TOLERANCE,
    Design,
    DesignProblem,
    parameter_values,
)
from beamdae.analysis.optimization.quantities import (
    MAX_EXPONENT,
    EquilibriumErrors,
    EquilibriumQuantity,
    EquilibriumValue,
    LargestOf,
    Limit,
    Quantity,
    RunQuantity,
)
from beamdae.analysis.optimization.search import (
    INTERRUPTED_CHECKS,
    SearchResult,
    find_active_bounds,
)
from beamdae.beams.beam import Beam
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.dependent_constraints import analyze_constraint_rank
from beamdae.equations.starts.mobility import describe_free_motions
from beamdae.errors import (
    format_count,
    format_percent,
    list_first,
    name_with_others,
)
from beamdae.interrupts import acknowledge
from beamdae.model_parameters import format_with_unit
from beamdae.read_only import read_only_data
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.noise import rounding_limits
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution
from beamdae.results.storage.files import require_file_path, write_escaped_table
from beamdae.symbolic.statements import Variable

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

    from beamdae.parts.mechanism import Mechanism

# The best design of an interrupted search is checked if its analyses took less time [s]; the checks
# take two to eight times as long.
_MAX_CHECKED_TIME = 1.0
# Relative excess of the smooth bound of `LargestOf` from which the largest quantity is stated.
_MAX_BOUND_EXCESS = 5e-3
# Relative difference of objectives up to which several searches end at the same one.
_EQUAL_OBJECTIVES = 1e-3
# Relative excess for which an exponent is recommended.
_RECOMMENDED_BOUND_EXCESS = 0.01
# Values below this share of their limit, and rounding errors below the second one, are negligible:
# the stress of a steel beam without loads is about 1e-4 Pa.
_NEGLIGIBLE_SHARE, _MAX_ROUNDING_SHARE = 1e-9, 1e-6
# Ratio of a value to its upper limit, or of a lower limit to the value, below which the limit is
# far from active.
_MAX_INACTIVE_RATIO = 0.1
# Ratio of an upper limit to the largest value of all designs, or of the smallest value to a lower
# limit, from which the limit may be in another unit: mm and degrees are 1000 and 57 times smaller
# than m and rad, and without the limit, designs exceed it several times.
_MIN_DISTANT_RATIO = 20.0
_MAX_NAMES = 3  # of free motions in a warning
_MAX_NOTES = 3  # on bounds in the short form of a result
# Distance from a bound, relative to the bound, up to which a number is reported to be at it.
_MAX_BOUND_DISTANCE = 1e-3


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
    largest
        Largest magnitude of the quantities of a `LargestOf`, or of the stresses of a
        `Beam.largest_stress`, whose smooth upper bound is the value; NaN for other quantities.
    exponent
        Exponent with which this bound exceeds the largest magnitude by about 1 %; NaN if it does
        not exceed it by more.
    """

    name: str
    value: float
    limit: float
    margin: float
    multiplier: float
    relative_margin: float
    unit: str
    largest: float = float("nan")
    exponent: float = float("nan")

    @property
    def comparison(self) -> str:
        """Comparison of the value with the limit: "at its limit" or the margin.

        The largest of several quantities is added if their smooth bound is over 0.5 % larger.
        """
        if self.value > (1.0 + _MAX_BOUND_EXCESS) * self.largest:
            size = format_with_unit(float(f"{self.largest:.4g}"), self.unit)
            closer = f" (closer with exponent={self.exponent:g})" if self.exponent > 0.0 else ""
            return f"{self._margin_text}; the largest quantity itself is {size}{closer}"
        return self._margin_text

    @property
    def _margin_text(self) -> str:
        if self.relative_margin == 0.0:
            return "at its limit"
        size, word = abs(self.margin), "margin" if self.margin > 0.0 else "violated by"
        if self.limit == 0.0:
            return f"{word} {format_with_unit(float(f'{size:.3g}'), self.unit)}"
        return f"{word} {format_percent(abs(self.relative_margin), 3)} of the limit"


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class Optimization:
    """Best design of a search, with all evaluated designs; see `optimize`.

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
        Names of the numbers at a bound, such as "thickness[3]"; see `bound_notes`.
    evaluations
        Number of evaluated designs of the best search, including those whose analyses failed.
    residual
        Norm of the gradient of the Lagrange function, relative to that of the objective and at
        least to the largest one of the search, within 0.1 to 1 times the first value of the
        objective per size of a parameter. It is 0 at an exact optimum, and NaN if the search was
        interrupted.
    analyses
        Results of the analyses of the best design: `Solution`, `Equilibrium` and `Modes`.
    first_analyses
        Results of the analyses of the first design.
    model
        Name and all parameters of the model of the best design.
    warnings
        Sentences on `errors` above 4 %, on stresses, and quantities of one sign, within a limit of
        their signed value whose magnitude is beyond it, on quantities that are zero or negligible
        for every design, on designs of which all numbers are at bounds, far from all limits, on
        limits that are over 20 times away from the values of all designs, and the warnings of
        `analyses`.
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
    _first: Mapping[str, float] = field(repr=False)
    _numbers: Mapping[str, tuple[float, float, float]] = field(repr=False)
    _history: Mapping[str, Any] = field(repr=False)
    _problem: DesignProblem = field(repr=False)
    _search: SearchResult = field(repr=False)
    _starts: list[dict[str, Any]] | None = field(repr=False)

    def __repr__(self) -> str:
        notes = self.bound_notes
        bounds = f"; {list_first(notes, _MAX_NOTES)}" if notes else ""
        count = len(self.constraints)
        limits = f", {format_count(count, 'constraint')}" if count else ""
        return (
            f"<Optimization: {self.status.sentence}; objective {self.objective_text}{limits}, "
            f"{format_count(self.evaluations, 'evaluation')}{bounds}>"
            + "".join(f" {x}" for x in self.warnings)
        )

    @property
    def bound_notes(self) -> tuple[str, ...]:
        """Notes such as "height is at its lower limit 0.005 m".

        There is one for each number in `at_bounds`, and for each one within 0.1 % of a bound.
        """
        units = self._problem.units
        notes = []
        for name, (value, *bounds) in self._numbers.items():
            for side, bound in zip(("lower", "upper"), bounds, strict=True):
                distance = abs(value - bound)
                # A number at a bound of zero is at its nearest bound.
                is_near = distance <= _MAX_BOUND_DISTANCE * abs(bound)
                is_nearest = distance <= min(abs(value - x) for x in bounds)
                if math.isfinite(bound) and (is_near or (name in self.at_bounds and is_nearest)):
                    limit = format_with_unit(float(bound), units[name])
                    notes.append(f"{name} is at its {side} limit {limit}")
        return tuple(notes)

    @cached_property
    def errors(self) -> Any:
        """Errors of the objective and of the limited quantities at the best design, see `Errors`.

        They are relative to the larger one of the value and the limit.
        """
        return deferred.module("accuracy.designs").measure_design(self._problem, self._search)

    @property
    def solution(self) -> Solution | None:
        """The run of the best design; None if no quantity needs a run."""
        return next((x for x in self.analyses if isinstance(x, Solution)), None)

    def table(self) -> pd.DataFrame:
        """Return first and final values, bounds and units of the numbers in parameters, by name.

        The unit is "" if it is unknown.
        """
        import pandas as pd

        units = self._problem.units
        rows = {
            name: {
                "first value": self._first[name],
                "value": value,
                "lower bound": lower,
                "upper bound": upper,
                "at bound": name in self.at_bounds,
                "unit": units[name],
            }
            for name, (value, lower, upper) in self._numbers.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index")

    def constraint_table(self) -> pd.DataFrame:
        """Return the constraints, one row each.

        The columns "largest" and "exponent" exist only if there is a smooth bound.
        """
        import pandas as pd

        table = pd.DataFrame(self.constraints, columns=list(Constraint._fields))
        has_bound = table["largest"].notna().any()
        return table if has_bound else table.drop(columns=["largest", "exponent"])

    def history(self) -> pd.DataFrame:
        """Return all evaluated designs in their order.

        The columns are "objective", "violation" (largest violation of a limit, relative to it), the
        constrained quantities, the numbers in the parameters, and "failure" (the reason if an
        analysis failed, whose values are NaN). A limited `SmoothMaximum` is multiplied by the ratio
        of the maximum over the run to it, both of the best design.
        """
        import pandas as pd

        return pd.DataFrame(dict(self._history))

    @property
    def starts(self) -> pd.DataFrame | None:
        """Table of all searches with first and last values, objective, violation and status.

        None without the argument `starts` of `optimize`.
        """
        import pandas as pd

        if self._starts is None:
            return None
        names = list(self._numbers)
        columns = ["status", "reason", "objective", "violation", "evaluations", *names]
        return pd.DataFrame(self._starts, columns=[*(f"first {x}" for x in names), *columns])

    def describe_starts(self) -> str:
        """Return how many of several searches end at the best objective, or "" of one search.

        Others have an objective that differs by over 0.1 %, or violate a constraint.
        """
        table = self.starts
        if table is None:
            return ""
        is_feasible = table["violation"] <= FEASIBILITY_TOLERANCE
        objectives = table["objective"][is_feasible].to_numpy(float)
        if not len(objectives):
            return f"none of {len(table)} searches ends at a design that satisfies the constraints"
        limit = objectives.min() + _EQUAL_OBJECTIVES * np.abs(objectives).max()
        text = f"{np.sum(objectives <= limit)} of {len(table)} searches end at this objective"
        worse = objectives[objectives > limit]
        if len(worse):
            unit = self.units["objective"]
            text += f"; the next best objective is {format_with_unit(float(worse.min()), unit)}"
        return text

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
    def units(self) -> dict[str, str]:
        """Units of the parameters and of the columns of `history`; "" if a unit is unknown."""
        headers = [f"{k}: {x.quantity.label}" for k, x in enumerate(self._problem.limits, 1)]
        units = self._problem.units_of(self.first_analyses)
        return dict(zip(("objective", *headers), units, strict=True)) | self._problem.units

    @property
    def max_evaluations(self) -> int:
        """Maximum number of evaluated designs, as given."""
        return self._search.max_evaluations

    @property
    def best_number(self) -> int:
        """Number of the best design in `history`, from 1."""
        return 1 + next(k for k, x in enumerate(self._search.trials) if x is self._search.best)

    def is_feasible(self, number: int) -> bool:
        """Return True if a design, by its number from 1, satisfies the constraints."""
        return bool(self._search.trials[number - 1].violation <= FEASIBILITY_TOLERANCE)

    def mechanism(self, is_best: bool = True) -> Mechanism:
        """Return the mechanism of the best or of the first design."""
        values = self._search.best.numbers if is_best else self._problem.first
        return self._problem.flat.model(**self._problem.parameters(values))

    def page(self, path: str | Path) -> Path:
        """Write an HTML page with the designs, the constraints and the parameters.

        The page shows the motions of the first and of the best design (of their runs, equilibrium
        paths or first modes, otherwise their drawings), and the objective and the constrained
        quantities of all evaluated designs.

        Parameters
        ----------
        path
            Path of the file.

        Raises
        ------
        BeamdaeError
            If the file cannot be written.
        """
        write: Any = deferred.module("report.optimization_page").write_optimization_page
        return Path(write(self, require_file_path("page", path)))

    def to_csv(self, path: str | Path, *, sep: str = ",", decimal: str = ".") -> Path:
        """Write `history` as CSV and return the path.

        Parameters
        ----------
        path
            Path of the file. An existing file is replaced.
        sep, decimal
            See `Solution.to_csv`.

        Raises
        ------
        BeamdaeError
            If an argument is invalid or the file cannot be written.
        """
        return write_escaped_table(path, self.history(), sep, decimal)


def create_optimization(
    problem: DesignProblem, search: SearchResult, starts: list[dict[str, Any]] | None
) -> Optimization:
    """Return the result of a search, with the analyses of its best design.

    `starts` are the rows of the table of several searches, of which this is the best one.
    """
    best, trials = search.best, search.trials
    design = problem.design(best.numbers)
    stationarity = search.stationarity
    constraints = _list_constraints(problem, search, design)
    at_lower, at_upper = find_active_bounds(problem, best.numbers)
    names = problem.names
    columns: dict[str, Any] = {
        "objective": [x.values[0] for x in trials],
        "violation": [x.violation for x in trials],
    }
    for k, limit in enumerate(problem.limits):
        ratio = search.ratios[k]
        columns[f"{k + 1}: {limit.quantity.label}"] = [ratio * x.values[1 + k] for x in trials]
    columns |= {name: [x.numbers[k] for x in trials] for k, name in enumerate(names)}
    columns["failure"] = [x.failure for x in trials]
    numbers = zip(
        best.numbers.tolist(), problem.lower.tolist(), problem.upper.tolist(), strict=True
    )
    results, status = design.results, search.status
    own: tuple[str, ...] = ()
    errors = None
    of_user_code: tuple[str, ...] = ()
    if not search.was_ended or design.wall_time <= _MAX_CHECKED_TIME:
        try:
            results, of_user_code = problem.checked_results(design)
            zeros = _check_zeros(problem, search)
            errors = deferred.module("accuracy.designs").measure_design(problem, search)
            own = (
                *errors.sentences(),
                *(
                    zeros
                    or _check_inactive_limits(problem, constraints, best.numbers, design)
                    or _check_distant_limits(problem, search, constraints)
                ),
            )
            own = (*own, *_check_signs(problem, search, constraints))
        except KeyboardInterrupt:
            acknowledge()
            if not search.was_ended:
                status = Status("interrupted", INTERRUPTED_CHECKS)
    messages = list_warnings(results)
    leaves = [x for quantity in problem.quantities for x in quantity.leaves]
    if not any(isinstance(x, (EquilibriumValue, EquilibriumErrors)) for x in leaves):
        # Paths of critical loads end beyond these.
        about_end = [x.instability for x in results if isinstance(x, Equilibrium)]
        messages = tuple(x for x in messages if x not in about_end)
    optimization = Optimization(
        parameter_values(problem.flat, best.numbers),
        float(best.values[0]),
        constraints,
        status,
        tuple(np.array(names)[at_lower | at_upper].tolist()),
        len(trials),
        float("nan") if stationarity is None else stationarity.residual,
        results,
        search.first_analyses,
        {"name": problem.flat.name, "parameters": dict(design.flat.parameters)},
        tuple(dict.fromkeys((*own, *messages, *of_user_code))),
        dict(zip(names, problem.first.tolist(), strict=True)),
        dict(zip(names, numbers, strict=True)),
        columns,
        problem.without_designs(),
        search,
        starts,
    )
    if errors is not None:
        vars(optimization)["errors"] = errors
    return optimization


def list_warnings(results: Sequence[Any]) -> tuple[str, ...]:
    """Return the warnings of results of analyses, each once.

    Those about the output rows and errors of runs are omitted, because quantities are integrals
    over the steps whose errors are measured.
    """
    omitted = {x for result in results if isinstance(result, Solution) for x in result.row_warnings}
    sentences = (x.model_warnings if isinstance(x, Solution) else x.warnings for x in results)
    messages = dict.fromkeys(message for x in sentences for message in x)
    return tuple(x for x in messages if x not in omitted)


def _list_constraints(
    problem: DesignProblem, search: SearchResult, design: Design
) -> tuple[Constraint, ...]:
    nothing = [float("nan")] * len(problem.limits)
    stationarity = search.stationarity
    multipliers = nothing if stationarity is None else stationarity.multipliers.tolist()
    _, *units = problem.units_of(search.first_analyses)
    values, firsts = (x.values[1:].tolist() for x in (search.best, search.trials[0]))
    ratios, noise = search.ratios.tolist(), problem.noise[1:].tolist()
    rows = zip(problem.limits, values, ratios, firsts, multipliers, units, noise, strict=True)
    constraints = []
    for limit, smooth, ratio, first, multiplier, unit, jump in rows:
        value = ratio * smooth
        margin = limit.margin(value)
        relative = _relative_margin(limit, margin, first, jump)
        numbers = (value, limit.bound, margin, multiplier, relative)
        largest, exponent = _find_largest(limit.quantity, smooth, design)
        if ratio > 1.0 and isinstance(limit.quantity, LargestOf):
            # The largest smooth maximum is below the largest maximum, which is the value.
            largest = value
        closer = _suggest_exponent(value / largest, exponent) if largest > 0.0 else float("nan")
        constraints.append(Constraint(limit.label, *numbers, unit, largest, closer))
    return tuple(constraints)


def _find_largest(quantity: Quantity, value: float, design: Design) -> tuple[float, float]:
    """Return the largest magnitude of which a quantity is a smooth bound, and its exponent.

    Both are NaN if the quantity is no smooth bound.
    """
    if isinstance(quantity, LargestOf):
        return quantity.largest(design.leaf_values), quantity.exponent
    column, is_maximum = "", False
    if isinstance(quantity, EquilibriumValue):
        column = quantity.column
    elif isinstance(quantity, RunQuantity) and len(quantity.objective.terms) == 1:
        factor, term = quantity.objective.terms[0]
        is_maximum = isinstance(term, SmoothMaximum)
        column = term.column if factor == 1.0 else ""
    name, _, column = column.partition(" [")[0].rpartition(".")
    for result in design.results if column == "bound" else ():
        if not isinstance(result, Solution if is_maximum else (Solution, Equilibrium)):
            continue
        mechanism = result.equations.mechanism
        observed = None if mechanism is None else mechanism.observables.get(name)
        exponent = None if observed is None else Beam.exponent_of_bound(observed)
        if exponent is None:
            continue
        largest, bound = (
            result.columns[Variable(f"{name}.{x}", "Pa").header] for x in ("largest", "bound")
        )
        if is_maximum:
            return float(np.max(largest)), exponent
        # Several analyses may contain the column, but one row has the value.
        row = int(np.argmin(np.abs(bound - value)))
        if abs(bound[row] - value) <= FEASIBILITY_TOLERANCE * abs(value):
            return float(largest[row]), exponent
    return float("nan"), float("nan")


def _suggest_exponent(ratio: float, exponent: float) -> float:
    """Return the exponent with which bound / largest is about 1 %; NaN if it is not above."""
    # The ratio is N^(1/p) with an effective number N of sections.
    if ratio <= 1.0 + _RECOMMENDED_BOUND_EXCESS:
        return float("nan")
    recommended = exponent * math.log(ratio) / math.log(1.0 + _RECOMMENDED_BOUND_EXCESS)
    return min(math.ceil(recommended / 10.0) * 10.0, MAX_EXPONENT)


def _relative_margin(limit: Limit, margin: float, first: float, noise: float) -> float:
    """Return the margin relative to the limit; 0 within the tolerance of the search, or the noise.

    The tolerance of a limit of zero is relative to the first value of the quantity.
    """
    size = abs(limit.bound)
    if abs(margin) <= max(FEASIBILITY_TOLERANCE, noise) * (size or abs(first) or 1.0):
        return 0.0
    return margin / size if size else float("nan")


def _check_distant_limits(
    problem: DesignProblem, search: SearchResult, constraints: Sequence[Constraint]
) -> tuple[str, ...]:
    """Return a warning if limits are far from the values of all designs, as in another unit."""
    trials = np.abs([x.values[1:] for x in search.trials if not x.failure]) * search.ratios
    distances: dict[int, tuple[float, float]] = {}
    for k, (limit, constraint) in enumerate(zip(problem.limits, constraints, strict=True)):
        bound, is_upper = abs(limit.bound), limit.sign * limit.bound > 0.0
        nearest = float(np.max(trials[:, k]) if is_upper else np.min(trials[:, k]))
        small, large = (nearest, bound) if is_upper else (bound, nearest)
        if constraint.margin > 0.0 and 0.0 < _MIN_DISTANT_RATIO * small < large:
            distances[k] = large / small, nearest
    if not distances:
        return ()
    farthest, *others = sorted(distances, key=lambda k: -distances[k][0])
    constraint, (ratio, nearest) = constraints[farthest], distances[farthest]
    limit_text, value = (
        format_with_unit(float(f"{x:.3g}"), constraint.unit) for x in (constraint.limit, nearest)
    )
    label = problem.limits[farthest].quantity.label
    name = name_with_others(label, [constraints[k].name for k in others], most=1)
    is_upper = problem.limits[farthest].sign * constraint.limit > 0.0
    times = float(f"{ratio:.2g}")
    comparison = f"{times:.0f} times the largest" if is_upper else f"1/{times:.0f} of the smallest"
    return (
        f"{name}: the limit of {limit_text} is {comparison} magnitude of all designs, {value}, "
        "and has no effect; check its unit (numbers are in SI units).",
    )


def _check_signs(
    problem: DesignProblem, search: SearchResult, constraints: Sequence[Constraint]
) -> tuple[str, ...]:
    """Return a warning for each quantity whose magnitude is beyond the limit of its signed value.

    Quantities with limits on both sides have none, nor have those other than stresses whose sign
    is that of the limit for some design.
    """
    labels = [limit.quantity.label for limit in problem.limits]
    trials = np.array([x.values[1:] for x in search.trials if not x.failure])
    messages = []
    for k, (limit, label, x) in enumerate(zip(problem.limits, labels, constraints, strict=True)):
        # A limit on the side of compression, such as at_least(stress, -2e8), permits any tension.
        bound, value = limit.sign * x.limit, limit.sign * x.value
        if labels.count(label) > 1 or not 0.0 < bound < -value:
            continue
        if x.unit == "Pa":
            reason = "because stresses have a sign"
        elif np.max(limit.sign * trials[:, k]) < 0.0:
            sign = "negative" if x.value < 0.0 else "positive"
            reason = f"because it is {sign} for every design, so that the limit has no effect"
        else:
            continue
        size, most = (
            format_with_unit(float(f"{number:.4g}"), x.unit) for number in (x.value, x.limit)
        )
        other = "at_least" if limit.sign > 0 else "at_most"
        messages.append(
            f"{label} is {size}, {-value / bound:.3g} times its limit of {most} in magnitude, "
            f"{reason}; to limit the magnitude, add {other}(quantity, {-x.limit:.4g}) or limit "
            "LargestOf([quantity])."
        )
    return tuple(messages)


def _check_zeros(problem: DesignProblem, search: SearchResult) -> tuple[str, ...]:
    """Return a warning for each quantity that is zero or negligible for every design.

    It is of a column that nothing moves, for example because an equilibrium is at a time at which
    a driver is at zero. Without loads, strains and forces are rounding errors.
    """
    values = np.array([x.values for x in search.trials if not x.failure])
    largest = np.max(np.abs(values), axis=0)
    units = problem.units_of(search.first_analyses)
    messages = []
    for k in np.flatnonzero(largest <= _negligible_sizes(problem, search, units)).tolist():
        quantity = problem.quantities[k]
        is_static = any(isinstance(x, EquilibriumQuantity) for x in quantity.leaves)
        cause = (
            "check the loads, and set t= to a time at which drivers are not at zero"
            if is_static
            else "check the column and the motion of the model"
        )
        effect = "any design minimizes it"
        if k:
            is_satisfied = problem.limits[k - 1].margin(0.0) >= 0.0
            effect = "its limit has no effect" if is_satisfied else "no design satisfies its limit"
        size = "zero for every design"
        if largest[k]:
            most = format_with_unit(float(f"{largest[k]:.2g}"), units[k])
            size = f"negligible for every design, at most {most}"
        messages.append(f"{quantity.label} is {size}, so that {effect}; {cause}.")
    return tuple(messages)


def _negligible_sizes(
    problem: DesignProblem, search: SearchResult, units: Sequence[str]
) -> np.ndarray:
    """Return the sizes (1 + C,) up to which the objective and limited quantities are negligible.

    These are a billionth of the limit and, within a millionth of it, the rounding errors of strains
    and forces.
    """
    equations = next((x.equations for x in search.first_analyses if hasattr(x, "equations")), None)
    rounding = np.zeros(len(units))
    if equations is not None:
        rounding = rounding_limits(equations, [Variable("", x).header for x in units])
    limits = np.array([np.inf, *(abs(x.bound) or np.inf for x in problem.limits)])
    shares = np.where(np.isfinite(limits), _NEGLIGIBLE_SHARE * limits, 0.0)
    return np.maximum(shares, np.minimum(rounding, _MAX_ROUNDING_SHARE * limits))


def _check_inactive_limits(
    problem: DesignProblem, constraints: Sequence[Constraint], numbers: np.ndarray, design: Design
) -> tuple[str, ...]:
    """Return a warning if all numbers are at bounds and no limit is near its quantity."""
    if not constraints or not np.all(np.any(find_active_bounds(problem, numbers), axis=0)):
        return ()
    for limit, constraint in zip(problem.limits, constraints, strict=True):
        value, bound = abs(constraint.value), abs(constraint.limit)
        is_upper = limit.sign * constraint.limit > 0.0
        small, large = (value, bound) if is_upper else (bound, value)
        if not bound or constraint.margin < 0.0 or not small < _MAX_INACTIVE_RATIO * large:
            return ()
    path = next((x for x in design.results if isinstance(x, Equilibrium)), None)
    motions: tuple[str, ...] = ()
    if path is not None:
        e = path.equations
        time = time_on_branch(e.breakpoints, path.t)
        joints = analyze_constraint_rank(ConsistencySolver(e), time, e.q0)
        motions = describe_free_motions(e, e.q0, joints)
    free = f" ({list_first(motions, _MAX_NAMES)} without strains)" if motions else ""
    return (
        "all numbers are at bounds, and no quantity is within a factor of "
        f"{1.0 / _MAX_INACTIVE_RATIO:.0f} of its limit, so that the bounds alone determine the "
        f"design; check loads, supports{free} and limits.",
    )
