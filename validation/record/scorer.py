"""Scorer: compares CSV files of any tool with the references; requires numpy and pandas only."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

TIME = "t [s]"
TIME_TOLERANCE = 1e-9  # relative to the end time
COSTS = ("wall_time", "processor_time", "steps", "max_position_drift", "energy_imbalance")

Reference = tuple[pd.DataFrame, pd.DataFrame]  # the solution and its uncertainty, a row a time


def read_references(file: Path) -> dict[str, Reference]:
    """Return the solution and the uncertainty of each mechanism, with equal columns and times."""
    return {
        str(name): (_widen(rows, "value"), _widen(rows, "uncertainty"))
        for name, rows in pd.read_csv(file).groupby("mechanism")
    }


def _widen(rows: pd.DataFrame, values: str) -> pd.DataFrame:
    table = rows.pivot(index=TIME, columns="column", values=values)
    return table[rows["column"].unique()].rename_axis(columns=None).reset_index()


def half_ranges(reference: pd.DataFrame) -> pd.Series:
    """Return half the range of each column of the reference."""
    table = reference.drop(columns=TIME)
    return (table.max() - table.min()) / 2.0


def score_columns(
    reference: pd.DataFrame, uncertainty: pd.DataFrame, result: pd.DataFrame
) -> pd.DataFrame:
    """Return error and uncertainty of each column of a result.

    Returns
    -------
    DataFrame
        One row per column of the reference. `error` is the largest difference from the reference,
        `rms` its root mean square and `uncertainty` the largest uncertainty of the reference, all
        relative to half the range of the column in the reference. `is_resolved` is True if at some
        time the difference exceeds the uncertainty at that time.

    Raises
    ------
    ValueError
        If columns or times of the result are missing.
    """
    missing = [name for name in reference.columns if name not in result.columns]
    if missing:
        raise ValueError(f"result: columns {missing} are missing; add them.")
    times = reference[TIME].to_numpy()
    result_times = result[TIME].to_numpy()
    tolerance = TIME_TOLERANCE * times[-1]
    rows = np.searchsorted(result_times, times - tolerance)
    rows = np.clip(rows, 0, max(len(result_times) - 1, 0))
    if not len(result_times) or not np.abs(result_times[rows] - times).max() <= tolerance:
        raise ValueError("result: not all times of the reference are present; write all of them.")
    columns = [name for name in reference.columns if name != TIME]
    difference = np.abs(result[columns].to_numpy()[rows] - reference[columns])
    broken = [name for name in columns if not np.all(np.isfinite(difference[name]))]
    if broken:
        raise ValueError(f"result: columns {broken} are not finite.")
    half_range = half_ranges(reference)
    scores = {
        "error": difference.max() / half_range,
        "rms": np.sqrt((difference**2).mean()) / half_range,
        "uncertainty": uncertainty[columns].max() / half_range,
        "is_resolved": (difference > uncertainty[columns]).any(),
    }
    return pd.DataFrame(scores, index=columns)


def score_result(reference: Reference, result: Path) -> dict[str, Any]:
    """Return one row of the table of results; a failure is a row as well.

    Parameters
    ----------
    reference
        Reference of the mechanism.
    result
        CSV file of the tool, with the name of the mechanism. The JSON file of the same name, if
        present, contains `success`, `reason` and costs: wall and processor time [s], steps, drift
        [m], energy imbalance.
    """
    details = result.with_suffix(".json")
    information = json.loads(details.read_text()) if details.exists() else {}
    row: dict[str, Any] = {
        "mechanism": result.stem,
        "tool": result.parent.name,
        "success": information.get("success", True),
        "error": np.nan,
        "worst column": "",
        "uncertainty": np.nan,
        **{name: information.get(name, np.nan) for name in COSTS},
        "warnings": len(information.get("warnings", [])),
        "reason": information.get("reason", ""),
    }
    if not result.exists():
        return row | {"success": False, "reason": row["reason"] or "there is no CSV file"}
    try:
        columns = score_columns(*reference, pd.read_csv(result))
    except (ValueError, KeyError) as error:
        return row | {"success": False, "reason": f"{row['reason']}; {error}".strip("; ")}
    worst = columns["error"].idxmax()
    return row | {
        "error": columns["error"].max(),
        "worst column": worst,
        "uncertainty": columns["uncertainty"].max(),
    }


def score_all(references: Mapping[str, Reference], results: Path) -> pd.DataFrame:
    """Return the scores of all result files in results/TOOL/MECHANISM.csv or .json."""
    files = {
        file.with_suffix(".csv")
        for file in results.glob("*/*.*")
        if file.suffix in (".csv", ".json") and file.stem in references
    }
    return pd.DataFrame([score_result(references[x.stem], x) for x in sorted(files)])


def write_markdown(scores: pd.DataFrame, path: Path, first: Sequence[str] = ()) -> None:
    """Write the table of mechanisms and tools in Markdown, with one line per failure below.

    The columns start with the tools of `first`.
    """
    names = sorted(scores["tool"].unique())
    tools = [x for x in first if x in names] + [x for x in names if x not in first]
    cells = scores.assign(cell=scores.apply(_format_cell, axis=1))
    cells = cells.pivot(index="mechanism", columns="tool", values="cell")[tools].fillna("")
    uncertainty = scores.groupby("mechanism")["uncertainty"].max().map("{:.0e}".format)
    cells.insert(0, "uncertainty", uncertainty)
    headers = ["mechanism", *(name.replace("_", " ") for name in cells)]
    lines = [f"| {' | '.join(headers)} |", "|" + "---|" * len(headers)]
    lines += [f"| {' | '.join(row)} |" for row in cells.itertuples(name=None)]
    order = scores["tool"].map(tools.index)
    failed = scores.assign(order=order)[~scores["success"].astype(bool)]
    failures = [
        f"- {row.mechanism}, {row.tool.replace('_', ' ')}: {row.reason}"
        for row in failed.sort_values(["mechanism", "order"]).itertuples()
    ]
    if failures:
        lines += ["", "Failures and refusals:", "", *failures]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _format_cell(row: pd.Series) -> str:
    """Return error, cost and marks of a result."""
    has_failed = np.isnan(row["error"])
    text = "failed" if has_failed else f"{row['error']:.1e}"
    text += "" if np.isnan(row["processor_time"]) else f" / {row['processor_time']:.2f} s"
    text += "" if has_failed or row["success"] else " (refused)"
    return text + (" (warns)" if row["warnings"] else "")
