"""Case table of a study, and its summary: observed orders, by group."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from beamdae.results.columns import Header, remove_unit
from beamdae.studies.case import Case, format_parameter
from beamdae.studies.references import (
    Reference,
    compute_amplitudes,
    compute_deviations,
)
from beamdae.studies.run_values import (
    COUNT_COLUMNS,
    MEASURE_COLUMNS,
)
from beamdae.studies.tasks import Outcome

ERROR_COLUMN = "error [-]"
BOUND_COLUMN = "error bound [-]"
# Columns of the integrator settings that control the accuracy, by name.
ACCURACY_COLUMNS = {"rtol": "rtol", "step": "step [s]"}
_PARAMETER_PREFIX = "parameter: "
_MAX_INTEGER = 2**63  # larger integers do not fit into the columns of tables

_SUMMARY_COLUMNS = ["group", "what", "at", "answer", "value"]


def tabulate_case(
    case: Case, group: str, outcome: Outcome, reference: Reference | None
) -> dict[str, Any]:
    """Return the row of a case: model, parameters, integrator, status, cost and quality.

    With a `reference`, the row also contains the errors.
    """
    accuracy = case.integrator.accuracy
    values: dict[str, Any] = {
        "model": case.model.name,
        **{
            _PARAMETER_PREFIX + case.model.header(name): _format_cell(value)
            for name, value in case.parameters.items()
        },
        "group": group,
        "integrator": case.integrator.method,
        "label": case.label,
        "series": case.series,
        "settings": ", ".join(f"{k}={v}" for k, v in case.changed.items()),
        **{
            column: accuracy.value if accuracy.name == name else np.nan
            for name, column in ACCURACY_COLUMNS.items()
        },
        "status": outcome.status.kind,
        "reason": "" if outcome.status.success else outcome.status.sentence,
        "reached [s]": np.nan,
        **dict.fromkeys(COUNT_COLUMNS),
        **dict.fromkeys(MEASURE_COLUMNS, np.nan),
        **outcome.values,
    }
    return values if reference is None else values | _error_columns(outcome, reference)


def _error_columns(outcome: Outcome, reference: Reference) -> dict[str, Any]:
    """Return the errors of a case.

    "error [-]" is the largest error of all columns, relative to half their ranges; the errors by
    column are in its unit. Errors below the resolution of the reference are NaN. The bound is the
    larger one of the error and the resolution.
    """
    columns: dict[str, Any] = dict.fromkeys([ERROR_COLUMN, BOUND_COLUMN], np.nan)
    columns["below resolution"] = False
    columns["reference uncertainty [-]"] = reference.uncertainty
    if reference.table is None or outcome.rows is None:
        return columns
    is_complete = outcome.status.success
    errors = compute_deviations(outcome.rows.table(), reference.table, reference.columns)
    # The initial state has no error.
    if len(errors) < 2:
        return columns
    largest, resolution = errors.max(), reference.resolution
    is_below = is_complete & (largest < resolution)
    columns[BOUND_COLUMN] = float(np.fmax(largest.max(), resolution))
    columns["below resolution"] = bool(is_below.all())
    if not columns["below resolution"]:
        columns[ERROR_COLUMN] = float(largest.max())
    amplitudes = compute_amplitudes(reference.table, reference.columns)
    for name, amplitude in zip(reference.columns, amplitudes.tolist(), strict=True):
        error = amplitude * errors[name]
        measures = {
            "end": error.iloc[-1] if is_complete else np.nan,
            "max": error.max(),
            "rms": np.sqrt(np.mean(error**2)),
        }
        for measure, value in measures.items():
            column = f"error of {remove_unit(name)}, {measure} [{Header.of(name).unit}]"
            columns[column] = np.nan if is_below[name] else float(value)
    return columns


def _format_cell(value: Any) -> Any:
    fits = not isinstance(value, int) or abs(value) < _MAX_INTEGER
    is_scalar = isinstance(value, (bool, int, float, str))
    return value if is_scalar and fits else format_parameter(value)


def assemble_case_table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """Return the case table built from `rows`; missing counts are <NA>.

    Parameter columns are inserted between "model" and "group". If a parameter has the name of
    another column, the parameter column is called "parameter NAME".
    """
    table = pd.DataFrame(rows)
    columns = [str(c) for c in table]
    parameters = [c for c in columns if c.startswith(_PARAMETER_PREFIX)]
    others = [c for c in columns if not c.startswith(_PARAMETER_PREFIX)]
    table = table[[others[0], *parameters, *others[1:]]]
    names = {c: c.removeprefix(_PARAMETER_PREFIX) for c in parameters}
    headers = {c: f"parameter {name}" if name in others else name for c, name in names.items()}
    table = table.rename(columns=headers)
    if "below resolution" in table:
        # Groups without errors lack this column.
        table["below resolution"] = table["below resolution"].eq(True)
    return table.astype({c: "Int64" for c in map(str, table) if c in COUNT_COLUMNS})


def summarize_cases(cases: pd.DataFrame, over: str | None = None) -> pd.DataFrame:
    """Return the observed orders by group: of steps and tolerances, or of meshes.

    Only successful cases are included, without errors that are zero or that the reference cannot
    resolve. `over` is the header of the refined parameter of a mesh study.
    """
    lines: list[tuple[Any, ...]] = []
    if ERROR_COLUMN in cases:
        resolved = cases[(cases["status"] == "ok") & (cases[ERROR_COLUMN] > 0.0)]
        for group, rows in resolved.groupby("group", sort=False):
            if over is not None:
                # Between successive meshes.
                rows = rows.sort_values(over)
                sizes, errors = rows[over].to_numpy(float), rows[ERROR_COLUMN].to_numpy()
                orders = -np.diff(np.log(errors)) / np.diff(np.log(sizes))
                for a, b, error, order in zip(sizes, sizes[1:], errors[1:], orders, strict=False):
                    at = f"{over} {a:g} to {b:g}"
                    lines.append((group, "order in space", at, f"{error:.2e}", order))
                continue
            for series, runs in rows.groupby("series", sort=False):
                errors = runs[ERROR_COLUMN].to_numpy()
                for name, column in ACCURACY_COLUMNS.items():
                    sizes = runs[column].to_numpy(float)
                    if len(np.unique(sizes)) < 2 or np.isnan(sizes).any():
                        continue
                    # Slope of the error over the step or the tolerance on logarithmic scales.
                    order = float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])
                    at = f"{sizes.max():g} to {sizes.min():g}"
                    lines.append((group, f"order in {name}", at, series, order))
    return pd.DataFrame(lines, columns=_SUMMARY_COLUMNS)
