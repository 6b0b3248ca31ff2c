"""`beamdae buckling`: linear buckling loads of a model, as a table and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

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
    load_configured_model,
    parse_start,
    required_accuracy,
    split_names,
)
from beamdae.cli.output import (
    WrittenFiles,
    create_console,
    print_accuracy,
    print_warnings,
    record_results,
)
from beamdae.cli.output_paths import plan_outputs


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
    from beamdae.cli.model_files.model_file import ModelFile

    model = load_configured_model(ModelFile(path), model_name, settings)
    table_path, picture_path = plan_outputs(out, f"{model.name}_buckling", picture, page)
    page_path = table_path.with_suffix(".html")
    from beamdae.analysis.statics.linear_buckling import buckling
    from beamdae.report.analysis_pages import write_analysis_page
    from beamdae.report.pictures.figures import save_figure
    from beamdae.report.pictures.mode_shapes import create_modes_figure
    from beamdae.report.terminal import text_tables
    from beamdae.results.storage.files import escape_table, write_text

    accurate = required_accuracy("buckling", accuracy, accuracy_columns, model)
    loads, initial_state = split_names(load, model) or None, parse_start(start, model)
    result = buckling(model, number, loads, t, initial_state, **accurate)
    table = result.table()
    text = escape_table(table).to_csv(index=False)
    files = WrittenFiles([write_text(table_path, text)], (page_path, picture_path))
    console = create_console()
    record_results(lambda: {"loads": list(result.loads), "modes": table.to_dict("records")})
    console.print(model.name, style="bold")
    console.print(text_tables.buckling_table(table))
    print_accuracy(console, result)
    print_warnings(console, result.warnings)
    title = f"{model.name}, linear buckling"
    if page:
        files.write(page_path.name, lambda: [write_analysis_page(result, page_path, title)])
    if picture and result.mechanism is not None and len(result):
        files.write(
            picture_path.name,
            lambda: [save_figure(create_modes_figure(result, title), picture_path)],
        )
    files.finish(result=result)
