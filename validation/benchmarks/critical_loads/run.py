"""Compare critical points of beamdae with exact ones over slenderness and mesh.

    python validation/benchmarks/critical_loads/run.py [--case Beck] [--complete]

Prints each departure; a run of all cases writes summary.csv.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import pandas as pd

from benchmarks.critical_loads.cases import CASES

SUMMARY = Path(__file__).parent / "summary.csv"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--case", help="run the cases whose group or name contains this text")
    parser.add_argument(
        "--complete", action="store_true", help="run every mesh at every slenderness"
    )
    parser.add_argument("--output", type=Path, help="write the table to this file")
    options = parser.parse_args()
    is_summary = options.case is None and not options.complete
    output = options.output or (SUMMARY if is_summary else None)
    rows = []
    for case in CASES:
        if options.case and options.case not in f"{case.group}, {case.name}":
            continue
        begin = len(rows)
        for setting in case.settings(options.complete):
            for row in case.rows(*setting):
                rows.append(row)
                if row["verdict"] != "ok":
                    print(", ".join(str(value) for value in row.values()), flush=True)
        new = pd.DataFrame(rows[begin:])
        departures = int((new["verdict"] != "ok").sum())
        seconds = new["seconds"].astype(float).sum()
        title = f"{case.group}, {case.name}"
        print(f"{title}: {len(new)} points, {departures} departures, {seconds:.0f} s", flush=True)
        if output:
            pd.DataFrame(rows).to_csv(output, index=False)
    table = pd.DataFrame(rows)
    print(table.groupby(["group", "verdict"]).size().unstack(fill_value=0).to_string())


if __name__ == "__main__":
    main()
