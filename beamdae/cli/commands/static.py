"""`beamdae static`: equilibria of a model under increasing loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.options import (
    AccurateColumns,
    HorizontalColumn,
    Loads,
    LoadTime,
    ModelName,
    ModelPath,
    Out,
    Page,
    Picture,
    PlottedColumns,
    RequiredAccuracy,
    Settings,
    Starts,
    load_model,
    parse_named_number,
    parse_start,
    required_accuracy,
    split_names,
)
from beamdae.cli.results import Report, ResultFiles, run_analysis, without_status
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.model_functions import Model
    from beamdae.results.equilibrium import Equilibrium


def static_command(
    path: ModelPath,
    settings: Settings = None,
    model_name: ModelName = None,
    load: Loads = None,
    to: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TARGET",
            help="Load factor to reach, or COLUMN=VALUE of an observed position, with or without a "
            "unit (tip.y=-2mm); repeatable. Defaults to the load factor 1. With --over, its value.",
        ),
    ] = None,
    over: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Quantity that varies in place of a load factor: t, or a driver, an input or a "
            "parameter of the model.",
        ),
    ] = None,
    begin: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="VALUE",
            help="Value of --over at which the path begins. Defaults to that of the drawing.",
        ),
    ] = None,
    control: Annotated[
        str | None,
        typer.Option(
            help="Quantity prescribed in each step: load, displacement or 'arc length'. Defaults "
            "to displacement if --to names a column, to the value of --over, otherwise to the load "
            "and, if that path ends before, to the arc length, which passes limit points."
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(metavar="STEP", help="Largest step of the prescribed quantity."),
    ] = None,
    switch: Annotated[
        list[int] | None,
        typer.Option(
            metavar="N",
            help="Switch to the crossing path at branch point N; -N: in the opposite direction. "
            "Repeatable.",
        ),
    ] = None,
    max_points: Annotated[int, typer.Option(help="Maximum number of points of the path.")] = 500,
    t: LoadTime = 0.0,
    start: Starts = None,
    accuracy: RequiredAccuracy = None,
    accuracy_columns: AccurateColumns = None,
    page: Page = True,
    picture: Picture = True,
    plot: PlottedColumns = None,
    x: HorizontalColumn = None,
    out: Out = Path("results"),
) -> None:
    """Compute equilibria of a model under increasing loads; write CSV, JSON, PNG and a page.

    Exits with 0 if the path reached its target (and --accuracy), 1 if it did not (partial results
    are written) or the page or picture failed, 2 for a usage or model error, 130 after Ctrl-C, and
    143 after SIGTERM; an interrupt ends the path, writes the points so far and skips page and
    picture.
    """
    model, _ = load_model(path, model_name, settings)
    plotted = split_names(plot, model)
    _require_plot(model, plotted, x, picture)
    stem = f"{model.name}_static"
    files = ResultFiles.plan(out, stem, page, picture, out / f"{stem}.json")
    parse_value = _value_parser(model, over)
    if over is None:
        targets, size = _parse_targets(model, to, step, control == "arc length" or bool(switch))
    else:
        targets = [parse_value("--to", x) for x in to or []] or None
        size = None if step is None else parse_value("--step", step)
    options: dict[str, Any] = {
        "loads": split_names(load, model) or None,
        "to": targets,
        "control": control,
        "step": size,
        "switch": switch or 0,
        "max_points": max_points,
        "t": t,
        "start": parse_start(start, model),
        "over": over,
        "from_": None if begin is None else parse_value("--from", begin),
        **required_accuracy("static", accuracy, accuracy_columns, model),
    }

    def analyze() -> Equilibrium:
        from beamdae.analysis.statics.static_equilibrium import equilibrium

        path = equilibrium(model, **options, partial="return")
        is_by_load = control is None and over is None and path.settings.get("control") == "load"
        if not is_by_load or path.status.kind in ("ok", "interrupted"):
            return path
        traced = equilibrium(model, **options | {"control": "arc length"}, partial="return")
        return traced if traced.status.success else path

    def draw(result: Equilibrium, path: Path, title: str) -> Path:
        from beamdae.report.pictures.path_plots import save_path_figure

        suffix = "" if result.status.success else f", ended early ({result.status.kind})"
        return save_path_figure(path, result, f"{title}{suffix}", plotted, x)

    run_analysis(
        files,
        f"{model.name}, equilibria",
        analyze,
        partial(_describe, model.name),
        draw,
        lambda result: [result.to_csv(files.table), files.table.with_suffix(".json")],
    )


def _value_parser(model: Model, over: str | None) -> Callable[[str, str], float]:
    """Return the function of an option and its text to a value of the quantity `over`."""

    @cache
    def find_units() -> Mapping[str, str]:
        from beamdae.analysis.statics.path_parameters import quantity_units
        from beamdae.simulation import as_equations

        return quantity_units(model, as_equations("static", model).mechanism)

    return lambda option, text: parse_named_number(option, over or "", text.strip(), find_units)


def _require_plot(model: Model, names: list[str], x: str | None, is_drawn: bool) -> None:
    """Reject options of the picture before the analysis, as `run` does."""
    if not names and x is None:
        return
    if not is_drawn:
        raise BeamdaeError("static: --plot and --x require the picture; omit --no-picture.")
    from beamdae.results.columns import require_one_column, select_columns
    from beamdae.results.equilibrium import static_coordinate_headers, static_headers
    from beamdae.simulation import as_equations

    equations = as_equations("static", model)
    observed = static_headers(equations)
    headers = dict.fromkeys([*observed, *static_coordinate_headers(equations)])

    def select(name: str) -> list[str]:
        return select_columns(headers, name, "Equilibrium", observed)

    for name in names:
        select(name)
    if x is not None:
        require_one_column("static", x, select(x))


def _parse_targets(
    model: Model, options: list[str] | None, step: str | None, is_arc_length: bool
) -> tuple[Any, float | None]:
    """Return the targets of --to, load factors or values of one column, and the value of --step."""
    pairs = [option.rpartition("=") for option in options or ["1"]]
    columns = sorted({column.strip() for column, _, _ in pairs})
    if len(columns) > 1:
        raise BeamdaeError(
            f"--to: all targets must prescribe the same column, got {', '.join(columns)}."
        )
    (column,) = columns

    @cache
    def find_units() -> Mapping[str, str]:
        from beamdae.model_parameters import split_unit
        from beamdae.results.equilibrium import static_headers
        from beamdae.simulation import as_equations

        headers = map(split_unit, static_headers(as_equations("static", model)))
        return {"": "-"} | {x: unit for name, unit in headers for x in (name, f"{name} [{unit}]")}

    values = [parse_named_number("--to", column, text.strip(), find_units) for *_, text in pairs]
    targets = {column: values} if column else values
    if step is None:
        return targets, None
    name = "" if is_arc_length else column

    def find_unit() -> Mapping[str, str]:
        units = find_units()
        return {"": units[name]} if name in units else {}

    return targets, parse_named_number("--step", "", step, find_unit)


def _describe(name: str, result: Equilibrium) -> Report:
    from beamdae.report.analysis_pages import path_facts
    from beamdae.report.terminal import text_tables

    facts, warnings = without_status(path_facts(result)), result.warnings

    def create_data() -> dict[str, Any]:
        errors = zip(result.errors.headers, result.errors.total.tolist(), strict=True)
        data = result.metadata(**{"relative errors": dict(errors)})
        del data["warnings"]
        observed = text_tables.column_extremes(result.columns)
        return data | {"points": len(result.q), "observed": observed}

    # Errors that take long are not measured.
    errors = vars(result).get("errors")
    return Report(
        name,
        create_data,
        result.status,
        facts,
        [text_tables.equilibrium_table(result.columns, errors)],
        {"path": facts.pop("path")},
        warnings,
    )
