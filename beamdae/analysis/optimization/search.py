"""Search of an optimum: the policy that both solvers share, and searches from several designs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.analysis.optimization.problem import (
    FEASIBILITY_TOLERANCE,
    DesignProblem,
    Linearization,
)
from beamdae.analysis.optimization.solvers import Method, SmoothProblem, relax_limits, solve
from beamdae.analysis.parameter_bounds import draw_starts
from beamdae.errors import (
    BeamdaeError,
    ProgressError,
    call_progress,
    format_count,
    format_distinct,
    format_exception,
    list_first,
)
from beamdae.interrupts import acknowledge
from beamdae.model_parameters import format_with_unit
from beamdae.results.outcome import Status

Array = np.ndarray

# Decrease of the linearized objective within a step of one size, relative to that without
# constraints and bounds, up to which a design is an optimum, and smallest decrease of the scaled
# objective to which it is relative: gradients of minima in the interior vanish.
_OPTIMALITY_TOLERANCE, _MIN_DECREASE = 0.05, 0.1
# Relative difference up to which maxima over a run, objectives, and numbers and bounds are equal.
EQUAL_RATIO = 1e-3
_MAX_ROUNDS = 6  # of searches with other ratios of maxima
_INTERRUPTED = Status("interrupted", "interrupted before the end of all searches")


@dataclass(frozen=True)
class SearchSettings:
    """Arguments of `optimize` for a search."""

    method: Method
    max_evaluations: int
    tolerance: float
    progress: Callable[[int, float, float], object] | None


@dataclass(frozen=True, eq=False)
class Trial:
    """Evaluated design.

    Attributes
    ----------
    numbers
        Values (k,) of the numbers in the parameters.
    values
        Values (1 + C,) of the objective and of the constrained quantities; NaN if an analysis
        failed.
    failure
        Reason for the failure, or "".
    """

    numbers: Array
    values: Array
    failure: str = ""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """End of a search.

    Attributes
    ----------
    problem
        The problem with the ratios of maxima of the best design.
    best
        The best evaluated design.
    trials
        All evaluated designs, in their order.
    status
        Reason of the end.
    first_analyses
        Results of the analyses of the first design.
    units
        Units (1 + C,) of the objective and the limited quantities; "" if unknown.
    max_evaluations
        Maximum number of designs.
    multipliers, residual
        Multipliers (C,), the decrease of the objective per unit by which a limit is relaxed; the
        possible decrease, relative to that without constraints. NaN if the search was interrupted.
    idle
        Names of the numbers on which no quantity depends at the best design.
    progress_error
        Exception of the user's function `progress` that ended the search, or None.
    """

    problem: DesignProblem
    best: Trial
    trials: tuple[Trial, ...]
    status: Status
    first_analyses: tuple[Any, ...]
    units: tuple[str, ...]
    max_evaluations: int
    multipliers: Array
    residual: float = float("nan")
    idle: tuple[str, ...] = ()
    progress_error: Exception | None = None

    @property
    def was_ended(self) -> bool:
        """True if an interrupt or an exception of `progress` ended the search."""
        return self.status.kind == "interrupted" or self.progress_error is not None

    @property
    def violation(self) -> float:
        """Largest violation of a limit by the best design, 0 within the tolerances."""
        return self.problem.violation(self.best.values)


class _SearchEndError(Exception):
    """End of a search for a reason other than that of its solver."""

    def __init__(self, kind: Any, sentence: str) -> None:
        super().__init__(sentence)
        self.status = Status(kind, sentence)


class Search:
    """Minimization from the first design of a problem.

    All designs of a solver have the same ratios of maxima to smooth maxima, with which the values
    are smooth functions: maxima have kinks (Le et al., Struct. Multidisc. Optim. 41 (2010) 605,
    doi:10.1007/s00158-009-0440-y).
    """

    def __init__(self, problem: DesignProblem, settings: SearchSettings) -> None:
        self._problem, self._settings = problem, settings
        # Variables and functions of the design with the latest gradients of the present solver.
        self._latest: tuple[Array, Linearization] | None = None
        # Evaluated designs by the variables of the search, in their order.
        self._known: dict[bytes, Trial] = {}

    def run(self) -> SearchResult:
        """Search until convergence, a limit or an interrupt.

        Raises
        ------
        BeamdaeError
            If an analysis of the first design or its gradient fails.
        """
        problem = self._problem
        first, most = problem.design(problem.first), self._settings.max_evaluations
        units = tuple(problem.units_of(first.results))
        x = problem.variables.variables(problem.first)
        trial = self._known[x.tobytes()] = Trial(problem.first, first.values)
        facts: dict[str, Any] = {"multipliers": np.full(len(problem.limits), np.nan)}
        try:
            self._problem = problem.scaled_by(first)
            self._report(trial)
            status, best = self._search(), self._best()
            point, scales = self._problem.linearize(best.numbers, best.values), self._problem.scales
            decrease, multipliers = point.measure_decrease()
            residual = decrease / max(float(np.linalg.norm(point.gradient)), _MIN_DECREASE)
            has_effect = np.any(np.vstack([point.gradient, point.jacobian]), axis=0)
            facts = {
                "multipliers": multipliers * scales[0] / scales[1:],
                "residual": residual,
                "idle": tuple(np.array(problem.names)[~has_effect].tolist()),
            }
            status = self._conclude(status, units, residual)
        except KeyboardInterrupt:
            acknowledge()
            sentence = f"interrupted after {format_count(len(self._known), 'evaluation')}"
            status = Status("interrupted", sentence)
        except ProgressError as failure:
            status = Status("failed", str(failure))
            facts["progress_error"] = failure.problem
        except (BeamdaeError, ArithmeticError) as failure:
            if self._problem is problem:
                raise  # Errors of the first gradient concern the model rather than a design.
            status = self._conclude(Status("failed", describe_failure(failure)), units)
        trials, results = tuple(self._known.values()), first.results
        return SearchResult(
            self._problem, self._best(), trials, status, results, units, most, **facts
        )

    def _search(self) -> Status:
        """Search until the maxima of the best design are those assumed."""
        for _ in range(_MAX_ROUNDS):
            status = self._solve(self._settings.method)
            if status.success and self._violation(self._best()):
                status = self._solve("SLSQP", relax_limits)
                if status.success and not self._violation(self._best()):
                    status = self._solve(self._settings.method)
            # Further designs have the maxima of the best one.
            problem = self._problem
            design, limits = problem.design(self._best().numbers), problem.limits
            rows = zip(limits, design.values[1:].tolist(), strict=True)
            ratios = np.array([design.maximum_ratio(limit, value) for limit, value in rows])
            is_off = np.abs(ratios - problem.ratios) > EQUAL_RATIO * problem.ratios
            # Maxima that do not reach their limit need no further search.
            largest = np.maximum(ratios, problem.ratios) * np.abs(design.values[1:])
            reaches = largest * (1.0 + EQUAL_RATIO) > np.abs([x.bound for x in limits])
            self._problem = replace(problem, ratios=np.where(is_off, ratios, problem.ratios))
            if not (status.success and np.any(is_off & reaches)):
                break
        return status

    def _solve(
        self, method: Method, change: Callable[[SmoothProblem], SmoothProblem] = lambda x: x
    ) -> Status:
        """Minimize from the best design, and return why the solver ended."""
        problem, settings, best = self._problem, self._settings, self._best()
        self._latest = None
        points = [problem.variables.variables(best.numbers), *problem.variables.limits]
        smooth = SmoothProblem(self._values, self._gradients, len(problem.limits), *points)
        try:
            solve(change(smooth), method, settings.tolerance, settings.max_evaluations)
        except _SearchEndError as end:
            return end.status
        except (BeamdaeError, ArithmeticError) as failure:
            return Status("failed", describe_failure(failure))
        return Status("ok", "the solver ended")

    def _values(self, x: Array) -> tuple[float, Array]:
        """Return the function to minimize, infinite if an analysis fails, and the margins (C,)."""
        problem = self._problem
        trial = self._known.get(x.tobytes()) or self._evaluate(x)
        if trial.failure:
            return np.inf, np.zeros(len(problem.ratios))
        margins = problem.log_margins(problem.margins(trial.values))[0]
        return float(trial.values[0] / problem.scales[0]), margins

    def _gradients(self, x: Array) -> tuple[Array, Array]:
        """Return the derivatives of the function to minimize and of the margins.

        The search ends at designs that satisfy the conditions of first order.
        """
        trial = self._known[x.tobytes()]
        if trial.failure:
            raise _SearchEndError("ok", "analyses fail")
        point = self._problem.linearize(trial.numbers, trial.values)
        self._latest = x.copy(), point
        is_feasible = np.all(point.margins >= -FEASIBILITY_TOLERANCE)
        if is_feasible and point.measure_decrease()[0] <= self._settings.tolerance:
            raise _SearchEndError("ok", "converged")
        return point.gradient, point.jacobian

    def _evaluate(self, x: Array) -> Trial:
        """Analyze a design that is not known, unless the search has to end."""
        count, problem, settings = len(self._known), self._problem, self._settings
        if count >= settings.max_evaluations:
            sentence = f"stopped after {format_count(count, 'evaluation')}"
            raise _SearchEndError("limited", f"{sentence}; increase max_evaluations=")
        if self._latest is not None:
            # Line searches of values that jump between designs would only compare these jumps.
            here, point = self._latest
            changes = np.abs(np.vstack([point.gradient, point.jacobian]) @ (x - here))
            if np.all(changes <= np.maximum(problem.noise, settings.tolerance)):
                raise _SearchEndError("ok", "values change by less than their errors")
        numbers = problem.variables.values(x)
        try:
            trial = Trial(numbers, problem.design(numbers).values)
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            nothing = np.full(1 + len(problem.ratios), np.nan)
            trial = Trial(numbers, nothing, describe_failure(failure))
        self._known[x.tobytes()] = trial
        if not trial.failure:
            self._report(trial)
        return trial

    def _conclude(self, status: Status, units: tuple[str, ...], residual: float = np.inf) -> Status:
        """Return the status of the best design, with its `residual` if known."""
        failures, sentence = [x.failure for x in self._known.values() if x.failure], status.sentence
        problem, values = self._problem, self._best().values
        if problem.violation(values):
            margins = problem.margins(values)
            worst, is_violated = int(np.argmin(margins)), -margins > problem.tolerances
            limit, value = problem.limits[worst], problem.ratios[worst] * values[1 + worst]
            numbers = format_distinct(limit.bound, float(value), digits=4)
            allowed, actual = (format_with_unit(x, units[1 + worst]) for x in numbers)
            violated = [x.label for x, y in zip(problem.limits, is_violated, strict=True) if y]
            cause = f"{list_first(violated)} cannot be satisfied by small changes"
            sentence = (
                "no evaluated design satisfies the constraints; in the best one "
                f"{limit.quantity.label} is {actual}, but the limit is at "
                f"{'most' if limit.sign > 0 else 'least'} {allowed}; "
                f"{cause if status.success else sentence}; the search is local, start it from "
                "other values (parameters={name: value}) or increase starts="
            )
        elif status.success and residual <= _OPTIMALITY_TOLERANCE:
            return Status("ok", "converged")
        else:
            if status.success:
                cause = "analyses fail" if failures else "a quantity jumps or has a kink"
                sentence = f"the search ended next to designs at which {cause}, before an optimum"
            if problem.noise.any():
                sentence += (
                    "; values of runs with adaptive steps change abruptly between designs, use a "
                    "fixed step, GeneralizedAlpha(step=...)"
                )
        if failures:
            sentence += (
                f"; {len(failures)} analyses failed, the last one: {failures[-1]}; pass bounds= "
                "that exclude such designs"
            )
        return Status("limited" if status.success else status.kind, sentence)

    def _report(self, trial: Trial) -> None:
        if self._settings.progress is not None:
            facts = float(trial.values[0]), self._violation(trial)
            call_progress(self._settings.progress, len(self._known), *facts)

    def _violation(self, trial: Trial) -> float:
        return self._problem.violation(trial.values)

    def _best(self) -> Trial:
        """Return the design with the smallest violation, and with the best objective of these."""
        designs = [x for x in self._known.values() if not x.failure]
        return min(designs, key=lambda x: (self._violation(x), float(x.values[0])))


def search_from_starts(
    problem: DesignProblem, settings: SearchSettings, starts: int, seed: int
) -> tuple[SearchResult, list[dict[str, Any]] | None]:
    """Return the best of several searches, and the rows of the table of all; None for one search.

    See `optimize` for the arguments.

    Raises
    ------
    BeamdaeError
        If a number has no finite bounds, or the first designs of all searches fail.
    """
    if starts == 1:
        return Search(problem, settings).run(), None
    names, bounds = problem.names, (problem.lower, problem.upper)
    points = [problem.first, *draw_starts("optimize", names, *bounds, starts - 1, seed)]
    searches: list[SearchResult] = []
    rows: list[dict[str, Any]] = []
    status = None

    def report(designs: int, *facts: float) -> None:
        if settings.progress is not None:
            settings.progress(sum(len(x.trials) for x in searches) + designs, *facts)

    for point in points:
        row: dict[str, Any] = {f"first {x}": y for x, y in zip(names, point, strict=True)}
        rows.append(row | {"status": "failed", "evaluations": 1})
        try:
            end = Search(problem.starting_at(point), replace(settings, progress=report)).run()
        except KeyboardInterrupt:
            if not searches:
                raise
            acknowledge()
            rows.pop()
            status = _INTERRUPTED
            break
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            rows[-1]["reason"] = describe_failure(failure)
            continue
        searches.append(end)
        rows[-1] |= {
            "status": end.status.kind,
            "reason": end.status.sentence,
            "objective": float(end.best.values[0]),
            "violation": end.violation,
            "evaluations": len(end.trials),
            **dict(zip(names, end.best.numbers.tolist(), strict=True)),
        }
        if end.was_ended:
            status = _INTERRUPTED if end.progress_error is None else end.status
            break
    if not searches:
        raise BeamdaeError(
            f"optimize: the first designs of all {starts} searches failed; the first one: "
            f"{rows[0]['reason']}."
        )

    def rank(search: SearchResult) -> tuple[float, float, bool, float]:
        """Return a key that is smallest for the best design; of equal ones, for a converged one."""
        objective = float(search.best.values[0])
        return search.violation, float(f"{objective:.6g}"), not search.status.success, objective

    best, error = min(searches, key=rank), searches[-1].progress_error
    return replace(best, status=status or best.status, progress_error=error), rows


def describe_failure(failure: Exception) -> str:
    """Return the message of an error of an analysis or of the model function."""
    if isinstance(failure, BeamdaeError):
        return str(failure).removeprefix("optimize: ").removesuffix(".")
    return format_exception(failure)
