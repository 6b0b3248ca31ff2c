"""HTML pages of runs, periodic motions and responses, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any

from beamdae.equations.measures import TIME
from beamdae.report.descriptions import describe
from beamdae.report.page.content import (
    Content,
    compute_row_limit,
    create_cases,
    describe_columns,
    describe_page,
    export_table,
    export_tables,
    fact_table,
    sample_evenly,
    select_curves,
    slider,
)
from beamdae.report.pictures.time_plots import PlotSelection
from beamdae.report.scene.run_scene import FRAMES_PER_PERIOD, export_run_frames
from beamdae.report.tables import format_number, range_rows, run_facts
from beamdae.results.columns import Header, observed_columns
from beamdae.results.outcome import accuracy_of
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    from beamdae.results.frequency_response import FrequencyResponse
    from beamdae.results.periodic_motion import PeriodicMotion

_MAX_RESPONSE_MOTIONS = 25  # motions on the page of a response
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
    points = {} if charts is None else charts.points
    measured = [
        {
            "id": f"data {column} {experiment}",
            "group": _ID,
            "label": f"data of {column}" + (f", {experiment}" if experiment else ""),
            "family": "data",
            "points": True,
            "curves": select_curves({TIME: times, column: values}, limit),
        }
        for column, by_experiment in points.items()
        for experiment, (times, values) in by_experiment.items()
    ]
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


def build_periodic_page(motion: PeriodicMotion, title: str, names: Sequence[str] = ()) -> Content:
    """Return the page content of a periodic motion: one period as a run, and its stability.

    It opens on the columns `names`, if there are any.
    """
    page = build_run_page(motion.solution, title, warnings=motion.warnings)
    description = describe(motion)
    facts = {"status": motion.status.sentence, **description.facts}
    added = [fact_table("Periodic motion", facts), *export_tables(description)]
    tables = [table for table in page["tables"] if table["title"] != "Observed"]
    subtitle = f"{motion.status.sentence}; {motion.stability}"
    featured = {"featured": list(names)} if names else {}
    return page | featured | {"subtitle": subtitle, "tables": [*added, *tables]}


def build_response_page(
    response: FrequencyResponse, title: str, names: Sequence[str] = ()
) -> Content:
    """Return the page content of a response curve: one case per periodic motion along the curve.

    The scatter plot shows a half range over the parameter, with peaks marked and lines to unstable
    motions dashed. It is that of the first one of `names`, or of the largest motion.
    """
    table, points, parameter = response.table(), response.points, response.parameter
    observed = list(points[0].solution.columns) if points else []
    amplitudes = {name: response.curve(name)[1] for name in observed}
    lengths = [name for name in observed if Header.of(name).unit == "m"]
    moving_most = max(lengths or observed, key=lambda name: amplitudes[name].max(), default=None)
    largest = next(iter(names), moving_most)
    peaks, description = response.peak_table(), describe(response)
    moving = sample_evenly(len(points), _MAX_RESPONSE_MOTIONS)
    max_rows = compute_row_limit(len(points) * len(observed))
    motions = [
        {
            "family": "stable" if point.stable else "unstable",
            "at": [k],
            "dashed": not point.stable,
            "curves": select_curves({TIME: point.solution.t, **point.solution.columns}, max_rows),
            "frames": export_run_frames(point.solution, FRAMES_PER_PERIOD) if k in moving else None,
        }
        for k, point in enumerate(points)
    ]
    labels = [f"{parameter} = {x.parameter:.6g} {response.unit}".rstrip() for x in points]
    return describe_page(
        title,
        f"periodic motions over {parameter}: {response.status.sentence}",
        response.warnings,
        [
            fact_table("Response", {"status": response.status.sentence, **description.facts}),
            *export_tables(description),
        ],
        noun="motions",
        families=["stable", "unstable"],
        leads=True,
        columns=describe_columns("motion", table, {parameter: response.unit}),
        axes={"x": parameter, "y": largest and _half_range_column(largest)},
        overlays=[
            {
                "x": parameter,
                "y": _half_range_column(str(name)),
                "lines": [],
                "marks": [
                    {"label": f"{x:.4g}", "x": x, "y": y}
                    for x, y in rows[[parameter, "half range"]].to_numpy().tolist()
                ],
            }
            for name, rows in peaks.groupby("observed", sort=False)
        ],
        sliders=[slider(parameter, [point.parameter for point in points], response.unit)],
        cases=create_cases(table, labels, *motions, series="curve"),
    )


def _half_range_column(header: str) -> str:
    """Return the name of the column of `FrequencyResponse.table` with the half ranges."""
    name, _, unit = header.partition(" [")
    return f"{name} half range [{unit}"
