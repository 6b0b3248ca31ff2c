"""The work of `beamdae run`, each part of it as far as an interrupt lets it."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae.cli import signals
from beamdae.cli.output import WrittenFiles, create_console, print_warnings, record_results
from beamdae.cli.progress import show_run_progress
from beamdae.errors import BeamdaeWarning

if TYPE_CHECKING:
    from beamdae.model_functions import Model
    from beamdae.results.outcome import Status
    from beamdae.results.solution import Solution
    from beamdae.results.storage.continued_runs import RunParts


@dataclass
class Run:
    """A run of a model and what has become of it, as far as it got.

    Attributes
    ----------
    table
        Where the table of all of the run is; other files are named after it.
    columns
        Those of that table.
    end
        The file that tells where the run ended, if one was written.
    errors, beyond
        How far off the observed columns are, and the sentence on those that are too far.
    cut_short
        Whether an interrupt ended something after the run.
    """

    model: Model
    method: Any
    table: Path
    columns: dict[str, Any] = field(default_factory=dict)
    written: WrittenFiles = field(default_factory=WrittenFiles)
    end: Path | None = None
    errors: Any = None
    beyond: str = ""
    cut_short: bool = False

    @property
    def picture(self) -> Path:
        """Where the run is drawn."""
        return self.table.with_suffix(".png")

    @property
    def page(self) -> Path:
        """Where the page of the run is."""
        return self.table.with_suffix(".html")

    @property
    def title(self) -> str:
        """Model and method."""
        return f"{self.model.name}, {self.method.label}"

    @contextmanager
    def goes_on(self) -> Iterator[None]:
        """Go on after this, also where an interrupt ends it, once there are files."""
        try:
            yield
        except KeyboardInterrupt:
            if not self.written.paths:
                raise
            self.cut_short = True


def can_resume(status: Status) -> bool:
    """Whether there is more of the run to come; where it had not begun yet, it begins again."""
    from beamdae.results.outcome import PILOT_RUN_SUFFIX

    return not status.success and PILOT_RUN_SUFFIX not in status.sentence


def integrate_run(
    run: Run, t_end: float | None, output_step: float | None, *start: Any
) -> Solution:
    """The solution, also one that an interrupt ended; `start` as `simulate` takes it."""
    from beamdae.simulation import simulate

    with show_run_progress(t_end or run.model.t_end) as progress, warnings.catch_warnings():
        # They are told with the result.
        warnings.simplefilter("ignore", BeamdaeWarning)

        def reached(label: str, t: float) -> None:
            progress(label, t)
            # One that was lost, as in a callback of other code, is made up for.
            if signals.is_interrupted():
                raise KeyboardInterrupt

        try:
            told = partial(reached, run.method.label)
            return simulate(run.model, run.method, t_end, output_step, told, *start)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("before the run had begun; nothing was written") from None


def write_tables(run: Run, parts: RunParts, solution: Solution, checkpoint: Path | None) -> None:
    """Write the table, and where the run ended if that is asked for or it can go on."""
    with signals.defer_interrupts():
        run.columns, files = parts.write(solution)
        run.written.paths += files
        if checkpoint is not None or can_resume(solution.status):
            metadata = run.table.with_name(f"{run.table.stem}_end.json")
            run.end = solution.checkpoint(checkpoint or metadata)
            run.written.paths.append(run.end)
    run.cut_short = signals.is_interrupted()


def estimate_errors(run: Run, solution: Solution, verify: bool, table: Path) -> None:
    """Find how far the observed columns are off, and write that beside the table."""
    from beamdae import verification
    from beamdae.results.storage.files import write_metadata

    if not solution.columns:
        return
    what = "verification" if verify else "estimate of errors"
    with show_run_progress(float(solution.t[-1]), what) as progress:
        told = partial(progress, run.method.label)
        if verify:
            errors = verification.compare_methods(solution, progress=told)
        else:
            errors = verification.estimate_errors(solution, told)
    # The second run takes an interrupt for its own.
    if signals.is_interrupted():
        return
    run.errors, run.beyond = errors, verification.accuracy_warning(solution, errors)
    with signals.defer_interrupts():
        write_metadata(table, solution.metadata(errors=_errors_by_column(run, solution)))


def _errors_by_column(run: Run, solution: Solution) -> dict[str, Any]:
    """What is known of the error of each observed column."""
    import numpy as np

    rows = zip(*(np.asarray(values).tolist() for values in run.errors.values()), strict=True)
    return {
        column: {name: None if x != x else x for name, x in zip(run.errors, row, strict=True)}
        for column, row in zip(solution.columns, rows, strict=True)
    }


def draw_run(run: Run, solution: Solution) -> None:
    """Draw the run; the title says if it ended early."""
    from beamdae.report.pictures.time_plots import save_run_figure

    status = solution.status
    title = run.title if status.success else f"{run.title}, ended early ({status.kind})"
    run.written.draw(run.picture.name, lambda: [save_run_figure(run.picture, run.columns, title)])


def write_page(run: Run, solution: Solution) -> None:
    """Write the page of the run."""
    from beamdae.report.page import page_file
    from beamdae.report.run_page import build_run_page

    def written() -> list[Path]:
        further = [run.beyond] if run.beyond else []
        shown = build_run_page(solution, run.model.name, run.columns, run.errors, further)
        return [page_file.write_page(run.page, shown)]

    run.written.draw(run.page.name, written)


def print_results(run: Run, solution: Solution) -> None:
    """Tables and sentences of a run on the screen."""
    from beamdae.report.terminal import text_tables
    from beamdae.results.event_records import format_event_times

    record_results(lambda: _json_results(run, solution))
    screen = create_console()
    rows = text_tables.run_facts(solution.summary(), solution.integrator)
    if solution.equations.events:
        rows["events"] = format_event_times(solution.event_records)
    screen.print(text_tables.fact_list(run.model.name, rows))
    if solution.columns:
        screen.print(text_tables.range_table(solution.columns, run.errors))
    if solution.validity:
        screen.print(text_tables.validity_table(solution.validity))
    print_warnings(screen, [*filter(None, [run.beyond]), *solution.warnings])
    # Whoever reads a pipe has it now as well.
    sys.stdout.flush()


def _json_results(run: Run, solution: Solution) -> dict[str, Any]:
    """What --json tells of a run: what is beside its table, and its observed columns."""
    from beamdae.report.terminal import text_tables

    told = solution.metadata()
    del told["equations"], told["warnings"]
    errors = {} if run.errors is None else _errors_by_column(run, solution)
    observed = text_tables.column_extremes(solution.columns).items()
    return told | {"observed": {name: x | errors.get(name, {}) for name, x in observed}}
