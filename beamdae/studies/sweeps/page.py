"""What the page of a sweep shows, as plain data."""

from __future__ import annotations

from typing import Any

from beamdae.studies.study_page import create_study_page, extra_column_key
from beamdae.studies.sweeps.pictures import axis_of, families_of
from beamdae.studies.sweeps.results import SweepResults
from beamdae.studies.sweeps.tables import parameter_column


def page_of_sweep(swept: SweepResults) -> dict[str, Any]:
    """The page of a sweep; see `beamdae.report.page.page_file.write_page`.

    What is told of its runs is drawn over a parameter; each choice of the others is a family.
    """
    made = create_study_page(swept.results, swept.table[[*swept.parameters, *swept.told]])
    made["columns"][0] |= {"label": "case"}
    if not swept.sweep.varied:
        return made
    x = axis_of(swept, None)
    for family, rows in families_of(swept, x).items():
        for row in rows:
            case, at = made["cases"][row], swept.sweep.settings[row][x]
            case |= {"family": family or case["family"], "series": family}
            case["rank"] = at if isinstance(at, (int, float)) else row
    numbers = {column["key"] for column in made["columns"] if column["kind"] == "number"}
    told = [key for key in map(extra_column_key, swept.told) if key in numbers]
    made["axes"] = {
        "x": extra_column_key(parameter_column(swept.sweep, x)),
        "y": next(iter(told), None),
    }
    return made
