"""HTML page of an optimization: the first and the best design, and all evaluated designs."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, BeamdaeWarning
from beamdae.model_parameters import format_with_unit, split_unit
from beamdae.report.analysis_pages import build_modes_page, build_path_page
from beamdae.report.page.page_content import (
    Curves,
    Frames,
    PageCase,
    PageColumn,
    PageContent,
    PageTable,
    PageTime,
)
from beamdae.report.page.page_data import compute_row_limit, select_curves
from beamdae.report.page.page_file import write_page
from beamdae.report.scene.frame_export import export_frames, export_run_frames
from beamdae.report.scene.mechanism_scene import build_scene
from beamdae.report.scene.poses import reference_poses
from beamdae.report.terminal.text_tables import format_headers, format_number
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.solution import Solution
from beamdae.results.storage.files import versions

if TYPE_CHECKING:
    from beamdae.analysis.optimization.result import Optimization

_DIGITS = 6  # of values and bounds
_GROUP = "designs"  # id of the only group
_BEST, _FIRST, _FEASIBLE, _INFEASIBLE = "best", "first", "within limits", "beyond a limit"
_DESIGN, _OBJECTIVE, _VIOLATION = "design", "objective", "violation"
# Numbers of more parameters, such as the heights of a beam, are in the table of parameters only.
_MAX_NUMBER_COLUMNS = 12


class _Motion(TypedDict):
    """Motion, equilibria, mode or drawing of a design; `time` is the axis of its curves."""

    frames: Frames | None
    curves: Curves | None
    time: PageTime


def write_optimization_page(result: Optimization, path: Path) -> Path:
    """Write the page of an optimization and return its path; see `Optimization.page`."""
    return write_page(path, build_optimization_page(result, f"Design of {result.model['name']}"))


def build_optimization_page(result: Optimization, title: str) -> PageContent:
    """Return the page content of an optimization for `write_page`.

    The cases are the evaluated designs; the first and the best one have a motion or a drawing.
    """
    motions = [_export_design(result, is_best) for is_best in (False, True)]
    tables: list[PageTable] = [
        {"title": "Optimization", "rows": list(describe_optimization(result).items())},
        _constraints_table(result),
        _parameters_table(result),
        _starts_table(result),
    ]
    return {
        "title": title,
        "subtitle": result.status.sentence,
        "made": versions(),
        "notes": list(dict.fromkeys([*result.warnings, *_build_warnings(result)])),
        "groups": [{"id": _GROUP, "label": result.model["name"]}],
        "noun": "designs",
        "leads": True,
        "columns": _list_columns(result),
        "axes": {"x": _DESIGN, "y": _OBJECTIVE},
        "families": [_BEST, _FIRST, _FEASIBLE, _INFEASIBLE],
        "time": motions[1]["time"],
        "featured": _list_headers(result),
        "tables": [table for table in tables if table["rows"]],
        "cases": _list_cases(result, motions),
    }


def describe_optimization(result: Optimization) -> dict[str, str]:
    """Return texts about the end of the search and its cost, by topic."""
    history = result.history()
    unit = result.units[_OBJECTIVE]
    first = float(history["objective"].iloc[0])
    values = (format_number(x, _DIGITS) for x in (first, result.objective))
    failures = int((history["failure"] != "").sum())
    count = f"{result.evaluations} of at most {result.max_evaluations}"
    searches = result.describe_starts()
    return {
        "status": result.status.sentence,
        "objective": f"{result.objective_label}{f' [{unit}]' if unit else ''}",
        "first and last value": " and ".join(values),
        "designs": count + (f", {failures} failed" if failures else ""),
        **({"searches": searches} if searches else {}),
        "at a bound": "; ".join(result.bound_notes) or "none",
    }


def _build_warnings(result: Optimization) -> tuple[str, ...]:
    """Return the warnings of the model function, which were issued by the optimization."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BeamdaeWarning)
        return result.mechanism().build_warnings


def _constraints_table(result: Optimization) -> PageTable:
    rows = [
        [
            format_with_unit(x.name, x.unit),
            *(format_number(y, _DIGITS) for y in (x.value, x.limit)),
            format_number(100.0 * x.relative_margin),
            format_number(x.multiplier, _DIGITS),
        ]
        for x in result.constraints
    ]
    head = ["constraint", "value", "limit", "margin [%]", "multiplier"]
    return {"title": "Constraints", "head": head, "rows": rows}


