"""Jobs of the commands that analyze a model: their common options, files and outputs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae.cli import process
from beamdae.cli.option_values import parse_assignments, split_names
from beamdae.cli.options import (
    AccurateColumns,
    ModelName,
    ModelPath,
    Out,
    Page,
    Picture,
    RequiredAccuracy,
    Settings,
    parse_start,
)
from beamdae.cli.output import record_results
from beamdae.cli.results import Report, ResultFiles, run_analysis
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.cli.model_file import ModelFile
    from beamdae.model_functions import Model


@dataclass
class ModelJob:
    """Model of a command, whose fields are its name, its first argument and its options.

    Attributes
    ----------
    command
        Name of the command.
    needs
        Module that is imported before the model, see `ModelFile`.
    """

    command: str
    path: ModelPath
    settings: Settings = None
    model_name: ModelName = None

    needs = process.RUNS

    @cached_property
    def file(self) -> ModelFile:
        """File of the model."""
        from beamdae.cli.model_file import ModelFile

        return ModelFile(self.path, self.needs)

    @cached_property
    def model(self) -> Model:
        """The model with the values of --set as defaults."""
        model = self.file.model(self.model_name)
        model = replace(model, parameters=model.complete(parse_assignments(self.settings)))
        record_results(lambda: {"model": {"name": model.name, "parameters": model.parameters}})
        return model

    def start(self, texts: list[str] | None) -> Any:
        """Return the start described by --start, or None without this option."""
        return parse_start(texts, self.model)


@dataclass
class Job(ModelJob):
    """Model of a command that analyzes it, and the files that it writes."""

    page: Page = True
    picture: Picture = True
    out: Out = Path("results")

    @property
    def selection(self) -> list[str]:
        """Arguments --model and --set of the command line."""
        named = [("--model", self.model_name), *(("--set", x) for x in self.settings or ())]
        return [text for option, value in named if value for text in (option, value)]

    @cached_property
    def mechanism(self) -> Any:
        """What the model function returns."""
        return self.model()

    def output(self, suffix: str) -> Path:
        """Return the path of an output file, whose name is that of the model with a suffix."""
        return self.out / f"{self.model.name}{suffix}"

    def plan(
        self,
        suffix: str,
        *further: Path,
        others: tuple[str, Iterable[Path]] = ("", ()),
    ) -> ResultFiles:
        """Return the files of table, page and picture; see `ResultFiles.plan`."""
        stem = f"{self.model.name}{suffix}"
        return ResultFiles.plan(self.out, stem, self.page, self.picture, *further, others=others)

    def select_columns(
        self,
        names: list[str] | None,
        x: str | None = None,
        list_headers: Callable[[Any], tuple[Iterable[str], Iterable[str]]] | None = None,
    ) -> tuple[list[str], str | None]:
        """Return the headers of --plot and --x, before an analysis that takes long.

        Parameters
        ----------
        names, x
            Values of the options.
        list_headers
            Function of the equations of motion that returns all headers and the observed ones;
            None if both are the observed ones.
        """
        if not names and x is None:
            return [], None
        if not self.picture:
            option = "--plot" if names else "--x"
            raise BeamdaeError(f"{self.command}: {option} requires the picture; omit --no-picture.")
        from beamdae.results.columns import require_one_column, select_columns
        from beamdae.simulation import as_equations

        equations = as_equations(self.command, self.model)
        observed: Iterable[str] = equations.observed_headers
        headers, observed = map(
            list, (observed, observed) if list_headers is None else list_headers(equations)
        )

        def select(name: str) -> list[str]:
            return select_columns(headers, name, observed=observed, part=self.command)

        selected = dict.fromkeys(y for name in split_names(names) for y in select(name))
        return list(selected), x and require_one_column(self.command, x, select(x))

    def run(
        self,
        files: ResultFiles,
        title: str,
        analyze: Callable[[], Any],
        write_tables: Callable[[Any], Sequence[Path]] | None = None,
        names: Sequence[str] = (),
        x: str | None = None,
        further: Callable[[Any], None] | None = None,
        complete: Callable[[Any, Report], Report] = lambda result, report: report,
    ) -> None:
        """Analyze the model and write and print its results; see `run_analysis`.

        Tables are those of the method `to_csv` by default, `names` and `x` the columns of the
        picture, and `complete` returns the report on a result with additions.
        """
        name = self.model.name

        def describe_result(result: Any) -> Report:
            from beamdae.report.descriptions import describe

            warnings = result.warnings  # These may measure errors, which the description contains.
            status = getattr(result, "status", None)
            return complete(result, Report(name, describe(result), status, warnings))

        def write_page(result: Any, path: Path, title: str) -> Path:
            from beamdae.report.result_displays import write_analysis_page

            return write_analysis_page(result, path, title, names)

        def draw(result: Any, title: str) -> Any:
            from beamdae.report.result_displays import create_result_figure

            return create_result_figure(result, title, names, x)

        run_analysis(
            files,
            lambda _: f"{name}, {title}",
            analyze,
            write_tables or (lambda result: [result.to_csv(files.table)]),
            describe_result,
            write_page,
            draw,
            further,
        )


@dataclass
class AccurateJob(Job):
    """Job of an analysis that can refine its result to a required accuracy."""

    accuracy: RequiredAccuracy = None
    accuracy_columns: AccurateColumns = None

    def __post_init__(self) -> None:
        if self.accuracy_columns and self.accuracy is None:
            raise BeamdaeError(
                f"{self.command}: --columns requires --accuracy; use both options or neither."
            )

    @property
    def requirement(self) -> dict[str, Any]:
        """Arguments of the analysis for --accuracy and --columns."""
        columns = split_names(self.accuracy_columns) or None
        return {"accuracy": self.accuracy, "accuracy_columns": columns}
