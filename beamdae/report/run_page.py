"""What the page of one run shows, as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from beamdae.equations.measures import TIME
from beamdae.report.page.curves_data import curves_of, rows_a_curve
from beamdae.report.scene.frame_export import export_run_frames
from beamdae.report.terminal import text_tables as terminal
from beamdae.report.terminal.responsive_table import ResponsiveTable
from beamdae.results.columns import observed_columns
from beamdae.results.event_records import format_event_times
from beamdae.results.solution import Solution
from beamdae.results.storage.files import versions

_ID = "run"
# Of the hash of the equations, enough to tell runs apart.
_DIGITS = 12


def page_of_run(
    solution: Solution,
    title: str,
    columns: Mapping[str, Any] | None = None,
    errors: Mapping[str, Any] | None = None,
    warnings: Sequence[str] = (),
) -> dict[str, Any]:
    """The page of a run; see `beamdae.report.page.page.write_page`.

    Parameters
    ----------
    solution
        The run.
    title
        Of the page.
    columns
        Its table by header, where that is of more than this run; default its own.
    errors
        What is told of the error of each observed column, in their order; the first is left out.
    warnings
        What there is to say besides its own.
    """
    table = solution.all_columns() if columns is None else dict(columns)
    # Of this run alone, where the table is of more.
    if len(solution.t) == len(table[TIME]):
        table |= solution.drift_columns
    status = solution.status
    method = str(solution.integrator.get("integrator", ""))
    return {
        "title": title,
        "subtitle": f"{method}: {status.sentence}",
        "made": versions(),
        "notes": [*warnings, *solution.warnings],
        "groups": [{"id": _ID, "frames": export_run_frames(solution)}],
        "tables": [table for table in _tables(solution, table, errors) if table["rows"]],
        "cases": [
            {
                "id": _ID,
                "group": _ID,
                "label": title,
                "family": method,
                "status": "ok" if status.success else status.sentence,
                "curves": curves_of(table, rows_a_curve(len(table))),
            }
        ],
    }


def _tables(
    solution: Solution, columns: Mapping[str, Any], errors: Mapping[str, Any] | None
) -> list[dict[str, Any]]:
    facts = terminal.run_facts(solution.summary(), solution.integrator)
    if solution.equations.events:
        facts["events"] = format_event_times(solution.event_records)
    observed = {name: columns[name] for name in observed_columns(columns)}
    return [
        {"title": "Run", "rows": list(facts.items())},
        _told("Observed", terminal.range_table(observed, errors)),
        _told("Validity of the beams", terminal.validity_table(solution.validity)),
        {"title": "Where it comes from", "rows": _provenance(solution)},
    ]


def _told(title: str, table: ResponsiveTable) -> dict[str, Any]:
    head, *rows = table.texts
    return {"title": title, "head": head, "rows": rows}


def _provenance(solution: Solution) -> list[list[str]]:
    told = solution.beside()
    model = told["model"]
    settings = {"model": model.get("name", "")}
    settings |= {
        str(name): terminal.format_number(x, 6) for name, x in model.get("parameters", {}).items()
    }
    settings["started"] = str(told["start"]["asked"] or "as drawn")
    settings["equations"] = told["equations"]["identity"][:_DIGITS]
    settings["written"] = datetime.now().astimezone().isoformat(" ", "seconds")
    return [[name, value] for name, value in settings.items() if value]
