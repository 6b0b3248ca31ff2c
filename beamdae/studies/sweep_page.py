"""What the page of a sweep shows, as plain data."""

from __future__ import annotations

from typing import Any

from beamdae.studies.page_data import page, told_key
from beamdae.studies.sweep_pictures import axis_of, families_of
from beamdae.studies.sweep_results import SweepResults
from beamdae.studies.sweep_tables import parameter_column


def page_of_sweep(swept: SweepResults) -> dict[str, Any]:
    """Runs over each other, and what is told of them over a parameter; a family for each choice
    of the others. See `beamdae.report.page.page.write_page`.
    """
    made = page(swept.results, swept.table[[*swept.parameters, *swept.told]])
    if not swept.sweep.varied:
        return made
    x = axis_of(swept, None)
    for family, rows in families_of(swept, x).items():
        for case in (made["cases"][row] for row in rows):
            case |= {"family": family or case["family"], "series": family}
    numbers = {column["key"] for column in made["columns"] if column["kind"] == "number"}
    told = [key for key in map(told_key, swept.told) if key in numbers]
    made["axes"] = {"x": told_key(parameter_column(swept.sweep, x)), "y": next(iter(told), None)}
    return made
