"""Random mechanisms as tolerance cases, with short, coarse references in a single table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from tolerances.random_mechanisms import random_mechanism, sample_mechanism
from tolerances.references import Effort, compute_reference
from tolerances.tolerance_case import DAMPED, FOLDER, UNDAMPED, ToleranceCase

COLUMNS = ("end.x [m]", "end.y [m]", "end.angle [rad]")
TABLE, SUMMARY = FOLDER / "random.csv", FOLDER / "random_summary.csv"
EFFORT = Effort(converged=1e-6, patience=1.5)
# Largest disagreement of the two methods, relative to the amplitude.
MAX_DISAGREEMENT = 1e-5
# Largest disagreement for the shortened run of a seed, relative to the amplitude.
MAX_DISAGREEMENT_SHORTENED = 1e-4
SHORTENED_FRACTION = 0.4  # of the run
# Columns with a smaller range [m or rad] are considered fixed by a joint.
MIN_MOTION = 1e-7


@dataclass(frozen=True)
class RandomCase(ToleranceCase):
    """The random mechanism of a seed, with its reference in the table of all seeds."""

    rows: int = 41

    def load_reference(self, columns: tuple[str, ...]) -> np.ndarray:
        """Return columns of the stored reference, (rows, columns)."""
        return _load_table().get_group(self.parameters["seed"])[list(columns)].to_numpy()


@cache
def _load_table() -> pd.api.typing.DataFrameGroupBy:
    return pd.read_csv(TABLE).groupby("seed")


def random_case(seed: int) -> RandomCase:
    """Return the case of a seed over its whole run."""
    parameters = sample_mechanism(seed)
    bound = DAMPED if parameters.is_damped else UNDAMPED
    return RandomCase(
        f"random {seed}", random_mechanism, COLUMNS, {"seed": seed}, bound, parameters.t_end
    )


def random_cases() -> Iterator[RandomCase]:
    """Yield the seeds with a reference, limited to its time span and moving columns."""
    for seed, rows in _load_table():
        moving = tuple(name for name in COLUMNS if rows[name].notna().all())
        yield replace(random_case(seed), t_end=rows["t [s]"].max(), columns=moving)


def store_random_references(seeds: Iterable[int]) -> Iterator[pd.DataFrame]:
    """Store references of further seeds and yield their rows of the summary.

    If the two methods differ by more than `MAX_DISAGREEMENT`, the run is shortened to
    `SHORTENED_FRACTION`. Seeds that then differ by more than `MAX_DISAGREEMENT_SHORTENED` are
    skipped.
    """
    stored_seeds = set(pd.read_csv(TABLE)["seed"]) if TABLE.exists() else set()
    for seed in (seed for seed in seeds if seed not in stored_seeds):
        case = random_case(seed)
        result = _reference_of_moving_columns(case)
        if result is None or result[1]["disagreement"].max() > MAX_DISAGREEMENT:
            shortened = replace(case, t_end=SHORTENED_FRACTION * case.duration)
            result = _reference_of_moving_columns(shortened)
        if result is None or result[1]["disagreement"].max() > MAX_DISAGREEMENT_SHORTENED:
            continue
        table, summary = result
        table.insert(0, "seed", seed)
        _append(TABLE, table, "%.12g")
        _append(SUMMARY, summary, "%.2g")
        yield summary


def _reference_of_moving_columns(case: RandomCase) -> tuple[pd.DataFrame, pd.DataFrame] | None:
    """Return reference and summary of the moving columns, or None if there are none."""
    try:
        table, summary = compute_reference(case, EFFORT)
    except SystemExit:
        return None
    moving = np.ptp(table[list(COLUMNS)], axis=0) > MIN_MOTION
    if not moving.any():
        return None
    table.loc[:, [name for name in COLUMNS if not moving[name]]] = np.nan
    return table, summary[summary["column"].map(moving)]


def _append(path: Path, table: pd.DataFrame, digits: str) -> None:
    table.to_csv(path, mode="a", header=not path.exists(), index=False, float_format=digits)
