"""`beamdae bode`: linear frequency response of a model, as a table, a picture and a page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.options import (
    STATES,
    About,
    AccurateColumns,
    LoadTime,
    ModelName,
    ModelPath,
    Out,
    Page,
    Picture,
    RequiredAccuracy,
    Settings,
    as_bad_parameter,
    load_configured_model,
    parse_number,
    required_accuracy,
    split_names,
)
from beamdae.cli.output import (
    WrittenFiles,
    current_output,
    print_accuracy,
    print_facts,
    print_warnings,
)
from beamdae.cli.output_paths import plan_outputs
from beamdae.cli.ranges import SPACED_FORMS, parse_ends, parse_spaced_values
from beamdae.errors import BeamdaeError, format_count, require_choice, short_repr

if TYPE_CHECKING:
    from beamdae.analysis.linear_dynamics.bode_diagram import Bode
    from beamdae.analysis.linear_dynamics.linear_model import LinearModel
    from beamdae.analysis.linear_dynamics.stability_margins import StabilityMargins

_COUNTS = (1, 100_000)  # of frequencies
_MAX_SHOWN_PEAKS = 10  # of each transfer function in the terminal
_FORMS = f"FIRST:LAST, {SPACED_FORMS}"


def parse_frequencies(text: str) -> tuple[list[float] | None, tuple[float, float] | None]:
    """Return the frequencies [Hz] of --frequencies, or the ends of the default ones.

    Raises
    ------
    typer.BadParameter
        If a number or its unit is invalid, the text does not have one of the forms, or frequencies
        are not positive and ascending.
    """
    values: list[float] | None = None
    ends: tuple[float, float] | None
    try:
        if text.count(":") > 1:
            values = parse_spaced_values("--frequencies", "", text, "Hz", _COUNTS, _FORMS)
            ends = values[0], values[-1]
        else:
            ends = parse_ends("--frequencies", "", text, "Hz")
    except BeamdaeError as problem:
        raise as_bad_parameter(text, problem) from None
    if ends is None:
        raise typer.BadParameter(f"{short_repr(text)} must have the form {_FORMS}.")
    if not 0.0 < ends[0] <= ends[1] < math.inf or (values is None and ends[0] == ends[1]):
        raise typer.BadParameter(f"{short_repr(text)}: frequencies must be positive and ascend.")
    return values, None if values else ends


def bode_command(
    path: ModelPath,
    inputs: Annotated[
        list[str] | None,
        typer.Option(
            "--input",
            metavar="NAME",
            help="Input, force, moment or driver that excites the model, or a column such as "
            "push.Fy, or several separated by commas; repeatable. Defaults to all of them.",
        ),
    ] = None,
    outputs: Annotated[
        list[str] | None,
        typer.Option(
            "--output",
            metavar="NAME",
            help="Column or observable, or several separated by commas; repeatable. Defaults to "
            "all observables.",
        ),
    ] = None,
    frequencies: Annotated[
        Any,
        typer.Option(
            parser=parse_frequencies,
            metavar="FIRST:LAST",
            help="Range in Hz, or with a unit (0.1:1kHz), in which all resonances have their own "
            "frequencies, or START:STOP:COUNT with :log or without it for these frequencies only. "
            "Defaults to the range of the resonances, for which elements are short enough.",
        ),
    ] = None,
    settings: Settings = None,
    model_name: ModelName = None,
    about: About = "reference",
    speed: Annotated[
        float | None,
        typer.Option(
            parser=lambda text: parse_number(text, "rad/s"),
            metavar="SPEED",
            help="Linearize about a steady rotation at this speed in rad/s, or with a unit "
            "(3000rpm).",
        ),
    ] = None,
    t: LoadTime = 0.0,
    accuracy: RequiredAccuracy = None,
    accuracy_columns: AccurateColumns = None,
    page: Page = True,
    picture: Picture = True,
    out: Out = Path("results"),
) -> None:
    """Compute the linear frequency response (transfer functions); write CSV, PNG and page.

    Amplitudes are small; `response` computes nonlinear periodic motions. The input of a driver is
    its acceleration. The margins of the loop of each `pid` are printed, too.

    Exits with 0 on success, 1 if --accuracy was not reached or the page or the picture failed, and
    2 for a usage or model error.
    """
    from beamdae.cli.model_files.model_file import ModelFile

    model = load_configured_model(ModelFile(path), model_name, settings)
    require_choice("bode", "--about", about, STATES)
    if speed is not None and about != "reference":
        raise BeamdaeError(f"bode: --about {about} and --speed are mutually exclusive; omit one.")
    grid, ends = frequencies or (None, None)
    table_path, picture_path = plan_outputs(out, f"{model.name}_bode", picture, page)
    page_path = table_path.with_suffix(".html")
    from beamdae.analysis.linear_dynamics.bode_diagram import bode
    from beamdae.analysis.linear_dynamics.linear_model import linearize
    from beamdae.parts.rotation import rotation
    from beamdae.report.analysis_pages import write_analysis_page
    from beamdae.report.pictures.bode_plots import create_bode_figure
    from beamdae.report.pictures.figures import save_figure
    from beamdae.results.storage.files import escape_table, write_text

    mechanism = model()
    state = about if speed is None else rotation(speed)
    selected = [split_names(x, model) or None for x in (inputs, outputs)]
    linear = linearize(mechanism, state, selected[0], selected[1], t)
    if not linear.inputs or not linear.outputs:
        kind = "inputs, such as a force" if not linear.inputs else "outputs, such as an observable"
        raise BeamdaeError(f"bode: the model has no {kind}; add one.")
    accurate = required_accuracy("bode", accuracy, accuracy_columns, model)
    diagram = bode(linear, grid, ends, **accurate)
    output = current_output()
    has_readers = output.as_json or not output.quiet
    loops, notes = _compute_margins(linear, mechanism.outputs if has_readers else ())
    table = escape_table(diagram.table()).to_csv(index=False)
    files = WrittenFiles([write_text(table_path, table)], (page_path, picture_path))
    _print_results(diagram, loops, notes, model.name)
    title = f"{model.name}, linear response about {linear.about}"
    if page:
        files.write(page_path.name, lambda: [write_analysis_page(diagram, page_path, title)])
    if picture:
        files.write(
            picture_path.name,
            lambda: [save_figure(create_bode_figure(diagram, title), picture_path)],
        )
    files.finish(result=diagram)


def _compute_margins(
    linear: LinearModel, controllers: Iterable[str]
) -> tuple[dict[str, StabilityMargins], list[str]]:
    """Return the margins of the loop of each `pid`, and why loops have none."""
    from beamdae.analysis.linear_dynamics.stability_margins import margins

    loops: dict[str, StabilityMargins] = {}
    notes = []
    for name in controllers:
        try:
            loops[name] = margins(linear, name)
        except BeamdaeError as problem:
            notes.append(str(problem))
            continue
        notes.extend(loops[name].warnings)
    return loops, notes


def _print_results(
    diagram: Bode, loops: Mapping[str, StabilityMargins], notes: Sequence[str], name: str
) -> None:
    from beamdae.report.terminal import text_tables

    peaks, linear = diagram.peak_table(), diagram.model
    first, last = diagram.frequencies[[0, -1]].tolist()
    facts = {
        "about": linear.about,
        "states": str(len(linear.states)),
        "frequencies": f"{len(diagram.frequencies)}, {first:.4g} to {last:.4g} Hz",
        **{f"loop of {loop}": str(x) for loop, x in loops.items()},
    }
    console = print_facts(
        name,
        facts,
        lambda: {
            "about": linear.about,
            "response": diagram.table().to_dict("records"),
            "peaks": peaks.to_dict("records"),
            "margins": {loop: x.table().to_dict("records") for loop, x in loops.items()},
        },
    )
    ranks = peaks.groupby("output / input")["magnitude"].rank("first", ascending=False)
    shown = peaks[ranks <= _MAX_SHOWN_PEAKS]
    console.print(text_tables.bode_table(shown))
    if len(shown) < len(peaks):
        count = format_count(len(peaks) - len(shown), "peak")
        console.print(
            f"not shown: {count} beyond the {_MAX_SHOWN_PEAKS} largest of a transfer function; "
            "--json shows them",
            style="dim",
        )
    print_accuracy(console, diagram)
    print_warnings(console, [*diagram.warnings, *notes])
