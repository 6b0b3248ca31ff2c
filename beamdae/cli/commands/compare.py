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
    parse_assignments,
)
from beamdae.cli.output import create_console, print_error, record_results
from beamdae.cli.study_outputs import (
    MAX_SCREEN_ROWS,
    StudyOutputs,
    apply_limits,
    print_failures,
    results_folder_name,
    run_and_write,
)
from beamdae.errors import BeamdaeError

# Whatever imports NumPy or CasADi is imported inside the command: help has to answer at once.
if TYPE_CHECKING:
    from beamdae.cli.study_outputs import FileWriters
    from beamdae.studies import Study
    from beamdae.studies.execution.study_run import StudyResults


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
    study = _select_study(path, model_name, parse_assignments(settings))
    study = apply_limits("compare", study, time_limit, t_end, output_step)
    from beamdae.studies.execution.executors import create_executor

    work = StudyOutputs(study, out / study.name, _file_writers, parquet)
    run_and_write(
        work, lambda: create_executor("compare", "--jobs", jobs, scheduler), _print_results
    )


def _file_writers(results: StudyResults) -> tuple[FileWriters, FileWriters]:
    from beamdae.report.page.page_file import write_page
    from beamdae.studies.study_page import create_study_page
    from beamdae.studies.study_pictures import list_plots

    path = results.folder / "report.html"
    return {path.name: lambda: [write_page(path, create_study_page(results))]}, list_plots(results)


def _select_study(path: Path, name: str | None, settings: dict[str, str]) -> Study:
    """The study of a file, or one of its models with the default integrators."""
    from beamdae.cli.model_files.model_file import load_contents, load_model, select_name
    from beamdae.errors import suggest
    from beamdae.studies import Case, Study, Sweep, default_integrators

    models, held = load_contents(path)
    studies = {key: one for key, one in held.items() if not isinstance(one, Sweep)}
    if name in held.keys() - studies or (name is None and held and not studies):
        sweep = name or next(iter(held))
        raise BeamdaeError(f"{path}: {sweep} is a sweep, which beamdae sweep runs.")
    if name in studies or (studies and name is None):
        if settings:
            raise BeamdaeError(f"--set {next(iter(settings))}: a study sets its own parameters.")
        return studies[select_name(name, studies, f"{path}: it holds several studies")]
    if studies and name is not None and name not in models:
        raise BeamdaeError(f"{path}: no study {name!r}{suggest(name, studies)}.")
    model = load_model(path, name)
    values = {key: model.complete({key: value})[key] for key, value in settings.items()}
    cases = tuple(Case(model, values, integrator) for integrator in default_integrators())
    return Study(results_folder_name(f"{model.name}_compare", values), cases)


def _print_results(results: StudyResults) -> None:
    """Tables on the screen, and a sentence for each failure."""
    from beamdae.report.terminal import text_tables
    from beamdae.report.text import make_printable

    record_results(lambda: _json_results(results))
    screen = create_console()
    screen.print(results.study.name, style="bold")
    alone = results.table[~results.table["group"].isin(list(results.references))]
    if len(alone):
        ended = int((alone["status"] == "ok").sum())
        screen.print(f"{len(alone)} cases, {ended} of them reached their end", style="dim")
    summaries = dict(iter(results.summary.groupby("group", sort=False)))
    for group, reference in islice(results.references.items(), MAX_SCREEN_ROWS):
        screen.print(make_printable(f"{group}: {reference.sentence}"), style="dim", soft_wrap=True)
        rows = results.table[results.table["group"] == group]
        if len(results.table) <= MAX_SCREEN_ROWS:
            screen.print(text_tables.comparison_table(rows))
        if group in summaries:
            screen.print(text_tables.summary_table(summaries[group]))
    if len(results.references) > MAX_SCREEN_ROWS:
        more = len(results.references) - MAX_SCREEN_ROWS
        screen.print(f"{more} more groups, see summary.csv and report.html", style="dim")
    lacking = [
        f"{group}: {x.sentence}" for group, x in results.references.items() if x.table is None
    ]
    for sentence in () if results.interrupted else lacking[:MAX_SCREEN_ROWS]:
        print_error(f"failed: {sentence}")
    print_failures(results)


def _json_results(results: StudyResults) -> dict[str, Any]:
    """What --json tells of a study."""
    return {
        "study": results.study.name,
        "folder": results.folder,
        "interrupted": results.interrupted,
        "references": {group: one.sentence for group, one in results.references.items()},
        "cases": results.table.to_dict("records"),
        "summary": results.summary.to_dict("records"),
    }
