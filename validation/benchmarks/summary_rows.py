"""Rows of summary.csv."""

from __future__ import annotations

from typing import Any

import beamdae as bd

COLUMNS = (
    *("case", "setting", "quantity", "entry", "t [s]", "published", "ours", "error", "relative"),
    *("steps", "drift", "energy imbalance", "ended"),
)


def make_row(
    case: str,
    setting: str,
    quantity: str,
    published: float,
    ours: float,
    *,
    error: float | None = None,
    scale: float | None = None,
    digits: int = 12,
    **further: Any,
) -> dict[str, Any]:
    """Return the row of a value beside its reference.

    `error` defaults to their difference, and `scale`, by which the relative error is divided, to
    the reference.
    """
    error = abs(ours - published) if error is None else error
    return {
        "case": case,
        "setting": setting,
        "quantity": quantity,
        **further,
        "published": f"{published:.{digits}g}",
        "ours": f"{ours:.{digits}g}",
        "error": f"{error:.2e}",
        "relative": f"{error / abs(published if scale is None else scale):.2e}",
        "ended": "",
    }


def describe_run(run: bd.results.Solution) -> dict[str, Any]:
    """Return the columns of the cost and the residuals of a run."""
    return {
        "steps": run.statistics.steps,
        "drift": f"{run.quality.max_position_drift:.1e}",
        "energy imbalance": f"{run.quality.energy_imbalance:.1e}",
    }
