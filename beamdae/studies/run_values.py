"""What studies tell of a run: a few numbers, and its rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError, as_real, format_exception, short_repr, unbox_scalar
from beamdae.results.event_records import format_event_counts
from beamdae.results.solution import Solution

EVENTS_COLUMN = "events"


def collect_event_values(solution: Solution, until: float = np.inf) -> dict[str, Any]:
    """What happened in a run up to some time [s], by column of the case table.

    Nothing where nothing is watched.
    """
    found: dict[str, Any] = {}
    for term in solution.equations.events:
        times = [
            one.t for one in solution.event_records if one.name == term.name and one.t <= until
        ]
        found[_count_column(term.name)] = len(times)
        if times:
            found[_first_time_column(term.name)] = times[0]
    return {EVENTS_COLUMN: _format_counts(found), **found} if found else {}


def extrapolate_events(
    coarse: Mapping[str, Any], fine: Mapping[str, Any], order: int
) -> dict[str, Any]:
    """Events of two runs with steps h and h/2, their times extrapolated (Richardson)."""
    found = _select_event_columns(fine)
    for column, value in found.items():
        if column in coarse and isinstance(value, float):
            found[column] = value + (value - coarse[column]) / (2.0**order - 1.0)
    return found


def compute_event_errors(
    values: Mapping[str, Any], reference: Mapping[str, Any]
) -> dict[str, float]:
    """How far first times are off those of a reference, by column of the case table."""
    times = {name: value for name, value in reference.items() if isinstance(value, float)}
    return {
        f"error of {column}": abs(values.get(column, np.nan) - value)
        for column, value in times.items()
    }


def describe_event_mismatch(values: Mapping[str, Any], reference: Mapping[str, Any]) -> str:
    """A sentence, where other events happened than in a reference, or nothing."""
    own, others = _select_event_columns(values), _select_event_columns(reference)
    counts = [name for name, value in others.items() if isinstance(value, int)]
    if not others or all(own.get(name) == others[name] for name in counts):
        return ""
    return f"other events than in the reference: {_format_counts(own)}; in the reference: {_format_counts(others)}."


def is_event_count(column: str) -> bool:
    """Whether a column of the case table tells how often an event happened."""
    return column.startswith("event ") and column.endswith(", times")


def _count_column(name: str) -> str:
    return f"event {name}, times"


def _first_time_column(name: str) -> str:
    return f"event {name}, first [s]"


def _select_event_columns(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name.startswith("event ")}


def _format_counts(found: Mapping[str, Any]) -> str:
    """Which happened, and how often."""
    return format_event_counts(
        column.removeprefix("event ").removesuffix(", times")
        for column, value in found.items()
        if isinstance(value, int)
        for _ in range(value)
    )


# Column of the case table by name in the summary of a solution.
COUNT_COLUMNS = {
    "steps": "steps",
    "rejected steps": "rejected_steps",
    "residual calls": "residual_calls",
    "Jacobian calls": "jacobian_calls",
    "factorizations": "factorizations",
    "solves": "solves",
    "Newton failures": "newton_failures",
}
# Of cases that ran several times, beside the median of their wall times.
WALL_TIME_RANGE = ("wall time min [s]", "wall time max [s]")
MEASURE_COLUMNS = {
    "setup time [s]": "setup_time",
    "wall time [s]": "wall_time",
    "max position drift": "max_position_drift",
    "max velocity drift": "max_velocity_drift",
    "max residual [-]": "max_residual",
    "energy imbalance [-]": "energy_imbalance",
}


def collect_run_values(solution: Solution) -> dict[str, Any]:
    """Cost and quality of a solution by column of the case table."""
    summary = solution.summary()
    chosen = solution.integrator
    return {
        "reached [s]": summary["last_time"],
        "formulation": chosen.get("formulation", "stabilized-index1"),
        "error control": chosen.get("error_control", ""),
        "max order": chosen.get("max_order"),
        **{column: summary[name] for column, name in (COUNT_COLUMNS | MEASURE_COLUMNS).items()},
        "warnings": " ".join(solution.warnings),
        **collect_event_values(solution),
    }


def evaluate_outputs(
    outputs: Mapping[str, Callable[[Solution], Any]], solution: Solution
) -> dict[str, Any]:
    """What functions of a solution, which are a user's own, return by column of the case table.

    Raises
    ------
    BeamdaeError
        If one of them fails, or returns what no table has room for.
    """
    found = {}
    for name, function in outputs.items():
        try:
            value = unbox_scalar(function(solution))
        except Exception as problem:
            raise BeamdaeError(
                f"the output {name!r} failed, {format_exception(problem)}."
            ) from problem
        size = as_real(value)
        if size is None and not isinstance(value, (bool, str, type(None))):
            raise BeamdaeError(
                f"the output {name!r} must be a number, a truth value, a text or None, "
                f"got {short_repr(value)}."
            )
        found[format_output_column(name)] = value if size is None else size
    return found


def format_output_column(name: str) -> str:
    """Column of the case table for an output of a sweep."""
    return f"output {name}"


def summarize_wall_times(times: Sequence[float]) -> dict[str, float]:
    """The median of the wall times of equal runs, and their ends, by column of the case table."""
    found = {"wall time [s]": float(np.median(times))}
    return (
        found
        if len(times) < 2
        else found | dict(zip(WALL_TIME_RANGE, (min(times), max(times)), strict=True))
    )


def tabulate_trajectory(solution: Solution) -> pd.DataFrame:
    """Observed columns, energies and drift at the output times."""
    parts = (solution.observed, solution.ledger, solution.drift)
    headers = pd.Index([header for part in parts for header in part])
    return pd.DataFrame(np.hstack(parts), pd.Index(solution.t, name="t [s]"), headers)
