"""HTML pages of fits and of optimized designs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError
from beamdae.model_parameters import split_unit
from beamdae.report.analysis_pages import build_modes_page, build_path_page
from beamdae.report.descriptions import describe
from beamdae.report.page.content import (
    GROUP,
    Content,
    compute_row_limit,
    create_cases,
    describe_columns,
    describe_page,
    export_tables,
    fact_table,
    select_curves,
)
from beamdae.report.scene.mechanism_scene import build_scene, reference_poses
from beamdae.report.scene.run_scene import export_frames, export_run_frames
from beamdae.results.columns import remove_unit
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.solution import Solution
from beamdae.simulation import silenced

if TYPE_CHECKING:
    from beamdae.analysis.fit.result import Fit
    from beamdae.analysis.optimization.result import Optimization

_DATA_GROUP = "data"  # id of the group of experiments without a name
_BEST, _FIRST, _FEASIBLE, _INFEASIBLE = "best", "first", "within limits", "beyond a limit"
_OBJECTIVE, _VIOLATION = "objective", "violation"
# Numbers of more parameters, such as the heights of a beam, are in the table of parameters only.
_MAX_NUMBER_COLUMNS = 12


def build_fit_page(fit: Fit, title: str) -> Content:
    """Return the page content of a fit for `beamdae.report.page.page_file.write_page`."""
    runs, data = fit.solutions, fit.residual_table()
    groups = data.groupby(["experiment", "observable"], sort=False)
    sources = [(str(x), str(header), rows) for (x, header), rows in groups]
    columns = sum(len(run.columns) for run in runs.values()) + 2 * len(sources)
    limit = compute_row_limit(columns)
    cases: list[Content] = []
    for experiment, run in runs.items():
        cases.append(
            {
                "id": f"model {experiment}",
                "group": experiment or _DATA_GROUP,
                "label": "model",
                "family": "model",
                "curves": select_curves({TIME: run.t, **run.columns}, limit),
            }
        )
    for k, (experiment, header, rows) in enumerate(sources):
        shift, scale, offset = fit.sensor_of(int(rows.index[0]))
        curve = {
            TIME: rows[TIME].to_numpy() - shift,
            header: (rows["value"].to_numpy() - offset) / scale,
            _residual_header(header): rows["residual"].to_numpy(),
        }
        cases.append(
            {
                "id": f"data {k}",
                "group": experiment or _DATA_GROUP,
                "label": f"data of {header}",
                "family": "data",
                "points": True,
                "values": {
                    "count": len(rows),
                    "rms": float(np.sqrt(np.mean(rows["residual"] ** 2))),
                },
                "curves": select_curves(curve, limit),
            }
        )
    corrections = "data, corrected by the estimated shifts, offsets and scales"
    source = corrections if fit.sensors else "data as measured"
    description = describe(fit)
    facts = {**description.facts, **description.details, "points in the charts": source}
    return describe_page(
        title,
        fit.status.sentence,
        [*fit.warnings, *fit.undetermined],
        [
            fact_table("Fit", facts),
            *export_tables(description),
        ],
        made=next(iter(runs.values())).versions,
        groups=[
            {
                "id": experiment or _DATA_GROUP,
                "label": experiment or fit.model_name,
                "frames": export_run_frames(run, enlarges=True),
            }
            for experiment, run in runs.items()
        ],
        columns=[
            {"key": "count", "label": "number of data", "unit": "", "kind": "number"},
            {"key": "rms", "label": "rms residual", "unit": "sigma", "kind": "number"},
        ],
        axes=None,
        noun="curves",
        featured=list(dict.fromkeys(y for _, x, _ in sources for y in (x, _residual_header(x)))),
        cases=cases,
    )


def _residual_header(header: str) -> str:
    return f"residual of {remove_unit(header)} [sigma]"


def build_optimization_page(result: Optimization, title: str) -> Content:
    """Return the page content of an optimization for `write_page`.

    The cases are the evaluated designs; the first and the best one have a motion or a drawing.
    """
    with silenced():  # The optimization has issued them.
        of_model = result.mechanism().build_warnings
    history, best, units = result.history(), result.best_number, result.units
    labels: list[str] = []
    entries: list[Content] = []
    time: Content = {}
    for k, violation in enumerate(history[_VIOLATION], 1):
        family = _FEASIBLE if violation == 0.0 else _INFEASIBLE
        label, motion = f"design {k}", Content()
        if k in (1, best):
            family = _BEST if k == best else _FIRST
            label += f" ({'first and best' if best == 1 else family})"
            motion, axis = _export_design(result, k == best)
            time = axis if k == best else time
        labels.append(label)
        status = history["failure"].iloc[k - 1] or "ok"
        entries.append({"rank": k, "family": family, "status": status, **motion})
    table = history.drop(columns="failure")
    table.insert(0, "design", range(1, len(table) + 1))
    numbers = list(result.table().index)
    shown = table.drop(columns=numbers if len(numbers) > _MAX_NUMBER_COLUMNS else [])
    cases, description = create_cases(table, labels, *entries), describe(result)
    # The page opens on the first cases with curves.
    cases.sort(key=lambda x: (_BEST, _FIRST).index(x["family"]) if x.get("frames") else 2)
    return describe_page(
        title,
        result.status.sentence,
        list(dict.fromkeys([*result.warnings, *of_model])),
        [
            fact_table("Optimization", {"status": result.status.sentence, **description.facts}),
            *export_tables(description),
        ],
        groups=[{"id": GROUP, "label": result.model["name"]}],
        noun="designs",
        leads=True,
        columns=describe_columns("design", shown, units)[1:],
        axes={"x": "design", "y": _OBJECTIVE},
        families=[_BEST, _FIRST, _FEASIBLE, _INFEASIBLE],
        time=time,
        featured=_list_headers(result),
        cases=cases,
    )


def _list_headers(result: Optimization) -> list[str]:
    """Return the headers of the columns in the objective and the constraints."""
    observed: dict[str, str] = {}
    for analysis in result.analyses:
        for header in getattr(analysis, "columns", ()):
            observed |= {header: header, split_unit(header)[0]: header}
    return [observed.get(name, name) for name in result.columns]


def _export_design(result: Optimization, is_best: bool) -> tuple[Content, Content]:
    """Return frames and curves of a run, a path, a mode, or a drawing, and their time axis."""
    analyses = result.analyses if is_best else result.first_analyses
    run = next((x for x in analyses if isinstance(x, Solution)), None)
    path = next((x for x in analyses if isinstance(x, Equilibrium)), None)
    if run is not None:
        limit = compute_row_limit(2 * len(run.columns))
        curves = select_curves({TIME: run.t, **run.columns}, limit)
        return {"frames": export_run_frames(run, enlarges=True), "curves": curves}, {}
    if path is not None:
        page = build_path_page(path, "")
        entries = {"frames": page["groups"][0]["frames"], "curves": page["cases"][0]["curves"]}
        return entries, page["time"]
    if analyses:
        page = build_modes_page(analyses[0], "")
        return {"frames": next((x["frames"] for x in page["cases"]), None)}, page["time"]
    times = np.zeros(1)
    try:
        scene = build_scene(result.mechanism(is_best), reference_poses, times)
        return {"frames": export_frames(scene, times)}, {}
    except BeamdaeError:
        return {"frames": None}, {}  # There are no parts that can be drawn.
