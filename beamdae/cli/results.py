"""Results of commands: tables first, then the screen and the JSON document, page and picture.

Every command describes its result by a `Report` and its files by `ResultFiles`; `run_analysis` is
the sequence of the analyses.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from beamdae.cli import signals
from beamdae.cli.output import (
    create_console,
    current_output,
    print_error,
    print_warnings,
    record_results,
    show,
)
from beamdae.cli.output_paths import require_writable
from beamdae.errors import BeamdaeError, format_exception
from beamdae.garbage_collection import paused_collection
from beamdae.input_files import is_input
from beamdae.report.option_names import name_options
from beamdae.report.text import make_printable

if TYPE_CHECKING:
    from beamdae.results.outcome import Status


@dataclass(frozen=True)
class Report:
    """What a command shows of a result.

    Attributes
    ----------
    name
        Name of the model, or "" for commands without a result.
    create_data
        Function that returns the entries of the JSON document.
    status
        Termination status, whose reason follows the name; None for results without a status.
    facts
        Texts by topic, shown above the tables.
    tables
        Tables, and lines as strings.
    details
        Texts by topic that the option --verbose shows below the tables.
    warnings
        Warnings about the result.
    cost
        Text that follows the reason of the status.
    """

    name: str
    create_data: Callable[[], Mapping[str, Any]]
    status: Status | None = None
    facts: Mapping[str, str] = field(default_factory=dict)
    tables: Sequence[Any] = ()
    details: Mapping[str, str] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    cost: str = ""

    def print(self, accuracy: Status | None = None) -> None:
        """Print the report, with what was reached of a required accuracy, or record its data."""
        from beamdae.report.terminal import text_tables

        record_results(self.create_data)
        if accuracy is not None:
            reached = {"status": accuracy.kind, "reason": accuracy.sentence}
            record_results(lambda: {"accuracy": reached})
        console = create_console()
        if self.name:
            # Reasons of failures are the last line of a command.
            status = self.status
            verdict = "" if status is None else status.sentence if status.success else status.kind
            line = ", ".join(filter(None, [verdict, self.cost]))
            line = f"{self.name}: {line}" if line else self.name
            console.print(make_printable(name_options(line)), style="bold")

        def show_facts(facts: Mapping[str, str]) -> None:
            texts = {topic: name_options(text) for topic, text in facts.items()}
            show(console, text_tables.fact_list("", texts))

        show_facts(self.facts)
        for table in self.tables:
            show(console, table, "dim" if isinstance(table, str) else None)
        if current_output().verbose:
            show_facts(self.details)
        if accuracy is not None and accuracy.success:
            console.print(f"accuracy: {name_options(accuracy.sentence)}", style="dim")
        # The reason of a failure is the last line of a command.
        reason = "" if self.status is None or self.status.success else self.status.sentence
        print_warnings(console, (x for x in self.warnings if not reason or reason not in x))


@dataclass
class ResultFiles:
    """Files that a command writes.

    Attributes
    ----------
    paths
        Paths of the files written so far.
    failed
        True if a file could not be written.
    table, page, picture
        Paths of the files of an analysis; None for a page or a picture that is not requested.
    """

    paths: list[Path] = field(default_factory=list)
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
        return cls([], False, table, html, png)

    def add(self, *paths: Path) -> None:
        """Add written tables, and remove the page and the picture of earlier ones."""
        self.paths += paths
        for suffix in (".html", ".png"):
            self.remove(self.table.with_suffix(suffix))

    def remove(self, path: Path) -> None:
        """Remove a page or a picture, which show earlier results, unless it is an input."""
        if is_input(path):
            return
        try:
            path.unlink(missing_ok=True)
        except OSError as problem:
            reason = f"shows earlier results and cannot be removed ({problem.strerror})"
            print_error(f"failed: {path}: the file {reason}; remove it.")
            self.failed = True

    def write(self, name: str, write: Callable[[], Iterable[Path]]) -> None:
        """Write files; if this fails, print one line and set `failed`."""
        # Flush, so that the reader of a pipe gets the tables before the files are written.
        sys.stdout.flush()
        try:
            # Importing Matplotlib and drawing create no garbage to speak of.
            with paused_collection():
                self.paths += write()
            return
        except BeamdaeError as problem:
            print_error(f"failed: {problem}")
        except Exception as problem:  # Results may contain values that cannot be drawn.
            print_error(f"failed: {name}: the file cannot be created: {format_exception(problem)}.")
        self.failed = True

    def print_paths(self) -> None:
        """Print the paths of the written files, and add them to the JSON document."""
        console = create_console()
        for path in map(make_printable, map(str, self.paths)):
            current_output().files.append(path)
            console.print(f"written: {path}", style="dim", soft_wrap=True)

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
        for prefix, status in failures:
            if status.kind == "interrupted":
                print_error(f"{status.sentence}; the results so far are in {self.paths[0]}")
                raise typer.Exit(signals.exit_code())
            print_error(f"{prefix}: {name_options(status.sentence)}")
        if failures or self.failed:
            raise typer.Exit(1)


def run_analysis(
    files: ResultFiles,
    title: str,
    analyze: Callable[[], Any],
    describe: Callable[[Any], Report],
    draw: Callable[[Any, Path, str], Path | None],
    write_tables: Callable[[Any], Sequence[Path]] | None = None,
    write_page: Callable[[Any, Path], Path] | None = None,
    further: Callable[[Any], None] | None = None,
) -> None:
    """Analyze a model, write tables, print the result, write page and picture, and end the command.

    After the first interrupt of an analysis that returns what it has, its tables are written before
    a further one is raised; page and picture are skipped.

    Parameters
    ----------
    files
        Paths of the files.
    title
        Title of page and picture.
    analyze
        Function that returns the result.
    describe
        Function that returns the report on a result.
    draw
        Function that writes the picture of a result with a title; None if there is nothing to draw.
    write_tables
        Function that writes the tables of a result; by default, its method `to_csv`.
    write_page
        Function that writes the page of a result; by default, `write_analysis_page`.
    further
        Function that writes further files, after page and picture.
    """
    with signals.defer_interrupts(immediate=1):
        result = analyze()
        files.add(*(write_tables(result) if write_tables else [result.to_csv(files.table)]))
    from beamdae.report.analysis_pages import write_analysis_page
    from beamdae.results.outcome import accuracy_of

    report, accuracy = describe(result), accuracy_of(result)
    report.print(accuracy)

    page, picture = files.page, files.picture
    if report.status is None or report.status.kind != "interrupted":
        if page is not None:
            write = write_page or partial(write_analysis_page, title=title)
            files.write(page.name, lambda: [write(result, page)])
        if picture is not None:
            files.write(picture.name, lambda: filter(None, [draw(result, picture, title)]))
        if further is not None:
            further(result)
    files.finish(("failed", report.status), ("the accuracy is not reached", accuracy))


def without_status(facts: Mapping[str, str]) -> dict[str, str]:
    """Return facts but the status, which follows the name of the model."""
    return {topic: text for topic, text in facts.items() if topic != "status"}


def draw_modes(modes: Any, path: Path, title: str) -> Path | None:
    """Write the picture of natural or buckling modes; None without modes or parts to draw."""
    if modes.mechanism is None or not len(modes):
        return None
    from beamdae.report.pictures.figures import save_figure
    from beamdae.report.pictures.mode_shapes import create_modes_figure

    return save_figure(create_modes_figure(modes, title), path)


def named_reasons(searches: Any) -> Any:
    """Return a table of searches whose reasons name options of the command."""
    return searches.assign(reason=searches["reason"].map(name_options))
