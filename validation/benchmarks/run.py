"""Compare integrators, equilibria, modes, section forces and periodic motions with references.

    python validation/benchmarks/run.py [--case "car axis"]

Prints the errors by case; a run of all cases writes summary.csv.
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
from benchmarks.cases import PARALLELOGRAM, PUBLISHED_CASES, PublishedCase
from benchmarks.equilibria import PATH_CASES
from benchmarks.mechanism_cases import MECHANISM_CASES
from benchmarks.modes import MODE_CASES
from benchmarks.periodic_motions import PERIODIC_CASES
from benchmarks.section_forces import SECTION_FORCE_CASES
from benchmarks.spin_up_cases import SPIN_UP_CASES
from benchmarks.static_cases import STATIC_CASES
from benchmarks.step_response import STEP_RESPONSES
from benchmarks.summary_rows import COLUMNS, describe_run, make_row

SUMMARY = Path(__file__).parent / "summary.csv"
CASES = (*PUBLISHED_CASES, PARALLELOGRAM, *MECHANISM_CASES)
# Cases that compute their rows themselves.
OTHER_CASES = (
    *MODE_CASES,
    *STEP_RESPONSES,
    *STATIC_CASES,
    *PATH_CASES,
    *SPIN_UP_CASES,
    *SECTION_FORCE_CASES,
    *PERIODIC_CASES,
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


def compare_case(case: PublishedCase, setting: str) -> Iterator[dict[str, object]]:
    """Yield one row per published quantity, at its largest error.

    A run that does not reach its end yields one row with the reason. `relative` is the error
    divided by the largest published value.
    """
    with warnings.catch_warnings():
        # Warnings about change points and tight tolerances; the table shows their effect.
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        solution = case.attempt(INTEGRATORS[setting])
        cost = describe_run(solution)
    if not solution.status.success:
        yield {"case": case.name, "setting": setting, "ended": solution.status.sentence}
        return
    for name, (reference, computed) in case.compare(solution).items():
        worst = np.unravel_index(np.argmax(np.abs(computed - reference)), reference.shape)
        place = {"entry": worst[1], "t [s]": f"{case.times[worst[0]]:.6g}"}
        values, scale = (reference[worst], computed[worst]), np.max(np.abs(reference))
        yield make_row(case.name, setting, name, *values, scale=scale, **place, **cost)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--case",
        help="run this case only",
        choices=list(dict.fromkeys(x.name for x in (*CASES, *OTHER_CASES))),
    )
    name = parser.parse_args().case
    cases = [case for case in CASES if name in (None, case.name)]
    rows = [row for case in cases for x in INTEGRATORS for row in compare_case(case, x)]
    other_cases = [case for case in OTHER_CASES if name in (None, case.name)]
    rows += [row for case in other_cases for row in case.rows()]
    table = pd.DataFrame(rows, columns=COLUMNS, dtype=object)
    if name is None:
        table.to_csv(SUMMARY, index=False)
    for _, row in table[table["ended"] != ""].iterrows():
        print(f"{row['case']}, {row['setting']}: {row['ended']}")
    summary = table.astype({"relative": float}).pivot_table(
        index=["case", "quantity"], columns="setting", values="relative", sort=False
    )
    print("largest error relative to the largest published value")
    print(summary.to_string(float_format=lambda x: f"{x:.0e}"))


if __name__ == "__main__":
    main()
