"""`beamdae static`: where a model rests under its loads, and the path of equilibria to there."""

from __future__ import annotations

import sys
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.options import (
    ModelFile,
    ModelName,
    Out,
    Settings,
    Starts,
    load_configured_model,
    parse_assignments,
    parse_start,
    require_writable,
)
from beamdae.cli.output import (
    WrittenFiles,
    create_console,
    print_error,
    print_warnings,
    print_written_files,
    record_results,
)
from beamdae.errors import BeamdaeError, BeamdaeWarning

if TYPE_CHECKING:
    from beamdae.results.equilibrium import Equilibrium


def static_command(
    path: ModelFile,
    settings: Settings = None,
    model_name: ModelName = None,
    load: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Which loads to scale, or 'gravity'; repeat. Default all."
        ),
    ] = None,
    to: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TARGET", help="Load factor, or COLUMN=VALUE of an observed one; repeat."
        ),
    ] = None,
    control: Annotated[str | None, typer.Option(help="load, displacement or 'arc length'.")] = None,
    step: Annotated[
        float | None, typer.Option(help="Largest step, of what controls the path.")
    ] = None,
    switch: Annotated[
        list[int] | None,
        typer.Option(
            metavar="N", help="Go over to the other path at this branch point; -N: back; repeat."
        ),
    ] = None,
    most_points: Annotated[int, typer.Option(help="Points of the path at most.")] = 500,
    t: Annotated[float, typer.Option(help="Time in seconds at which laws are read.")] = 0.0,
    start: Starts = None,
    out: Out = Path("results"),
) -> None:
    """Find where a model rests as its loads are brought up; write the path as CSV, JSON and PNG.

    Ends with 0 where the path reached its target, with 1 where it did not (what it reached is
    written), and with 2 after a mistake.
    """
    model = load_configured_model(path, model_name, settings)
    name = f"{model.name}_static"
    table, picture = out / f"{name}.csv", out / f"{name}.png"
    require_writable(out, (table.name, table.with_suffix(".json").name, picture.name))
    from beamdae.analysis.statics.static_equilibrium import equilibrium
    from beamdae.report.pictures.path_plots import save_path_figure

    with warnings.catch_warnings():
        # They are told with the result.
        warnings.simplefilter("ignore", BeamdaeWarning)
        found = equilibrium(
            model,
            load,
            _parse_targets(to),
            control,
            step,
            switch or 0,
            most_points,
            t,
            parse_start(start),
        )
    written = WrittenFiles([found.to_csv(table), table.with_suffix(".json")])
    _print_results(found, model.name)
    early = "" if found.status.success else f", ended early ({found.status.kind})"
    title = f"{model.name}, equilibria{early}"
    written.draw(picture.name, lambda: [save_path_figure(picture, found, title)])
    print_written_files(create_console(), written.paths)
    if not found.status.success:
        print_error(f"failed: {found.status.sentence}")
    if written.failed or not found.status.success:
        raise typer.Exit(1)


def _parse_targets(given: list[str] | None) -> Any:
    """What --to says: load factors, or values of one column."""
    if not given:
        return 1.0
    try:
        if not any("=" in one for one in given):
            return [float(one) for one in given]
        pairs = [parse_assignments([one], "--to") for one in given]
        columns = {column for pair in pairs for column in pair}
        if len(columns) > 1:
            raise BeamdaeError(
                f"--to: values of one column can be gone to, got {', '.join(sorted(columns))}."
            )
        return {columns.pop(): [float(value) for pair in pairs for value in pair.values()]}
    except ValueError as problem:
        if isinstance(problem, BeamdaeError):
            raise
        raise BeamdaeError(f"--to {' '.join(given)}: values must be numbers.") from None


def _print_results(found: Equilibrium, name: str) -> None:
    """Tables and sentences of a path on the screen."""
    from beamdae.report.terminal import text_tables

    record_results(lambda: _json_results(found))
    screen = create_console()
    screen.print(text_tables.fact_list(name, path_facts(found)))
    if found.columns:
        screen.print(text_tables.range_table(found.columns, None))
    if found.validity:
        screen.print(text_tables.validity_table(found.validity))
    print_warnings(screen, found.warnings)
    sys.stdout.flush()


def _json_results(found: Equilibrium) -> dict[str, Any]:
    """What --json tells of a path: what is beside its table, and its observed columns."""
    from beamdae.report.terminal import text_tables

    told = found.metadata(validity=[asdict(beam) for beam in found.validity])
    del told["warnings"]
    return told | {"points": len(found.q), "observed": text_tables.column_extremes(found.columns)}


def path_facts(found: Equilibrium) -> dict[str, str]:
    """What a path came to, by topic."""
    loads = "; then ".join(", ".join(stage) for stage in found.loads)
    unstable = int(found.unstable[-1])
    told = f"unstable in {unstable} direction{'s' * (unstable > 1)}"
    stability = {0: "stable", -1: "not known"}.get(unstable, told)
    if found.free and unstable == 0:
        stability = f"neither stable nor unstable, {found.free} is free to move"
    critical = "; ".join(
        f"{one.kind} at {one.factor:.7g}{f', {one.moves} moves most' if one.moves else ''}"
        for one in found.critical
    )
    return {
        "status": found.status.sentence,
        "loads": loads or "none is scaled",
        "load factor": f"{found.factor:.7g}",
        "equilibrium": stability,
        "critical points": critical or "none",
        "path": f"{len(found.q)} point{'s' * (len(found.q) > 1)}, {found.settings['iterations']} "
        f"iterations of Newton's method, by "
        f"{found.settings['control']}",
    }
