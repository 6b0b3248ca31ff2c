"""Classes of trials: their trials by name, the function that tries one, and the sizes of samples.

`run.py` runs all of `CLASSES` and prints one table. To add a class, write a module with a
`TrialClass` and add its place to `CLASSES`.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from typing import Any

import pandas as pd

SKIPPED, HOPELESS = "skipped", "hopeless"
CLASSES = {
    "inputs": "robustness.inputs.catalog:TRIALS",
    "mechanisms": "robustness.mechanisms:TRIALS",
    "faults": "robustness.faults.catalog:TRIALS",
    "interrupts": "robustness.interrupts:TRIALS",
    "files": "robustness.files.catalog:TRIALS",
}


@dataclass(frozen=True)
class LostTrial:
    """Row of a trial whose process died or exceeded the time limit."""

    trial: str
    ended: str
    complaint: str


@dataclass(frozen=True)
class TrialClass:
    """Class of trials.

    Attributes
    ----------
    name
        Name in the table and in `--only`.
    collect
        Function that returns the names of all trials.
    attempt
        Function name -> row or list of rows, called in a worker process, so it must be a function
        of a module. A row is a dataclass with the fields `complaint`, empty if the outcome is
        right, and `ended`; "skipped..." and "hopeless..." are counted apart. Its text fields are
        printed if there is a complaint.
    time_limit
        Time limit of one trial [s].
    size
        Number of trials of a normal run, drawn by `draw`; None for all.
    quick_size
        Number of trials with `--quick`. All classes together should take less than two minutes on
        two cores.
    draw
        Function (names, size, seed) -> names of a sample. Defaults to a random sample.
    hopeless
        Function name -> reason why no program could answer this trial correctly, or "".
    """

    name: str
    collect: Callable[[], Sequence[str]]
    attempt: Callable[[str], Any]
    time_limit: float
    quick_size: int
    size: int | None = None
    draw: Callable[[Sequence[str], int, int], Sequence[str]] | None = None
    hopeless: Callable[[str], str] | None = None

    def sample(self, size: int | None, seed: int, match: str = "") -> list[str]:
        """Return the names that contain `match`, or a sample if there are more than `size`."""
        names = [name for name in self.collect() if match in name]
        if size is None or len(names) <= size:
            return names
        return list((self.draw or draw_sample)(names, size, seed))

    def rows_of(self, name: str, answer: Any) -> list[dict[str, Any]]:
        """Return the rows of an answer of `ProcessPool.run_trials` as dictionaries."""
        if answer is None or answer is ...:
            ended = "crashed" if answer is None else "hung"
            answer = LostTrial(name, ended, f"it {ended}")
        rows = [asdict(row) for row in (answer if isinstance(answer, list) else [answer])]
        excuse = self.hopeless(name) if self.hopeless else ""
        if excuse:
            rows = [
                {**row, "ended": f"{HOPELESS}: {excuse}", "complaint": ""}
                if row["complaint"]
                else row
                for row in rows
            ]
        return rows


def draw_sample(names: Sequence[str], size: int, seed: int) -> list[str]:
    """Return a random sample in the order of `names`."""
    chosen = set(random.Random(seed).sample(range(len(names)), size))
    return [name for k, name in enumerate(names) if k in chosen]


@dataclass(frozen=True)
class ClassCounts:
    """Counts of outcomes of one class, and its duration [s]."""

    name: str
    trials: int
    skipped: int
    hopeless: int
    not_right: int
    seconds: float

    @property
    def right(self) -> int:
        """Number of rows that are right."""
        return self.trials - self.skipped - self.hopeless - self.not_right


def count_outcomes(name: str, rows: pd.DataFrame, seconds: float) -> ClassCounts:
    """Count the rows of a class."""
    if rows.empty:
        return ClassCounts(name, 0, 0, 0, 0, seconds)
    wrong = rows["complaint"].fillna("") != ""
    ended = rows["ended"].fillna("").where(~wrong, "")
    skipped, hopeless = (int(ended.str.startswith(x).sum()) for x in (SKIPPED, HOPELESS))
    return ClassCounts(name, len(rows), skipped, hopeless, int(wrong.sum()), seconds)


def load_class(name: str) -> TrialClass:
    """Import and return a registered class."""
    module, _, attribute = CLASSES[name].partition(":")
    trial_class = getattr(import_module(module), attribute)
    assert trial_class.name == name, f"{CLASSES[name]} has another name than {name}"
    return trial_class
