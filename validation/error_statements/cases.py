"""Cases: runs that are too coarse in one respect, and accurate ones, with their references.

`cases.csv` lists them. Seeds from 300 on were drawn after errors were measured in the present way.
"""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from error_statements.mechanisms import EXACT

import beamdae as bd

FOLDER = Path(__file__).parent
CASES, REFERENCES = FOLDER / "cases.csv", FOLDER / "results" / "references.npz"
ROWS = 1000  # rows of a run, and of all references
STRIDE = 10  # every tenth row of a reference is stored
REFINEMENT, SHARPNESS, RTOL = 4, 30.0, 1e-7
# A second reference shows the uncertainty of the first; its friction is sharper, because errors by
# the friction speed decrease in proportion.
CHECK = (2, 90.0, 1e-6)


@dataclass(frozen=True)
class ErrorCase:
    """A run whose stated errors are compared with true ones.

    Attributes
    ----------
    name
        Name, with the respect in which the run is coarse after a colon, or "accurate".
    model
        Model; its parameters `elements`, `formulation` and `friction_speed` are refined.
    settings
        Parameters of the run.
    integrator
        Integrator of the run.
    rows
        Number of intervals between output rows, a divisor of `ROWS`.
    """

    name: str
    model: bd.results.Model
    settings: dict[str, Any]
    integrator: bd.Integrator
    rows: int

    @property
    def kind(self) -> str:
        """What is too coarse, or "accurate"."""
        return self.name.partition(": ")[2].partition(",")[0]

    def run(self) -> bd.results.Solution:
        """Return the run, whose checks are evaluated when its warnings are read."""
        return self._simulate(self.settings, self.integrator, self.rows)

    def refine(self, factor: int, sharpness: float, rtol: float) -> pd.DataFrame:
        """Return all rows of a refined run; a run that does not end raises RuntimeError."""
        settings, known = dict(self.settings), self.model.parameters
        if "elements" in known:
            settings["elements"] = factor * max(settings.get("elements", known["elements"]), 2)
        if "formulation" in known:
            settings["formulation"] = EXACT
        if "friction_speed" in known:
            speed = settings.get("friction_speed", known["friction_speed"])
            settings["friction_speed"] = speed / sharpness
        method = bd.Radau(rtol, time_limit=240.0)
        solution = self._simulate(settings, method, ROWS)
        if not solution.status.success:
            raise RuntimeError(f"{self.name}: {solution.status.sentence}")
        return solution.observed

    def _simulate(
        self, settings: dict[str, Any], method: bd.Integrator, rows: int
    ) -> bd.results.Solution:
        t_end = self.model.t_end
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bd.BeamdaeWarning)
            mechanism = self.model(**settings)
            return bd.simulate(mechanism, method, t_end=t_end, output_step=t_end / rows)

    @cached_property
    def reference(self) -> StoredReference:
        """The stored reference."""
        with np.load(REFERENCES) as file:
            return StoredReference(*(file[f"{self.name}/{key}"] for key in StoredReference.KEYS))


@dataclass(frozen=True)
class StoredReference:
    """Thinned rows of a reference, (rows, columns), its extremes, (2, columns), and uncertainty."""

    columns: np.ndarray
    rows: np.ndarray
    extremes: np.ndarray
    uncertainty: np.ndarray

    KEYS = ("columns", "rows", "extremes", "uncertainty")


def compare_rows(observed: pd.DataFrame, exact: pd.DataFrame) -> pd.DataFrame:
    """Return root mean square, largest and peak errors of the columns [-], see `measure_errors`."""
    difference = (observed - exact).abs()
    ends = [(getattr(observed, x)() - getattr(exact, x)()).abs() for x in ("max", "min")]
    half_range = 0.5 * (exact.max() - exact.min())
    return pd.DataFrame(
        {
            "rms": np.sqrt((difference**2).mean()) / exact.std(ddof=0),
            "largest": difference.max() / half_range,
            "peak": np.maximum(*ends) / half_range,
        }
    )


