"""Random mechanisms as tolerance cases, with short, coarse references."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pandas as pd

from tolerances.random_mechanisms import random_mechanism, sample_mechanism
from tolerances.references import Effort, compute_reference, write_reference
from tolerances.tolerance_case import DAMPED, UNDAMPED, ToleranceCase, load_references

COLUMNS = ("end.x [m]", "end.y [m]", "end.angle [rad]")
PREFIX = "random "  # of the names of cases; the seed follows
EFFORT = Effort(converged=1e-6, patience=1.5)
# Largest disagreement of the two methods, relative to the amplitude.
MAX_DISAGREEMENT = 1e-5
# Largest disagreement for the shortened run of a seed, relative to the amplitude.
MAX_DISAGREEMENT_SHORTENED = 1e-4
SHORTENED_FRACTION = 0.4  # of the run
# Columns with a smaller range [m or rad] are considered fixed by a joint.
MIN_MOTION = 1e-7


def random_case(seed: int) -> ToleranceCase:
    """Return the case of a seed over its whole run."""
    parameters = sample_mechanism(seed)
    return ToleranceCase(
        f"{PREFIX}{seed}",
        random_mechanism,
        COLUMNS,
        {"seed": seed},
        DAMPED if parameters.is_damped else UNDAMPED,
        parameters.t_end,
        rows=41,
    )


def stored_seeds() -> list[int]:
    """Return the seeds with a reference."""
    names = (name for name in load_references() if name.startswith(PREFIX))
    return sorted(int(name.removeprefix(PREFIX)) for name in names)


def random_cases() -> Iterator[ToleranceCase]:
    """Yield the seeds with a reference, limited to its time span and moving columns."""
    for case in map(random_case, stored_seeds()):
        reference = load_references()[case.name]
        moving = tuple(name for name in COLUMNS if name in reference)
        yield replace(case, t_end=reference["t [s]"][-1], columns=moving)


def store_random_references(seeds: Iterable[int]) -> Iterator[pd.DataFrame]:
    """Store references of further seeds and yield their rows of the summary.

    If the two methods differ by more than `MAX_DISAGREEMENT`, the run is shortened to
    `SHORTENED_FRACTION`. Seeds that then differ by more than `MAX_DISAGREEMENT_SHORTENED` are
    skipped.
    """
    for seed in sorted(set(seeds).difference(stored_seeds())):
        case = random_case(seed)
        result = _reference_of_moving_columns(case)
        if result is None or result[1]["disagreement"].max() > MAX_DISAGREEMENT:
            shortened = replace(case, t_end=SHORTENED_FRACTION * case.duration)
            result = _reference_of_moving_columns(shortened)
        if result is None or result[1]["disagreement"].max() > MAX_DISAGREEMENT_SHORTENED:
            continue
        table, summary = result
        write_reference(case.name, table, summary)
        yield summary


def _reference_of_moving_columns(case: ToleranceCase) -> tuple[pd.DataFrame, pd.DataFrame] | None:
    """Return reference and summary of the moving columns, or None if there are none."""
    try:
        table, summary = compute_reference(case, EFFORT)
    except SystemExit:
        return None
    moving = np.ptp(table[list(COLUMNS)], axis=0) > MIN_MOTION
    if not moving.any():
        return None
    fixed = [name for name in COLUMNS if not moving[name]]
    return table.drop(columns=fixed), summary[summary["column"].map(moving)]
