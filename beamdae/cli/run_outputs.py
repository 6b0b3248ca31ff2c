"""Steps of `beamdae run`: integration, files and messages; results survive an interrupt."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae.cli import signals
from beamdae.cli.progress import show_run_progress
from beamdae.cli.results import Report, ResultFiles
from beamdae.errors import BeamdaeError, format_count, warn_user
from beamdae.interrupts import Interrupted, acknowledge

if TYPE_CHECKING:
    from beamdae.accuracy.errors import Errors
    from beamdae.cli.job import Job
    from beamdae.model_functions import Model
    from beamdae.report.pictures.time_plots import PlotSelection
    from beamdae.results.outcome import Status
    from beamdae.results.solution import Solution


@dataclass
class Run:
    """Run of a model and its outputs; after an interrupt, some outputs may be missing.

    Attributes
    ----------
    job, integrator
        Job with the model and the parameters of the run, and integrator.
    files
        Files of the run.
    charts, picture_charts, data
        Contents of the page and of the picture, None for the columns that vary, and name of the
        file with measured data.
    checkpoint
        File with the run, from which it can be resumed, or None.
    errors
        Errors of the observed columns; None if they are not known.
    error_warnings
        Sentences about columns with large errors.
    reached
        What was reached of a required accuracy; None if none is required.
    interrupted
        True if an interrupt ended the integration or a later step.
    """

    job: Job
    integrator: Any
    files: ResultFiles
    charts: PlotSelection | None = None
    picture_charts: PlotSelection | None = None
    data: str = ""
    checkpoint: Path | None = None
    errors: Errors | None = None
    error_warnings: list[str] = field(default_factory=list)
    reached: Status | None = None
    interrupted: bool = False

    @contextmanager
    def continue_after_interrupt(self) -> Iterator[None]:
        """Suppress an interrupt of the `with` block if files have already been written."""
        try:
            yield
        except KeyboardInterrupt:
            if not self.files.paths:
                raise
            acknowledge()
            self.interrupted = True


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
    """Return the run in the file of --continue; None for a checkpoint or a changed model."""
    from beamdae.results.storage.checkpoint import Checkpoint
    from beamdae.results.storage.reader import is_archive
    from beamdae.results.storage.saved_run import load_saved_run
    from beamdae.simulation import as_equations

    equations = as_equations("run", model)
    checkpoint = Checkpoint.read(path)
    checkpoint.start_equations(equations, f"--continue {path}")
    if not is_archive(path) or checkpoint.describe_changes(equations, {}):
        return None
    earlier: Any = load_saved_run(path, equations)
    return earlier


def can_resume(solution: Solution) -> bool:
    """Return True if a run ended before its end time, but not during its pilot run."""
    from beamdae.results.outcome import PILOT_RUN_SUFFIX

    status, is_early = solution.status, solution.t[-1] < solution.model["t_end"]
    return not status.success and is_early and PILOT_RUN_SUFFIX not in status.sentence


def integrate_run(
    run: Run,
    t_end: float | None,
    output_step: float | None,
    *start: Any,
    **settings: Any,
) -> Solution:
    """Simulate the model and return the solution, even if interrupted; see `simulate`.

    `settings` are `sensitivities`, `accuracy` and `accuracy_columns`.

    Raises
    ------
    KeyboardInterrupt
        If the command is interrupted before the run starts.
    """
    from beamdae.results.outcome import accuracy_of
    from beamdae.simulation import simulate, unchecked

    accuracy = run.job.accuracy["accuracy"]
    task = "" if accuracy is None else f"accuracy {accuracy:g}"
    with show_run_progress(t_end or run.job.model.t_end, task) as show_progress:

        def update(label: str, t: float) -> None:
            show_progress(label, t)
            # The exception may have been swallowed, for example by a callback of other code.
            if signals.is_interrupted():
                raise KeyboardInterrupt

        try:
            # `estimate_errors` follows, with a progress bar of its own.
            with unchecked():
                solution = simulate(
                    run.job.model,
                    run.integrator,
                    t_end,
                    output_step,
                    partial(update, run.integrator.label),
                    *start,
                    partial="return",
                    **settings,
                )
        except KeyboardInterrupt:
            reason = "interrupted before the run started; nothing was written"
            raise Interrupted(reason) from None
    if accuracy is not None:
        run.integrator, run.reached = solution.made_by, accuracy_of(solution)
    return solution


def write_tables(run: Run, solution: Solution, checkpoint: Path | None) -> None:
    """Write the table, and the whole run if this is requested or the run can be resumed."""
    files, table = run.files, run.files.table
    with signals.defer_interrupts():
        files.add(solution.to_csv(table), table.with_suffix(".json"))
        if checkpoint is not None or (run.reached is None and can_resume(solution)):
            path = checkpoint or table.with_suffix(".run")
            files.write(path.name, lambda: [solution.save(path)])
            if path in files.paths:
                run.checkpoint = path
    run.interrupted = signals.is_interrupted()


def estimate_errors(run: Run, solution: Solution, verify: bool) -> None:
    """Estimate the errors by a second run or, with `verify`, compare with a different method.

    The errors of the observed columns are stored in `run` and in the metadata of its table, unless
    the second run is interrupted. Without observed columns, nothing is done.
    """
    from beamdae.accuracy import runs
    from beamdae.results.storage.files import write_metadata

    if not solution.columns:
        return
    task = "verification" if verify else "estimate of errors"
    with show_run_progress(float(solution.t[-1]), task) as show_progress:
        progress = partial(show_progress, run.integrator.label)
        if verify:
            errors: Any = runs.verify(solution, progress=progress)
            sentences = list(errors.sentences())
        else:
            sentences = list(runs.check_run(solution, progress))
            errors = vars(solution).get("errors")
    # The exception may have been swallowed, for example by a callback of other code.
    if signals.is_interrupted():
        return
    run.errors, run.error_warnings = errors, sentences
    with signals.defer_interrupts():
        results = {
            "errors": _errors_by_column(run, solution),
            "warnings": _warnings(run, solution),
        } | _required_accuracy(run)
        write_metadata(run.files.table, solution.metadata(**results))


def _required_accuracy(run: Run) -> dict[str, Any]:
    if run.reached is None:
        return {}
    reached = {"status": run.reached.kind, "reason": run.reached.sentence}
    return {"accuracy": {"required": run.job.accuracy["accuracy"]} | reached}


def _errors_by_column(run: Run, solution: Solution) -> dict[str, Any]:
    """Return the errors of each observed column; missing errors are None."""
    if run.errors is None:
        return {}
    columns = {name: x.tolist() for name, x in run.errors.columns().items()}
    return {
        column: {name: x[k] if math.isfinite(x[k]) else None for name, x in columns.items()}
        for k, column in enumerate(solution.columns)
    }


def write_views(run: Run, solution: Solution) -> None:
    """Write the page and the picture; the title states if the run ended early."""
    from beamdae.report.page import page_file
    from beamdae.report.pictures.figures import save_figure
    from beamdae.report.pictures.time_plots import create_figure, create_run_figure
    from beamdae.report.run_page import build_run_page
    from beamdae.results.columns import merge_columns

    status, columns = solution.status, solution.all_columns()
    page, picture, name = run.files.page, run.files.picture, run.job.model.name
    title = f"{name}, {run.integrator.label}"
    if not status.success:
        title += f", ended early ({status.kind})"
    if run.reached is not None and not run.reached.success:
        title += f", accuracy {run.job.accuracy['accuracy']:g} not reached"

    def write_page(path: Path) -> Path:
        warnings = _warnings(run, solution)
        content = build_run_page(solution, name, columns, run.errors, warnings, run.charts)
        return page_file.write_page(path, content)

    def draw(path: Path) -> Path:
        charts = run.picture_charts
        if charts is None:
            return save_figure(create_run_figure(columns, title), path)
        merged = merge_columns(columns, solution.coordinate_columns())
        return save_figure(create_figure({"run": merged}, charts, list(columns), title), path)

    if page is not None:
        run.files.write(page.name, lambda: [write_page(page)])
    if picture is not None:
        run.files.write(picture.name, lambda: [draw(picture)])


def describe_run(run: Run, solution: Solution) -> Report:
    """Return the report on a run: its end and cost, events, data and the ranges of its columns."""
    from beamdae.model_parameters import format_with_unit, split_unit
    from beamdae.report.descriptions import Description
    from beamdae.report.terminal.text_tables import column_extremes, range_rows, run_facts
    from beamdae.results.columns import remove_unit

    details = run_facts(solution)
    facts = {topic: details.pop(topic) for topic in ("events",) if topic in details}
    comparisons = _compare_with_data(run, solution)
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
        "Observed": range_rows(solution.columns, run.errors, extremes),
        "Derivatives": range_rows(derivatives),
    }

    def create_data() -> dict[str, Any]:
        data = solution.metadata()
        del data["equations"], data["warnings"]
        errors = _errors_by_column(run, solution)
        observed = column_extremes(solution.columns, extremes).items()
        data["observed"] = {name: x | errors.get(name, {}) for name, x in observed}
        return data | _required_accuracy(run) | ({"data": comparisons} if comparisons else {})

    statistics = solution.statistics
    return Report(
        run.job.model.name,
        Description(facts, tables, create_data, details),
        solution.status,
        _warnings(run, solution),
        f"t = {solution.trajectory.end:.6g} s, {format_count(statistics.steps, 'step')} of "
        f"{solution.integrator.get('method', run.integrator.label)} in "
        f"{statistics.setup_time + statistics.wall_time:.2g} s",
        "--json",
    )


def _compare_with_data(run: Run, solution: Solution) -> dict[str, dict[str, float]]:
    """Return differences between the run and measured data, by header of the column.

    These are the RMS and the largest magnitude, its time [s], and the number of values within the
    run. Columns that are not in the table of the run are omitted.
    """
    import numpy as np

    points = {} if run.charts is None else run.charts.points
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
                f"{run.data}, up to t = {t.max():.5g} s, lie outside the run from "
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


def _warnings(run: Run, solution: Solution) -> list[str]:
    """Return the warnings to show."""
    return [*run.error_warnings, *solution.model_warnings]
