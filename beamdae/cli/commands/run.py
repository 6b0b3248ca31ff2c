"""`beamdae run`: simulate one model."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli import process
from beamdae.cli.job import AccurateJob
from beamdae.cli.option_values import parse_assignments, split_names
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
)
from beamdae.cli.output import record_results
from beamdae.cli.progress import show_run_progress
from beamdae.cli.results import Report, run_analysis
from beamdae.errors import BeamdaeError, format_count, warn_user
from beamdae.interrupts import Interrupted

if TYPE_CHECKING:
    from beamdae.cli.job import Job
    from beamdae.model_functions import Model
    from beamdae.report.pictures.time_plots import PlotSelection
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
    accuracy = job.accuracy
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
    files = job.plan("", job.output(".json"), others=checkpoints)
    columns = parse_assignments(data_columns, "--data-column")
    charts = select_charts(job, split_names(plot), x, data, columns)
    earlier = None
    if resume_from is not None:
        earlier = load_earlier_run(resume_from, job.model)
    initial_state = job.start(start) if resume_from is None else resume_from
    saved = checkpoint or files.table.with_suffix(".run")
    warnings: list[str] = []

    def analyze() -> Solution:
        solution = integrate_run(
            job,
            method,
            t_end=t_end,
            output_step=output_step,
            start=initial_state,
            accept_changes=accept_changes,
            sensitivities=names,
        )
        return solution if earlier is None else earlier.followed_by(solution)

    def is_resumable(solution: Solution) -> bool:
        from beamdae.results.outcome import PILOT_RUN_SUFFIX

        status, is_early = solution.status, solution.t[-1] < solution.model["t_end"]
        is_pilot = PILOT_RUN_SUFFIX in status.sentence
        return accuracy is None and not status.success and is_early and not is_pilot

    def write_tables(solution: Solution) -> list[Path]:
        from beamdae.simulation import unchecked

        with unchecked():
            written = [solution.to_csv(files.table), files.table.with_suffix(".json")]
        if checkpoint is not None or is_resumable(solution):
            files.write(saved.name, lambda: [solution.save(saved)])
        return written

    def describe(solution: Solution) -> Report:
        from beamdae.simulation import is_unchecked

        sentences: tuple[str, ...] = ()
        has_estimate = estimate or verify or accuracy is not None
        if has_estimate and solution.columns and not is_unchecked():
            sentences = measure_errors(solution, verify)
        warnings[:] = [*sentences, *solution.model_warnings]
        comparisons = compare_with_data(solution, charts[0], data)
        resume = ""
        if is_resumable(solution) and saved in files.paths:
            record_results(lambda: {"continue": saved})
            resume = shlex.join(["--continue", str(saved), *job.selection])
        return describe_run(job, files.table, solution, sentences, comparisons, resume)

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


def select_charts(
    job: Job, names: Sequence[str], x: str | None, data: Path | None, columns: Mapping[str, str]
) -> tuple[PlotSelection | None, PlotSelection | None]:
    """Return the contents of page and picture before the run, which may take hours.

    Those of the page are over time, those of the picture over `x`. None stands for the columns that
    vary.
    """
    if not names and x is None and data is None:
        return None, None
    if not job.picture and x is not None:
        raise BeamdaeError("run: --x requires the picture; omit --no-picture.")
    if not (job.picture or job.page):
        raise BeamdaeError(
            "run: --plot and --data require the picture or the page; omit --no-picture or "
            "--no-page."
        )
    from beamdae.equations.measures import LEDGER_COLUMNS, TIME
    from beamdae.report.pictures.time_plots import select_plot
    from beamdae.results.run_data import coordinate_headers
    from beamdae.simulation import as_equations

    equations = as_equations("run", job.model, sampled=True)
    in_table = [TIME, *equations.observed_headers, *LEDGER_COLUMNS]
    headers = list(dict.fromkeys([*in_table, *coordinate_headers(equations)]))
    drawn = select_plot(headers, in_table, names, x, data, columns)
    over_time = select_plot(headers, in_table, names, None, data, columns) if x else drawn
    return over_time, drawn


def load_earlier_run(path: Path, model: Model) -> Solution | None:
    """Return the run in the file of --continue; None for a changed model."""
    from beamdae.results.storage.checkpoint import Checkpoint
    from beamdae.results.storage.saved_run import load_saved_run
    from beamdae.simulation import as_equations

    equations = as_equations("run", model)
    checkpoint = Checkpoint.read(path)
    checkpoint.start_equations(equations, f"--continue {path}")
    if checkpoint.describe_changes(equations, {}):
        return None
    earlier: Any = load_saved_run(path, equations)
    return earlier


def integrate_run(job: AccurateJob, integrator: Any, **settings: Any) -> Solution:
    """Simulate the model and return the solution, even if interrupted.

    `settings` are arguments of `simulate`, among them `t_end`.

    Raises
    ------
    KeyboardInterrupt
        If the command is interrupted before the run starts.
    """
    from beamdae.simulation import simulate, unchecked

    accuracy = job.accuracy
    task = "" if accuracy is None else f"accuracy {accuracy:g}"
    with show_run_progress(settings["t_end"] or job.model.t_end, task) as show_progress:

        def update(t: float) -> None:
            show_progress(integrator.label, t)
            # The exception may have been swallowed, for example by a callback of other code.
            if process.is_interrupted():
                raise KeyboardInterrupt

        try:
            # `measure_errors` follows, with a progress bar of its own.
            with unchecked():
                return simulate(
                    job.model,
                    integrator,
                    progress=update,
                    partial="return",
                    **job.requirement,
                    **settings,
                )
        except KeyboardInterrupt:
            reason = "interrupted before the run started; nothing was written"
            raise Interrupted(reason) from None


def measure_errors(solution: Solution, verify: bool) -> tuple[str, ...]:
    """Measure the errors by a second run or, with `verify`, by a different method.

    Return the sentences about large ones. The errors become those of the solution.
    """
    from beamdae.accuracy import runs

    task = "verification" if verify else "estimate of errors"
    with show_run_progress(float(solution.t[-1]), task) as show_progress:
        progress = partial(show_progress, solution.label)
        if not verify:
            return tuple(runs.check_errors(solution, solution, progress))
        vars(solution)["errors"] = errors = runs.verify(solution, progress=progress)
        return tuple(errors.sentences())


def describe_run(
    job: AccurateJob,
    table: Path,
    solution: Solution,
    sentences: Sequence[str],
    comparisons: Mapping[str, Mapping[str, float]],
    resume: str,
) -> Report:
    """Return the report on a run: its end and cost, events, data and the ranges of its columns.

    If its errors are known, they are added to the metadata of the table.

    Parameters
    ----------
    job, table
        The job, and the path of the table.
    solution
        The run.
    sentences
        Sentences about its errors.
    comparisons
        Differences from measured data, see `compare_with_data`.
    resume
        Options that resume the run, or "".
    """
    from beamdae.model_parameters import format_with_unit, split_unit
    from beamdae.report.descriptions import Description
    from beamdae.report.tables import column_extremes, range_rows, run_facts
    from beamdae.results.columns import remove_unit
    from beamdae.results.outcome import REACHED_END, accuracy_of
    from beamdae.results.storage.files import write_metadata

    warnings = [*sentences, *solution.model_warnings]
    known = vars(solution).get("errors")
    required: dict[str, Any] = {}
    errors: dict[str, Any] = {}
    if (reached := accuracy_of(solution)) is not None:
        status = {"status": reached.kind, "reason": reached.sentence}
        required = {"accuracy": {"required": job.accuracy, **status}}
    if known is not None:
        columns = {name: x.tolist() for name, x in known.columns().items()}
        errors = {
            column: {name: x[k] if math.isfinite(x[k]) else None for name, x in columns.items()}
            for k, column in enumerate(solution.columns)
        }
    if errors or sentences:
        with process.defer_interrupts():
            write_metadata(table, solution.metadata(errors=errors, warnings=warnings) | required)
    details = run_facts(solution)
    facts = {topic: details.pop(topic) for topic in ("events",) if topic in details}
    for name, x in comparisons.items():
        unit = split_unit(name)[1]
        rms, largest = (format_with_unit(float(f"{x[k]:.3g}"), unit) for k in ("RMS", "largest"))
        facts[f"data of {remove_unit(name)}"] = (
            f"RMS difference {rms}, largest {largest} at t = {x['t']:.5g} s "
            f"({format_count(int(x['count']), 'value')})"
        )
    extremes = solution.step_extremes
    derivatives = {} if solution.derivatives is None else solution.derivatives.columns()
    tables = {
        "Observed": range_rows(solution.columns, known, extremes),
        "Derivatives": range_rows(derivatives),
    }

    def create_data() -> dict[str, Any]:
        data = solution.metadata()
        del data["equations"], data["warnings"]
        observed = column_extremes(solution.columns, extremes).items()
        data["observed"] = {name: x | errors.get(name, {}) for name, x in observed}
        return data | required | ({"data": comparisons} if comparisons else {})

    statistics = solution.statistics
    # The sentences of other ends contain their time.
    end = f"t = {solution.trajectory.end:.6g} s, " if solution.status == REACHED_END else ""
    return Report(
        job.model.name,
        Description(facts, tables, create_data, details),
        solution.status,
        warnings,
        f"{end}{format_count(statistics.steps, 'step')} of "
        f"{solution.integrator.get('method', solution.label)} in "
        f"{statistics.setup_time + statistics.wall_time:.2g} s",
        "--json",
        command=f"to resume: {resume}" if resume else "",
    )


def compare_with_data(
    solution: Solution, charts: PlotSelection | None, file: Path | None
) -> dict[str, dict[str, float]]:
    """Return differences between the run and measured data, by header of the column.

    These are the RMS and the largest magnitude, its time [s], and the number of values within the
    run. Columns that are not in the table of the run are omitted.
    """
    import numpy as np

    points = {} if charts is None else charts.points
    comparisons = {}
    for name, experiments in points.items():
        if name not in solution.columns or not experiments:
            continue
        t, measured = map(np.concatenate, zip(*experiments.values(), strict=True))
        begin, end = solution.trajectory.start, solution.trajectory.end
        is_inside = (begin <= t) & (t <= end)
        if not is_inside.all():
            warn_user(
                f"run: {np.sum(~is_inside)} of {format_count(len(t), 'value')} of {name} in "
                f"{file}, up to t = {t.max():.5g} s, lie outside the run from "
                f"{begin:.5g} to {end:.5g} s and are not compared; choose --t-end, or shift the "
                "times."
            )
        t, measured = t[is_inside], measured[is_inside]
        if not len(t):
            continue
        times, rows = np.unique(t, return_inverse=True)
        differences = np.abs(solution.at_times(times).columns[name][rows] - measured)
        k = int(np.argmax(differences))
        comparisons[name] = {
            "RMS": float(np.sqrt(np.mean(differences**2))),
            "largest": float(differences[k]),
            "t": float(t[k]),
            "count": len(t),
        }
    return comparisons
