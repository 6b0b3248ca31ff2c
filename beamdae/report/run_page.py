"""Content of the HTML page of a single run, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from beamdae.equations.measures import TIME
from beamdae.report.page.page_content import Content
from beamdae.report.page.page_data import compute_row_limit, select_curves
from beamdae.report.page_parts import describe_page, export_table, fact_table
from beamdae.report.pictures.time_plots import PlotSelection
from beamdae.report.scene.frame_export import export_run_frames
from beamdae.report.terminal.text_tables import format_number, range_rows, run_facts
from beamdae.results.columns import observed_columns
from beamdae.results.outcome import accuracy_of
from beamdae.results.solution import Solution

_ID = "run"  # id of the case of the run and of its group
_HASH_DIGITS = 12  # displayed digits of the equation hash, enough to distinguish runs
_PARAMETER_DIGITS = 6


def build_run_page(
    solution: Solution,
    title: str,
    warnings: Sequence[str] | None = None,
    charts: PlotSelection | None = None,
) -> Content:
    """Return the page content of a run for `beamdae.report.page.page_file.write_page`.

    Parameters
    ----------
    solution
        The run.
    title
        Title of the page.
    warnings
        Warnings to show. Defaults to those of the run.
    charts
        Columns that the charts show first, with measured values over time. Defaults to the columns
        that vary.
    """
    table = solution.all_columns() | solution.drift_columns
    status = solution.status
    method = str(solution.integrator.get("integrator", ""))
    limit = compute_row_limit(len(table))
    measured = [] if charts is None else _list_measured(charts, limit)
    case = {
        "id": _ID,
        "group": _ID,
        "label": title,
        "family": method,
        "status": "ok" if status.success else status.sentence,
        "curves": select_curves(table, limit),
    }
    return describe_page(
        title,
        f"{method}: {status.sentence}",
        solution.warnings if warnings is None else warnings,
        _build_tables(solution),
        made=solution.versions,
        groups=[{"id": _ID, "frames": export_run_frames(solution, enlarges=True)}],
        cases=[case, *measured],
        noun="curves" if measured else "cases",
        axes=None if measured else {},
        **({} if charts is None else {"featured": charts.columns}),
    )


def _list_measured(charts: PlotSelection, limit: int) -> list[Content]:
    """Return a case for the measured values of each column and experiment."""
    return [
        {
            "id": f"data {column} {experiment}",
            "group": _ID,
            "label": f"data of {column}" + (f", {experiment}" if experiment else ""),
            "family": "data",
            "points": True,
            "curves": select_curves({TIME: times, column: values}, limit),
        }
        for column, by_experiment in charts.points.items()
        for experiment, (times, values) in by_experiment.items()
    ]


def _build_tables(solution: Solution) -> list[Content]:
    facts = run_facts(solution)
    if (reached := accuracy_of(solution)) is not None:
        facts["accuracy"] = reached.sentence
    model, metadata = solution.model, solution.metadata()
    units = model.get("units", {})
    parameters = {
        name: f"{_format_parameter(x)} {units.get(name, '')}".strip()
        for name, x in model.get("parameters", {}).items()
    }
    provenance = {
        "model": model.get("name", ""),
        "started": metadata["start"]["asked"] or "as drawn",
        "equations": metadata["equations"]["identity"][:_HASH_DIGITS],
        "written": datetime.now().astimezone().isoformat(" ", "seconds"),
    }
    columns = solution.all_columns()
    observed = {name: columns[name] for name in observed_columns(columns)}
    known = vars(solution).get("errors")  # Those that take long are not measured.
    return [
        export_table("Observed", range_rows(observed, known, solution.step_extremes)),
        fact_table("Parameters", parameters, "motion"),
        fact_table("Run", facts, "solver"),
        fact_table("Provenance", provenance, "solver"),
    ]


def _format_parameter(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"({', '.join(map(_format_parameter, value))})"
    return format_number(value, _PARAMETER_DIGITS)
