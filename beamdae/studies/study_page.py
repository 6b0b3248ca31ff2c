"""What the page of a study shows, as plain data."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from beamdae.equations.measures import TIME
from beamdae.report.page.page_data import compute_row_limit, select_curves
from beamdae.results.columns import Header
from beamdae.results.storage.files import versions
from beamdae.studies.case import Case
from beamdae.studies.case_table import ERROR_COLUMN, WALL_TIME_COLUMN
from beamdae.studies.definition import Study
from beamdae.studies.deviations import compute_deviations, count_common_rows
from beamdae.studies.execution.study_run import StudyResults
from beamdae.studies.references import Reference
from beamdae.studies.run_values import EVENTS_COLUMN, WALL_TIME_RANGE
from beamdae.studies.sweeps.sweep import Sweep
from beamdae.studies.unique_names import number_duplicates

# Curves of more cases make a page that takes long to open.
_MAX_CURVES = 200
# Before the names of columns that may be called as others are.
_EXTRA_COLUMN_PREFIX = "told "
# Columns of the case table on the page: key, label, unit, kind.
_TABLE_COLUMNS = (
    ("label", "integrator", "", "text"),
    ("status", "status", "", "status"),
    (EVENTS_COLUMN, "events", "", "text"),
    (ERROR_COLUMN, "error", "-", "error"),
    ("reaction error [-]", "reaction error", "-", "number"),
    (WALL_TIME_COLUMN, "wall time", "s", "cost"),
    (WALL_TIME_RANGE[0], "wall min", "s", "number"),
    (WALL_TIME_RANGE[1], "wall max", "s", "number"),
    ("steps", "steps", "", "number"),
    ("rejected steps", "rejected", "", "number"),
    ("residual calls", "residuals", "", "number"),
    ("Jacobian calls", "Jacobians", "", "number"),
    ("max position drift", "position drift", "", "number"),
    ("max velocity drift", "velocity drift", "", "number"),
    ("energy imbalance [-]", "energy imbalance", "-", "number"),
    ("reached [s]", "reached", "s", "number"),
    ("peak memory [GB]", "memory", "GB", "number"),
)


def create_study_page(results: StudyResults, told: pd.DataFrame | None = None) -> dict[str, Any]:
    """The page of a study; see `beamdae.report.page.write_page`.

    `told` has a row a case as well: what stands in the place of the parameters.
    """
    table = results.table
    shown = [c for c in _TABLE_COLUMNS if c[0] in table]
    if told is None:
        parameters = list(table)[1 : list(table).index("group")]
        further = [(str(p), str(p), "", _column_kind(table[p])) for p in parameters]
    else:
        further = [_describe_extra_column(told, str(name)) for name in told]
        table = pd.concat([table, told.add_prefix(_EXTRA_COLUMN_PREFIX)], axis=1)
    columns = [shown[0], *further, *shown[1:]]
    failed = int((table["status"] != "ok").sum())
    rest = number_duplicates([*results.references, results.study.name])[-1]
    return {
        "title": results.study.name,
        "subtitle": f"{len(table)} cases, {failed} failed",
        "made": versions(),
        "notes": _create_notes(results),
        "groups": _create_groups(results, rest),
        "columns": [
            {"key": k, "label": label, "unit": unit, "kind": kind}
            for k, label, unit, kind in columns
        ],
        "cases": _create_cases(results, table, [c[0] for c in columns], rest),
    }


def extra_column_key(name: str) -> str:
    """What the page knows a column of `told` by."""
    return _EXTRA_COLUMN_PREFIX + name


def _describe_extra_column(table: pd.DataFrame, name: str) -> tuple[str, str, str, str]:
    """Key, label, unit and kind of a column on the page."""
    unit = Header.of(name).unit if name.endswith("]") else ""
    return extra_column_key(name), name.removesuffix(f" [{unit}]"), unit, _column_kind(table[name])


def _create_notes(results: StudyResults) -> list[str]:
    notes = []
    if results.references:
        notes.append(
            "Error: largest difference to the reference over the run and its columns, relative to "
            "half the range of each. An error less than ten times the uncertainty of the reference "
            "is drawn hollow: it is at most that."
        )
    if len(results.table) > _MAX_CURVES:
        notes.append(
            f"Curves are those of the first {_MAX_CURVES} cases, the others' are in trajectories/."
        )
    if results.interrupted:
        notes.append("The study was interrupted; start it again and it goes on.")
    return notes


def _create_groups(results: StudyResults, rest: str) -> list[dict[str, Any]]:
    """Those with a reference, and one, called `rest`, of all cases that have none."""
    frames: dict[str, Any] = {}
    for case, group in zip(results.study.cases, results.table["group"], strict=True):
        # Of whatever run of the same mechanism has them: its reference.
        frames[group] = frames.get(group) or results.frames_of(case)
    found = [
        _create_group(name, reference, frames[name])
        for name, reference in results.references.items()
    ]
    said = {"accepted": True, "sentence": "No errors are asked for."}
    alone = {"id": rest, "label": results.study.name, "reference": said}
    return found if set(frames) <= set(results.references) else [*found, alone]


def _create_group(
    group: str, reference: Reference, frames: dict[str, Any] | None
) -> dict[str, Any]:
    accepted = reference.table is not None
    return {
        "id": group,
        "label": group,
        "reference": {
            "methods": list(reference.methods),
            "uncertainty": reference.resolution if accepted else None,
            "accepted": accepted,
            # The page says itself that there is none.
            "sentence": reference.sentence.removeprefix("no reference, "),
        },
        "frames": frames,
    }


def _create_cases(
    results: StudyResults, table: pd.DataFrame, keys: list[str], rest: str
) -> list[dict[str, Any]]:
    study, ranks, most = results.study, _rank_cases(results.study), _max_rows_per_case(results)
    found = []
    for k, (case, (_, row)) in enumerate(zip(study.cases, table.iterrows(), strict=True)):
        group = str(row["group"])
        reference = results.references.get(group)
        told = reference is not None or isinstance(study, Sweep)
        where = {
            "group": rest if reference is None else group,
            "label": study.tag(case) if told else f"{group}, {case.label}",
        }
        curves = _create_curves(results, case, row, most) if k < _MAX_CURVES else None
        own = _describe_case(case, row, keys)
        found.append({"id": str(k), "rank": ranks[k], **where, **own, "curves": curves})
    return found


def _rank_cases(study: Study) -> list[int]:
    """The place of each case by series, and in a series from coarse to fine."""

    def place(k: int) -> tuple[str, float]:
        case = study.cases[k]
        coarse = -case.integrator.accuracy.value
        return case.series, coarse if study.over is None else case.parameters[study.over]

    order = sorted(range(len(study.cases)), key=place)
    return np.argsort(order).tolist()


def _describe_case(case: Case, row: pd.Series, keys: list[str]) -> dict[str, Any]:
    status = str(row["reason"]) or "ok"
    values = {key: _as_json_value(row[key]) for key in keys}
    return {
        "series": case.series,
        "family": case.integrator.method,
        "status": status,
        "values": values | {"status": status},
        "error": _as_json_value(row.get(ERROR_COLUMN)),
        "cost": _as_json_value(row.get(WALL_TIME_COLUMN)),
        "below": bool(row.get("below resolution", False)),
        "limited": row["status"] == "limited",
    }


def _column_kind(values: pd.Series) -> str:
    """What a column of parameters holds."""
    numbers = pd.api.types.is_numeric_dtype(values) and not pd.api.types.is_bool_dtype(values)
    return "number" if numbers else "text"


def _as_json_value(value: Any) -> Any:
    if value is None or value is pd.NA or (isinstance(value, float) and math.isnan(value)):
        return None
    return value.item() if isinstance(value, np.generic) else value


def _create_curves(
    results: StudyResults, case: Case, row: pd.Series, most: int
) -> dict[str, Any] | None:
    """A run over time, with its error and its differences to the reference."""
    table = results.outcome(case).table
    if table is None:
        return None
    reference = results.references.get(str(row["group"]))
    truth = None if reference is None else reference.table
    columns = {TIME: table.index.to_numpy(), **_column_arrays(table)}
    if reference is None or truth is None or not set(reference.columns) <= set(table):
        return select_curves(columns, most)
    error = compute_deviations(table, truth, reference.columns).max(axis=1).reindex(table.index)
    rows = count_common_rows(table, truth)
    beyond = np.full(len(table) - rows, np.nan)
    differences = {
        name: np.concatenate([values[:rows] - truth[name].to_numpy()[:rows], beyond])
        for name, values in _column_arrays(table).items()
        if name in truth
    }
    return select_curves(columns, most, error.to_numpy(), differences)


def _column_arrays(table: pd.DataFrame) -> dict[str, np.ndarray]:
    return {str(name): table[name].to_numpy() for name in table}


def _max_rows_per_case(results: StudyResults) -> int:
    """How many rows there is room for on the page in the curves of each case."""
    tables = [results.outcome(case).table for case in results.study.cases[:_MAX_CURVES]]
    # Each with its difference to a reference.
    return compute_row_limit(sum(2 * len(table.columns) for table in tables if table is not None))
