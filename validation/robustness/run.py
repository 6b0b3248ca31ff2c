"""Try bad inputs, random mechanisms and faults, and tell what was not right.

python validation/robustness/run.py                 everything (about an hour)
python validation/robustness/run.py --thinned       some of every kind (six minutes)
python validation/robustness/run.py --only faults   inputs, mechanisms or faults alone

Tables of everything go to results/; the exit code is 1 if something was not right.
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

from robustness import faults, inputs, judge, mechanisms, workers

RESULTS = Path(__file__).parent / "results"


def try_inputs(options: argparse.Namespace) -> pd.DataFrame:
    """One line a place, and one for each of its inputs that did not end right."""
    known = inputs.all_inputs()
    names = inputs.thinned(known, options.seed) if options.thinned else list(known)
    names = [name for name in names if options.match in name]
    found = dict(seen_inputs(known, names, options.workers))
    lines = [
        {
            "place": known[name].place,
            "value": known[name].value,
            "ended": found[name][0].ended,
            "complaint": found[name][1],
            "seen": judge.printable(f"{found[name][0].text} {found[name][0].output}".strip()[:200]),
        }
        for name in names
    ]
    return by_place(pd.DataFrame(lines))


def seen_inputs(
    known: dict[str, inputs.Input], names: list[str], processes: int
) -> Iterator[tuple[str, tuple[judge.Seen, str]]]:
    """What was seen of each input, and why it is not right."""
    with workers.Processes(processes) as pool:
        for name, found in pool.tried(inputs.see_by_name, names, inputs.LIMIT):
            if found is None or found is ...:
                seen = judge.Seen("crashed" if found is None else "hung")
                found = seen, judge.complaint(seen)
            seen, why = found
            if known[name].hopeless and why:
                found = judge.Seen("hopeless", known[name].hopeless), ""
            yield name, found


def try_mechanisms(options: argparse.Namespace) -> pd.DataFrame:
    """One line a mechanism and integrator."""
    names = [str(seed) for seed in range(mechanisms.COUNT)]
    if options.thinned:
        names = random.Random(options.seed).sample(names, mechanisms.THINNED)
    lines: list[mechanisms.Line] = []
    with workers.Processes(options.workers) as pool:
        for name, found in pool.tried(mechanisms.see_seed, names, mechanisms.LIMIT):
            lines += [mechanisms.lost(name, found is None)] if found in (None, ...) else found
    return pd.DataFrame([asdict(line) for line in sorted(lines, key=lambda line: line.seed)])


def try_faults(options: argparse.Namespace) -> pd.DataFrame:
    """One line a fault."""
    known = faults.all_faults(slow=not options.thinned)
    names = [name for name in known if options.match in name]
    lines = []
    with workers.Processes(options.workers) as pool:
        for name, found in pool.tried(faults.see_fault, names, faults.LIMIT):
            lost = faults.Line(name, known[name].__doc__ or "", "not right", "it did not end")
            lines.append(lost if found in (None, ...) else found)
            print(
                f"{lines[-1].wall:6.1f} s", lines[-1].ended, name, lines[-1].complaint, flush=True
            )
    return pd.DataFrame([asdict(line) for line in sorted(lines, key=lambda line: line.fault)])


def by_place(lines: pd.DataFrame) -> pd.DataFrame:
    """How many inputs of each place ended how; those not right in lines of their own."""
    rows: list[dict[str, Any]] = []
    for place, group in lines.groupby("place", sort=False):
        ended = group["ended"].where(group["complaint"] == "", "not right")
        counts = {kind: int((ended == kind).sum()) for kind in (*judge.RIGHT, "hopeless")}
        wrong = group[group["complaint"] != ""]
        rows.append({"place": place, "inputs": len(group), **counts, "not right": len(wrong)})
        for complaint, alike in wrong.groupby("complaint", sort=False):
            values = ", ".join(alike["value"])[:200]
            example = {"value": values, "complaint": complaint, "seen": alike["seen"].iloc[0]}
            rows.append({"place": place, "not right": len(alike), **example})
    columns = ["place", "inputs", *judge.RIGHT, "hopeless", "not right"]
    table = pd.DataFrame(rows, columns=[*columns, "value", "complaint", "seen"])
    return table.astype(dict.fromkeys(columns[1:], "Int64"))


def not_right(table: pd.DataFrame) -> pd.DataFrame:
    """The lines of what was not right."""
    return table[table["complaint"].fillna("") != ""]


def counted(table: pd.DataFrame) -> tuple[int, int]:
    """How many were tried, and how many of them were not right."""
    if "inputs" not in table:
        return len(table), len(not_right(table))
    places = table[table["inputs"].notna()]
    return int(places["inputs"].sum()), int(places["not right"].sum())


def said(what: str, table: pd.DataFrame, seconds: float) -> None:
    """What there is to say of a table."""
    tried, wrong = counted(table)
    print(f"{what}: {tried} tried in {seconds:.0f} s, {wrong} not right")
    for line in not_right(table).itertuples(index=False):
        told = {k: v for k, v in line._asdict().items() if isinstance(v, str) and v}
        print("  " + " | ".join(" ".join(v.split())[:160] for v in told.values()))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--thinned", action="store_true")
    parser.add_argument("--only", choices=("inputs", "mechanisms", "faults"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=workers.cores())
    parser.add_argument("--match", default="", help="those alone whose names hold this")
    options = parser.parse_args()
    kinds = {"inputs": try_inputs, "mechanisms": try_mechanisms, "faults": try_faults}
    wrong = 0
    for what, trial in kinds.items():
        if options.only not in (None, what):
            continue
        begin = time.perf_counter()
        table = trial(options)
        said(what, table, time.perf_counter() - begin)
        wrong += counted(table)[1]
        if not (options.thinned or options.match):
            RESULTS.mkdir(exist_ok=True)
            table.to_csv(RESULTS / f"{what}.csv", index=False, float_format="%.3g")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    # Whatever a process that was killed left behind goes with this folder.
    with tempfile.TemporaryDirectory(prefix="robustness-") as scratch:
        os.environ["TMPDIR"] = scratch
        main()
