"""`beamdae sweep`: run a model over values of its parameters, or the sweep of a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli import completion
from beamdae.cli.options import (
    EndTime,
    IntegratorName,
    Jobs,
    ModelName,
    Out,
    OutputStep,
    Parquet,
    Scheduler,
    Settings,
    StudyFile,
    TimeLimit,
    create_integrator,
    parse_assignments,
)
from beamdae.cli.output import create_console, record_results
from beamdae.cli.study_outputs import (
    MAX_SCREEN_ROWS,
    StudyOutputs,
    apply_limits,
    print_failures,
    results_folder_name,
    run_and_write,
)
from beamdae.errors import BeamdaeError, require_count, suggest

# Whatever imports NumPy or CasADi is imported inside the command: help has to answer at once.
if TYPE_CHECKING:
    from beamdae.cli.study_outputs import FileWriters
    from beamdae.model_functions import Model
    from beamdae.studies import Sweep
    from beamdae.studies.execution.study_run import StudyResults
    from beamdae.studies.sweeps.sweep_results import SweepResults

_VALUE_FORMS = "values with commas between, or START:STOP:COUNT or START:STOP:COUNT:log"
_MAX_VALUES = 1_000_000
# Of numbers as they are typed: what rounding makes of 0.3 is 0.3.
_SIGNIFICANT_DIGITS = 12


def sweep_command(
    path: StudyFile,
    over: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUES",
            help=f"Parameter to vary: {_VALUE_FORMS}; repeat.",
            autocompletion=completion.complete_parameters,
        ),
    ] = None,
    of: Annotated[
        list[str] | None,
        typer.Option(metavar="COLUMN", help="Observed column that is told of, as tip.y; repeat."),
    ] = None,
    settings: Settings = None,
    model_name: ModelName = None,
    integrator: IntegratorName = "auto",
    rtol: Annotated[float | None, typer.Option(help="Relative tolerance.")] = None,
    step: Annotated[float | None, typer.Option(help="Step in seconds (generalized-alpha).")] = None,
    time_limit: TimeLimit = None,
    t_end: EndTime = None,
    output_step: OutputStep = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    parquet: Parquet = False,
    out: Out = Path("results"),
) -> None:
    """Run a model over values of its parameters, all combinations of them: a table and plots.

    Of each run the table tells the end, the largest and smallest value and the root mean square of
    what is observed; a run that fails is a row with its reason. A file with a sweep (@bd.sweep)
    needs no --over. Finished runs are kept in the results folder: a second start goes on where the
    first one stopped. Ends as compare does.
    """
    if over:
        options = {"rtol": rtol, "step": step}
        sweep = _sweep_from_options(
            path, model_name, over, settings, of, create_integrator("sweep", integrator, options)
        )
    else:
        _require_no_sweep_options(settings, integrator, rtol, step)
        sweep = _sweep_of_file(path, model_name)
        sweep = replace(sweep, columns=tuple(of)) if of else sweep
    from beamdae.studies.execution.executors import create_executor

    study = apply_limits("sweep", sweep, time_limit, t_end, output_step)
    work = StudyOutputs(study, out / study.name, _file_writers, parquet)
    run_and_write(work, lambda: create_executor("sweep", "--jobs", jobs, scheduler), _print_results)


def _sweep_from_options(
    path: Path,
    name: str | None,
    over: list[str],
    settings: list[str] | None,
    of: list[str] | None,
    integrator: Any,
) -> Sweep:
    """The sweep that the options state."""
    from beamdae.cli.model_files.model_file import load_model
    from beamdae.studies.sweeps.sweep import create_sweep

    model = load_model(path, name)
    fixed, asked = parse_assignments(settings), parse_assignments(over, "--over")
    if len(asked) < len(over):
        raise BeamdaeError(f"--over: each parameter once, got {', '.join(over)}.")
    both = next((key for key in asked if key in fixed), None)
    if both is not None:
        raise BeamdaeError(f"--over {both}: it is set by --set as well, give one.")
    values = {key: parse_values(model, key, text) for key, text in asked.items()}
    values |= {key: [value] for key, value in fixed.items()}
    folder = results_folder_name("_".join([model.name, "sweep", *asked]), fixed)
    return create_sweep(model, values, folder, of or (), integrator)


def parse_values(model: Model, name: str, text: str) -> list[Any]:
    """The values that --over NAME=TEXT states.

    Raises
    ------
    BeamdaeError
        If the model has no such parameter, or they have another form.
    """
    kind = type(model.parameters.get(name))
    if kind in (int, float) and ":" in text:
        return _parse_range(model, name, text)
    return [model.complete({name: part.strip()})[name] for part in _split_at_commas(text)]


def _split_at_commas(text: str) -> list[str]:
    """What stands between commas, but those within brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _parse_range(model: Model, name: str, text: str) -> list[Any]:
    """Values of START:STOP:COUNT, of equal distances or, with :log, of equal ratios."""
    import numpy as np

    start, stop, number, *rest = [*text.split(":"), ""]
    geometric = rest == ["log", ""]
    try:
        ends, asked = (float(start), float(stop)), float(number)
    except ValueError:
        ends, asked = (np.nan, np.nan), np.nan
    if not np.isfinite([*ends, asked]).all() or not (geometric or rest == [""]):
        raise BeamdaeError(f"--over {name}={text}: values must have the form {_VALUE_FORMS}.")
    if geometric and min(ends) <= 0.0:
        raise BeamdaeError(f"--over {name}={text}: both ends must be positive for :log.")
    points = require_count(f"--over {name}={text}", "COUNT", asked, most=_MAX_VALUES)
    spaced = np.geomspace(*ends, points) if geometric else np.linspace(*ends, points)
    found = [float(f"{x:.{_SIGNIFICANT_DIGITS}g}") for x in spaced]
    return [model.complete({name: x})[name] for x in found]


