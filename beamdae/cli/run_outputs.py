"""Steps of `beamdae run`: integration, files and messages; results survive an interrupt."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from beamdae.cli import signals
from beamdae.cli.output import (
    WrittenFiles,
    print_facts,
    print_warnings,
)
from beamdae.cli.progress import show_run_progress
from beamdae.errors import BeamdaeError, format_count, warn_user
from beamdae.interrupts import Interrupted, acknowledge

if TYPE_CHECKING:
    from beamdae.model_functions import Model
    from beamdae.report.pictures.time_plots import PlotSelection
    from beamdae.results.outcome import Status
    from beamdae.results.solution import Solution
    from beamdae.results.storage.continued_runs import RunParts


class RunPlot(NamedTuple):
    """Columns, horizontal axis and measured data of the picture; see `beamdae.plot`."""

    columns: Sequence[str] = ()
    x: str | None = None
    data: Path | None = None
    data_columns: Mapping[str, str] | None = None

    @property
    def is_default(self) -> bool:
        """True if the picture shows the columns that vary."""
        return not self.columns and self.x is None and self.data is None


@dataclass
class Run:
    """Run of a model and its outputs; after an interrupt, some outputs may be missing.

    Attributes
    ----------
    model, integrator
        Model with the parameters of the run, and integrator.
    table
        Path of the table of all parts of the run; other files are named after it.
    parts
        Files of this run and of those that it resumes; None if it does not resume a run.
    columns
        Columns of the table by header; empty until the table is written.
    files
        Files written so far.
    checkpoint
        Checkpoint that was written, or None.
    errors
        Error estimates of the observed columns, by name of the estimate; None without estimates.
    error_warnings
        Sentences about columns with large errors.
    accuracy, reached
        Required accuracy [-], and what was reached of it; None if the run is not refined.
    interrupted
        True if an interrupt ended the integration or a later step.
    plot
        Contents of the picture.
    charts
        Columns of `plot` over time with the measured values, which the page shows first; None if
        the picture shows the columns that vary.
    """

    model: Model
    integrator: Any
    table: Path
    parts: RunParts | None = None
    columns: dict[str, Any] = field(default_factory=dict)
    files: WrittenFiles = field(default_factory=WrittenFiles)
    checkpoint: Path | None = None
    errors: Any = None
    error_warnings: list[str] = field(default_factory=list)
    accuracy: float | None = None
    reached: Status | None = None
    interrupted: bool = False
    plot: RunPlot = field(default_factory=RunPlot)
    charts: PlotSelection | None = None

    @property
    def is_inaccurate(self) -> bool:
        """True if the required accuracy was not reached."""
        return self.reached is not None and not self.reached.success

    @property
    def latest_table(self) -> Path:
        """Path of the table of this run alone."""
        return self.table if self.parts is None else self.parts.latest

    @property
    def picture(self) -> Path:
        """Path of the picture."""
        return self.table.with_suffix(".png")

    @property
    def page(self) -> Path:
        """Path of the page for the browser."""
        return self.table.with_suffix(".html")

    @property
    def title(self) -> str:
        """Title with the model and the integrator."""
        return f"{self.model.name}, {self.integrator.label}"

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


def select_charts(run: Run, is_drawn: bool, has_page: bool, is_resumed: bool) -> None:
    """Select the contents of the picture and of the page before the run, which may take hours.

    Raises
    ------
    BeamdaeError
        If neither a picture nor a page shows them, the model does not have a column, the data
        cannot be read, or a resumed run is to plot a coordinate.
    """
    if run.plot.is_default:
        return
    if not is_drawn and run.plot.x is not None:
        raise BeamdaeError("run: --x requires the picture; omit --no-picture.")
    if not (is_drawn or has_page):
        raise BeamdaeError(
            "run: --plot and --data require the picture or the page; omit --no-picture or "
            "--no-page."
        )
    from beamdae.analysis.fit.data import UnmatchedDataError
    from beamdae.equations.measures import LEDGER_COLUMNS, TIME
    from beamdae.report.pictures.time_plots import select_plot
    from beamdae.results.run_data import coordinate_headers
    from beamdae.simulation import as_equations

    equations = as_equations("run", run.model, sampled=True)
    observed = equations.observed_headers
    headers = dict.fromkeys([TIME, *observed, *LEDGER_COLUMNS, *coordinate_headers(equations)])
    in_table = [TIME, *observed, *LEDGER_COLUMNS]
    columns, x, data, data_columns = run.plot
    try:
        selection = select_plot(list(headers), in_table, columns, x, data, data_columns)
    except UnmatchedDataError as problem:
        warn_user(str(problem))
        run.plot = run.plot._replace(data=None)
        return select_charts(run, is_drawn, has_page, is_resumed)
    run.charts = selection
    if x:
        run.charts = select_plot(list(headers), in_table, columns, None, data, data_columns)
    missing = [c for c in (selection.abscissa, *selection.columns) if c not in in_table]
    if is_resumed and missing:
        raise BeamdaeError(
            f"run: the coordinate {missing[0]} is not in the tables of the earlier parts of a "
            "resumed run (--continue); plot observed columns."
        )


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
    from beamdae.accuracy.runs import unchecked
    from beamdae.results.outcome import accuracy_of
    from beamdae.simulation import simulate

    task = "" if run.accuracy is None else f"accuracy {run.accuracy:g}"
    with show_run_progress(t_end or run.model.t_end, task) as show_progress:

        def update(label: str, t: float) -> None:
            show_progress(label, t)
            # The exception may have been swallowed, for example by a callback of other code.
            if signals.is_interrupted():
                raise KeyboardInterrupt

        try:
            # `estimate_errors` follows, with a progress bar of its own.
            with unchecked():
                solution = simulate(
                    run.model,
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
    if run.accuracy is not None:
        run.integrator, run.reached = solution.made_by, accuracy_of(solution)
    return solution


def write_tables(run: Run, solution: Solution, checkpoint: Path | None) -> None:
    """Write the table, and a checkpoint if it is requested or the run can be resumed."""
    with signals.defer_interrupts():
        if run.parts is None:
            table = solution.to_csv(run.table)
            run.columns, files = solution.all_columns(), [table, table.with_suffix(".json")]
        else:
            run.columns, files = run.parts.write(solution)
        run.files.paths += files
        if checkpoint is not None or (run.accuracy is None and can_resume(solution)):
            default = run.table.with_name(f"{run.table.stem}_end.json")
            path = checkpoint or default
            run.files.write(path.name, lambda: [solution.checkpoint(path)])
            if path in run.files.paths:
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
    if errors is not None:
        run.errors = errors.columns()
    run.error_warnings = sentences
    with signals.defer_interrupts():
        results = {
            "errors": _errors_by_column(run, solution),
            "warnings": _warnings(run, solution),
        } | _required_accuracy(run)
        write_metadata(run.latest_table, solution.metadata(**results))


def _required_accuracy(run: Run) -> dict[str, Any]:
    if run.reached is None:
        return {}
    reached = {"status": run.reached.kind, "reason": run.reached.sentence}
    return {"accuracy": {"required": run.accuracy} | reached}


def _errors_by_column(run: Run, solution: Solution) -> dict[str, Any]:
    """Return the error estimates of each observed column; missing estimates are None."""
    import numpy as np

    if run.errors is None:
        return {}
    rows = zip(*(np.asarray(values).tolist() for values in run.errors.values()), strict=True)
    return {
        column: {name: _replace_non_finite(x) for name, x in zip(run.errors, row, strict=True)}
        for column, row in zip(solution.columns, rows, strict=True)
    }


def _replace_non_finite(value: Any) -> Any:
    """Return None for nan and infinity, which JSON lacks."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_page(run: Run, solution: Solution) -> None:
    """Write the page of the run."""
    from beamdae.report.page import page_file
    from beamdae.report.run_page import build_run_page

    def write() -> list[Path]:
        page = build_run_page(
            solution,
            run.model.name,
            run.columns,
            run.errors,
            _warnings(run, solution),
            run.charts,
        )
        return [page_file.write_page(run.page, page)]

    run.files.write(run.page.name, write)


