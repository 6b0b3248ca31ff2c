"""Stored references by two methods, their disagreement, and errors of runs against them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import chain, pairwise, takewhile
from time import process_time

import numpy as np
import pandas as pd
from scipy.linalg import eigh, null_space
from stored_columns import write_columns
from tolerances.cases import (
    REFERENCES,
    STORED_DIGITS,
    ToleranceCase,
    load_references,
    relative_deviations,
)

import beamdae as bd
from beamdae.equations import measures
from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.consistent_start import ConsistencySolver

SUMMARY = REFERENCES.with_name("summary.csv")
CONVERGED = 1e-7  # Refinement stops at a smaller change, relative to the amplitude.
PATIENCE = 15.0  # longest expected processor time of the next refinement [s]
RTOLS = tuple(10.0**-k for k in range(7, 13))
STEPS = tuple(2000 * 2**k for k in range(10))
# Rates and reactions converge later than positions, and their errors are only listed.
DERIVATIVE_WEIGHT = 0.01
# Wall time limit of a run over its longest expected processor time, for runs whose steps collapse.
TIME_LIMIT_RATIO = 4.0


def solve_small_vibrations(mechanism: bd.Mechanism, times: np.ndarray) -> dict[str, np.ndarray]:
    """Return observed columns by name at `times`, to first order in the loads.

    The equations are linearized about the unloaded drawing, M x'' + D x' + K x = f under G x = 0,
    and each mode follows x = f / w^2 (1 + (r2 exp(r1 t) - r1 exp(r2 t)) / (r1 - r2)) with r1 and r2
    the roots of r^2 + d r + w^2 = 0. Damping must be proportional, and rigid-body modes are not
    supported.
    """
    e = bd.equations_of_motion(mechanism)
    solver, t = ConsistencySolver(e), np.zeros(2)
    rest = State(e.q0, np.zeros(e.n), np.zeros(e.n), np.zeros(e.m))
    stiffness, damping, mass = (m.toarray() for m in solver.linearize_forces(t, rest))
    load = -solver.force(t, rest.q, rest.v, np.zeros(e.n))
    g = solver.constraint_matrix(t, rest.q).toarray()

    free = null_space(g)
    squares, modes = eigh(free.T @ stiffness @ free, free.T @ mass @ free)
    modes = free @ modes
    rates = np.einsum("ij,ij->j", modes, damping @ modes)
    root = np.sqrt((0.25 * rates**2 - squares).astype(complex))
    r1, r2 = -0.5 * rates + root, -0.5 * rates - root
    exponentials = [np.exp(np.outer(times, r)) for r in (r1, r2)]
    deflection = (modes.T @ load) / squares
    amplitude = deflection * (1.0 + (r2 * exponentials[0] - r1 * exponentials[1]) / (r1 - r2)).real
    rate = deflection * (squares * (exponentials[0] - exponentials[1]) / (r1 - r2)).real
    acceleration = (
        deflection * (squares * (r1 * exponentials[0] - r2 * exponentials[1]) / (r1 - r2)).real
    )

    x, v, a = (k @ modes.T for k in (amplitude, rate, acceleration))
    force = a @ mass.T + v @ damping.T + x @ stiffness.T - load
    lam = -np.linalg.lstsq(g.T, force.T, rcond=None)[0].T
    time_rows = np.stack([times, times], axis=-1)
    rows = measures.ObservedRows(e)(time_rows, e.q0 + x, v, a, lam)
    headers = [header for quantity in e.observables for header in quantity.headers]
    return dict(zip(headers, rows.T, strict=True))


@cache
def reference_uncertainties() -> pd.Series:
    """Return the disagreement of the two reference methods by case and column."""
    table = pd.read_csv(SUMMARY)
    compared = table[table["method 1"] != "stored reference"]
    return compared.set_index(["case", "column"])["disagreement"]


def measure_errors(case: ToleranceCase, solution: bd.results.Solution) -> pd.DataFrame:
    """Return error and uncertainty of the guaranteed columns, relative to their amplitudes.

    The uncertainty of the reference includes the rounding of its stored values.
    """
    columns = list(case.columns + case.deflections)
    uncertainty = reference_uncertainties()[case.name][columns] + case.reference_rounding(columns)
    errors = case.errors(solution, columns=columns)
    return pd.DataFrame({"error": errors, "uncertainty": uncertainty}, index=columns)


@dataclass(frozen=True)
class MethodResult:
    """Rows of all compared columns by one method, and a description of the method."""

    method: str
    rows: np.ndarray


def store_reference(case: ToleranceCase) -> pd.DataFrame:
    """Store the reference of a case, update the summary and return its rows there."""
    table, rows = compute_reference(case)
    write_reference(case.name, table, rows)
    return rows


def write_reference(name: str, reference: pd.DataFrame, rows: pd.DataFrame) -> None:
    """Write the reference of a case and its rows of the summary in place of the stored ones."""
    references = load_references() | {name: reference.to_dict("list")}
    write_columns(REFERENCES, dict(sorted(references.items())), STORED_DIGITS)
    load_references.cache_clear()
    summary = pd.read_csv(SUMMARY) if SUMMARY.exists() else rows.iloc[:0]
    others = summary[summary["case"] != name]
    pd.concat([others, rows]).to_csv(SUMMARY, index=False, float_format="%.2g")


def compute_reference(case: ToleranceCase) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the rows of the first method and the disagreement of the second by column.

    Raises
    ------
    SystemExit
        If no run of one of the methods reaches the end.
    """
    results = _refine_until_converged(case, _radau_results(case))
    if not results and not case.exact:
        raise SystemExit(f"{case.name}: Radau did not reach the end")
    if case.exact:
        first = MethodResult("closed form", case.exact(case.times))
        # Radau may fail in a singular position, which fixed steps pass over.
        others = iter(results[-1:]) if results else _extrapolated_results(case)
        second = _select_nearest(case, first, others)
    elif case.modal:
        first, second = _modal_result(case), results[-1]
    else:
        first = results[-1]
        others = chain(_bdf_results(case), _extrapolated_results(case))
        second = _select_nearest(case, first, others)
    headers = list(case.compared)
    table = pd.DataFrame(first.rows, columns=headers)
    table.insert(0, "t [s]", case.times)
    summary = pd.DataFrame({"case": case.name, "column": headers})
    summary["method 1"], summary["method 2"] = first.method, second.method
    summary["disagreement"] = relative_deviations(second.rows, first.rows)
    summary["last refinement"] = (
        relative_deviations(results[-2].rows, results[-1].rows) if len(results) > 1 else np.nan
    )
    return table, pd.concat([summary, _compare_with_published(case, table)])