def _parameters_table(result: Optimization) -> PageTable:
    table = result.table()
    rows = [
        [
            f"{name} [{unit}]" if (unit := result.units.get(str(name), "")) else str(name),
            *(format_number(x, _DIGITS) for x in row[:4]),
            "yes" if row[4] else "no",
        ]
        for name, row in zip(table.index, table.to_numpy().tolist(), strict=True)
    ]
    # The unit is part of the name.
    return {"title": "Parameters", "head": ["parameter", *map(str, list(table)[:-1])], "rows": rows}


def _starts_table(result: Optimization) -> PageTable:
    """Return the searches from several starts."""
    table, headers = result.starts, format_headers(result.units)
    columns = ["objective", "violation", "evaluations", *map(str, result.table().index), "status"]
    rows = [] if table is None else table[columns].to_numpy().tolist()
    texts = [[*(format_number(x, _DIGITS) for x in row[:-1]), row[-1]] for row in rows]
    return {"title": "Searches", "head": [headers.get(x, x) for x in columns], "rows": texts}


def _list_headers(result: Optimization) -> list[str]:
    """Return the headers of the columns in the objective and the constraints."""
    observed: dict[str, str] = {}
    for analysis in result.analyses:
        for header in getattr(analysis, "columns", ()):
            observed |= {header: header, split_unit(header)[0]: header}
    return [observed.get(name, name) for name in result.columns]


def _list_columns(result: Optimization) -> list[PageColumn]:
    """Return the columns of the table of designs."""
    names = [str(x) for x in result.history() if x != "failure"]
    numbers = list(result.table().index)
    if len(numbers) > _MAX_NUMBER_COLUMNS:
        names = [x for x in names if x not in numbers]
    columns: list[PageColumn] = [{"key": _DESIGN, "label": _DESIGN, "unit": "", "kind": "number"}]
    for name in names:
        unit = result.units.get(name, "")
        columns.append({"key": name, "label": name, "unit": unit, "kind": "number"})
    return columns


def _list_cases(result: Optimization, motions: list[_Motion]) -> list[PageCase]:
    """Return a case per evaluated design."""
    history = result.history()
    rows = history.drop(columns="failure").to_dict("records")
    best = result.best_number
    cases: list[PageCase] = []
    for k, (row, failure) in enumerate(zip(rows, history["failure"], strict=True), 1):
        family = _FEASIBLE if row[_VIOLATION] == 0.0 else _INFEASIBLE
        label = f"design {k}"
        if k in (1, best):
            family = _BEST if k == best else _FIRST
            label += f" ({'first and best' if best == 1 else family})"
        values = {_DESIGN: k, **{str(name): x for name, x in row.items() if np.isfinite(x)}}
        case: PageCase = {
            "id": f"{_DESIGN} {k}",
            "group": _GROUP,
            "label": label,
            "family": family,
            "rank": k,
            "status": failure or "ok",
            "values": values,
        }
        if k in (1, best):
            motion = motions[k == best]
            case |= {"frames": motion["frames"], "curves": motion["curves"]}
        cases.append(case)
    # The page opens on the first cases with curves.
    cases.sort(key=lambda case: (_BEST, _FIRST).index(case["family"]) if case.get("frames") else 2)
    return cases


def _export_design(result: Optimization, is_best: bool) -> _Motion:
    """Return frames, curves and their time axis: of a run, a path, a mode, or a drawing."""
    analyses = result.analyses if is_best else result.first_analyses
    run = next((x for x in analyses if isinstance(x, Solution)), None)
    if run is not None:
        limit = compute_row_limit(2 * len(run.columns))
        return {
            "frames": export_run_frames(run, enlarges=True),
            "curves": select_curves({TIME: run.t, **run.columns}, limit),
            "time": {},
        }
    path = next((x for x in analyses if isinstance(x, Equilibrium)), None)
    if path is not None:
        page = build_path_page(path, "")
        frames, curves = page["groups"][0]["frames"], page["cases"][0]["curves"]
        return {"frames": frames, "curves": curves, "time": page["time"]}
    if analyses:
        page = build_modes_page(analyses[0], "")
        frames = next((x["frames"] for x in page["cases"]), None)
        return {"frames": frames, "curves": None, "time": page["time"]}
    return {"frames": _export_drawing(result.mechanism(is_best)), "curves": None, "time": {}}


def _export_drawing(mechanism: Any) -> dict[str, Any] | None:
    times = np.zeros(1)
    try:
        return export_frames(build_scene(mechanism, reference_poses, times), times)
    except BeamdaeError:
        return None  # There are no parts that can be drawn.
