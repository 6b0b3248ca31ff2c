"""`beamdae bode`: linear frequency response of a model, as a table, a picture and a page."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.job import AccurateJob
from beamdae.cli.options import About, LoadTime, as_bad_parameter, find_state, split_names
from beamdae.cli.ranges import SPACED_FORMS, parse_ends, parse_spaced_values
from beamdae.cli.results import Report
from beamdae.errors import BeamdaeError, short_repr

if TYPE_CHECKING:
    from beamdae.analysis.linear_dynamics.bode_diagram import Bode
    from beamdae.analysis.linear_dynamics.linear_model import LinearModel
    from beamdae.analysis.linear_dynamics.stability_margins import StabilityMargins

_COUNTS = (1, 100_000)  # of frequencies
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
    try:
        if text.count(":") > 1:
            values = parse_spaced_values("--frequencies", "", text, "Hz", _COUNTS, _FORMS)
            ends = values[0], values[-1]
        else:
            ends = parse_ends("--frequencies", "", text, "Hz", _FORMS)
    except BeamdaeError as problem:
        raise as_bad_parameter(text, problem) from None
    if not 0.0 < ends[0] <= ends[1] < math.inf or (values is None and ends[0] == ends[1]):
        raise typer.BadParameter(f"{short_repr(text)}: frequencies must be positive and ascend.")
    return values, None if values else ends


def bode_command(
    job: AccurateJob,
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
    about: About = None,
    t: LoadTime = 0.0,
) -> None:
    """Compute the linear frequency response (transfer functions); write CSV, PNG and page.

    Amplitudes are small; `response` computes nonlinear periodic motions. The input of a driver is
    its acceleration. The margins of the loop of each `pid` are printed, too.

    Exits with 0 on success, 1 if --accuracy was not reached or the page or the picture failed, and
    2 for a usage or model error.
    """
    grid, ends = frequencies or (None, None)
    files, mechanism = job.plan("_bode"), job.mechanism
    state = find_state("bode", mechanism, about)
    selected = [split_names(x) or None for x in (inputs, outputs)]

    def analyze() -> Bode:
        from beamdae.analysis.linear_dynamics.bode_diagram import bode
        from beamdae.analysis.linear_dynamics.linear_model import linearize

        linear = linearize(mechanism, state, selected[0], selected[1], t)
        if not linear.inputs or not linear.outputs:
            kind = (
                "inputs, such as a force" if not linear.inputs else "outputs, such as an observable"
            )
            raise BeamdaeError(f"bode: the model has no {kind}; add one.")
        return bode(linear, grid, ends, **job.accuracy)

    job.run(files, "linear response", analyze, complete=partial(_add_margins, mechanism.outputs))


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


def _add_margins(controllers: Iterable[str], diagram: Bode, report: Report) -> Report:
    """Add the margins of control loops."""
    loops, notes = _compute_margins(diagram.model, controllers)
    x = report.description
    margins = {loop: margin.table() for loop, margin in loops.items()}
    description = replace(
        x,
        facts={**x.facts, **{f"loop of {loop}": str(margin) for loop, margin in loops.items()}},
        data=lambda: {**x.data(), "margins": margins},
    )
    warnings = [*report.warnings, *notes]
    return replace(report, description=description, warnings=warnings, source="--json")