def _compare_with_published(case: ToleranceCase, table: pd.DataFrame) -> pd.DataFrame:
    """Return the deviations of the end of a reference from published numbers, if any."""
    end_values = case.published
    columns = table[list(end_values)]
    deviations = np.abs(columns.iloc[-1] - pd.Series(end_values, dtype=float)) / (
        0.5 * np.ptp(columns, axis=0)
    )
    return pd.DataFrame(
        {
            "case": case.name,
            "column": list(end_values),
            "method 1": "stored reference",
            "method 2": "published, at the end",
            "disagreement": deviations.to_numpy(),
        }
    )


def _max_deviation(case: ToleranceCase, first: MethodResult, second: MethodResult) -> float:
    """Return the largest deviation; rates and reactions have the weight `DERIVATIVE_WEIGHT`."""
    deviations = relative_deviations(second.rows, first.rows)
    deviations[len(case.columns) + len(case.deflections) :] *= DERIVATIVE_WEIGHT
    return float(deviations.max())


def _refine_until_converged(
    case: ToleranceCase, results: Iterable[MethodResult]
) -> list[MethodResult]:
    """Return successively refined results up to the first that has converged."""
    refined: list[MethodResult] = []
    for result in results:
        refined.append(result)
        if len(refined) > 1 and _max_deviation(case, result, refined[-2]) < CONVERGED:
            break
    return refined


def _select_nearest(
    case: ToleranceCase, reference: MethodResult, results: Iterable[MethodResult]
) -> MethodResult:
    """Return the result nearest to the reference, or the first within the convergence limit."""
    nearest = None
    for result in results:
        deviation = _max_deviation(case, reference, result)
        if nearest is None or deviation < _max_deviation(case, reference, nearest):
            nearest = result
        if _max_deviation(case, reference, nearest) < CONVERGED:
            break
    if nearest is None:
        raise SystemExit(f"{case.name}: the second method did not reach the end")
    return nearest


def _run_in_turn(
    case: ToleranceCase, integrators: Iterable[bd.Integrator], growth: float
) -> Iterator[MethodResult | None]:
    """Yield the results of successive runs, None for one that fails, as long as they are short.

    Each run is expected to take `growth` times as long as the one before.
    """
    last_time = 0.0
    for integrator in integrators:
        if growth * last_time > PATIENCE:
            return
        start = process_time()
        solution = case.run(integrator)
        last_time = process_time() - start
        rows = solution.observed[list(case.compared)].to_numpy()
        yield MethodResult(integrator.label, rows) if solution.status.success else None


# At order 5 a tenth of the tolerance takes 1.6 times the steps.
_GROWTH = 1.6

_LIMIT = {"time_limit": TIME_LIMIT_RATIO * PATIENCE}


def _radau_results(case: ToleranceCase) -> Iterator[MethodResult]:
    runs = _run_in_turn(case, (bd.Radau(rtol, **_LIMIT) for rtol in RTOLS), _GROWTH)
    yield from takewhile(lambda result: result is not None, runs)


def _bdf_results(case: ToleranceCase) -> Iterator[MethodResult]:
    """Yield results of Ida where damping or the absence of fast modes permits order 5."""
    first_step = bd.simulate(case.build(), bd.Ida(max_steps=1), case.duration)
    if first_step.integrator["max_order"] < 5:
        return
    methods = (bd.Ida(10.0**-k, error_control="velocities", **_LIMIT) for k in (8, 9, 10, 11))
    runs = _run_in_turn(case, methods, _GROWTH)
    yield from takewhile(lambda result: result is not None, runs)


def _extrapolated_results(case: ToleranceCase) -> Iterator[MethodResult]:
    """Yield Richardson extrapolations of generalized-alpha with steps 2 h and h."""
    methods = (
        bd.GeneralizedAlpha(case.duration / steps, 0.9, newton_tolerance=1e-9) for steps in STEPS
    )
    for coarse, fine in pairwise(_run_in_turn(case, methods, 2.0)):
        if coarse is not None and fine is not None:
            rows = fine.rows + (fine.rows - coarse.rows) / 3.0
            yield MethodResult(f"{fine.method}, extrapolated", rows)


def _modal_result(case: ToleranceCase) -> MethodResult:
    columns = solve_small_vibrations(case.build(), case.times)
    rows = np.stack([columns[name] for name in case.compared], axis=-1)
    return MethodResult("modes of the linearized equations", rows)
