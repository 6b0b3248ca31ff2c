"""`beamdae run`: simulate one model."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli import run_outputs
from beamdae.cli.job import AccurateJob
from beamdae.cli.options import (
    DataColumns,
    EndTime,
    FixedStep,
    FurtherSettings,
    HorizontalColumn,
    IntegratorName,
    OutputStep,
    PlottedColumns,
    RelativeTolerance,
    Starts,
    TimeLimit,
    accuracy_option,
    create_integrator,
    expert_option,
    output_option,
    parse_assignments,
    split_names,
)
from beamdae.cli.output import record_results
from beamdae.cli.results import Report, run_analysis
from beamdae.errors import BeamdaeError

# NumPy and CasADi are imported inside functions, so that --help responds quickly.
if TYPE_CHECKING:
    from beamdae.results.solution import Solution


def run_command(
    job: AccurateJob,
    integrator: IntegratorName = "auto",
    rtol: RelativeTolerance = None,
    step: FixedStep = None,
    option: FurtherSettings = None,
    time_limit: TimeLimit = None,
    t_end: EndTime = None,
    start: Starts = None,
    output_step: OutputStep = None,
    estimate: Annotated[
        bool, accuracy_option(help="Estimate the error of every column by a second run.")
    ] = True,
    verify: Annotated[
        bool,
        accuracy_option(
            "--verify", help="Compare with another integrator at a tighter tolerance instead."
        ),
    ] = False,
    plot: PlottedColumns = None,
    x: HorizontalColumn = None,
    data: Annotated[
        Path | None,
        output_option(
            metavar="DATA.csv",
            help="Measured values, shown as markers in the picture and on the page: a column of "
            "times, such as 't [ms]', and columns of the model, such as 'tip.y [mm]'.",
        ),
    ] = None,
    data_columns: DataColumns = None,
    checkpoint: Annotated[
        Path | None,
        output_option(
            metavar="FILE", help="Write the whole run to this file, for --continue or bd.load."
        ),
    ] = None,
    sensitivities: Annotated[
        str | None,
        expert_option(
            metavar="NAMES",
            help="Add the derivatives of the columns with respect to these parameters, separated "
            "by commas, to the table and the page (radau, generalized-alpha; auto: radau).",
        ),
    ] = None,
    resume_from: Annotated[
        Path | None,
        typer.Option(
            "--continue",
            metavar="FILE",
            help="Resume the run in this file; the results then cover the whole run.",
        ),
    ] = None,
    accept_changes: Annotated[
        bool,
        expert_option(
            "--accept-changes", help="Resume even if the model or its parameters have changed."
        ),
    ] = False,
) -> None:
    """Simulate one model and write its results as CSV, JSON, PNG and a page for the browser.

    If a run ends early, it is written to NAME.run, from which --continue resumes it.

    Exits with 0 if the run was completed (and its --accuracy reached), 1 if it was not (partial
    results are written) or a file could not be written, 2 for a usage or model error, 130 after
    Ctrl-C, and 143 after SIGTERM, which skips the PNG and the page.
    """
    named = {"rtol": rtol, "step": step, "time_limit": time_limit}
    method = create_integrator("run", integrator, named, job.file, option)
    names = None if sensitivities is None else split_names(sensitivities)
    accuracy = job.accuracy["accuracy"]
    is_verified = verify or None
    _reject_combinations(
        "--accuracy", accuracy, {"--verify": is_verified, "--checkpoint": checkpoint}
    )
    for name, value in (("--accuracy", accuracy), ("--sensitivities", names), ("--start", start)):
        _reject_combinations(name, value, {"--continue": resume_from})
    _reject_combinations("--sensitivities", names, {"--accuracy": accuracy})
    if data_columns and data is None:
        raise BeamdaeError("run: --data-column requires --data; use both options or neither.")
    checkpoints = ("--checkpoint", () if checkpoint is None else (checkpoint,))
    files = job.plan("", job.path(".json"), others=checkpoints)
    columns = parse_assignments(data_columns, "--data-column")
    charts = run_outputs.select_charts(job, split_names(plot), x, data, columns)
    earlier = None
    if resume_from is not None:
        earlier = run_outputs.load_earlier_run(resume_from, job.model)
    initial_state = job.start(start) if resume_from is None else resume_from
    saved = checkpoint or files.table.with_suffix(".run")
    warnings: list[str] = []

    def analyze() -> Solution:
        solution = run_outputs.integrate_run(
            job,
            method,
            t_end=t_end,
            output_step=output_step,
            start=initial_state,
            accept_changes=accept_changes,
            sensitivities=names,
        )
        return solution if earlier is None else earlier.followed_by(solution)

    def can_resume(solution: Solution) -> bool:
        return accuracy is None and run_outputs.can_resume(solution)

    def write_tables(solution: Solution) -> list[Path]:
        from beamdae.simulation import unchecked

        with unchecked():
            written = [solution.to_csv(files.table), files.table.with_suffix(".json")]
        if checkpoint is not None or can_resume(solution):
            files.write(saved.name, lambda: [solution.save(saved)])
        return written

    def describe(solution: Solution) -> Report:
        from beamdae.simulation import is_unchecked

        sentences: tuple[str, ...] = ()
        has_estimate = estimate or verify or accuracy is not None
        if has_estimate and solution.columns and not is_unchecked():
            sentences = run_outputs.measure_errors(solution, verify)
        warnings[:] = [*sentences, *solution.model_warnings]
        comparisons = run_outputs.compare_with_data(solution, charts[0], data)
        resume = ""
        if can_resume(solution) and saved in files.paths:
            record_results(lambda: {"continue": saved})
            resume = shlex.join(["--continue", str(saved), *job.selection])
        return run_outputs.describe_run(job, files.table, solution, sentences, comparisons, resume)

    def write_page(solution: Solution, path: Path, title: str) -> Path:
        from beamdae.report.page import page_file
        from beamdae.report.run_pages import build_run_page

        of_page, name = charts[0], job.model.name
        content = build_run_page(solution, name, warnings=warnings, charts=of_page)
        return page_file.write_page(path, content)

    def draw(solution: Solution, title: str) -> Any:
        from beamdae.report.pictures.time_plots import create_figure, create_run_figure
        from beamdae.results.columns import merge_columns

        columns = solution.all_columns()
        if charts[1] is None:
            return create_run_figure(columns, title)
        merged = merge_columns(columns, solution.coordinate_columns())
        return create_figure({"run": merged}, charts[1], list(columns), title)

    def title(solution: Solution) -> str:
        return f"{job.model.name}, {solution.label}"

    run_analysis(files, title, analyze, write_tables, describe, write_page, draw)


def _reject_combinations(option: str, value: Any, others: Mapping[str, Any]) -> None:
    """Reject other options that cannot be combined with one, if it has a value."""
    for other in (x for x, given in others.items() if value and given is not None):
        raise BeamdaeError(f"run: {option} and {other} are mutually exclusive; omit one.")
