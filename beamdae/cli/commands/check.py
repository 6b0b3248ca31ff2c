"""`beamdae check`: what a model is and what is wrong with it, without a run to its end."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.options import ModelFile, ModelName, Settings, load_configured_model
from beamdae.cli.output import create_console, record_results
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.checks import Check


def check_command(
    path: ModelFile,
    settings: Settings = None,
    model_name: ModelName = None,
    predict: Annotated[
        bool, typer.Option(help="Predict steps and time by a trial of a second.")
    ] = True,
) -> None:
    """Build a model, find its consistent start, and explain what it can do and what is wrong.

    Ends with 0 where it can be run, and with 2 after a mistake, which the report explains.
    """
    model = load_configured_model(path, model_name, settings)
    from beamdae.checks import check
    from beamdae.parts.mechanism import Mechanism
    from beamdae.report.terminal import text_tables
    from beamdae.report.terminal.check_report import describe_check

    mechanism = model()
    found = check(mechanism, model.t_end, predict)
    parts = mechanism.parts if isinstance(mechanism, Mechanism) else {}
    facts = dict(describe_check(found))
    for name, part in parts.items():
        facts |= {
            f"{name}, {what}": text_tables.format_number(value)
            for what, value in part.facts.items()
        }
    kinds = {name: type(part).__name__ for name, part in parts.items()}
    record_results(lambda: {**_json_results(found), "parts": kinds})
    screen = create_console()
    screen.print(model.name, style="bold")
    if parts:
        screen.print(text_tables.parts_table(kinds))
    screen.print(text_tables.fact_list("", facts))
    if not found.ok:
        raise BeamdaeError(found.problem)


def _json_results(check: Check) -> dict[str, Any]:
    """What --json tells of a check."""
    told = asdict(check)
    del told["name"]
    return {"ok": check.ok, "mobility": check.mobility, **told}
