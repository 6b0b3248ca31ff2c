"""Stored references of the cases: two methods of different kind, and how far they differ."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from time import process_time

import numpy as np
import pandas as pd

import beamdae as bd
from tolerances.modal import solve_small_vibrations
from tolerances.tolerance_case import FOLDER, ToleranceCase, relative_deviations

SUMMARY = FOLDER / "summary.csv"
RTOLS = tuple(10.0**-k for k in range(7, 13))
STEPS = tuple(2000 * 2**k for k in range(10))


@dataclass(frozen=True)
class Effort:
    """How far references are refined.

    Attributes
    ----------
    settled
        Refinement ends where it changes less than this share of the amplitude.
    patience
        A method is refined while its next run is expected to take less processor time [s].
    """

    settled: float = 1e-7
    patience: float = 15.0


@dataclass(frozen=True)
class MethodResult:
    """Rows of all compared columns by one method, and the method in words."""

    method: str
    rows: np.ndarray


def store_reference(case: ToleranceCase, effort: Effort) -> pd.DataFrame:
    """Store the reference of a case, and in the summary how well it is known; its lines there."""
    table, lines = compute_reference(case, effort)
    FOLDER.mkdir(exist_ok=True)
    table.to_csv(FOLDER / f"{case.name}.csv", index=False, float_format="%.9g")
    known = pd.read_csv(SUMMARY) if SUMMARY.exists() else lines.iloc[:0]
    others = known[known["case"] != case.name]
    pd.concat([others, lines]).to_csv(SUMMARY, index=False, float_format="%.2g")
    return lines


def compute_reference(case: ToleranceCase, effort: Effort) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Rows by the first method, and by column how far the second one is from them.

    Raises
    ------
    SystemExit
        If no run of one of the methods reached the end.
    """
    answers = _refine_until_converged(case, _radau_results(case, effort), effort)
    if not answers:
        raise SystemExit(f"{case.name}: Radau did not reach the end")
    truth = answers[-1]
    if case.exact:
        truth, witness = MethodResult("closed form", case.exact(case.times)), truth
    elif case.small:
        truth, witness = _modal_result(case), truth
    else:
        others = chain(_bdf_results(case, effort), _extrapolated_results(case, effort))
        witness = _select_nearest(case, truth, others, effort)
    headers = [*case.columns, *case.reactions]
    table = pd.DataFrame(truth.rows, columns=headers)
    table.insert(0, "t [s]", case.times)
    lines = pd.DataFrame({"case": case.name, "column": headers})
    lines["method 1"], lines["method 2"] = truth.method, witness.method
    lines["disagreement"] = relative_deviations(witness.rows, truth.rows)
    lines["last refinement"] = (
        relative_deviations(answers[-2].rows, answers[-1].rows) if len(answers) > 1 else np.nan
    )
    return table, pd.concat([lines, _compare_with_published(case, table)])


def _compare_with_published(case: ToleranceCase, table: pd.DataFrame) -> pd.DataFrame:
    """How far the end of a reference is from published numbers, where there are some."""
    ends = case.published or {}
    columns = table[list(ends)]
    apart = np.abs(columns.iloc[-1] - pd.Series(ends, dtype=float)) / (
        0.5 * np.ptp(columns, axis=0)
    )
    return pd.DataFrame(
        {
            "case": case.name,
            "column": list(ends),
            "method 1": "stored reference",
            "method 2": "published, at the end",
            "disagreement": apart.to_numpy(),
        }
    )


def _max_deviation(case: ToleranceCase, truth: MethodResult, other: MethodResult) -> float:
    """How far two answers differ in the columns the promise is about."""
    n = len(case.columns)
    return float(relative_deviations(other.rows[:, :n], truth.rows[:, :n]).max())


def _refine_until_converged(
    case: ToleranceCase, answers: Iterable[MethodResult], effort: Effort
) -> list[MethodResult]:
    """Ever finer answers up to the first that hardly differs from the one before."""
    found: list[MethodResult] = []
    for answer in answers:
        found.append(answer)
        if len(found) > 1 and _max_deviation(case, answer, found[-2]) < effort.settled:
            break
    return found


def _select_nearest(
    case: ToleranceCase, truth: MethodResult, answers: Iterable[MethodResult], effort: Effort
) -> MethodResult:
    """The answer nearest to the truth, or the first that is near enough."""
    nearest = None
    for answer in answers:
        if nearest is None or _max_deviation(case, truth, answer) < _max_deviation(
            case, truth, nearest
        ):
            nearest = answer
        if _max_deviation(case, truth, nearest) < effort.settled:
            break
    if nearest is None:
        raise SystemExit(f"{case.name}: the second method did not reach the end")
    return nearest


def _run(case: ToleranceCase, integrator: bd.Integrator) -> tuple[np.ndarray | None, float]:
    """Compared rows, if the run reached its end, and the processor time it took [s]."""
    began = process_time()
    solution = case.run(integrator)
    rows = None
    if solution.status.success:
        rows = case.select_columns(solution, case.columns + case.reactions)
    return rows, process_time() - began


def _radau_results(case: ToleranceCase, effort: Effort) -> Iterator[MethodResult]:
    spent = 0.0
    for rtol in RTOLS:
        # Of order 5, a tenth of the tolerance takes 1.6 times the steps.
        if 1.6 * spent > effort.patience:
            return
        rows, spent = _run(case, bd.Radau(rtol, time_limit=40.0 * effort.patience))
        if rows is None:
            return
        yield MethodResult(f"Radau({rtol:.0e})", rows)


def _bdf_results(case: ToleranceCase, effort: Effort) -> Iterator[MethodResult]:
    """Ida, where damping or the lack of fast modes lets it use its order 5."""
    look = bd.simulate(case.model(**case.parameters), bd.Ida(max_steps=1), case.duration)
    if look.integrator["max_order"] < 5:
        return
    for rtol in (1e-8, 1e-9, 1e-10, 1e-11):
        settings = bd.Ida(rtol, error_control="velocities", time_limit=4.0 * effort.patience)
        rows, _ = _run(case, settings)
        if rows is None:
            return
        yield MethodResult(f"Ida({rtol:.0e}, velocities tested)", rows)


def _extrapolated_results(case: ToleranceCase, effort: Effort) -> Iterator[MethodResult]:
    """Generalized-alpha of steps 2 h and h, extrapolated (Richardson)."""
    coarse, spent = None, 0.0
    for steps in STEPS:
        if 2.0 * spent > effort.patience:
            return
        step = case.duration / steps
        fine, spent = _run(case, bd.GeneralizedAlpha(step, 0.9, newton_tolerance=1e-9))
        if fine is None:
            return
        if coarse is not None:
            method = f"GeneralizedAlpha({step:.3g} s), extrapolated"
            yield MethodResult(method, fine + (fine - coarse) / 3.0)
        coarse = fine


def _modal_result(case: ToleranceCase) -> MethodResult:
    columns = solve_small_vibrations(case.model(**case.parameters), case.times)
    rows = np.stack([columns[name] for name in (*case.columns, *case.reactions)], axis=-1)
    return MethodResult("modes of the linearized equations", rows)