def draw_run(run: Run, solution: Solution) -> None:
    """Write the picture of the run; the title states if the run ended early."""
    from beamdae.report.pictures.time_plots import save_run_figure, save_selected_columns
    from beamdae.results.columns import merge_columns

    status = solution.status
    title = run.title if status.success else f"{run.title}, ended early ({status.kind})"
    if run.is_inaccurate:
        title += f", accuracy {run.accuracy:g} not reached"
    if run.plot.is_default:
        run.files.write(
            run.picture.name, lambda: [save_run_figure(run.picture, run.columns, title)]
        )
        return
    # The table covers all parts of a continued run.
    columns = dict(run.columns)
    if len(next(iter(columns.values()))) == len(solution.t):
        columns = merge_columns(columns, solution.coordinate_columns())
    plot = run.plot
    run.files.write(
        run.picture.name,
        lambda: [
            save_selected_columns(
                run.picture, columns, plot.columns, plot.x, plot.data, title, plot.data_columns
            )
        ],
    )


def print_results(run: Run, solution: Solution) -> None:
    """Print the tables and warnings of a run, and add its results to the JSON document."""
    from beamdae.model_parameters import format_with_unit, split_unit
    from beamdae.report.terminal import text_tables
    from beamdae.results.columns import remove_unit
    from beamdae.results.event_records import describe_events

    rows = text_tables.run_facts(solution.summary(), solution.integrator)
    rows |= text_tables.further_facts(solution)
    if solution.equations.events:
        rows["events"] = describe_events(
            solution.equations, solution.trajectory, solution.event_records
        )
    comparisons = _compare_with_data(run, solution)
    for name, x in comparisons.items():
        unit = split_unit(name)[1]
        rms, largest = (format_with_unit(float(f"{x[k]:.3g}"), unit) for k in ("RMS", "largest"))
        rows[f"data of {remove_unit(name)}"] = (
            f"RMS difference {rms}, largest {largest} at t = {x['t']:.5g} s "
            f"({format_count(int(x['count']), 'value')})"
        )
    console = print_facts(
        run.model.name,
        rows,
        lambda: _json_results(run, solution) | ({"data": comparisons} if comparisons else {}),
    )
    if solution.columns:
        console.print(text_tables.range_table(solution.columns, run.errors, solution.step_extremes))
    if solution.derivatives is not None:
        console.print(text_tables.range_table(solution.derivatives.columns()))
    print_warnings(console, _warnings(run, solution))


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
                f"{run.plot.data}, up to t = {t.max():.5g} s, lie outside the run from "
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


def _json_results(run: Run, solution: Solution) -> dict[str, Any]:
    from beamdae.report.terminal import text_tables

    results = solution.metadata()
    del results["equations"], results["warnings"]
    errors = _errors_by_column(run, solution)
    observed = text_tables.column_extremes(solution.columns, solution.step_extremes).items()
    table = {"observed": {name: x | errors.get(name, {}) for name, x in observed}}
    return results | table | _required_accuracy(run)