def measure_errors(observed: pd.DataFrame, reference: StoredReference) -> pd.DataFrame:
    """Return root mean square, largest and peak errors of the columns [-].

    All are relative: "rms" to the root mean square of the deviations from the mean, "largest" and
    "peak", the larger error of both extremes, to half the range.
    """
    count = len(observed) - 1
    step = max(count * STRIDE // ROWS, 1)
    rows = observed[list(reference.columns)].to_numpy()
    exact = reference.rows[:: max(ROWS // STRIDE // count, 1)]
    difference = rows[::step] - exact
    half_range = 0.5 * np.ptp(reference.extremes, axis=0)
    extremes = np.stack([rows.min(axis=0), rows.max(axis=0)])
    with np.errstate(divide="ignore", invalid="ignore"):
        table = pd.DataFrame(
            {
                "rms": np.sqrt(np.mean(difference**2, axis=0)) / reference.rows.std(axis=0),
                "largest": np.abs(difference).max(axis=0) / half_range,
                "peak": np.abs(extremes - reference.extremes).max(axis=0) / half_range,
                "uncertainty": reference.uncertainty,
            },
            index=pd.Index(reference.columns, name="column"),
        )
    return table.replace([np.inf, -np.inf], np.nan)


def _read_cases() -> tuple[ErrorCase, ...]:
    table, cases = pd.read_csv(CASES, dtype=str, keep_default_na=False), []
    for row in table.to_dict("records"):
        accuracy = {x: float(row[x]) for x in ("rtol", "step") if row[x]}
        method = getattr(bd, row["integrator"])(**accuracy)
        settings = json.loads(row["settings"] or "{}")
        model = resolve_name(row["model"])
        cases.append(ErrorCase(row["case"], model, settings, method, int(row["rows"])))
    return tuple(cases)


ALL = _read_cases()


# Errors that beamdae states for the columns of a run, and their verdict beside the true ones.

WRONG, ACCURATE = 0.04, 0.01  # true errors [-]
FACTOR = 2.0  # of a stated error from the true one
# Columns are compared if the uncertainty is below 1 %, or below 10 % and a quarter of the error.
UNCERTAIN, MOST_UNCERTAIN, UNCERTAIN_SHARE = 0.01, 0.1, 0.25


class Statement(NamedTuple):
    """Statement on a run.

    Attributes
    ----------
    errors
        Stated errors of columns at the rows [-].
    peaks
        Errors of columns between rows [-], if a warning names the largest.
    has_warned
        True if any sentence says that the rows are not accurate, perhaps without a number.
    """

    errors: dict[str, float]
    peaks: dict[str, float]
    has_warned: bool


def read_statement(solution: bd.results.Solution) -> Statement:
    """Return what the errors and the warnings of a run state.

    A run that does not end is a statement as well, and so is a companion that does not.
    """
    measured = solution.errors
    total = measured.table()["total"]
    errors = {str(header): x for header, x in total.dropna().items()}
    has_warned = measured.largest > WRONG or measured.has_failed or not solution.status.success
    missed = solution.missed_peaks if solution.row_warnings else {}
    return Statement(errors, {header: x.error for header, x in missed.items()}, has_warned)


class Comparison(NamedTuple):
    """Verdict on the statement of a run.

    Attributes
    ----------
    verdict
        "right": every wrong run is detected with its size, every accurate run passes; "missed": a
        wrong run without a statement; "false": a stated error of an accurate column; "size": a
        wrong run is detected, but the largest stated error is not within a factor of two.
    largest
        Largest true error of the columns [-].
    stated
        Largest stated error [-].
    wrong, named, sized
        Number of wrong columns, of those with a statement, and of those within a factor of two.
    """

    verdict: str
    largest: float
    stated: float
    wrong: int
    named: int
    sized: int


def judge_columns(
    true: pd.Series, least: pd.Series, largest: pd.Series, stated: pd.Series
) -> Comparison:
    """Compare stated with true errors of columns.

    A column is wrong if its true error exceeds 4 %, and accurate if none of its errors exceeds 1 %.
    A stated error is right between half the smallest and twice the largest of the errors of its
    column, because statements refer to either. Errors above 100 % count as 100 %.

    Parameters
    ----------
    true
        True error of each column [-].
    least, largest
        Smallest and largest error of each column that a statement may refer to [-].
    stated
        Stated errors [-], of which those that are missing are not numbers.
    """
    true, least, largest, stated = (x.clip(upper=1.0) for x in (true, least, largest, stated))
    is_named = stated > WRONG
    is_right = (stated >= least / FACTOR) & (stated <= largest * FACTOR)
    wrong, accurate = true > WRONG, largest < ACCURATE
    if (accurate & is_named).any():
        verdict = "false"
    elif not wrong.any():
        verdict = "right"
    elif not is_named.any():
        verdict = "missed"
    else:
        worst = true.idxmax()
        is_sized = true[worst] / FACTOR <= stated.max() <= FACTOR * largest[worst]
        verdict = "right" if is_sized or is_right[worst] else "size"
    sizes = (float(np.nan_to_num(x.max())) for x in (true, stated))
    counts = (int(x.sum()) for x in (wrong, wrong & stated.notna(), wrong & is_right))
    return Comparison(verdict, *sizes, *counts)


def compare(case: ErrorCase, solution: bd.results.Solution, statement: Statement) -> Comparison:
    """Compare the statement of a run with the true errors of its columns, see `judge_columns`.

    Errors are root mean squares or, in cases of coarse rows, those of the peaks.
    """
    if not solution.status.success:
        return Comparison("right", np.inf, np.inf, 0, 0, 0)
    table = measure_errors(solution.observed, case.reference)
    kind = "peak" if case.kind == "rows" else "rms"
    limit = (UNCERTAIN_SHARE * table[kind]).clip(UNCERTAIN, MOST_UNCERTAIN)
    table = table[(table["uncertainty"] <= limit) & table[kind].notna()]
    stated = pd.Series(statement.peaks if kind == "peak" else statement.errors, dtype=float)
    largest = table[["rms", "largest", "peak"]].max(axis=1)
    least = table[kind].clip(upper=table["largest"])
    result = judge_columns(table[kind], least, largest, stated.reindex(table.index))
    has_warned = bool(statement.peaks) if kind == "peak" else statement.has_warned
    return result._replace(verdict="size") if result.verdict == "missed" and has_warned else result
