"""Tables of error over rtol for all cases and random mechanisms, by adaptive integrator."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from time import process_time

import numpy as np
import pandas as pd

import beamdae as bd
from tolerances.references import SUMMARY
from tolerances.tolerance_case import ToleranceCase

TIME_LIMIT = 10.0  # wall time of a run [s]
WARM_UP_RTOL = 1e-2
INTEGRATORS: dict[str, Callable[[float], bd.Integrator]] = {
    "Ida": lambda rtol: bd.Ida(rtol, time_limit=TIME_LIMIT),
    "Radau": lambda rtol: bd.Radau(rtol, time_limit=TIME_LIMIT),
    "GeneralizedAlpha": lambda rtol: bd.GeneralizedAlpha(rtol=rtol, time_limit=TIME_LIMIT),
    "Auto": lambda rtol: bd.Auto(rtol, time_limit=TIME_LIMIT),
}


# Kinds of compared columns: heading in the tables and attribute of a case.
KINDS = {
    "": "columns",
    " of deflections": "deflections",
    " of rates": "rates",
    " of reactions": "reactions",
}
# Kinds whose errors the guarantee covers.
GUARANTEED = ("", " of deflections")
# Largest processor time of a good choice relative to the best method within its bound.
MAX_TIME_RATIO = 1.5


def reference_uncertainties() -> pd.Series:
    """Return the disagreement of the two reference methods by case and column."""
    table = pd.read_csv(SUMMARY)
    compared = table[table["method 1"] != "stored reference"]
    return compared.set_index(["case", "column"])["disagreement"]


def error_rows(
    cases: Iterable[ToleranceCase],
    names: Iterable[str],
    rtols: Iterable[float],
    estimate: bool = True,
) -> Iterator[dict[str, object]]:
    """Yield one row per run: the largest error over rtol, r, and the cost of the run.

    r is NaN for a run that did not reach its end. "r of reference" is the uncertainty of the
    reference, including the rounding of stored values, over rtol. Estimated errors, which take a
    second run, are compared with true ones if `estimate`.
    """
    uncertainties = reference_uncertainties()
    for case in cases:
        for name in names:
            _compile_kernels(case, name)
            for rtol in rtols:
                yield _error_row(case, name, rtol, uncertainties[case.name], estimate)


def _compile_kernels(case: ToleranceCase, name: str) -> None:
    """Run a few steps, so that the processor times of the case contain no compilation."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        case.run(replace(INTEGRATORS[name](WARM_UP_RTOL), max_steps=1))


def _error_row(
    case: ToleranceCase, name: str, rtol: float, uncertainties: pd.Series, estimate: bool
) -> dict[str, object]:
    start = process_time()
    solution = case.run(INTEGRATORS[name](rtol))
    processor_time = process_time() - start
    success = solution.status.success
    columns = {heading: getattr(case, attribute) for heading, attribute in KINDS.items()}
    errors = {
        heading: case.errors(solution, columns=names) if success and names else np.array([np.nan])
        for heading, names in columns.items()
    }
    row: dict[str, object] = {"case": case.name, "integrator": name, "rtol": rtol}
    row["bound"] = case.bound
    for heading, names in columns.items():
        row[f"r{heading}"] = errors[heading].max() / rtol
        row[f"r of reference{heading}"] = (
            (uncertainties[list(names)] + case.reference_rounding(names)).max() / rtol
            if names
            else np.nan
        )
    statistics = solution.statistics
    row |= {
        "column": case.columns[int(np.argmax(errors[""]))] if success else "",
        "steps": statistics.steps,
        "wall [s]": statistics.wall_time,
        "processor [s]": processor_time,
        "status": solution.status.kind,
        "energy imbalance": solution.quality.energy_imbalance,
        "chosen": solution.integrator.get("method", name),
    }
    if estimate:
        estimates = solution.errors.table()["time"] if success else None
        for heading, names in columns.items():
            ratio = (
                np.array([np.nan])
                if estimates is None or not names
                else estimates[list(names)].to_numpy() / errors[heading]
            )
            row[f"columns{heading}"] = np.isfinite(ratio).sum()
            row[f"covered{heading}"] = (ratio >= 1.0).sum()
            row[f"estimate / error{heading}"] = np.median(ratio)
    return row


def pivot_errors(table: pd.DataFrame, column: str = "r") -> pd.DataFrame:
    """Return r by case over integrator and rtol; failed runs show their status."""
    cells = table[column].map("{:.3g}".format).where(table["status"] == "ok", table["status"])
    cell_table = table.assign(cell=cells, rtol=table["rtol"].map("{:.0e}".format))
    layout = {"index": ["case", "bound"], "columns": ["integrator", "rtol"], "values": "cell"}
    return cell_table.pivot(**layout).loc[list(dict.fromkeys(table["case"]))]


def summarize_errors(table: pd.DataFrame) -> pd.DataFrame:
    """Return median and worst r by integrator and rtol, and the number of runs outside the bound.

    Runs that did not reach their end are counted separately.
    """
    groups = table.groupby(["integrator", "rtol"], sort=False)
    summary = pd.DataFrame(index=groups.size().index)
    for column in (f"r{heading}" for heading in KINDS):
        summary[f"median {column}"] = groups[column].median()
        summary[f"worst {column}"] = groups[column].max()
    outside = is_outside(table)
    keys = [table["integrator"], table["rtol"]]
    summary["outside"] = outside.groupby(keys, sort=False).sum()
    summary["not ended"] = groups["r"].apply(lambda r: int(r.isna().sum()))
    summary["processor [s]"] = groups["processor [s]"].sum()
    return summary


def is_outside(table: pd.DataFrame) -> pd.Series:
    """Return the runs above their bound by more than the uncertainty of the reference."""
    excess = [
        table[f"r{kind}"] - table[f"r of reference{kind}"] > table["bound"] for kind in GUARANTEED
    ]
    return excess[0] | excess[1]


def summarize_auto_cost(table: pd.DataFrame) -> pd.DataFrame:
    """Return by rtol the processor time of Auto over that of the best method within its bound.

    Runs without a method within its bound are left out.
    """
    within = table["r"].notna() & ~is_outside(table)
    methods = table[within & (table["integrator"] != "Auto")]
    best = methods.groupby(["case", "rtol"])["processor [s]"].min()
    auto = table[table["integrator"] == "Auto"].set_index(["case", "rtol"])["processor [s]"]
    ratio = (auto / best).dropna().groupby("rtol")
    return pd.DataFrame(
        {
            "median": ratio.median(),
            "95 %": ratio.quantile(0.95),
            "worst": ratio.max(),
            f"share up to {MAX_TIME_RATIO}": ratio.agg(lambda x: np.mean(x <= MAX_TIME_RATIO)),
            "cases": ratio.size(),
        }
    )


def summarize_coverage(table: pd.DataFrame) -> pd.DataFrame:
    """Return by integrator, kind of column and rtol how often the estimate covers the true error.

    Also returns the median of estimate over error. Runs whose true error is below ten times the
    uncertainty of the reference are left out.
    """
    parts = []
    for heading, attribute in KINDS.items():
        certain = table[table[f"r{heading}"] > 10.0 * table[f"r of reference{heading}"]]
        groups = certain.assign(kind=attribute).groupby(["integrator", "kind", "rtol"], sort=False)
        part = groups[[f"columns{heading}", f"covered{heading}"]].sum()
        part.columns = ["columns", "covered"]
        part["median of estimate / error"] = groups[f"estimate / error{heading}"].median()
        parts.append(part)
    summary = pd.concat(parts)
    summary.insert(2, "share covered", summary["covered"] / summary["columns"])
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