def _require_no_sweep_options(
    settings: list[str] | None, integrator: str, rtol: float | None, step: float | None
) -> None:
    """What a sweep of a file says itself."""
    method = None if integrator == "auto" else integrator
    given = {"--set": settings, "--integrator": method, "--rtol": rtol, "--step": step}
    for option, value in given.items():
        if value is not None:
            raise BeamdaeError(
                f"sweep: {option} goes with --over, a sweep in a file says that itself."
            )


def _sweep_of_file(path: Path, name: str | None) -> Sweep:
    """The sweep of a file, by `name` if it holds several."""
    from beamdae.cli.model_files.model_file import load_contents, select_name
    from beamdae.studies import Sweep

    models, studies = load_contents(path)
    sweeps = {key: study for key, study in studies.items() if isinstance(study, Sweep)}
    if not sweeps:
        known = {name: models[name]} if name in models else models
        parameters = ", ".join(x for model in known.values() for x in model.parameters)
        raise BeamdaeError(
            f"{path}: it holds no sweep, say what to vary with --over NAME=VALUES, of the "
            f"parameters {parameters or 'of a model, which it does not hold either'}."
        )
    chosen = select_name(name, sweeps, f"{path}: it holds several sweeps")
    if chosen not in sweeps:
        raise BeamdaeError(f"{path}: no sweep {chosen!r}{suggest(chosen, sweeps)}.")
    return sweeps[chosen]


def _file_writers(results: StudyResults) -> tuple[FileWriters, FileWriters]:
    from beamdae.studies.sweeps.response_plots import list_response_plots
    from beamdae.studies.sweeps.sweep_results import TABLE_FILE, create_sweep_results

    swept, folder = create_sweep_results(results), results.folder
    first: FileWriters = {
        TABLE_FILE: lambda: [swept.to_csv(folder / TABLE_FILE)],
        "report.html": lambda: [swept.page(folder / "report.html")],
    }
    plots = list_response_plots(swept.sweep, swept.table, swept.panels(), folder)
    return first, plots


def _print_results(results: StudyResults) -> None:
    """The table on the screen, and a sentence for each failure."""
    from beamdae.report.terminal import text_tables
    from beamdae.studies.sweeps.sweep_results import create_sweep_results

    swept, screen = create_sweep_results(results), create_console()
    record_results(lambda: _json_results(swept))
    screen.print(results.study.name, style="bold")
    ended = int((swept.table["status"] == "ok").sum())
    screen.print(f"{len(swept.table)} cases, {ended} of them reached their end", style="dim")
    if len(swept.table) <= MAX_SCREEN_ROWS:
        screen.print(text_tables.sweep_table(swept.table, swept.parameters, swept.response_columns))
    doubtful = int((swept.table["warnings"] != "").sum())
    if doubtful:
        screen.print(f"{doubtful} of them warn of what is not to be trusted, see sweep.csv")
    print_failures(results)


def _json_results(swept: SweepResults) -> dict[str, Any]:
    """What --json tells of a sweep."""
    return {
        "sweep": swept.sweep.name,
        "folder": swept.results.folder,
        "interrupted": swept.interrupted,
        "cases": swept.table.to_dict("records"),
    }
