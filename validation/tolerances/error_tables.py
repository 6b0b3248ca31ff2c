"""Error over rtol of the wide set and of random mechanisms, by the three adaptive integrators."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

import beamdae as bd
from beamdae.verification import RELATIVE_ERROR
from tolerances.references import SUMMARY
from tolerances.tolerance_case import ToleranceCase

# A run is given up after so long [s].
TIME_LIMIT = 10.0
INTEGRATORS: dict[str, Callable[[float], bd.Integrator]] = {
    "Ida": lambda rtol: bd.Ida(rtol, time_limit=TIME_LIMIT),
    "Radau": lambda rtol: bd.Radau(rtol, time_limit=TIME_LIMIT),
    "GeneralizedAlpha": lambda rtol: bd.GeneralizedAlpha(rtol=rtol, time_limit=TIME_LIMIT),
    "Auto": lambda rtol: bd.Auto(rtol, time_limit=TIME_LIMIT),
}


def reference_uncertainties(summary: Path) -> pd.Series:
    """How far the two methods of each reference are apart, the worst column, by case."""
    known = pd.read_csv(summary)
    promised = known[known["column"].str.contains(r"\[(?:m|rad)\]")]
    promised = promised[promised["method 1"] != "stored reference"]
    return promised.groupby("case")["disagreement"].max()


def error_rows(
    cases: Iterable[ToleranceCase],
    names: Iterable[str],
    rtols: Iterable[float],
    summary: Path = SUMMARY,
) -> Iterator[dict[str, object]]:
    """One line a run: r, the largest error over rtol, and what the run cost.

    A run that did not reach its end has no r. "r of reference" is what of r the reference's own
    uncertainty may make.
    """
    known = reference_uncertainties(summary)
    for case in cases:
        for name in names:
            for rtol in rtols:
                yield _error_row(case, name, rtol, known.get(case.name, np.nan))


def _error_row(
    case: ToleranceCase, name: str, rtol: float, uncertainty: float
) -> dict[str, object]:
    solution = case.run(INTEGRATORS[name](rtol))
    ended = solution.status.success
    errors = case.errors(solution) if ended else np.array([np.nan])
    reactions = case.reaction_errors(solution) if ended and case.reactions else np.array([np.nan])
    columns = (*case.columns, *case.reactions)
    statistics = solution.statistics
    estimated = (
        bd.error_estimate(solution).loc[list(columns), RELATIVE_ERROR].to_numpy()
        if ended
        else np.array([np.nan])
    )
    true = np.concatenate([errors, reactions]) if case.reactions else errors
    factor = estimated / true
    return {
        "case": case.name,
        "integrator": name,
        "rtol": rtol,
        "r": errors.max() / rtol,
        "bound": case.bound,
        "r of reference": uncertainty / rtol,
        "column": case.columns[int(np.argmax(errors))] if ended else "",
        "r of reactions": reactions.max() / rtol,
        "steps": statistics.steps,
        "wall [s]": statistics.wall_time,
        "status": solution.status.kind,
        "energy imbalance": solution.quality.energy_imbalance,
        "chosen": solution.integrator.get("method", name),
        "columns": np.isfinite(factor).sum(),
        "covered": (factor >= 1.0).sum(),
        "estimate / error": np.median(factor),
    }


def pivot_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Table of r by case over integrator and rtol; how a run ended where it has none."""
    cells = table["r"].map("{:.3g}".format).where(table["status"] == "ok", table["status"])
    shown = table.assign(cell=cells, rtol=table["rtol"].map("{:.0e}".format))
    order = {"index": ["case", "bound"], "columns": ["integrator", "rtol"], "values": "cell"}
    return shown.pivot(**order).loc[list(dict.fromkeys(table["case"]))]


def summarize_coverage(table: pd.DataFrame) -> pd.DataFrame:
    """How often the estimate covers the true error, and by how much it exceeds it, by integrator.

    Columns whose true error is below ten times the uncertainty of the reference are left out with
    their runs.
    """
    known = table[table["r"] > 10.0 * table["r of reference"].fillna(0.0)]
    groups = known.groupby("integrator")
    found = groups[["columns", "covered"]].sum()
    found["share covered"] = found["covered"] / found["columns"]
    found["median of estimate / error"] = groups["estimate / error"].median()
    return found


def select_violations(table: pd.DataFrame) -> pd.DataFrame:
    """Runs outside their bound, the worst first, and those that did not end."""
    outside = ~(table["r"] <= table["bound"])
    return table[outside].sort_values("r", ascending=False, na_position="first")


def summarize_quantiles(table: pd.DataFrame) -> pd.DataFrame:
    """Distribution of r over bound by integrator and rtol."""
    share = table.assign(share=table["r"] / table["bound"])
    groups = share.groupby(["integrator", "rtol"])
    found = groups["share"].quantile([0.5, 0.9, 0.99, 1.0]).unstack()
    found.columns = ["median", "90 %", "99 %", "worst"]
    found["outside"] = groups["share"].apply(lambda s: int((s > 1.0).sum()))
    found["not ended"] = groups["r"].apply(lambda s: int(s.isna().sum()))
    return found
