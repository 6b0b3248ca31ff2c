"""Run all classes of robustness trials and print the counts of each class.

python validation/robustness/run.py                 every class (about two hours on two cores)
python validation/robustness/run.py --quick         a seeded sample of each (under two minutes)
python validation/robustness/run.py --all           every bad input, too
python validation/robustness/run.py --only faults   one class; may be repeated

The exit code is 1 if an outcome is not right.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "validation"), str(ROOT / "tests")]

import pandas as pd

from robustness import isolation
from robustness.trial_class import (
    CLASSES,
    ClassCounts,
    TrialClass,
    count_outcomes,
    load_class,
)

_MAX_PRINTED_LENGTH = 160  # characters of a cell
_COUNTS = "{:<16}{:>8}{:>8}{:>9}{:>10}{:>11}{:>9}"


def run_class(trial_class: TrialClass, options: argparse.Namespace) -> pd.DataFrame:
    """Return the rows of a class, in the order of its trials."""
    size = trial_class.quick_size if options.quick else trial_class.size
    names = trial_class.sample(None if options.all else size, options.seed, options.match)
    rows = {}
    with isolation.ProcessPool(min(options.workers, max(len(names), 1))) as pool:
        for name, answer in pool.run_trials(trial_class.attempt, names, trial_class.time_limit):
            rows[name] = trial_class.rows_of(name, answer)
            if options.verbose:
                print(f"  {trial_class.name}: {name}", flush=True)
    return pd.DataFrame([row for name in names for row in rows[name]])


def print_rest(name: str, rows: pd.DataFrame) -> None:
    """Print every row with a complaint."""
    for row in rows[rows["complaint"].fillna("") != ""].itertuples(index=False):
        cells = [cell for cell in row if isinstance(cell, str) and cell]
        text = " | ".join(" ".join(cell.split())[:_MAX_PRINTED_LENGTH] for cell in cells)
        print(f"{name}: {text}")


def print_counts(counts: list[ClassCounts]) -> None:
    """Print the table of all classes."""
    print(
        _COUNTS.format("class", "trials", "right", "skipped", "hopeless", "not right", "time [s]")
    )
    for c in counts:
        print(
            _COUNTS.format(
                c.name, c.trials, c.right, c.skipped, c.hopeless, c.not_right, f"{c.seconds:.0f}"
            )
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a seeded sample of each class")
    parser.add_argument("--all", action="store_true", help="every trial of each class")
    parser.add_argument("--only", choices=tuple(CLASSES), action="append", help="this class")
    parser.add_argument("--seed", type=int, default=0, help="seed of the samples")
    parser.add_argument("--workers", type=int, default=isolation.count_cores())
    parser.add_argument("--match", default="", help="trials whose names contain this text")
    parser.add_argument("--verbose", action="store_true", help="print each trial when it ends")
    options = parser.parse_args()
    counts = []
    for name in options.only or CLASSES:
        begin = time.perf_counter()
        trial_class = load_class(name)
        rows = run_class(trial_class, options)
        counts.append(count_outcomes(name, rows, time.perf_counter() - begin))
        if not rows.empty:
            print_rest(name, rows)
    print_counts(counts)
    sys.exit(1 if any(c.not_right for c in counts) else 0)


if __name__ == "__main__":
    # Processes that are killed leave files behind, which are deleted with this folder.
    with tempfile.TemporaryDirectory(prefix="robustness-") as scratch:
        os.environ["TMPDIR"] = scratch
        main()
