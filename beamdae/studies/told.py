"""What studies tell of a run: a few numbers, and its rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

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
