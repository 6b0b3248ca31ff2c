"""`beamdae sweep`: run a model over values of its parameters, or run the sweep of a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.option_values import SPACED_FORMS, parse_assignments, parse_spaced_values
from beamdae.cli.options import (
    About,
    FixedStep,
    IntegratorName,
    RelativeTolerance,
    Repeated,
    create_integrator,
    find_state,
)
from beamdae.cli.results import Report
from beamdae.cli.study_outputs import StudyJob, StudyReport, results_folder_name
from beamdae.errors import BeamdaeError, require_count

# NumPy and CasADi are imported inside functions, so that --help responds quickly.
if TYPE_CHECKING:
    from beamdae.cli.model_file import ModelFile
    from beamdae.model_functions import Model
    from beamdae.studies.study_run import StudyResults
    from beamdae.studies.sweeps.sweep import Sweep

_VALUE_FORMS = f"VALUE,VALUE,... or {SPACED_FORMS}"
_MAX_MEASURES = 100


def sweep_command(
    job: StudyJob,
    over: Annotated[
        Repeated,
        typer.Option(
            metavar="NAME=VALUES",
            help=f"Parameter to vary and its values: {_VALUE_FORMS}; repeatable.",
        ),
    ] = None,
    of: Annotated[
        Repeated,
        typer.Option(
            metavar="COLUMN",
            help="Observed column to evaluate, for example tip.y, or several separated by commas; "
            "repeatable. Defaults to all, of which the terminal shows up to three.",
        ),
    ] = None,
    modes: Annotated[
        int | None,
        typer.Option(metavar="N", help="Compute N natural frequencies instead of runs."),
    ] = None,
    buckling: Annotated[
        int | None,
        typer.Option(metavar="N", help="Compute N buckling load factors instead of runs."),
    ] = None,
    about: About = None,
    integrator: IntegratorName = "auto",
    rtol: RelativeTolerance = None,
    step: FixedStep = None,
) -> None:
    """Run a model over all combinations of parameter values; write a table, plots and a page.

    The table contains the final value, minimum, maximum and root mean square of the observed
    columns of each run; the row of a failed run contains the reason. With --modes or --buckling, it
    contains natural frequencies or load factors, and there are no runs. A file with a sweep
    (@bd.sweep) needs no --over. Finished runs are stored in the results folder: run the same
    command again to resume. The exit codes are the same as for compare.
    """
    from beamdae.cli.model_file import ModelFile

    named = None if integrator == "auto" else integrator
    method_options = {"--integrator": named, "--rtol": rtol, "--step": step}
    if about is not None and modes is None:
        raise BeamdaeError("sweep: --about requires --modes; use both options or neither.")
    if modes is not None or buckling is not None:
        if not over:
            raise BeamdaeError("sweep: --modes and --buckling require --over NAME=VALUES.")
        settings_of_runs = {"--of": of, "--time-limit": job.time_limit, "--t-end": job.t_end}
        settings_of_runs |= {"--output-step": job.output_step, "--start": job.start}
        reason = (
            "is an option of runs, but with --modes or --buckling the model is not run; omit it."
        )
        _reject_options(method_options | settings_of_runs, reason)
        model = ModelFile(job.path).model(job.model_name)
        measure = _create_measure(model, modes, buckling, about)
        kind = "_".join(["sweep", *(["modes"] * bool(modes)), *(["buckling"] * bool(buckling))])
        sweep = _sweep_from_options(model, over, job.settings, measure, kind=kind)
    elif over:
        file = ModelFile(job.path)
        method = create_integrator("sweep", integrator, {"rtol": rtol, "step": step}, file)
        model = file.model(job.model_name)
        sweep = _sweep_from_options(model, over, job.settings, None, method)
    else:
        reason = "requires --over; to change a sweep in a file, edit the file."
        _reject_options({"--set": job.settings, **method_options}, reason)
        sweep = _sweep_of_file(ModelFile(job.path), job.model_name)
    job.run(sweep, of, _create_report)


def _sweep_from_options(
    model: Model,
    over: list[str],
    settings: list[str] | None,
    measure: dict[str, Any] | None,
    integrator: Any = None,
    kind: str = "sweep",
) -> Sweep:
    from beamdae.studies.sweeps.sweep import create_sweep

    constants = parse_assignments(settings)
    ranges = parse_assignments(over, "--over")
    for name in ranges:
        if name in constants:
            raise BeamdaeError(
                f"--over {name}: the parameter is also set by --set; omit one of the options."
            )
    values = {name: parse_values(model, name, text) for name, text in ranges.items()}
    values |= {name: [value] for name, value in constants.items()}
    folder = results_folder_name("_".join([model.name, kind, *ranges]), constants)
    return create_sweep(model, values, folder, measure, integrator=integrator)


def _create_measure(
    model: Model, modes: int | None, buckling: int | None, about: str | None
) -> dict[str, Any]:
    """Return the measures of --modes and --buckling."""
    from beamdae.studies.sweeps.sweep import buckling_factors, natural_frequencies

    def count(option: str, n: int) -> int:
        return require_count("sweep", option, n, most=_MAX_MEASURES)

    measure: dict[str, Any] = {}
    if modes is not None:
        state = find_state("sweep", model(), about)
        measure |= natural_frequencies(count("--modes", modes), state)
    if buckling is not None:
        measure |= buckling_factors(count("--buckling", buckling))
    return measure


def _reject_options(options: Mapping[str, Any], reason: str) -> None:
    """Raise an error for the first option that has a value."""
    for option, value in options.items():
        if value is not None:
            raise BeamdaeError(f"sweep: {option} {reason}")


def parse_values(model: Model, name: str, text: str) -> list[Any]:
    """Return the values of --over NAME=TEXT.

    Raises
    ------
    BeamdaeError
        If the parameter is unknown, a value has the wrong type, or a range has a wrong form.
    """
    if type(model.parameters.get(name)) in (int, float) and ":" in text:
        from beamdae.studies.case import MAX_CASES

        unit = model.parameter_info[name].unit
        values = parse_spaced_values("--over", name, text, unit, (1, MAX_CASES), _VALUE_FORMS)
        return [model.complete({name: value})[name] for value in values]
    return [model.complete({name: part.strip()})[name] for part in _split_at_commas(text)]


def _split_at_commas(text: str) -> list[str]:
    parts, depth = [""], 0
    for character in text:
        depth += (character in "([{") - (character in ")]}")
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return parts


def _sweep_of_file(file: ModelFile, name: str | None) -> Sweep:
    """Return the sweep called `name`, or the only sweep of the file."""
    from beamdae.cli.model_file import select_by_name
    from beamdae.studies.sweeps.sweep import Sweep

    models = file.models
    sweeps = {key: study for key, study in file.studies.items() if isinstance(study, Sweep)}
    if not sweeps:
        candidates = [models[name]] if name in models else list(models.values())
        parameters = ", ".join(parameter for model in candidates for parameter in model.parameters)
        raise BeamdaeError(
            f"{file.path}: the file contains no sweep; vary a parameter with --over "
            f"NAME=VALUES (parameters: {parameters or 'none'})."
        )
    return select_by_name(file.path, "sweep", sweeps, name)


def _create_report(results: StudyResults) -> StudyReport:
    from beamdae.report import tables
    from beamdae.report.descriptions import Description
    from beamdae.studies.sweeps.response_plots import list_response_plots
    from beamdae.studies.sweeps.sweep_results import TABLE_FILE, create_sweep_results

    swept, folder = create_sweep_results(results), results.folder
    sweep, table = swept.sweep, swept.table
    shown: dict[str, Any] = {"completion": results.describe_completion(sweep.cases)}
    responses = [list(panel.lines.values()) for panel in swept.panels()]
    shown["cases"] = tables.sweep_table(table, swept.parameters, responses)
    data = {
        "sweep": sweep.name,
        "folder": folder,
        "interrupted": swept.interrupted,
        "cases": table,
    }
    return StudyReport(
        results,
        Report(
            sweep.name,
            Description({}, shown, lambda: data),
            warnings=swept.warnings,
            source=TABLE_FILE,
        ),
        [*(folder / name for name in results.tables), swept.to_csv(folder / TABLE_FILE)],
        swept.page,
        list_response_plots(sweep, table, swept.panels()),
    )
