"""Try bad inputs, random mechanisms and faults, and report outcomes that are not right.

python validation/robustness/run.py                 everything (about an hour)
python validation/robustness/run.py --thinned       a sample of every kind (six minutes)
python validation/robustness/run.py --only faults   only inputs, mechanisms or faults

Tables of complete runs are written to results/. The exit code is 1 if any outcome is not right.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parents[1])]

import pandas as pd

from robustness import isolation, judge, mechanisms
from robustness.faults import catalog as fault_catalog
from robustness.inputs import catalog as input_catalog
from robustness.inputs.bad_input import BadInput

RESULTS = Path(__file__).parent / "results"
_MAX_CELL_LENGTH = 200  # characters
_MAX_PRINTED_LENGTH = 160  # characters of a cell


def try_inputs(options: argparse.Namespace) -> pd.DataFrame:
    """Return a row for each place, and one for each of its complaints."""
    inputs = input_catalog.collect_inputs()
    names = input_catalog.sample_inputs(inputs, options.seed) if options.thinned else list(inputs)
    names = [name for name in names if options.match in name]
    outcomes = dict(judge_inputs(inputs, names, options.workers))
    rows = []
    for name in names:
        outcome, complaint = outcomes[name]
        text = f"{outcome.text} {outcome.output}".strip()[:_MAX_CELL_LENGTH]
        rows.append(
            {
                "place": inputs[name].place,
                "value": inputs[name].value,
                "ended": outcome.ended,
                "complaint": complaint,
                "seen": judge.escape_unprintable(text),
            }
        )
    return count_by_place(pd.DataFrame(rows))


def judge_inputs(
    inputs: dict[str, BadInput], names: list[str], processes: int
) -> Iterator[tuple[str, tuple[judge.TrialOutcome, str]]]:
    """Yield name, outcome and complaint of each input."""
    with isolation.ProcessPool(processes) as pool:
        for name, answer in pool.run_trials(
            input_catalog.try_input_by_name, names, input_catalog.INPUT_TIME_LIMIT
        ):
            if answer is None or answer is ...:
                outcome = judge.TrialOutcome("crashed" if answer is None else "hung")
                complaint = judge.find_complaint(outcome)
            else:
                outcome, complaint = answer
            if inputs[name].hopeless and complaint:
                outcome, complaint = judge.TrialOutcome("hopeless", inputs[name].hopeless), ""
            yield name, (outcome, complaint)


def try_mechanisms(options: argparse.Namespace) -> pd.DataFrame:
    """Return a row for each mechanism and integrator."""
    names = [str(seed) for seed in range(mechanisms.SEED_COUNT)]
    if options.thinned:
        names = random.Random(options.seed).sample(names, mechanisms.SAMPLE_SIZE)
    rows: list[mechanisms.MechanismRow] = []
    with isolation.ProcessPool(options.workers) as pool:
        for name, answer in pool.run_trials(
            mechanisms.try_seed, names, mechanisms.MECHANISM_TIME_LIMIT
        ):
            if answer is None or answer is ...:
                rows.append(mechanisms.row_of_lost_process(name, answer is None))
            else:
                rows += answer
    return pd.DataFrame([asdict(row) for row in sorted(rows, key=lambda row: row.seed)])


def try_faults(options: argparse.Namespace) -> pd.DataFrame:
    """Return a row for each fault."""
    faults = fault_catalog.collect_faults(slow=not options.thinned)
    names = [name for name in faults if options.match in name]
    rows = []
    with isolation.ProcessPool(options.workers) as pool:
        for name, answer in pool.run_trials(
            fault_catalog.try_fault, names, fault_catalog.FAULT_TIME_LIMIT
        ):
            row = answer
            if answer is None or answer is ...:
                right = faults[name].__doc__ or ""
                row = fault_catalog.FaultRow(name, right, "not right", "it did not end")
            rows.append(row)
            print(f"{row.wall:6.1f} s", row.ended, name, row.complaint, flush=True)
    return pd.DataFrame([asdict(row) for row in sorted(rows, key=lambda row: row.fault)])


def count_by_place(trials: pd.DataFrame) -> pd.DataFrame:
    """Count trials of each place by outcome; each complaint gets a row with an example."""
    rows: list[dict[str, Any]] = []
    for place, group in trials.groupby("place", sort=False):
        ended = group["ended"].where(group["complaint"] == "", "not right")
        counts = {kind: int((ended == kind).sum()) for kind in (*judge.ACCEPTED_ENDS, "hopeless")}
        wrong = group[group["complaint"] != ""]
        rows.append({"place": place, "inputs": len(group), **counts, "not right": len(wrong)})
        for complaint, same in wrong.groupby("complaint", sort=False):
            values = ", ".join(same["value"])[:_MAX_CELL_LENGTH]
            example = {"value": values, "complaint": complaint, "seen": same["seen"].iloc[0]}
            rows.append({"place": place, "not right": len(same), **example})
    columns = ["place", "inputs", *judge.ACCEPTED_ENDS, "hopeless", "not right"]
    table = pd.DataFrame(rows, columns=[*columns, "value", "complaint", "seen"])
    return table.astype(dict.fromkeys(columns[1:], "Int64"))


def rows_with_complaints(table: pd.DataFrame) -> pd.DataFrame:
    return table[table["complaint"].fillna("") != ""]


def count_failures(table: pd.DataFrame) -> tuple[int, int]:
    """Return the number of trials, and of those that are not right."""
    if "inputs" not in table:
        return len(table), len(rows_with_complaints(table))
    places = table[table["inputs"].notna()]
    return int(places["inputs"].sum()), int(places["not right"].sum())


def print_summary(kind: str, table: pd.DataFrame, seconds: float) -> None:
    """Print the counts of a table, and its rows with complaints."""
    tried, wrong = count_failures(table)
    print(f"{kind}: {tried} tried in {seconds:.0f} s, {wrong} not right")
    for row in rows_with_complaints(table).itertuples(index=False):
        cells = [cell for cell in row if isinstance(cell, str) and cell]
        print("  " + " | ".join(" ".join(cell.split())[:_MAX_PRINTED_LENGTH] for cell in cells))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--thinned", action="store_true", help="a sample of every kind")
    parser.add_argument("--only", choices=("inputs", "mechanisms", "faults"))
    parser.add_argument("--seed", type=int, default=0, help="seed of the sample")
    parser.add_argument("--workers", type=int, default=isolation.count_cores())
    parser.add_argument("--match", default="", help="trials whose names contain this text")
    options = parser.parse_args()
    kinds = {"inputs": try_inputs, "mechanisms": try_mechanisms, "faults": try_faults}
    total_wrong = 0
    for kind, run_trials in kinds.items():
        if options.only not in (None, kind):
            continue
        begin = time.perf_counter()
        table = run_trials(options)
        print_summary(kind, table, time.perf_counter() - begin)
        total_wrong += count_failures(table)[1]
        if not (options.thinned or options.match):
            RESULTS.mkdir(exist_ok=True)
            table.to_csv(RESULTS / f"{kind}.csv", index=False, float_format="%.3g")
    sys.exit(1 if total_wrong else 0)


if __name__ == "__main__":
    # Processes that are killed leave files behind, which are deleted with this folder.
    with tempfile.TemporaryDirectory(prefix="robustness-") as scratch:
        os.environ["TMPDIR"] = scratch
        main()
