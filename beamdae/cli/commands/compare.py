"""`beamdae compare`: run a study, or one model with several integrators."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae.cli.options import (
    EndTime,
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
from beamdae.cli.output import complain, console, record
from beamdae.cli.study_outputs import MOST_ROWS, Work, carry_out, folder_name, limited, say_failures
from beamdae.errors import BeamdaeError

# Whatever imports NumPy or CasADi is imported inside the command: help has to answer at once.
if TYPE_CHECKING:
    from beamdae.cli.study_outputs import Draws
    from beamdae.studies import Study
    from beamdae.studies.execution.engine import Results


def compare_command(
    path: StudyFile,
    settings: Settings = None,
    model_name: ModelName = None,
    time_limit: TimeLimit = None,
    t_end: EndTime = None,
    output_step: OutputStep = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    parquet: Parquet = False,
    out: Out = Path("results"),
) -> None:
    """Run a study, or one model with several integrators, against a reference.

    Finished cases are kept in the results folder: a second start goes on where the first one
    stopped. Ends with 0 where cases succeeded and have a reference, with 1 where not, with 2 after
    a mistake, with 130 after Ctrl-C, and with 143 after SIGTERM.
    """
    study = _study(path, model_name, assignments(settings))
    study = limited("compare", study, time_limit, t_end, output_step)
    from beamdae.studies.execution.pool import pool_of

    work = Work(study, out / study.name, _draws, parquet)
    carry_out(work, lambda: pool_of("compare", "--jobs", jobs, scheduler), _say)


def _draws(results: Results) -> tuple[Draws, Draws]:
    from beamdae.report.page.page_file import write_page
    from beamdae.studies.study_page import create_study_page
    from beamdae.studies.study_pictures import list_plots

    path = results.folder / "report.html"
    return {path.name: lambda: [write_page(path, create_study_page(results))]}, list_plots(results)


def _study(path: Path, name: str | None, settings: dict[str, str]) -> Study:
    """The study of a file, or one of its models with the default integrators."""
    from beamdae.cli.model_files.model_file import contents, load_model, only_or
    from beamdae.errors import suggest
    from beamdae.studies import Case, Study, Sweep, default_integrators

    models, held = contents(path)
    studies = {key: one for key, one in held.items() if not isinstance(one, Sweep)}
    if name in held.keys() - studies or (name is None and held and not studies):
        sweep = name or next(iter(held))
        raise BeamdaeError(f"{path}: {sweep} is a sweep, which beamdae sweep runs.")
    if name in studies or (studies and name is None):
        if settings:
            raise BeamdaeError(f"--set {next(iter(settings))}: a study sets its own parameters.")
        return studies[only_or(name, studies, f"{path}: it holds several studies")]
    if studies and name is not None and name not in models:
        raise BeamdaeError(f"{path}: no study {name!r}{suggest(name, studies)}.")
    model = load_model(path, name)
    values = {key: model.complete({key: value})[key] for key, value in settings.items()}
    cases = tuple(Case(model, values, integrator) for integrator in default_integrators())
    return Study(folder_name(f"{model.name}_compare", values), cases)


def _say(results: Results) -> None:
    """Tables on the screen, and a sentence for each failure."""
    from beamdae.report.terminal import text_tables as terminal
    from beamdae.report.text import make_printable

    record(lambda: _found(results))
    screen = console()
    screen.print(results.study.name, style="bold")
    alone = results.table[~results.table["group"].isin(list(results.references))]
    if len(alone):
        ended = int((alone["status"] == "ok").sum())
        screen.print(f"{len(alone)} cases, {ended} of them reached their end", style="dim")
    summaries = dict(iter(results.summary.groupby("group", sort=False)))
    for group, reference in islice(results.references.items(), MOST_ROWS):
        screen.print(make_printable(f"{group}: {reference.sentence}"), style="dim", soft_wrap=True)
        rows = results.table[results.table["group"] == group]
        if len(results.table) <= MOST_ROWS:
            screen.print(terminal.comparison_table(rows))
        if group in summaries:
            screen.print(terminal.summary_table(summaries[group]))
    if len(results.references) > MOST_ROWS:
        more = len(results.references) - MOST_ROWS
        screen.print(f"{more} more groups, see summary.csv and report.html", style="dim")
    lacking = [
        f"{group}: {x.sentence}" for group, x in results.references.items() if x.table is None
    ]
    for sentence in () if results.interrupted else lacking[:MOST_ROWS]:
        complain(f"failed: {sentence}")
    say_failures(results)


def _found(results: Results) -> dict[str, Any]:
    """What --json tells of a study."""
    return {
        "study": results.study.name,
        "folder": results.folder,
        "interrupted": results.interrupted,
        "references": {group: one.sentence for group, one in results.references.items()},
        "cases": results.table.to_dict("records"),
        "summary": results.summary.to_dict("records"),
    }
