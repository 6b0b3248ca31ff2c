"""Random mechanisms as cases: their references are in one table, short and coarse."""

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
EFFORT = Effort(settled=1e-6, patience=1.5)
MAX_DISAGREEMENT, MAX_DISAGREEMENT_SHORTENED = 1e-5, 1e-4
# A column that moves less is one that a joint holds.
MIN_MOTION = 1e-7


@dataclass(frozen=True)
class RandomCase(ToleranceCase):
    """The mechanism of a seed; its rows are in the table of all seeds."""

    rows: int = 41

    def load_reference(self, columns: tuple[str, ...]) -> np.ndarray:
        """Columns of the stored reference, (rows, columns)."""
        return _stored().get_group(self.parameters["seed"])[list(columns)].to_numpy()


@cache
def _stored() -> pd.api.typing.DataFrameGroupBy:
    return pd.read_csv(TABLE).groupby("seed")


def random_case(seed: int) -> RandomCase:
    """The mechanism of a seed over its whole run."""
    plan = sample_mechanism(seed)
    bound = DAMPED if plan.damped else UNDAMPED
    return RandomCase(
        f"random {seed}", random_mechanism, COLUMNS, {"seed": seed}, bound, plan.t_end
    )


def random_cases() -> Iterator[RandomCase]:
    """All seeds with a reference, over the time it spans and the columns that move."""
    for seed, rows in _stored():
        moving = tuple(name for name in COLUMNS if rows[name].notna().all())
        yield replace(random_case(seed), t_end=rows["t [s]"].max(), columns=moving)


def store_random_references(seeds: Iterable[int]) -> Iterator[pd.DataFrame]:
    """Store references of further seeds; the lines of the summary, seed by seed.

    A seed whose two methods differ by more than `MAX_DISAGREEMENT` of some column is run for two fifths of
    its time instead; one that still has no reference worth the name is left out.
    """
    stored = set(pd.read_csv(TABLE)["seed"]) if TABLE.exists() else set()
    for seed in (seed for seed in seeds if seed not in stored):
        case = random_case(seed)
        found = _reference_of_moving_columns(case)
        if found is None or found[1]["disagreement"].max() > MAX_DISAGREEMENT:
            found = _reference_of_moving_columns(replace(case, t_end=0.4 * case.duration))
        if found is None or found[1]["disagreement"].max() > MAX_DISAGREEMENT_SHORTENED:
            continue
        table, lines = found
        table.insert(0, "seed", seed)
        _append(TABLE, table, "%.12g")
        _append(SUMMARY, lines, "%.2g")
        yield lines


def _reference_of_moving_columns(case: RandomCase) -> tuple[pd.DataFrame, pd.DataFrame] | None:
    """Reference and summary of the columns that move; None if a method fails, or nothing moves."""
    try:
        table, lines = compute_reference(case, EFFORT)
    except SystemExit:
        return None
    moving = np.ptp(table[list(COLUMNS)], axis=0) > MIN_MOTION
    if not moving.any():
        return None
    table.loc[:, [name for name in COLUMNS if not moving[name]]] = np.nan
    return table, lines[lines["column"].map(moving)]


def _append(path: Path, table: pd.DataFrame, digits: str) -> None:
    table.to_csv(path, mode="a", header=not path.exists(), index=False, float_format=digits)
