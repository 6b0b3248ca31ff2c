"""Ratios of true errors to the differences of runs, from which `beamdae.certification` chooses.

    python validation/certificates/calibrate.py [CASE ...]

For exact beams with elements halved from 2 to 16 (base mesh), and for rtol from 1e-3 to 1e-6, the
error of the finer of two runs is divided by their difference: largest values over the run of each
position, angle and deflection. Results are in results/ratios.csv.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from functools import cache
from pathlib import Path

VALIDATION = Path(__file__).parents[1]
sys.path[:0] = [str(VALIDATION), str(VALIDATION.parent / "models")]

import numpy as np
import pandas as pd
from tolerances.cases import ALL

import beamdae as bd
from beamdae.beams.remeshing import choose_base_meshes, with_meshes
from beamdae.equations.assembly.assemble import equations_of_motion
from certificates.run import RESULTS, TUNED, duration

TIME_LIMIT = 30.0  # of a run [s]
FINE_RTOL, FINEST_RTOL = 1e-6, 1e-8
ROWS = 1001


class TooLongError(Exception):
    """A run does not end within the time limit."""


def calibrate(case) -> list[dict]:
    """Return one row per column and pair of runs."""
    names = [*case.columns, *case.deflections]
    times = np.linspace(0.0, duration(case), ROWS)

    @cache
    def run(halvings: int, rtol: float):
        mechanism = case.build()
        bases = choose_base_meshes(mechanism, 2)
        meshes = {name: base.refined(halvings) for name, base in bases.items()}
        exact = with_meshes(mechanism, meshes, dict.fromkeys(meshes, "exact"))
        method = bd.Radau(rtol, time_limit=TIME_LIMIT)
        solution = method.integrate(equations_of_motion(exact), times)
        if not solution.status.success:
            raise TooLongError(f"{case.name}: {solution.status.sentence}")
        rejected = solution.statistics.rejected_steps
        steps = solution.trajectory.steps
        return solution.observed[names].to_numpy(), (steps, rejected / (steps + rejected))

    rows = []

    def compare(kind, coarse, fine, truth):
        try:
            (a, steps_a), (b, steps_b), (c, _) = run(*coarse), run(*fine), run(*truth)
        except TooLongError as problem:
            print(problem, flush=True)
            return
        half_range = 0.5 * np.ptp(c, axis=0)
        difference, error = np.max(np.abs(a - b), axis=0), np.max(np.abs(b - c), axis=0)
        rho = steps_b[0] / steps_a[0]
        for k, name in enumerate(names):
            rows.append(
                {
                    "case": case.name,
                    "kind": kind,
                    "coarse": str(coarse),
                    "fine": str(fine),
                    "column": name,
                    "rho": rho,
                    "rejected": steps_b[1],
                    "rejected_coarse": steps_a[1],
                    "difference": difference[k] / half_range[k],
                    "error": error[k] / half_range[k],
                }
            )

    for rtol in (1e-3, 1e-4, 1e-5):
        compare("time", (1, rtol), (1, rtol / 10.0), (1, FINEST_RTOL))
    for halvings, rtol in ((0, 1e-3), (1, 1e-4)):
        # The difference at a loose tolerance, the error at a tight one.
        try:
            tight = run(halvings + 1, FINE_RTOL)[0] - run(halvings + 3, FINE_RTOL)[0]
            loose = run(halvings, rtol)[0] - run(halvings + 1, rtol)[0]
        except TooLongError as problem:
            print(problem, flush=True)
            continue
        half_range = 0.5 * np.ptp(run(halvings + 1, FINE_RTOL)[0], axis=0)
        for k, name in enumerate(names):
            rows.append(
                {
                    "case": case.name,
                    "kind": "mesh",
                    "coarse": str((halvings, rtol)),
                    "fine": str((halvings + 1, rtol)),
                    "column": name,
                    "rho": np.nan,
                    "rejected": np.nan,
                    "rejected_coarse": np.nan,
                    "difference": np.max(np.abs(loose[:, k])) / half_range[k],
                    "error": np.max(np.abs(tight[:, k])) / half_range[k],
                }
            )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", help="names of cases")
    parser.add_argument("--out", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    cases = {case.name: case for case in ALL}
    rows = []
    for name in arguments.cases or TUNED:
        begin = time.perf_counter()
        rows += calibrate(cases[name])
        print(name, f"{time.perf_counter() - begin:.1f} s", flush=True)
        arguments.out.mkdir(exist_ok=True)
        pd.DataFrame(rows).to_csv(arguments.out / "ratios.csv", index=False)
    table = pd.DataFrame(rows)
    ratio = (table["error"] / table["difference"]).groupby([table["kind"], table["coarse"]])
    print(ratio.quantile([0.5, 0.9, 0.95, 1.0]).unstack().round(3).to_string())


if __name__ == "__main__":
    main()
