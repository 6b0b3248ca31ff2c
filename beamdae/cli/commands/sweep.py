"""`beamdae sweep`: run a model over values of its parameters, or the sweep of a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli import completion
from beamdae.cli.model_options import integrator_of
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
    assignments,
)
from beamdae.cli.output import console, record
from beamdae.cli.study_outputs import MOST_ROWS, Work, carry_out, folder_name, limited, say_failures
from beamdae.errors import BeamdaeError, require_count, suggest

# Whatever imports NumPy or CasADi is imported inside the command: help has to answer at once.
if TYPE_CHECKING:
    from beamdae.cli.study_outputs import Draws
    from beamdae.model_functions import Model
    from beamdae.studies import Sweep
    from beamdae.studies.execution.engine import Results
    from beamdae.studies.sweeps.results import SweepResults

_FORMS = "values with commas between, or START:STOP:COUNT or START:STOP:COUNT:log"
_MOST_VALUES = 1_000_000
# Of numbers as they are typed: what rounding makes of 0.3 is 0.3.
_DIGITS = 12


def sweep_command(
    path: StudyFile,
    over: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUES",
            help=f"Parameter to vary: {_FORMS}; repeat.",
            autocompletion=completion.parameters,
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
        sweep = _stated(
            path, model_name, over, settings, of, integrator_of("sweep", integrator, options)
        )
    else:
        _refuse(settings, integrator, rtol, step)
        sweep = _of_file(path, model_name)
        sweep = replace(sweep, columns=tuple(of)) if of else sweep
    from beamdae.studies.execution.pool import pool_of

    study = limited("sweep", sweep, time_limit, t_end, output_step)
    work = Work(study, out / study.name, _draws, parquet)
    carry_out(work, lambda: pool_of("sweep", "--jobs", jobs, scheduler), _say)


def _stated(
    path: Path,
    name: str | None,
    over: list[str],
    settings: list[str] | None,
    of: list[str] | None,
    integrator: Any,
) -> Sweep:
    """The sweep that the options state."""
    from beamdae.cli.model_files.model_file import load_model
    from beamdae.studies.sweeps.sweep import sweep_of

    model = load_model(path, name)
    fixed, asked = assignments(settings), assignments(over, "--over")
    if len(asked) < len(over):
        raise BeamdaeError(f"--over: each parameter once, got {', '.join(over)}.")
    both = next((key for key in asked if key in fixed), None)
    if both is not None:
        raise BeamdaeError(f"--over {both}: it is set by --set as well, give one.")
    values = {key: listed(model, key, text) for key, text in asked.items()}
    values |= {key: [value] for key, value in fixed.items()}
    folder = folder_name("_".join([model.name, "sweep", *asked]), fixed)
    return sweep_of(model, values, folder, of or (), integrator)


def listed(model: Model, name: str, text: str) -> list[Any]:
    """The values that --over NAME=TEXT states.

    Raises
    ------
    BeamdaeError
        If the model has no such parameter, or they have another form.
    """
    kind = type(model.parameters.get(name))
    if kind in (int, float) and ":" in text:
        return _between(model, name, text)
    return [model.complete({name: part.strip()})[name] for part in _parts(text)]


def _parts(text: str) -> list[str]:
    """What stands between commas, but those within brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _between(model: Model, name: str, text: str) -> list[Any]:
    """Values of START:STOP:COUNT, of equal distances or, with :log, of equal ratios."""
    import numpy as np

    start, stop, number, *rest = [*text.split(":"), ""]
    geometric = rest == ["log", ""]
    try:
        ends, asked = (float(start), float(stop)), float(number)
    except ValueError:
        ends, asked = (np.nan, np.nan), np.nan
    if not np.isfinite([*ends, asked]).all() or not (geometric or rest == [""]):
        raise BeamdaeError(f"--over {name}={text}: values must have the form {_FORMS}.")
    if geometric and min(ends) <= 0.0:
        raise BeamdaeError(f"--over {name}={text}: both ends must be positive for :log.")
    points = require_count(f"--over {name}={text}", "COUNT", asked, most=_MOST_VALUES)
    spaced = np.geomspace(*ends, points) if geometric else np.linspace(*ends, points)
    found = [float(f"{x:.{_DIGITS}g}") for x in spaced]
    return [model.complete({name: x})[name] for x in found]


def _refuse(
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


def _of_file(path: Path, name: str | None) -> Sweep:
    """The sweep of a file, by `name` if it holds several."""
    from beamdae.cli.model_files.model_file import contents, only_or
    from beamdae.studies import Sweep

    models, studies = contents(path)
    sweeps = {key: study for key, study in studies.items() if isinstance(study, Sweep)}
    if not sweeps:
        known = {name: models[name]} if name in models else models
        parameters = ", ".join(x for model in known.values() for x in model.parameters)
        raise BeamdaeError(
            f"{path}: it holds no sweep, say what to vary with --over NAME=VALUES, of the "
            f"parameters {parameters or 'of a model, which it does not hold either'}."
        )
    chosen = only_or(name, sweeps, f"{path}: it holds several sweeps")
    if chosen not in sweeps:
        raise BeamdaeError(f"{path}: no sweep {chosen!r}{suggest(chosen, sweeps)}.")
    return sweeps[chosen]


def _draws(results: Results) -> tuple[Draws, Draws]:
    from beamdae.studies.sweeps.pictures import plots
    from beamdae.studies.sweeps.results import TABLE, results_of

    swept, folder = results_of(results), results.folder
    first: Draws = {
        TABLE: lambda: [swept.to_csv(folder / TABLE)],
        "report.html": lambda: [swept.page(folder / "report.html")],
    }
    return first, plots(swept, folder)


def _say(results: Results) -> None:
    """The table on the screen, and a sentence for each failure."""
    from beamdae.report.terminal import text_tables as terminal
    from beamdae.studies.sweeps.results import results_of

    swept, screen = results_of(results), console()
    record(lambda: _found(swept))
    screen.print(results.study.name, style="bold")
    ended = int((swept.table["status"] == "ok").sum())
    screen.print(f"{len(swept.table)} cases, {ended} of them reached their end", style="dim")
    if len(swept.table) <= MOST_ROWS:
        screen.print(terminal.sweep_table(swept.table, swept.parameters, swept.told))
    doubtful = int((swept.table["warnings"] != "").sum())
    if doubtful:
        screen.print(f"{doubtful} of them warn of what is not to be trusted, see sweep.csv")
    say_failures(results)


def _found(swept: SweepResults) -> dict[str, Any]:
    """What --json tells of a sweep."""
    return {
        "sweep": swept.sweep.name,
        "folder": swept.results.folder,
        "interrupted": swept.interrupted,
        "cases": swept.table.to_dict("records"),
    }
