"""Events in the tables of studies: how often each happened, when first, and when it should have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from beamdae.results.event_records import format_event_counts
from beamdae.results.solution import Solution

EVENTS = "events"


def event_values(solution: Solution, until: float = np.inf) -> dict[str, Any]:
    """What happened in a run up to some time [s], by column of the case table.

    Nothing where nothing is watched.
    """
    found: dict[str, Any] = {}
    for term in solution.equations.events:
        times = [
            one.t for one in solution.event_records if one.name == term.name and one.t <= until
        ]
        found[_count(term.name)] = len(times)
        if times:
            found[_first(term.name)] = times[0]
    return {EVENTS: _phrase(found), **found} if found else {}


def extrapolated(coarse: Mapping[str, Any], fine: Mapping[str, Any], order: int) -> dict[str, Any]:
    """Events of two runs with steps h and h/2, their times extrapolated (Richardson)."""
    found = _of_events(fine)
    for column, value in found.items():
        if column in coarse and isinstance(value, float):
            found[column] = value + (value - coarse[column]) / (2.0**order - 1.0)
    return found


def event_errors(values: Mapping[str, Any], reference: Mapping[str, Any]) -> dict[str, float]:
    """How far first times are off those of a reference, by column of the case table."""
    times = {name: value for name, value in reference.items() if isinstance(value, float)}
    return {
        f"error of {column}": abs(values.get(column, np.nan) - value)
        for column, value in times.items()
    }


def misfit(values: Mapping[str, Any], reference: Mapping[str, Any]) -> str:
    """A sentence, where other events happened than in a reference, or nothing."""
    own, others = _of_events(values), _of_events(reference)
    counts = [name for name, value in others.items() if isinstance(value, int)]
    if not others or all(own.get(name) == others[name] for name in counts):
        return ""
    return (
        f"other events than in the reference: {_phrase(own)}; in the reference: {_phrase(others)}."
    )


def is_count(column: str) -> bool:
    """Whether a column of the case table tells how often an event happened."""
    return column.startswith("event ") and column.endswith(", times")


def _count(name: str) -> str:
    return f"event {name}, times"


def _first(name: str) -> str:
    return f"event {name}, first [s]"


def _of_events(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name.startswith("event ")}


def _phrase(found: Mapping[str, Any]) -> str:
    """Which happened, and how often."""
    return format_event_counts(
        column.removeprefix("event ").removesuffix(", times")
        for column, value in found.items()
        if isinstance(value, int)
        for _ in range(value)
    )
