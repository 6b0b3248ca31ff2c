"""Errors that beamdae states for the columns of a run, and their verdict beside the true ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd
from error_statements.cases import ErrorCase, measure_errors

import beamdae as bd

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
