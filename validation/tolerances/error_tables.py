"""Tables of error over rtol for the wide set and random mechanisms, by adaptive integrator."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd

import beamdae as bd
from beamdae.verification import RELATIVE_ERROR
from tolerances.references import SUMMARY
from tolerances.tolerance_case import ToleranceCase

TIME_LIMIT = 10.0  # wall time of a run [s]
INTEGRATORS: dict[str, Callable[[float], bd.Integrator]] = {
    "Ida": lambda rtol: bd.Ida(rtol, time_limit=TIME_LIMIT),
    "Radau": lambda rtol: bd.Radau(rtol, time_limit=TIME_LIMIT),
    "GeneralizedAlpha": lambda rtol: bd.GeneralizedAlpha(rtol=rtol, time_limit=TIME_LIMIT),
    "Auto": lambda rtol: bd.Auto(rtol, time_limit=TIME_LIMIT),
}


def reference_uncertainties(summary: Path) -> pd.Series:
    """Return the largest disagreement of the two reference methods by case."""
    table = pd.read_csv(summary)
    compared = table[table["column"].str.contains(r"\[(?:m|rad)\]")]
    compared = compared[compared["method 1"] != "stored reference"]
    return compared.groupby("case")["disagreement"].max()


def error_rows(
    cases: Iterable[ToleranceCase],
    names: Iterable[str],
    rtols: Iterable[float],
    summary: Path = SUMMARY,
) -> Iterator[dict[str, object]]:
    """Yield one row per run: the largest error over rtol, r, and the cost of the run.

    r is NaN for a run that did not reach its end. "r of reference" is the uncertainty of the
    reference over rtol.
    """
    uncertainties = reference_uncertainties(summary)
    for case in cases:
        for name in names:
            for rtol in rtols:
                yield _error_row(case, name, rtol, uncertainties.get(case.name, np.nan))


def _error_row(
    case: ToleranceCase, name: str, rtol: float, uncertainty: float
) -> dict[str, object]:
    solution = case.run(INTEGRATORS[name](rtol))
    success = solution.status.success
    errors = case.errors(solution) if success else np.array([np.nan])
    reactions = case.reaction_errors(solution) if success and case.reactions else np.array([np.nan])
    columns = (*case.columns, *case.reactions)
    statistics = solution.statistics
    estimates = (
        bd.error_estimate(solution).loc[list(columns), RELATIVE_ERROR].to_numpy()
        if success
        else np.array([np.nan])
    )
    true_errors = np.concatenate([errors, reactions]) if case.reactions else errors
    ratio = estimates / true_errors
    return {
        "case": case.name,
        "integrator": name,
        "rtol": rtol,
        "r": errors.max() / rtol,
        "bound": case.bound,
        "r of reference": uncertainty / rtol,
        "column": case.columns[int(np.argmax(errors))] if success else "",
        "r of reactions": reactions.max() / rtol,
        "steps": statistics.steps,
        "wall [s]": statistics.wall_time,
        "status": solution.status.kind,
        "energy imbalance": solution.quality.energy_imbalance,
        "chosen": solution.integrator.get("method", name),
        "columns": np.isfinite(ratio).sum(),
        "covered": (ratio >= 1.0).sum(),
        "estimate / error": np.median(ratio),
    }


def pivot_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Return r by case over integrator and rtol; failed runs show their status."""
    cells = table["r"].map("{:.3g}".format).where(table["status"] == "ok", table["status"])
    cell_table = table.assign(cell=cells, rtol=table["rtol"].map("{:.0e}".format))
    layout = {"index": ["case", "bound"], "columns": ["integrator", "rtol"], "values": "cell"}
    return cell_table.pivot(**layout).loc[list(dict.fromkeys(table["case"]))]


def summarize_coverage(table: pd.DataFrame) -> pd.DataFrame:
    """Return by integrator how often the estimate covers the true error, and the median ratio.

    Runs whose true error is below ten times the uncertainty of the reference are left out.
    """
    certain = table[table["r"] > 10.0 * table["r of reference"].fillna(0.0)]
    groups = certain.groupby("integrator")
    summary = groups[["columns", "covered"]].sum()
    summary["share covered"] = summary["covered"] / summary["columns"]
    summary["median of estimate / error"] = groups["estimate / error"].median()
    return summary


def select_violations(table: pd.DataFrame) -> pd.DataFrame:
    """Return unfinished runs and runs above their bound, the worst first."""
    outside = ~(table["r"] <= table["bound"])
    return table[outside].sort_values("r", ascending=False, na_position="first")


def summarize_quantiles(table: pd.DataFrame) -> pd.DataFrame:
    """Return quantiles of r over its bound by integrator and rtol."""
    shares = table.assign(share=table["r"] / table["bound"])
    groups = shares.groupby(["integrator", "rtol"])
    summary = groups["share"].quantile([0.5, 0.9, 0.99, 1.0]).unstack()
    summary.columns = ["median", "90 %", "99 %", "worst"]
    summary["outside"] = groups["share"].apply(lambda s: int((s > 1.0).sum()))
    summary["not ended"] = groups["r"].apply(lambda s: int(s.isna().sum()))
    return summary
