"""`beamdae optimize`: parameters of a model that minimize a quantity under constraints."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.job import Job
from beamdae.cli.options import (
    Bounds,
    FixedStep,
    LoadTime,
    StartCount,
    Starts,
    StartSeed,
    parse_bounds,
    split_names,
)
from beamdae.cli.progress import show_design_progress
from beamdae.errors import BeamdaeError

# NumPy and CasADi are imported inside functions, so that --help responds quickly.
if TYPE_CHECKING:
    from beamdae.analysis.gradients.objectives import Quantity
    from beamdae.analysis.optimization.quantities import Limit
    from beamdae.analysis.optimization.result import Optimization
    from beamdae.model_functions import Model

_KINDS = (
    "mass, frequency:NUMBER, frequency:NUMBER:equilibrium, frequency:NUMBER:reference, "
    "equilibrium:COLUMN, end:COLUMN, maximum:COLUMN, integral:COLUMN, or the name of a parameter"
)
_STATES = ("equilibrium", "reference")


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
        list[str] | None,
        typer.Option(
            metavar="QUANTITY=LIMIT",
            help="Upper limit of a quantity, with its sign; repeatable.",
        ),
    ] = None,
    at_least: Annotated[
        list[str] | None,
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
    history, searches = job.path("_designs.csv"), job.path("_design_starts.csv")
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
