"""HTML summary of a run for notebooks: status, cost and accuracy."""

from __future__ import annotations

import html
from collections.abc import Mapping

from beamdae.report.terminal.text_tables import format_number
from beamdae.results.event_records import describe_events
from beamdae.results.solution import Solution

_CELL_STYLE = 'style="text-align: left; padding: 1px 12px 1px 0; vertical-align: top; {}"'
_NAME_STYLE = _CELL_STYLE.format("white-space: nowrap")
_VALUE_STYLE = _CELL_STYLE.format("")


def summarize_as_html(solution: Solution) -> str:
    """Return the summary of a run as a self-contained HTML fragment."""
    name = solution.model.get("name", "")
    method = str(solution.integrator.get("integrator", ""))
    title = " by ".join(filter(None, (name, method))) or "run"
    return f"<div><b>{html.escape(title)}</b>{format_html_table(_collect_facts(solution))}</div>"


def _collect_facts(solution: Solution) -> dict[str, str]:
    cost, quality, status = solution.statistics, solution.quality, solution.status
    wall_time = format_number(cost.wall_time)
    position_drift = format_number(quality.max_position_drift)
    velocity_drift = format_number(quality.max_velocity_drift)
    facts = {
        "status": f"{status.kind}: {status.sentence}",
        "time": f"{solution.t[0]:g} s to {solution.trajectory.end:g} s, {len(solution.t)} rows",
        "cost": f"{cost.steps} steps, {cost.rejected_steps} rejected, {wall_time} s",
        "energy imbalance": format_number(quality.energy_imbalance),
        "drift": f"{position_drift}, {velocity_drift} (positions, velocities)",
        "observed": ", ".join(o.name for o in solution.equations.observables) or "nothing",
    }
    if solution.equations.events:
        facts["events"] = describe_events(
            solution.equations, solution.trajectory, solution.event_records
        )
    for k, sentence in enumerate(solution.warnings):
        facts[f"warning {k + 1}"] = sentence
    return facts


def format_html_table(facts: Mapping[str, str]) -> str:
    """Return an HTML table with a column of names and a column of values."""
    rows = "".join(
        f"<tr><td {_NAME_STYLE}>{html.escape(name)}</td>"
        f"<td {_VALUE_STYLE}>{html.escape(value)}</td></tr>"
        for name, value in facts.items()
    )
    return f"<table>{rows}</table>"
