"""Page and pictures of a study."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from beamdae.equations.measures import TIME
from beamdae.report.page.content import (
    Content,
    compute_row_limit,
    describe_columns,
    describe_page,
    select_curves,
)
from beamdae.report.pictures.figures import (
    COLORS,
    DASHES,
    MAX_DRAWABLE,
    Panel,
    draw_panels,
)
from beamdae.report.tables import RESULT_COLUMNS, SOLVER_COLUMNS
from beamdae.studies.case import Case
from beamdae.studies.case_table import ACCURACY_COLUMNS, BOUND_COLUMN, ERROR_COLUMN
from beamdae.studies.references import (
    RESOLUTION_FACTOR,
    compute_deviations,
    number_duplicates,
)
from beamdae.studies.run_values import (
    MAX_WALL_TIME_COLUMN,
    MIN_WALL_TIME_COLUMN,
    WALL_TIME_COLUMN,
)
from beamdae.studies.study_run import StudyResults

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MAX_CURVES = 200  # cases with curves in the page; pages with more take long to open
_NO_ERRORS = "These cases have no errors: no other case has the same parameters."
# Prefix of the keys of extra columns, whose names may also occur in the case table.
_EXTRA_COLUMN_PREFIX = "extra: "

_MARKERS = "osD^vPX"
_ERROR_LABEL = "error / amplitude [-]"

Style = dict[str, Any]
Line = tuple[Any, Any, Style]


def create_study_page(
    results: StudyResults,
    extra_columns: pd.DataFrame | None = None,
    with_curves: set[int] | None = None,
    is_stored: bool = True,
) -> Content:
    """Return the page data of a study for `beamdae.report.page.page_file.write_page`.

    Parameters
    ----------
    results
        Results of the study.
    extra_columns
        Columns in place of the parameters, one row per case.
    with_curves
        Row numbers of the cases whose curves are stored. Defaults to the first 200 cases.
    is_stored
        False if the trajectory files of the cases are not kept.
    """
    table, is_labeled_by_tag = results.table, extra_columns is not None
    if with_curves is None:
        with_curves = set(range(MAX_CURVES))
    if extra_columns is None:
        parameters = list(map(str, table))[1 : list(table).index("group")]
        inserted = describe_columns("", table[parameters])[1:]
    else:
        inserted = describe_columns("", extra_columns)[1:]
        for column in inserted:
            column["key"] = extra_column_key(column["key"])
        table = pd.concat([table, extra_columns.add_prefix(_EXTRA_COLUMN_PREFIX)], axis=1)
    first, *others = (
        {"key": key, "label": label, "unit": unit, "kind": kind, "section": section}
        for section, group in (("results", RESULT_COLUMNS), ("solver", SOLVER_COLUMNS))
        for key, (label, unit, kind) in group.items()
        if key in table and not (section == "solver" and table[key].isna().all())
    )
    columns = [first, *inserted, *others]
    failures = int((table["status"] != "ok").sum())
    notes = results.describe_warnings()
    if results.references:
        notes.append(
            "Error: largest difference from the reference over all times and compared "
            "columns, relative to half the range of each column. Errors below "
            f"{RESOLUTION_FACTOR:g} times the uncertainty of the reference are upper "
            "bounds; their markers are hollow."
        )
    if results.interrupted:
        notes.append("The study was interrupted; run the study again to resume.")
    # All cases without a reference are in one group with the name of the study.
    group_without_reference = number_duplicates([*results.references, results.study.name])[-1]
    return describe_page(
        results.study.name,
        f"{len(table)} cases, {failures} failed",
        notes,
        groups=_create_groups(results, group_without_reference),
        columns=columns,
        cases=_create_cases(
            results,
            table[[column["key"] for column in columns]],
            group_without_reference,
            is_labeled_by_tag,
            with_curves,
            is_stored,
        ),
    )


def extra_column_key(name: str) -> str:
    """Return the key of an extra column in the data of the page."""
    return _EXTRA_COLUMN_PREFIX + name


def _create_groups(results: StudyResults, group_without_reference: str) -> list[Content]:
    """Return the groups whose errors are computed and, if needed, one group for all other cases."""
    frames: dict[str, Any] = {}
    for case, group in zip(results.study.cases, results.table["group"], strict=True):
        # Only references record frames, which are valid for all runs of the same mechanism.
        frames[group] = frames.get(group) or results.frames_of(case)
    groups: list[Content] = []
    for name, reference in results.references.items():
        accepted = reference.table is not None
        description = {
            "uncertainty": reference.resolution if accepted else None,
            "accepted": accepted,
            # The page adds these words.
            "sentence": reference.sentence.removeprefix("no reference, "),
        }
        moving = frames[name] if frames[name] and frames[name]["glyphs"] else None
        groups.append({"id": name, "label": name, "reference": description, "frames": moving})
    if not set(frames) <= set(results.references):
        groups.append(
            {
                "id": group_without_reference,
                "label": results.study.name,
                "reference": {"accepted": True, "sentence": _NO_ERRORS} if groups else None,
            }
        )
    return groups


def _create_cases(
    results: StudyResults,
    shown: pd.DataFrame,
    group_without_reference: str,
    is_labeled_by_tag: bool,
    with_curves: set[int],
    is_stored: bool,
) -> list[Content]:
    study = results.study

    def sort_key(case: Case) -> tuple[str, float]:
        # By series, and within each series from coarse to fine.
        if study.over is not None:
            return case.series, case.parameters[study.over]
        return case.series, -case.integrator.accuracy.value

    keys = list(map(sort_key, study.cases))
    ranks = np.argsort(sorted(range(len(keys)), key=keys.__getitem__)).tolist()
    drawn = (case for k, case in enumerate(study.cases) if k in with_curves)
    trajectories = filter(None, (results.outcome(case).rows for case in drawn))
    max_rows = compute_row_limit(sum(len(x.headers) for x in trajectories))
    rows = results.table.replace({np.nan: None}).astype(object).to_dict("records")
    values = shown.astype(object).where(shown.notna(), None).to_dict("records")
    cases: list[Content] = []
    for k, (case, row, cells) in enumerate(zip(study.cases, rows, values, strict=True)):
        group = str(row["group"])
        reference = results.references.get(group)
        status = str(row["reason"] or "ok")
        label = study.tag(case)
        if reference is None and not is_labeled_by_tag:
            label = f"{group}, {case.label}"
        table = results.outcome(case).table if k in with_curves else None
        curves = None
        if table is not None:
            columns = {TIME: table.index.to_numpy(), **{str(x): table[x].to_numpy() for x in table}}
            error = None
            exact = None if reference is None else reference.table
            if reference is not None and exact is not None and set(reference.columns) <= set(table):
                deviations = compute_deviations(table, exact, reference.columns)
                error = deviations.max(axis=1).reindex(table.index).to_numpy()
            curves = select_curves(columns, max_rows, error)
        cases.append(
            {
                "id": str(k),
                "rank": ranks[k],
                "group": group_without_reference if reference is None else group,
                "label": label,
                "series": case.series,
                "family": case.integrator.method,
                "status": status,
                "values": cells | {"status": status},
                "error": row.get(BOUND_COLUMN),
                "cost": row.get(WALL_TIME_COLUMN),
                "below": bool(row.get("below resolution", False)),
                "limited": row["status"] == "limited",
                "curves": curves,
                "file": row["trajectory"] if is_stored else "",
            }
        )
    return cases


def list_plots(results: StudyResults) -> dict[str, Callable[[], Figure | None]]:
    """Return the functions that create the figures of a study, by file name.

    They return None if the study lacks the data for the figure. The dict is empty if no errors are
    computed.
    """
    if ERROR_COLUMN not in results.table:
        return {}
    if results.study.over is None:
        return {"work_precision.png": partial(_draw_work_precision, results)}
    return {"mesh_convergence.png": partial(_draw_mesh_convergence, results)}


def _draw_work_precision(results: StudyResults) -> Figure | None:
    """Plot the error over the wall time, with one panel per group.

    Markers of errors that the reference does not resolve are hollow, at its dotted line. Thin lines
    extend from the shortest to the longest wall time of repeated runs.
    """
    rows = _select_drawable(results.table, WALL_TIME_COLUMN, BOUND_COLUMN)
    styles, panels = _assign_styles(rows["series"]), []
    for group, members in rows.groupby("group", sort=False):
        lines: list[Line] = []
        for series, runs in members.groupby("series", sort=False):
            style = styles[str(series)]
            # Sort by setting: wall times scatter, so sorting by wall time would tangle the lines.
            runs = runs.sort_values(list(ACCURACY_COLUMNS.values()), ascending=False)
            resolved, bounds = runs[~runs["below resolution"]], runs[runs["below resolution"]]
            hollow = style | {"mfc": "none", "ls": "none"}
            lines.append((resolved[WALL_TIME_COLUMN], resolved[ERROR_COLUMN], style))
            lines.append((bounds[WALL_TIME_COLUMN], bounds[BOUND_COLUMN], hollow))
            span = runs.reindex(columns=[MIN_WALL_TIME_COLUMN, MAX_WALL_TIME_COLUMN, BOUND_COLUMN])
            thin = {"color": style["color"], "lw": 0.7}
            lines += [(x[:2], np.full(2, x[2]), thin) for x in span.dropna().to_numpy(float)]
        resolution = results.references[str(group)].resolution
        times = members[WALL_TIME_COLUMN].agg(["min", "max"]).to_numpy()
        lines.append((times, np.full(2, resolution), {"color": "0.4", "lw": 1.0, "ls": ":"}))
        # Equal errors have no range.
        low, high = members[BOUND_COLUMN].agg(["min", "max"])
        lines.append((times, np.array([0.3 * low, 3.0 * high]), {"ls": ""}))
        axes = WALL_TIME_COLUMN, _ERROR_LABEL
        panels.append(Panel(str(group), _ERROR_LABEL, lines, axes, ("log", "log")))
    return draw_panels(panels, "", styles, "groups", x_label=None) if panels else None


def _draw_mesh_convergence(results: StudyResults) -> Figure | None:
    """Plot the error over the refined parameter, with one line per group."""
    over = str(results.study.over_header)
    rows = _select_drawable(results.table, over, ERROR_COLUMN).sort_values(over)
    if rows.empty:
        return None
    styles = _assign_styles(rows["group"])
    lines = [
        (runs[over], runs[ERROR_COLUMN], styles[str(group)])
        for group, runs in rows.groupby("group", sort=False)
    ]
    panel = Panel("", _ERROR_LABEL, lines, (over, _ERROR_LABEL), ("log", "log"))
    return draw_panels([panel], "", styles, x_label=None)


def _select_drawable(table: pd.DataFrame, *columns: str) -> pd.DataFrame:
    """Return the rows of successful runs whose values can be drawn on logarithmic axes."""
    rows = table[table["status"] == "ok"]
    values = rows[list(columns)].astype(float)
    return rows[((values > 0.0) & (values < MAX_DRAWABLE)).all(axis=1)]


def _assign_styles(series: Iterable[str]) -> dict[str, Style]:
    """Return a line style for each series; after the last color, markers and dashes differ."""
    styles: dict[str, Style] = {}
    for k, name in enumerate(dict.fromkeys(map(str, series))):
        cycle, number = divmod(k, len(COLORS))
        styles[name] = {
            "color": COLORS[number],
            "marker": _MARKERS[cycle % len(_MARKERS)],
            "ls": DASHES[cycle % len(DASHES)],
            "ms": 4,
            "lw": 1.0,
        }
    return styles
