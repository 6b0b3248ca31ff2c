"""Commands `static` and `buckling`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.job import AccurateJob
from beamdae.cli.option_values import parse_named_number, split_names
from beamdae.cli.options import HorizontalColumn, Loads, LoadTime, PlottedColumns, Repeated, Starts
from beamdae.cli.output import withdraw_warnings
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.model_functions import Model
    from beamdae.results.equilibrium import Equilibrium


def static_command(
    job: AccurateJob,
    load: Loads = None,
    to: Annotated[
        Repeated,
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
    plot: PlottedColumns = None,
    x: HorizontalColumn = None,
) -> None:
    """Compute equilibria of a model under increasing loads; write CSV, JSON, PNG and a page.

    Exits with 0 if the path reached its target (and --accuracy), 1 if it did not (partial results
    are written) or the page or picture failed, 2 for a usage or model error, 130 after Ctrl-C, and
    143 after SIGTERM; an interrupt ends the path and writes the points so far.
    """
    model = job.model
    plotted, abscissa = job.select_columns(plot, x, _list_headers)
    files = job.plan("_static", job.output("_static.json"))
    parse_value = _value_parser(model, over)
    if over is None:
        targets, size = _parse_targets(model, to, step, control == "arc length" or bool(switch))
    else:
        targets = [parse_value("--to", x) for x in to or []] or None
        size = None if step is None else parse_value("--step", step)
    options: dict[str, Any] = {
        "loads": split_names(load) or None,
        "to": targets,
        "control": control,
        "step": size,
        "switch": switch or 0,
        "max_points": max_points,
        "t": t,
        "start": job.start(start),
        "over": over,
        "from_": None if begin is None else parse_value("--from", begin),
        **job.requirement,
    }

    def analyze() -> Equilibrium:
        from beamdae.analysis.statics.static_equilibrium import equilibrium

        path = equilibrium(model, **options, partial="return")
        is_by_load = control is None and over is None and path.settings.get("control") == "load"
        if not is_by_load or path.status.kind in ("ok", "interrupted"):
            return path
        traced = equilibrium(model, **options | {"control": "arc length"}, partial="return")
        if not traced.status.success:
            return path
        withdraw_warnings(path.status.sentence)
        return traced

    def write_tables(path: Equilibrium) -> list[Path]:
        return [path.to_csv(files.table), files.table.with_suffix(".json")]

    job.run(files, "equilibria", analyze, write_tables, names=plotted, x=abscissa)


def _value_parser(model: Model, over: str | None) -> Callable[[str, str], float]:
    """Return the function of an option and its text to a value of the quantity `over`."""

    @cache
    def find_units() -> Mapping[str, str]:
        from beamdae.analysis.statics.path_parameters import quantity_units
        from beamdae.simulation import as_equations

        return quantity_units(model, as_equations("static", model).mechanism)

    return lambda option, text: parse_named_number(option, over or "", text.strip(), find_units)


def _list_headers(equations: Any) -> tuple[list[str], list[str]]:
    """Return the headers of the columns of a path, and the observed ones."""
    from beamdae.results.equilibrium import static_coordinate_headers, static_headers

    observed = static_headers(equations)
    return [*observed, *static_coordinate_headers(equations)], observed


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


def buckling_command(
    job: AccurateJob,
    number: Annotated[int, typer.Option("-n", "--number", help="Number of load factors.")] = 5,
    load: Loads = None,
    t: LoadTime = 0.0,
    start: Starts = None,
) -> None:
    """Compute linear buckling loads of a model; write a table (CSV), a picture (PNG) and a page.

    Exits with 0 on success, 1 if --accuracy was not reached or the page or picture failed, and 2
    for a usage or model error.
    """
    files = job.plan("_buckling")
    loads, initial_state = split_names(load) or None, job.start(start)

    def analyze() -> Any:
        from beamdae.analysis.statics.linear_buckling import buckling

        return buckling(job.model, number, loads, t, initial_state, **job.requirement)

    job.run(files, "linear buckling", analyze)
