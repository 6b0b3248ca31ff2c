"""`beamdae check`: build a model and report its structure, defects and predicted cost."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.options import (
    ModelName,
    ModelPath,
    Settings,
    Starts,
    load_model,
    parse_start,
)
from beamdae.cli.output import record_warning
from beamdae.cli.results import Report
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.checks import Check


def check_command(
    path: ModelPath,
    settings: Settings = None,
    model_name: ModelName = None,
    start: Starts = None,
    predict: Annotated[
        bool, typer.Option(help="Predict steps and wall time from at most 1 s of the run.")
    ] = True,
) -> None:
    """Build a model, compute its consistent start, and report its mobility, errors and defects.

    Exits with 0 if the model can be run, and with 2 and a message for a usage or model error.
    """
    model, _ = load_model(path, model_name, settings)
    from beamdae.checks import check
    from beamdae.parts.mechanism import Mechanism
    from beamdae.report.descriptions import Description
    from beamdae.report.summaries import describe_check

    mechanism = model()
    result = check(mechanism, model.t_end, predict, parse_start(start, model))
    parts = mechanism.parts if isinstance(mechanism, Mechanism) else {}
    for sentence in result.warnings:
        record_warning(sentence)
    facts = describe_check(result)
    name = f"{model.name}: {facts.pop('verdict')}"
    types = {name: type(part).__name__ for name, part in parts.items()}
    data = _json_results(result) | {"parts": types}
    Report(name, Description(facts, data=lambda: data)).print()
    if not result.ok:
        raise BeamdaeError(result.problem)


def _json_results(check: Check) -> dict[str, Any]:
    results = asdict(replace(check, errors=None))
    del results["name"], results["warnings"], results["errors"]
    return {"ok": check.ok, "mobility": check.mobility, **results}
