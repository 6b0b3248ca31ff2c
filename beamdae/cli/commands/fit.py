"""`beamdae fit`: parameters of a model from measured data."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.job import Job
from beamdae.cli.options import (
    Bounds,
    DataColumns,
    FixedStep,
    Jobs,
    RelativeTolerance,
    StartCount,
    Starts,
    StartSeed,
    create_integrator,
    parse_assignments,
    parse_bounds,
    split_names,
)
from beamdae.cli.progress import show_study_progress
from beamdae.cli.ranges import parse_ends
from beamdae.cli.results import Report
from beamdae.errors import BeamdaeError

# NumPy and CasADi are imported inside functions, so that --help responds quickly.
if TYPE_CHECKING:
    from beamdae.analysis.fit.result import Fit


def fit_command(
    job: Job,
    data: Annotated[
        Path,
        typer.Argument(
            metavar="DATA.csv",
            help="Measured data: a column of times and observed columns, or one value per row "
            "with the columns experiment, observable, time, value and sigma.",
        ),
    ],
    by: Annotated[
        str, typer.Option(metavar="NAME,...", help="Parameters to estimate, separated by commas.")
    ],
    data_columns: DataColumns = None,
    bounds: Bounds = None,
    log: Annotated[
        str, typer.Option(metavar="NAME,...", help="Parameters whose logarithms are varied.")
    ] = "",
    sigma: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[COLUMN=]VALUE",
            help="Standard deviation of the errors of the data, in the unit of the column or with "
            "a unit; repeatable. Defaults to the column sigma, or to an estimate.",
        ),
    ] = None,
    experiment: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EXPERIMENT:NAME=VALUE",
            help="Value of a parameter in one experiment of the data; repeatable.",
        ),
    ] = None,
    scale: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN",
            help="Column, or EXPERIMENT:COLUMN, with an unknown scale; '*' for all columns; "
            "several are separated by commas; repeatable.",
        ),
    ] = None,
    offset: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN",
            help="Column with an unknown offset, or several separated by commas; repeatable.",
        ),
    ] = None,
    shift: Annotated[
        list[str] | None,
        typer.Option(
            metavar="COLUMN[=LOW:HIGH]",
            help="Column with an unknown delay of its times, and bounds in seconds; repeatable.",
        ),
    ] = None,
    integrator: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Integrator: radau (default), generalized-alpha (default with --step), or an "
            "Integrator class or instance of the model file.",
        ),
    ] = None,
    rtol: RelativeTolerance = None,
    step: FixedStep = None,
    start: Starts = None,
    starts: StartCount = 1,
    seed: StartSeed = 0,
    jobs: Jobs = None,
    max_evaluations: Annotated[
        int, typer.Option(help="Maximum number of runs with derivatives of a search.")
    ] = 100,
) -> None:
    """Estimate parameters of a model from measured data; write estimates, residuals and a page.

    The data determine the end time of the runs.

    With several starts, a table (CSV) contains all searches, and finished searches are stored in
    the results folder: run the same command again to resume. Exits with 0 if the search converged,
    1 if not (the last values are written) or if the page or picture failed, 2 for a usage or model
    error, and 130 after Ctrl-C (the best values so far are written).
    """
    model = job.model
    # A step belongs to generalized-alpha.
    integrator = integrator or ("radau" if step is None else "generalized-alpha")
    options: dict[str, Any] = {
        "integrator": create_integrator("fit", integrator, {"rtol": rtol, "step": step}, job.file),
        "by": split_names(by),
        "data_columns": parse_assignments(data_columns, "--data-column"),
        "sigma": _parse_sigma(sigma),
        "experiments": _parse_experiments(experiment),
        "bounds": parse_bounds(model, bounds),
        "log": split_names(log),
        "scale": split_names(scale),
        "offset": split_names(offset),
        "shift": _parse_shifts(shift),
        "start": job.start(start),
        "max_evaluations": max_evaluations,
        "starts": starts,
        "seed": seed,
    }
    residuals, searches = job.path("_fit_residuals.csv"), job.path("_fit_starts.csv")
    files = job.plan("_fit", residuals, *[searches] * (starts > 1))

    def analyze() -> Fit:
        from beamdae.analysis.fit.fit import fit

        with ExitStack() as stack:
            if starts > 1:
                options.update(folder=job.path("_fit_starts"), jobs=jobs)
                options["progress"] = stack.enter_context(show_study_progress())
            return fit(model, data, partial="return", **options)

    def write_tables(result: Fit) -> list[Path]:
        from beamdae.results.storage.files import write_escaped_table

        written = [result.to_csv(files.table)]
        written.append(write_escaped_table(residuals, result.residual_table()))
        if result.starts is not None:
            written.append(write_escaped_table(searches, result.starts))
        return written

    def add_undetermined(result: Fit, report: Report) -> Report:
        return replace(report, warnings=[*report.warnings, *result.undetermined])

    job.run(files, "fit", analyze, write_tables, complete=add_undetermined)


def _parse_sigma(texts: list[str] | None) -> str | dict[str, str] | None:
    """Return the value of --sigma VALUE, or the values by column of --sigma COLUMN=VALUE."""
    if texts and len(texts) == 1 and "=" not in texts[0]:
        return texts[0]
    return parse_assignments(texts, "--sigma") or None


def _parse_experiments(texts: list[str] | None) -> dict[str, dict[str, str]]:
    """Return the values of --experiment EXPERIMENT:NAME=VALUE by experiment and parameter."""
    experiments: dict[str, dict[str, str]] = {}
    for key, value in parse_assignments(texts, "--experiment").items():
        experiment, _, name = key.rpartition(":")
        if not experiment or not name:
            raise BeamdaeError(
                f"--experiment {key}={value}: the setting must have the form EXPERIMENT:NAME=VALUE."
            )
        experiments.setdefault(experiment, {})[name] = value
    return experiments


def _parse_shifts(texts: list[str] | None) -> dict[str, tuple[float, float] | None]:
    """Return the bounds of --shift COLUMN=LOW:HIGH by column, None without bounds."""
    shifts: dict[str, tuple[float, float] | None] = {}
    for text in texts or []:
        name, equals, limits = text.rpartition("=")
        form = "LOW:HIGH, in s or with units"
        ends = parse_ends("--shift", name, limits, "s", form) if equals else None
        if (column := name or text) in shifts:
            raise BeamdaeError(f"--shift {text}: {column} is given twice; omit one of them.")
        shifts[column] = ends
    return shifts
