"""HTML page of a fit: estimates, curves of data and model, and the motion of the model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from beamdae.equations.measures import TIME
from beamdae.errors import format_count
from beamdae.report.page.page_content import Content
from beamdae.report.page.page_data import compute_row_limit, select_curves
from beamdae.report.page.page_file import write_page
from beamdae.report.page_parts import describe_page, export_table, fact_table
from beamdae.report.scene.frame_export import export_run_frames
from beamdae.report.terminal import text_tables as terminal
from beamdae.results.columns import remove_unit

if TYPE_CHECKING:
    from beamdae.analysis.fit.result import Fit

_GROUP = "data"  # id of the group of experiments without a name


def write_fit_page(fit: Fit, path: Path) -> Path:
    """Write the page of a fit and return its path; see `Fit.page`."""
    return write_page(path, build_fit_page(fit, f"Fit of {fit.model_name}"))


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
    facts = describe_fit(fit)
    return describe_page(
        title,
        facts["status"],
        [*fit.warnings, *fit.undetermined],
        [
            fact_table("Fit", facts | {"points in the charts": source}),
            export_table("Estimates", terminal.estimates_table(fit.table(), fit.units)),
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


def describe_fit(fit: Fit) -> dict[str, str]:
    """Return texts about the end of the search and the quality of a fit, by topic."""
    interval = (
        "normal distribution, sigma is known"
        if fit.is_sigma_known
        else f"t distribution with {fit.degrees_of_freedom} degrees of freedom, sigma is estimated"
    )
    if not fit.status.success:
        interval = "none, because the search did not reach a minimum"
    facts = {"status": fit.status.sentence}
    if chi_square := fit.describe_chi_square():
        facts["chi-square"] = chi_square
    facts |= {
        "sigma": ", ".join(f"{name} {value:.4g}" for name, value in fit.sigma.items()),
        "intervals": interval,
        "data": f"{fit.residuals.size} in {format_count(len(fit.solutions), 'experiment')}",
        "runs": f"{fit.evaluations} with derivatives of each experiment",
    }
    if searches := fit.describe_starts():
        facts["searches"] = searches
    if fit.at_bounds:
        facts["at a bound"] = ", ".join(fit.at_bounds)
    return facts
