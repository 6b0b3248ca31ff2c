"""HTML summary of a run for notebooks: status, cost and accuracy."""

from __future__ import annotations

import html
from collections.abc import Mapping

from beamdae.report.terminal.text_tables import run_facts
from beamdae.results.solution import Solution

_CELL_STYLE = 'style="text-align: left; padding: 1px 12px 1px 0; vertical-align: top; {}"'
_NAME_STYLE = _CELL_STYLE.format("white-space: nowrap")
_VALUE_STYLE = _CELL_STYLE.format("")


def summarize_as_html(solution: Solution) -> str:
    """Return the summary of a run as a self-contained HTML fragment."""
    name = solution.model.get("name", "")
    method = str(solution.integrator.get("integrator", ""))
    title = " by ".join(filter(None, (name, method))) or "run"
    facts = run_facts(solution)
    facts["observed"] = ", ".join(o.name for o in solution.equations.observables) or "nothing"
    facts |= {f"warning {k + 1}": sentence for k, sentence in enumerate(solution.warnings)}
    return f"<div><b>{html.escape(title)}</b>{format_html_table(facts)}</div>"


def format_html_table(facts: Mapping[str, str]) -> str:
    """Return an HTML table with a column of names and a column of values."""
    rows = "".join(
        f"<tr><td {_NAME_STYLE}>{html.escape(name)}</td>"
        f"<td {_VALUE_STYLE}>{html.escape(value)}</td></tr>"
        for name, value in facts.items()
    )
    return f"<table>{rows}</table>"
