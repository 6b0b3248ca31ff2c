"""What studies tell of a run: a few numbers, and its rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError, as_real, format_exception, short_repr, unbox_scalar
from beamdae.results.solution import Solution
from beamdae.studies.event_columns import event_values

# Column of the case table by name in the summary of a solution.
COUNTS = {
    "steps": "steps",
    "rejected steps": "rejected_steps",
    "residual calls": "residual_calls",
    "Jacobian calls": "jacobian_calls",
    "factorizations": "factorizations",
    "solves": "solves",
    "Newton failures": "newton_failures",
}
# Of cases that ran several times, beside the median of their wall times.
SPREAD = ("wall time min [s]", "wall time max [s]")
MEASURES = {
    "setup time [s]": "setup_time",
    "wall time [s]": "wall_time",
    "max position drift": "max_position_drift",
    "max velocity drift": "max_velocity_drift",
    "max residual [-]": "max_residual",
    "energy imbalance [-]": "energy_imbalance",
}


def values(solution: Solution) -> dict[str, Any]:
    """Cost and quality of a solution by column of the case table."""
    summary = solution.summary()
    chosen = solution.integrator
    return {
        "reached [s]": summary["last_time"],
        "formulation": chosen.get("formulation", "stabilized-index1"),
        "error control": chosen.get("error_control", ""),
        "max order": chosen.get("max_order"),
        **{column: summary[name] for column, name in (COUNTS | MEASURES).items()},
        "warnings": " ".join(solution.warnings),
        **event_values(solution),
    }


def output_values(
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
        found[output_column(name)] = value if size is None else size
    return found


def output_column(name: str) -> str:
    """Column of the case table for an output of a sweep."""
    return f"output {name}"


def timings(times: Sequence[float]) -> dict[str, float]:
    """The median of the wall times of equal runs, and their ends, by column of the case table."""
    found = {"wall time [s]": float(np.median(times))}
    return (
        found
        if len(times) < 2
        else found | dict(zip(SPREAD, (min(times), max(times)), strict=True))
    )


def by_time(solution: Solution) -> pd.DataFrame:
    """Observed columns, energies and drift at the output times."""
    parts = (solution.observed, solution.ledger, solution.drift)
    headers = pd.Index([header for part in parts for header in part])
    return pd.DataFrame(np.hstack(parts), pd.Index(solution.t, name="t [s]"), headers)
