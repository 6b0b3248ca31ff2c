"""Peak memory of processes that each simulate one beam of many elements over many steps.

    python validation/performance/peak_memory.py    two minutes

Only the output rows and some of the steps of such runs are stored. Peaks include Python, the
compiled loops, the rows, and the checks and warnings of the run.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import warnings
from pathlib import Path
from resource import RUSAGE_SELF, getrusage

from benchmark_systems import beam

import beamdae as bd

RESULTS = Path(__file__).parent / "results"
RUNS = ((512, 10_000), (2048, 10_000), (4096, 1_100), (4096, 10_000))  # elements and steps
ROWS = 1000
STEP = 2e-6  # s, which resolves the motion of the shortest elements


def measure_peak(elements: int, steps: int) -> float:
    """Return the peak memory of a new process that simulates a beam [GB]."""
    command = [sys.executable, __file__, "--one", str(elements), str(steps)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def print_peak(elements: int, steps: int) -> None:
    """Simulate a beam and print the peak memory of this process [GB]."""
    t_end = steps * STEP
    with warnings.catch_warnings():
        # Few steps are stored, and the motion is short.
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        solution = bd.simulate(beam(elements), bd.GeneralizedAlpha(STEP), t_end, t_end / ROWS)
    if not solution.status.success:
        raise RuntimeError(solution.status.sentence)
    print(getrusage(RUSAGE_SELF).ru_maxrss * 1024.0 / 1e9)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the table")
    parser.add_argument("--one", type=int, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print_peak(*options.one)
        return
    import pandas as pd
    from measurement import write_table

    peaks = [measure_peak(*run) for run in RUNS]
    table = pd.DataFrame(RUNS, columns=["elements", "steps"])
    write_table(options.out, "peak_memory", table.assign(rows=ROWS, **{"peak [GB]": peaks}))


if __name__ == "__main__":
    main()
