"""HTML page of a fit: estimates, curves of data and model, and the motion of the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from beamdae.equations.measures import TIME
from beamdae.report.descriptions import describe
from beamdae.report.page.page_content import Content
from beamdae.report.page.page_data import compute_row_limit, select_curves
from beamdae.report.page_parts import describe_page, export_tables, fact_table
from beamdae.report.scene.frame_export import export_run_frames
from beamdae.results.columns import remove_unit

if TYPE_CHECKING:
    from beamdae.analysis.fit.result import Fit

_GROUP = "data"  # id of the group of experiments without a name


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
                "group": experiment or _GROUP,
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
                "group": experiment or _GROUP,
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
                "id": experiment or _GROUP,
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
