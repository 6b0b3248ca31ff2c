"""`beamdae buckling`: linear buckling loads of a model, as a table and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from beamdae.cli.options import (
    AccurateColumns,
    Loads,
    LoadTime,
    ModelName,
    ModelPath,
    Out,
    Page,
    Picture,
    RequiredAccuracy,
    Settings,
    Starts,
    load_model,
    parse_start,
    required_accuracy,
    split_names,
)
from beamdae.cli.results import Report, ResultFiles, draw_modes, run_analysis


def buckling_command(
    path: ModelPath,
    settings: Settings = None,
    model_name: ModelName = None,
    number: Annotated[int, typer.Option("-n", "--number", help="Number of load factors.")] = 5,
    load: Loads = None,
    t: LoadTime = 0.0,
    start: Starts = None,
    accuracy: RequiredAccuracy = None,
    accuracy_columns: AccurateColumns = None,
    page: Page = True,
    picture: Picture = True,
    out: Out = Path("results"),
) -> None:
    """Compute linear buckling loads of a model; write a table (CSV), a picture (PNG) and a page.

    Exits with 0 on success, 1 if --accuracy was not reached or the page or picture failed, and 2
    for a usage or model error.
    """
    model, _ = load_model(path, model_name, settings)
    files = ResultFiles.plan(out, f"{model.name}_buckling", page, picture)
    accurate = required_accuracy("buckling", accuracy, accuracy_columns, model)
    loads, initial_state = split_names(load, model) or None, parse_start(start, model)

    def analyze() -> Any:
        from beamdae.analysis.statics.linear_buckling import buckling

        return buckling(model, number, loads, t, initial_state, **accurate)

    def describe(result: Any) -> Report:
        from beamdae.report.terminal import text_tables

        table = result.table()
        return Report(
            model.name,
            lambda: {"loads": list(result.loads), "modes": table.to_dict("records")},
            tables=[text_tables.buckling_table(table)],
            warnings=result.warnings,
        )

    run_analysis(files, f"{model.name}, linear buckling", analyze, describe, draw_modes)
