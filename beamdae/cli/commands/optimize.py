"""`beamdae optimize`: parameters of a model that minimize a quantity under constraints."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.options import (
    Bounds,
    FixedStep,
    LoadTime,
    ModelName,
    ModelPath,
    Out,
    Page,
    Picture,
    Settings,
    StartCount,
    Starts,
    StartSeed,
    load_model,
    parse_bounds,
    parse_start,
    split_names,
)
from beamdae.cli.progress import show_design_progress
from beamdae.cli.results import Report, ResultFiles, named_reasons, run_analysis
from beamdae.errors import BeamdaeError

# NumPy and CasADi are imported inside functions, so that --help responds quickly.
if TYPE_CHECKING:
    from beamdae.analysis.optimization.quantities import Limit, Quantity
    from beamdae.analysis.optimization.result import Optimization
    from beamdae.model_functions import Model

_KINDS = (
    "mass, frequency:NUMBER, frequency:NUMBER:equilibrium, frequency:NUMBER:reference, "
    "equilibrium:COLUMN, end:COLUMN, maximum:COLUMN, integral:COLUMN, or the name of a parameter"
)
_STATES = ("equilibrium", "reference")


def optimize_command(
    path: ModelPath,
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
    settings: Settings = None,
    model_name: ModelName = None,
    step: FixedStep = None,
    t: LoadTime = 0.0,
    start: Starts = None,
    method: Annotated[str, typer.Option(help="SLSQP or IPOPT.")] = "SLSQP",
    max_evaluations: Annotated[
        int, typer.Option(help="Maximum number of evaluated designs.")
    ] = 200,
    starts: StartCount = 1,
    seed: StartSeed = 0,
    page: Page = True,
    picture: Picture = True,
    out: Out = Path("results"),
) -> None:
    """Minimize a quantity of a model under constraints; write the designs and a page.

    Exits with 0 if the search converged, 1 if not (the best design is written) or if the page
    failed, 2 for a usage or model error, and 130 after Ctrl-C (the best design so far is written).
    """
    if (minimize is None) == (maximize is None):
        raise BeamdaeError("optimize: pass either --minimize or --maximize.")
    model, _ = load_model(path, model_name, settings)
    history, searches = (out / f"{model.name}_{name}.csv" for name in ("designs", "design_starts"))
    further = [history, *[searches] * (starts > 1)]
    files = ResultFiles.plan(out, f"{model.name}_design", page, picture, *further)
    texts = [minimize or maximize, *(at_most or []), *(at_least or [])]
    if t and not any(str(x).startswith("equilibrium:") for x in texts):
        raise BeamdaeError(f"--t {t:g}: no quantity is of the kind equilibrium:COLUMN; add one.")
    parse = partial(_parse_quantity, model, t)
    objective = (
        parse("--minimize", minimize) if maximize is None else -parse("--maximize", maximize)
    )
    limits = [_parse_limit(parse, "--at-most", x) for x in at_most or []]
    limits += [_parse_limit(parse, "--at-least", x) for x in at_least or []]
    ranges, initial_state = parse_bounds(model, bounds), parse_start(start, model)

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
                method=method,  # type: ignore[arg-type]
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

    run_analysis(
        files,
        f"{model.name}, optimization",
        analyze,
        partial(_describe, model.name),
        _draw,
        write_tables,
        lambda result, path: result.page(path),
    )


def _parse_quantity(model: Model, t: float, option: str, text: Any) -> Quantity:
    """Return the quantity KIND:NAME, with equilibria at the time `t` [s], or a parameter."""
    from beamdae.analysis.gradients.objectives import EndValue, SmoothMaximum, TimeIntegral
    from beamdae.analysis.optimization.quantities import (
        EquilibriumValue,
        Frequency,
        Mass,
        ParameterFunction,
        as_quantity,
    )

    kind, _, name = str(text).partition(":")
    number, _, about = name.partition(":")
    is_frequency = number.isdigit() and name in (number, *(f"{number}:{x}" for x in _STATES))
    kinds: dict[str, Any] = {
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
    return as_quantity(option, kinds[kind]())


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


def _describe(name: str, result: Optimization) -> Report:
    from beamdae.model_parameters import format_with_unit
    from beamdae.report.terminal import text_tables

    design = result.table()
    facts = {
        "objective": f"{result.objective_label} = {result.objective_text}",
        "designs": str(result.evaluations),
        "at a bound": "; ".join(result.bound_notes) or "none",
    }
    if searches := result.describe_starts():
        facts["searches"] = searches
    facts |= {
        format_with_unit(x.name, x.unit): f"{format_with_unit(x.value, x.unit)}, {x.comparison}"
        for x in result.constraints
    }
    facts |= {
        str(parameter): format_with_unit(float(row["value"]), row["unit"])
        for parameter, row in design.iterrows()
    }
    tables = []
    if result.starts is not None:
        units = {x: result.units[x] for x in map(str, design.index)}
        starts = named_reasons(result.starts)
        tables = [text_tables.searches_table(starts, units, "objective", "designs")]
    return Report(
        name,
        lambda: {
            "status": result.status.kind,
            "reason": result.status.sentence,
            "objective": result.objective,
            "parameters": dict(design["value"]),
            "constraints": result.constraint_table().to_dict("records"),
            "evaluations": result.evaluations,
            "at bounds": list(result.at_bounds),
            "searches": None if result.starts is None else result.starts.to_dict("records"),
        },
        result.status,
        facts,
        tables,
        warnings=result.warnings,
    )


def _draw(result: Optimization, path: Path, _: str) -> Path | None:
    """Write a drawing of the best design; None for equations without a shape."""
    from beamdae.parts.mechanism import Mechanism

    best = result.mechanism()
    return best.draw().save(path) if isinstance(best, Mechanism) else None
