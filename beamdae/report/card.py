"""A run in a notebook: how it ended, what it cost, how good it is, how it moved."""

from __future__ import annotations

import html
from collections.abc import Mapping

from beamdae.errors import BeamdaeError
from beamdae.report.pictures.run_animation import draw_thumbnail
from beamdae.report.terminal.text_tables import format_number
from beamdae.results.event_records import format_event_times
from beamdae.results.solution import Solution

_CELL = 'style="text-align: left; padding: 1px 12px 1px 0; vertical-align: top; {}"'
_NAME, _VALUE = _CELL.format("white-space: nowrap"), _CELL.format("")


def card(solution: Solution) -> str:
    """The run as a piece of HTML that needs nothing else."""
    return (
        '<div style="display: flex; gap: 24px; align-items: center">'
        f"<div><b>{html.escape(_title(solution))}</b>{table(_facts(solution))}</div>"
        f"<div>{_picture(solution)}</div></div>"
    )


def _title(solution: Solution) -> str:
    name = solution.model.get("name", "")
    method = str(solution.integrator.get("integrator", ""))
    return " by ".join(filter(None, (name, method))) or "run"


def _facts(solution: Solution) -> dict[str, str]:
    cost, quality, status = solution.statistics, solution.quality, solution.status
    facts = {
        "status": f"{status.kind}: {status.sentence}",
        "time": f"{solution.t[0]:g} s to {solution.trajectory.end:g} s, {len(solution.t)} rows",
        "cost": f"{cost.steps} steps, {cost.rejected_steps} rejected, {format_number(cost.wall_time)} s",
        "energy imbalance": format_number(quality.energy_imbalance),
        "drift": f"{format_number(quality.max_position_drift)}, {format_number(quality.max_velocity_drift)} "
        "(positions, velocities)",
        "observed": ", ".join(o.name for o in solution.equations.observables) or "nothing",
    }
    if solution.equations.events:
        facts["events"] = format_event_times(solution.event_records)
    for k, sentence in enumerate(solution.warnings):
        facts[f"warning {k + 1}"] = sentence
    return facts


def table(facts: Mapping[str, str]) -> str:
    """Facts by their names, as HTML."""
    rows = "".join(
        f"<tr><td {_NAME}>{html.escape(name)}</td><td {_VALUE}>{html.escape(value)}</td></tr>"
        for name, value in facts.items()
    )
    return f"<table>{rows}</table>"


def _picture(solution: Solution) -> str:
    try:
        return draw_thumbnail(solution)
    except BeamdaeError:
        # Equations have no shape.
        return ""
