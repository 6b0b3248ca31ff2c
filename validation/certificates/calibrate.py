"""Errors extrapolated from two differences of runs, and true errors.

    python validation/certificates/calibrate.py [CASE ...]

Beams are geometrically exact. With the mesh fixed, rtol decreases from 1e-2 to 1e-6; with rtol
fixed, elements are halved up to three times. For three successive runs, `estimate` is the error of
the finest one by the extrapolation of `beamdae.certification` without safety factors, and `error`
its difference from a run with rtol 1e-7, or with elements halved four times: largest values over
the run of each position, angle and deflection, relative to half its range. Results are in
results/ratios.csv.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable
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

Array = np.ndarray
# Returns observed columns (k, columns) and the number of steps, for halvings and -log10(rtol).
Runs = Callable[[int, int], tuple[Array, int]]

TIME_LIMIT = 30.0  # of a run [s]
ROWS = 1001
FIRST_ELEMENTS = 1
TIME_HALVINGS, FINEST_DECADE = 1, 7  # of the runs that differ in rtol
MESH_DECADE, FINEST_HALVINGS = 6, 4  # of the runs that differ in the mesh
# Limits of the ratio of successive errors, as in beamdae.certification.
TIME_LIMITS, MESH_LIMITS = (0.1, 0.6), (0.02, 0.5)


class TooLongError(Exception):
    """A run does not end within the time limit."""


def extrapolate(before: Array, last: Array, limits: tuple[float, float]) -> Array:
    """Return the errors of the finest of three runs from their two differences."""
    ratio = last / before
    ratio = np.clip(np.fmax(ratio, np.nanmedian(ratio)), *limits)
    return ratio / (1.0 - ratio) * last


def compare_runs(run: Runs) -> list[dict]:
    """Return one row per column and three successive runs."""
    settings = [
        ("time", [(TIME_HALVINGS, k + j) for j in range(3)], (TIME_HALVINGS, FINEST_DECADE))
        for k in (2, 3, 4)
    ]
    settings += [
        ("mesh", [(k + j, MESH_DECADE) for j in range(3)], (FINEST_HALVINGS, MESH_DECADE))
        for k in (0, 1)
    ]
    rows = []
    for kind, successive, finest in settings:
        try:
            (a, _), (b, steps), (c, finer_steps) = (run(*x) for x in successive)
            truth, _ = run(*finest)
        except TooLongError as problem:
            print(problem, flush=True)
            continue
        half_range = 0.5 * np.ptp(truth, axis=0)
        before, last, error = (
            np.max(np.abs(x - y), axis=0) / half_range for x, y in ((a, b), (b, c), (c, truth))
        )
        estimate = extrapolate(before, last, TIME_LIMITS if kind == "time" else MESH_LIMITS)
        rows += [
            {
                "kind": kind,
                "halvings": successive[-1][0],
                "decade": successive[-1][1],
                "column": k,
                "step ratio": finer_steps / steps,
                "difference before": before[k],
                "difference": last[k],
                "estimate": estimate[k],
                "error": error[k],
            }
            for k in range(len(error))
        ]
    return rows


def calibrate(case) -> list[dict]:
    """Return the rows of a case."""
    names = [*case.columns, *case.deflections]
    times = np.linspace(0.0, duration(case), ROWS)

    @cache
    def run(halvings: int, decade: int) -> tuple[Array, int]:
        mechanism = case.build()
        bases = choose_base_meshes(mechanism, FIRST_ELEMENTS)
        meshes = {name: base.refined(halvings) for name, base in bases.items()}
        exact = with_meshes(mechanism, meshes, dict.fromkeys(meshes, "exact"))
        method = bd.Radau(10.0**-decade, time_limit=TIME_LIMIT)
        solution = method.integrate(equations_of_motion(exact), times)
        if not solution.status.success:
            raise TooLongError(f"{case.name}: {solution.status.sentence}")
        return solution.observed[names].to_numpy(), solution.trajectory.steps

    return [{"case": case.name, **row, "column": names[row["column"]]} for row in compare_runs(run)]


def summarize(table: pd.DataFrame) -> pd.DataFrame:
    """Return quantiles of estimate / error and of error / estimate."""
    moving = table[table["estimate"] > 0.0]
    ratio = moving["error"] / moving["estimate"]
    groups = ratio.groupby([moving["kind"], moving["halvings"], moving["decade"]])
    return groups.quantile([0.05, 0.5, 0.95, 1.0]).unstack().round(3)


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
    print(summarize(pd.DataFrame(rows)).to_string())


if __name__ == "__main__":
    main()
