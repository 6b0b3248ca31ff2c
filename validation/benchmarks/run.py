"""Integrators, equilibria, modes, linear models, section forces, steady states: known answers.

    python validation/benchmarks/run.py [--case "car axis"]

Prints errors by case; the table of all of them goes to summary.csv.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import pandas as pd

import beamdae as bd
from benchmarks.bent_beams import KNOWN_RESTS
from benchmarks.cases import PARALLELOGRAM, PUBLISHED_CASES, PublishedCase
from benchmarks.equilibria import KNOWN_PATHS
from benchmarks.mechanism_cases import MECHANISM_CASES
from benchmarks.modes import KNOWN_MODES
from benchmarks.periodic_motions import KNOWN_PERIODIC
from benchmarks.section_forces import KNOWN_SECTION_FORCES
from benchmarks.spun_up import SPUN_UP
from benchmarks.step_response import STEP_RESPONSES

SUMMARY = Path(__file__).parent / "summary.csv"
CASES = (*PUBLISHED_CASES, PARALLELOGRAM, *MECHANISM_CASES)
# What gives rows of its own.
FURTHER = (
    *KNOWN_MODES,
    *STEP_RESPONSES,
    *KNOWN_RESTS,
    *KNOWN_PATHS,
    *SPUN_UP,
    *KNOWN_SECTION_FORCES,
    *KNOWN_PERIODIC,
    *SPUN_UP,
)
RTOLS = (1e-4, 1e-6, 1e-8)
INTEGRATORS = {
    **{f"Ida rtol {rtol:g}": bd.Ida(rtol) for rtol in RTOLS},
    **{f"Radau rtol {rtol:g}": bd.Radau(rtol) for rtol in RTOLS},
    **{f"GeneralizedAlpha rtol {rtol:g}": bd.GeneralizedAlpha(rtol=rtol) for rtol in RTOLS[:2]},
    **{
        f"GeneralizedAlpha step {step:g}": bd.GeneralizedAlpha(step, newton_tolerance=1e-9)
        for step in (4e-3, 2e-3, 1e-3)
    },
}


def rows(case: PublishedCase, setting: str) -> Iterator[dict[str, object]]:
    """A row for each thing that is known: where it is off most, and what that is worth.

    Of a run that does not reach its end a row that says why. `relative` is the error beside the
    largest value that is known.
    """
    with warnings.catch_warnings():
        # Of change points, and of tolerances that take many steps: the table has what comes of it.
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        solution = case.tried(INTEGRATORS[setting])
        quality = solution.quality
    if not solution.status.success:
        yield {"case": case.name, "setting": setting, "ended": solution.status.sentence}
        return
    for name, (known, ours) in case.both(solution).items():
        worst = np.unravel_index(np.argmax(np.abs(ours - known)), known.shape)
        error = abs(ours[worst] - known[worst])
        yield {
            "case": case.name,
            "setting": setting,
            "quantity": name,
            "entry": worst[1],
            "t [s]": f"{case.times[worst[0]]:.6g}",
            "published": f"{known[worst]:.12g}",
            "ours": f"{ours[worst]:.12g}",
            "error": f"{error:.2e}",
            "relative": f"{error / np.max(np.abs(known)):.2e}",
            "steps": solution.statistics.steps,
            "drift": f"{quality.max_position_drift:.1e}",
            "energy imbalance": f"{quality.energy_imbalance:.1e}",
            "ended": "",
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--case", choices=list(dict.fromkeys(x.name for x in (*CASES, *FURTHER))))
    chosen = parser.parse_args().case
    cases = [case for case in CASES if chosen in (None, case.name)]
    found = [row for case in cases for x in INTEGRATORS for row in rows(case, x)]
    further = [case for case in FURTHER if chosen in (None, case.name)]
    found += [row for case in further for row in case.rows()]
    table = pd.DataFrame(found, dtype=object)
    if chosen is None:
        table.to_csv(SUMMARY, index=False)
    for _, row in table[table["ended"] != ""].iterrows():
        print(f"{row['case']}, {row['setting']}: {row['ended']}")
    short = table.astype({"relative": float}).pivot_table(
        index=["case", "quantity"], columns="setting", values="relative", sort=False
    )
    print("largest error relative to the largest known value")
    print(short.to_string(float_format=lambda x: f"{x:.0e}"))


if __name__ == "__main__":
    main()
