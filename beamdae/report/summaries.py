"""Summaries of runs for notebooks, and of model checks."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import Any

from beamdae.analysis.eigenproblems.eigensolution import FrequencyRange
from beamdae.equations.starts.dependent_constraints import describe_dependent_sets
from beamdae.errors import list_first
from beamdae.report.tables import run_facts
from beamdae.results.solution import Solution

_CELL_STYLE = 'style="text-align: left; padding: 1px 12px 1px 0; vertical-align: top; {}"'
_NAME_STYLE = _CELL_STYLE.format("white-space: nowrap")
_VALUE_STYLE = _CELL_STYLE.format("")
_MAX_FREE_MOTIONS = 8
_MAX_ERRORS = 8


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


def describe_check(check: Any) -> dict[str, str]:
    """Return the results of a `Check` as texts by topic, the verdict first."""
    facts = {"verdict": check.verdict}
    if check.mobility is not None:
        states = f" - {check.states} states" if check.states else ""
        facts["mobility"] = (
            f"{check.rigid_mobility} with rigid beams and fixed drivers; {check.mobility} = "
            f"{check.coordinates} coordinates{states} - {check.rank} independent constraints"
        )
        if dependent := describe_dependent_sets(check.dependent):
            facts["dependent constraints"] = dependent
        if check.free_motions:
            motions = [*check.free_motions[:_MAX_FREE_MOTIONS]]
            if omitted := len(check.free_motions) - len(motions):
                motions.append(f"and {omitted} more")
            facts["free motions"] = "; ".join(motions)
    else:
        facts["mobility"] = (
            f"not computed: {check.coordinates} coordinates, {check.constraints} constraints"
        )
    if loose := "; ".join(", ".join(group) for group in check.loose):
        facts["unconnected parts"] = f"no joint connects to the ground: {loose}"
    facts["start"] = _describe_start(check)
    if check.spectrum is not None:
        facts |= _describe_frequencies(check.spectrum)
    elif check.start is not None:
        facts["frequencies"] = "not computed: too many coordinates or constraints"
    if check.errors is not None and not check.errors.reason:
        total = dict(zip(check.errors.headers, check.errors.total.tolist(), strict=True))
        named = sorted((name for name in total if total[name] > 0.0), key=lambda x: -total[x])
        if named:
            facts["errors"] = list_first([f"{total[x]:.2g} ({x})" for x in named], _MAX_ERRORS)
    if check.prediction is not None:
        p = check.prediction
        facts["predicted cost"] = (
            f"about {_round(p.steps)} steps of {p.method}, {_round(p.seconds)} s, measured in "
            f"{100.0 * p.covered_share:.3g} % of a run"
        )
    for k, warning in enumerate(check.warnings, start=1):
        facts["warning" if len(check.warnings) == 1 else f"warning {k}"] = warning
    return facts


def _round(value: float) -> str:
    """Return the value with one significant digit, without an exponent below a million."""
    return f"{float(f'{value:.1g}'):g}"


def _describe_start(check: Any) -> str:
    if check.start is None:
        return "no consistent start"
    change = check.start.largest
    if change is None:
        text = "there are no coordinates"
    elif change.displacement > 0.0:
        distance = f"{change.displacement:.3g} m ({change.coordinate})"
        text = f"closing the joints moves {change.part} by {distance}"
    else:
        text = "the joints are closed"
    return f"{check.start.request}; {text}"


def _describe_frequencies(frequencies: FrequencyRange) -> dict[str, str]:
    if frequencies.massless:
        return {"mass": f"singular: {frequencies.massless} has no inertia"}
    facts = {}
    lowest, highest = frequencies.lowest, frequencies.highest
    if highest is not None and lowest is not None:
        facts["frequencies"] = f"{lowest:.4g} to {highest:.4g} Hz"
    if frequencies.growth:
        facts["unstable"] = frequencies.growth
    return facts
