"""Commands `fit` and `optimize`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.job import Job
from beamdae.cli.option_values import parse_assignments, parse_bounds, parse_ends, split_names
from beamdae.cli.options import (
    Bounds,
    DataColumns,
    FixedStep,
    Jobs,
    LoadTime,
    RelativeTolerance,
    Repeated,
    StartCount,
    Starts,
    StartSeed,
    create_integrator,
)
from beamdae.cli.progress import show_design_progress, show_study_progress
from beamdae.cli.results import Report
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.analysis.fit.result import Fit
    from beamdae.analysis.gradients.objectives import Quantity
    from beamdae.analysis.optimization.quantities import Limit
    from beamdae.analysis.optimization.result import Optimization
    from beamdae.model_functions import Model


_KINDS = (
    "mass, frequency:NUMBER, frequency:NUMBER:equilibrium, frequency:NUMBER:reference, "
    "equilibrium:COLUMN, end:COLUMN, maximum:COLUMN, integral:COLUMN, or the name of a parameter"
)
_STATES = ("equilibrium", "reference")


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
        Repeated,
        typer.Option(
            metavar="[COLUMN=]VALUE",
            help="Standard deviation of the errors of the data, in the unit of the column or with "
            "a unit; repeatable. Defaults to the column sigma, or to an estimate.",
        ),
    ] = None,
    experiment: Annotated[
        Repeated,
        typer.Option(
            metavar="EXPERIMENT:NAME=VALUE",
            help="Value of a parameter in one experiment of the data; repeatable.",
        ),
    ] = None,
    scale: Annotated[
        Repeated,
        typer.Option(
            metavar="COLUMN",
            help="Column, or EXPERIMENT:COLUMN, with an unknown scale; '*' for all columns; "
            "several are separated by commas; repeatable.",
        ),
    ] = None,
    offset: Annotated[
        Repeated,
        typer.Option(
            metavar="COLUMN",
            help="Column with an unknown offset, or several separated by commas; repeatable.",
        ),
    ] = None,
    shift: Annotated[
        Repeated,
        typer.Option(
            metavar="COLUMN[=LOW:HIGH]",
            help="Column with an unknown delay of its times, and bounds in seconds; repeatable.",
        ),
    ] = None,
    clock: Annotated[
        Repeated,
        typer.Option(
            metavar="COLUMN[=LOW:HIGH]",
            help="Column with an unknown ratio of recorded to true times, and bounds; repeatable.",
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
        "shift": _parse_timing("--shift", "s", shift),
        "clock": _parse_timing("--clock", "-", clock),
        "start": job.start(start),
        "max_evaluations": max_evaluations,
        "starts": starts,
        "seed": seed,
    }
    residuals, searches = job.output("_fit_residuals.csv"), job.output("_fit_starts.csv")
    files = job.plan("_fit", residuals, *[searches] * (starts > 1))

    def analyze() -> Fit:
        from beamdae.analysis.fit.fit import fit

        with ExitStack() as stack:
            if starts > 1:
                options.update(folder=job.output("_fit_starts"), jobs=jobs)
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


def _parse_timing(
    option: str, unit: str, texts: list[str] | None
) -> dict[str, tuple[float, float] | None]:
    """Return the bounds of an option COLUMN=LOW:HIGH by column, None without bounds."""
    found: dict[str, tuple[float, float] | None] = {}
    for text in texts or []:
        name, equals, limits = text.rpartition("=")
        form = "LOW:HIGH, in s or with units" if unit == "s" else "LOW:HIGH"
        ends = parse_ends(option, name, limits, unit, form) if equals else None
        if (column := name or text) in found:
            raise BeamdaeError(f"{option} {text}: {column} is given twice; omit one of them.")
        found[column] = ends
    return found


def optimize_command(
    job: Job,
    by: Annotated[
        str, typer.Option(metavar="NAME,...", help="Parameters to vary, separated by commas.")
    ],
    minimize: Annotated[
        str | None, typer.Option(metavar="QUANTITY", help=f"Quantity to minimize: {_KINDS}.")
    ] = None,
    maximize: Annotated[
        str | None, typer.Option(metavar="QUANTITY", help="Quantity to maximize instead.")
    ] = None,
    at_most: Annotated[
        Repeated,
        typer.Option(
            metavar="QUANTITY=LIMIT",
            help="Upper limit of a quantity, with its sign; repeatable.",
        ),
    ] = None,
    at_least: Annotated[
        Repeated,
        typer.Option(
            metavar="QUANTITY=LIMIT",
            help="Lower limit of a quantity, with its sign; repeatable.",
        ),
    ] = None,
    bounds: Bounds = None,
    step: FixedStep = None,
    t: LoadTime = 0.0,
    start: Starts = None,
    max_evaluations: Annotated[
        int, typer.Option(help="Maximum number of evaluated designs.")
    ] = 200,
    starts: StartCount = 1,
    seed: StartSeed = 0,
) -> None:
    """Minimize a quantity of a model under constraints; write the designs and a page.

    Exits with 0 if the search converged, 1 if not (the best design is written) or if the page
    failed, 2 for a usage or model error, and 130 after Ctrl-C (the best design so far is written).
    """
    if (minimize is None) == (maximize is None):
        raise BeamdaeError("optimize: pass either --minimize or --maximize.")
    model = job.model
    history, searches = job.output("_designs.csv"), job.output("_design_starts.csv")
    files = job.plan("_design", history, *[searches] * (starts > 1))
    texts = [minimize or maximize, *(at_most or []), *(at_least or [])]
    if t and not any(str(x).startswith("equilibrium:") for x in texts):
        raise BeamdaeError(f"--t {t:g}: no quantity is of the kind equilibrium:COLUMN; add one.")
    parse = partial(_parse_quantity, model, t)
    objective = (
        parse("--minimize", minimize) if maximize is None else -parse("--maximize", maximize)
    )
    limits = [_parse_limit(parse, "--at-most", x) for x in at_most or []]
    limits += [_parse_limit(parse, "--at-least", x) for x in at_least or []]
    ranges, initial_state = parse_bounds(model, bounds), job.start(start)

    def analyze() -> Optimization:
        from beamdae.analysis.optimization.optimize import optimize
        from beamdae.integrators import GeneralizedAlpha

        with show_design_progress(starts * max_evaluations) as progress:
            return optimize(
                model,
                objective,
                split_names(by),
                limits,
                ranges,
                None if step is None else GeneralizedAlpha(step=step),
                start=initial_state,
                max_evaluations=max_evaluations,
                starts=starts,
                seed=seed,
                progress=progress,
                partial="return",
            )

    def write_tables(result: Optimization) -> list[Path]:
        from beamdae.results.storage.files import write_escaped_table

        design = result.table().rename_axis("parameter").reset_index()
        written = [write_escaped_table(files.table, design), result.to_csv(history)]
        if result.starts is not None:
            written.append(write_escaped_table(searches, result.starts))
        return written

    job.run(files, "optimization", analyze, write_tables)


def _parse_quantity(model: Model, t: float, option: str, text: Any) -> Quantity:
    """Return the quantity KIND:NAME, with equilibria at the time `t` [s], or a parameter."""
    from beamdae.analysis.gradients.objectives import EndValue, SmoothMaximum, TimeIntegral
    from beamdae.analysis.optimization.quantities import (
        EquilibriumValue,
        Frequency,
        Mass,
        ParameterFunction,
    )

    kind, _, name = str(text).partition(":")
    number, _, about = name.partition(":")
    is_frequency = number.isdigit() and name in (number, *(f"{number}:{x}" for x in _STATES))
    kinds: dict[str, Callable[[], Quantity]] = {
        "frequency": lambda: Frequency(int(number), about or None),
        "equilibrium": lambda: EquilibriumValue(name, t=t),
        "end": lambda: EndValue(name),
        "maximum": lambda: SmoothMaximum(name),
        "integral": lambda: TimeIntegral(name),
    }
    if kind == "mass" and not name:
        return Mass()
    if text in model.parameters:
        unit = model.parameter_info[text].unit
        return ParameterFunction(lambda **parameters: parameters[text], text, unit)
    if kind not in kinds or not (is_frequency if kind == "frequency" else name):
        raise BeamdaeError(f"{option} {text}: the quantity must be one of {_KINDS}.")
    return kinds[kind]()


def _parse_limit(parse: Callable[[str, str], Quantity], option: str, text: str) -> Limit:
    """Return the constraint QUANTITY=LIMIT."""
    from beamdae.analysis.optimization.quantities import at_least, at_most
    from beamdae.model_parameters import parse_quantity

    quantity, _, limit = text.rpartition("=")
    if not quantity or parse_quantity(limit) is None:
        raise BeamdaeError(
            f"{option} {text}: the constraint must have the form QUANTITY=LIMIT, with a number in "
            "SI units, or with a unit, as limit."
        )
    create = at_most if option == "--at-most" else at_least
    return create(parse(option, quantity), limit)
