"""Results of commands: tables first, then the screen and the JSON document, page and picture.

Every command describes its result by a `Report` and its files by `ResultFiles`; `run_analysis` is
the sequence of the analyses.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from beamdae.cli import process
from beamdae.cli.output import (
    create_console,
    current_output,
    print_error,
    print_warnings,
    record_results,
    require_writable,
    show,
)
from beamdae.errors import BeamdaeError, format_count, format_exception
from beamdae.interrupts import acknowledge
from beamdae.report.option_names import name_options
from beamdae.report.text import make_printable

# Exit code of a study with runs that are missing because processes or a cluster failed.
NOT_RUN_CODE = 3

if TYPE_CHECKING:
    from beamdae.report.descriptions import Description
    from beamdae.results.outcome import Status


_MAX_SCREEN_ROWS = 24


@dataclass(frozen=True)
class Report:
    """What a command shows of a result.

    Attributes
    ----------
    name
        Name of the model, or "" for commands without a result.
    description
        Facts and tables. Tables that are texts are printed as lines.
    status
        Termination status, whose reason follows the name; None for results without a status.
    warnings
        Warnings about the result.
    cost
        Text that follows the reason of the status.
    source
        What shows columns of tables that do not fit into the terminal, and entries beyond
        `max_rows`.
    max_rows
        Most rows of a table, most tables, and most failures.
    command
        Options that continue with the result, on one line.
    failures
        Sentences on failures that are printed last.
    """

    name: str
    description: Description
    status: Status | None = None
    warnings: Sequence[str] = ()
    cost: str = ""
    source: str = "the CSV file"
    max_rows: int = _MAX_SCREEN_ROWS
    command: str = ""
    failures: Sequence[str] = ()

    def print(self, accuracy: Status | None = None) -> None:
        """Print the report, with what was reached of a required accuracy, or record its data."""
        record_results(lambda: self._status_data(accuracy) | dict(self.description.data()))
        console, status = create_console(), self.status
        if self.name:
            # Reasons of failures are the last line of a command.
            verdict = "" if status is None else status.sentence if status.success else status.kind
            line = ", ".join(filter(None, [verdict, self.cost]))
            line = f"{self.name}: {line}" if line else self.name
            show(console, make_printable(name_options(line)), "bold")
        self._show_facts(console, self.description.facts)
        count = 0  # of tables, which texts precede
        for content in self.description.tables.values():
            if count < self.max_rows:
                self._show_table(console, content)
            count += not isinstance(content, str)
        self._show_omission(console, count, "table", self.source)
        if current_output().verbose:
            self._show_facts(console, self.description.details)
        if accuracy is not None and accuracy.success:
            show(console, f"accuracy reached: {name_options(accuracy.sentence)}", "dim")
        # The reason of a failure is the last line of a command.
        reason = "" if status is None or status.success else status.sentence
        print_warnings(console, (x for x in self.warnings if not reason or reason not in x))
        if self.command:
            console.print(self.command, style="dim", soft_wrap=True)
        for sentence in self.failures[: self.max_rows]:
            print_error(f"failed: {sentence}")
        self._show_omission(create_console(stderr=True), len(self.failures), "failure", self.source)

    def _status_data(self, accuracy: Status | None) -> dict[str, Any]:
        statuses = (self.status, accuracy)
        data, reached = (
            {} if x is None else {"status": x.kind, "reason": x.sentence} for x in statuses
        )
        return data | ({"accuracy": reached} if reached else {})

    def _show_facts(self, console: Any, facts: Mapping[str, str]) -> None:
        from beamdae.report.tables import FactList

        show(console, FactList(facts))

    def _show_table(self, console: Any, content: Any) -> None:
        from beamdae.report.tables import table_of

        if isinstance(content, str):
            show(console, content, "dim")
            return
        is_ready = hasattr(content, "texts")
        if not is_ready and not len(content):
            return
        table = content if is_ready else table_of(content, self.source)
        rows = [list(map(name_options, row)) for row in table.rows[: self.max_rows]]
        show(console, replace(table, rows=rows))
        self._show_omission(console, len(table.rows), "row", table.source)

    def _show_omission(self, console: Any, count: int, noun: str, source: str) -> None:
        if (n_more := count - self.max_rows) > 0:
            show(console, f"not shown: {format_count(n_more, noun)}; see {source}", "dim")


@dataclass
class ResultFiles:
    """Files that a command writes.

    Attributes
    ----------
    paths
        Paths of the files written so far.
    earlier
        Paths of pages and pictures of earlier results.
    failed
        True if a file could not be written.
    table, page, picture
        Paths of the files of an analysis; None for a page or a picture that is not requested.
    """

    paths: list[Path] = field(default_factory=list)
    earlier: list[Path] = field(default_factory=list)
    failed: bool = False
    table: Path = Path()
    page: Path | None = None
    picture: Path | None = None

    @classmethod
    def plan(
        cls,
        out: Path,
        stem: str,
        page: bool,
        picture: bool,
        *further: Path,
        others: tuple[str, Iterable[Path]] = ("", ()),
    ) -> ResultFiles:
        """Return the files STEM.csv, STEM.html and STEM.png in the folder of --out.

        Raises
        ------
        BeamdaeError
            If one of these, of the `further` files or of the `others`, which another option sets,
            cannot be written; see `require_writable`.
        """
        table = out / f"{stem}.csv"
        html = table.with_suffix(".html") if page else None
        png = table.with_suffix(".png") if picture else None
        require_writable(("--out", [table, *filter(None, (html, png)), *further]), others)
        return cls(table=table, page=html, picture=png)

    def add(self, *paths: Path) -> None:
        """Add written tables; a page or a picture that exists already shows earlier results."""
        self.paths = [*paths, *self.paths]
        self.note_earlier(self.table.with_suffix(suffix) for suffix in (".html", ".png"))

    def note_earlier(self, paths: Iterable[Path]) -> None:
        """Note the existing ones of these pages and pictures, which show earlier results."""
        self.earlier += filter(Path.exists, paths)

    def write(self, name: str, write: Callable[[], Iterable[Path]]) -> None:
        """Write files; if this fails, print one line and set `failed`."""
        # Flush, so that the reader of a pipe gets the tables before the files are written.
        sys.stdout.flush()
        try:
            self.paths += write()
            return
        except BeamdaeError as problem:
            print_error(f"failed: {problem}")
        except Exception as problem:  # Results may contain values that cannot be drawn.
            print_error(f"failed: {name}: the file cannot be created: {format_exception(problem)}.")
        self.failed = True

    def draw(self, path: Path, create: Callable[[], Any]) -> None:
        """Write the figure that `create` returns, unless it is None, as a picture."""

        def write() -> list[Path]:
            from beamdae.report.pictures.figures import save_figure

            figure = create()
            return [] if figure is None else [save_figure(figure, path)]

        self.write(path.name, write)

    def print_paths(self) -> None:
        """Print the paths of the written files, and add them to the JSON document."""
        console = create_console()
        for path in map(make_printable, map(str, self.paths)):
            current_output().files.append(path)
            console.print(f"written: {path}", style="dim", soft_wrap=True)
        for old in (x for x in self.earlier if x not in self.paths):
            text = f"not renewed: {make_printable(str(old))}, which shows earlier results"
            console.print(text, style="dim", soft_wrap=True)

    def finish(self, *outcomes: tuple[str, Status | None]) -> None:
        """End a command: print the paths and the reasons for failures, and set the exit code.

        Parameters
        ----------
        *outcomes
            Pairs of a prefix of messages, and the status of the result or of its accuracy.

        Raises
        ------
        typer.Exit
            If the analysis was interrupted, or failed, or a file could not be written.
        """
        self.print_paths()
        failures = [(prefix, x) for prefix, x in outcomes if x is not None and not x.success]
        reasons = [x.sentence for _, x in failures if x.kind == "interrupted"]
        if reasons or process.is_interrupted():
            acknowledge()
            places = [f"the results so far are in {path}" for path in self.paths[:1]]
            print_error("; ".join([*(reasons or ["interrupted"])[:1], *places]))
            raise typer.Exit(process.exit_code())
        is_incomplete = any(x.kind == "not run" for _, x in failures)
        for prefix, status in failures:
            prefix = "not run" if is_incomplete else prefix
            print_error(f"{prefix}: {name_options(status.sentence)}")
        if is_incomplete:
            raise typer.Exit(NOT_RUN_CODE)
        if failures or self.failed:
            raise typer.Exit(1)


@contextmanager
def continue_after_interrupt() -> Iterator[None]:
    """Suppress an interrupt of the `with` block, after the tables have been written."""
    try:
        yield
    except KeyboardInterrupt:
        acknowledge()


def run_analysis(
    files: ResultFiles,
    title: Callable[[Any], str],
    analyze: Callable[[], Any],
    write_tables: Callable[[Any], Sequence[Path]],
    describe: Callable[[Any], Report],
    write_page: Callable[[Any, Path, str], Path],
    draw: Callable[[Any, str], Any],
    further: Callable[[Any], None] | None = None,
) -> None:
    """Analyze a model, write tables, print the result, write page and picture, and end the command.

    An interrupt of an analysis that returns what it has, or a later one, ends only the present
    step; SIGTERM skips page and picture.

    Parameters
    ----------
    files
        Paths of the files.
    title
        Function of the result that returns the title of page and picture.
    analyze
        Function that returns the result.
    write_tables
        Function that writes the tables of a result.
    describe
        Function that returns the report on a result, and measures its errors unless `unchecked`.
    write_page, draw
        Functions of a result and a title that write the page, and that return the picture.
    further
        Function that writes further files, after page and picture.
    """
    try:
        with process.defer_interrupts(immediate=1):
            result = analyze()
            with process.defer_interrupts():
                files.add(*write_tables(result))
    except KeyboardInterrupt:
        if not files.paths:
            raise
        acknowledge()
    from beamdae.results.outcome import accuracy_of
    from beamdae.simulation import unchecked

    report = None
    if not process.is_interrupted():
        with continue_after_interrupt():
            report = describe(result)
    if report is None:
        with unchecked():
            report = describe(result)
    status, accuracy = report.status, accuracy_of(result)
    report.print(accuracy)

    def draw_result() -> Any:
        suffix = "" if status is None or status.success else f", ended early ({status.kind})"
        if accuracy is not None and not accuracy.success:
            suffix += ", accuracy not reached"
        return draw(result, f"{title(result)}{suffix}")

    page, picture = files.page, files.picture
    with continue_after_interrupt():
        if not process.is_terminated():
            if page is not None:
                files.write(page.name, lambda: [write_page(result, page, title(result))])
            if picture is not None:
                files.draw(picture, draw_result)
            if further is not None:
                further(result)
    files.finish(("failed", status), ("the accuracy is not reached", accuracy))
