"""True errors of runs that are refined until an accuracy is reached.

    python validation/required_accuracy/run.py [--references FOLDER] [--summary] [CASE ...]

`simulate(accuracy=)` runs each case for 1 % and 0.1 %. The reference has geometrically exact beams
of at least 16 elements and rtol = 1e-7; the columns of a case count if it differs from a run with
half as many elements and rtol = 1e-6 by at most a third of the accuracy. Errors are those of
`Errors`: the larger one of the errors of peaks and of root mean squares; "rows" are the largest
differences at single times. Long runs are shortened. Results are in results/columns.csv (a row per
column) and results/runs.csv (a row per run); --summary prints the table of both.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path

VALIDATION = Path(__file__).parents[1]
sys.path[:0] = [str(VALIDATION), str(VALIDATION.parent / "models")]

import numpy as np
import pandas as pd
from tolerances.cases import ALL
from tolerances.tolerance_case import ToleranceCase

import beamdae as bd
from beamdae.accuracy import refinement
from beamdae.equations.assembly.assemble import equations_of_motion

RESULTS = Path(__file__).parent / "results"
ACCURACIES = (0.01, 0.001)
TIME_LIMIT, REFERENCE_TIME_LIMIT = 60.0, 90.0  # wall time [s]
WARM_UP_SHARE = 0.02  # of the duration of a case
REFERENCES = ((16, 1e-7), (8, 1e-6))  # elements of a beam and rtol, of the reference and its check
# End times [s] of cases whose reference would take too long.
DURATIONS = {
    "drag_flag": 1.5,
    "falling_mast": 1.0,
    "hanging_four_bar": 1.5,
    "leaf_spring_vehicle": 0.5,
    "pendulum_damped": 2.0,
    "rolling_arm": 2.0,
    "tethered_satellites": 6.0,
    "watt_six_bar": 0.8,
    "wound_spiral": 0.2,
}
CASES = (
    *("blade_in_gusts", "bow", "cart_mast", "crossed_bridge", "drag_flag", "exact_pendulum"),
    *("falling_mast", "flexible_crank_damped", "gas_engine", "hanging_four_bar"),
    *("hub_fast_damped", "leaf_spring_vehicle", "micro_resonator", "pendulum_damped"),
    *("rolling_arm", "scotch_yoke", "slider_crank_chord", "spinning_beam", "tethered_satellites"),
    *("tuning_fork", "watt_six_bar", "whip", "wound_spiral"),
)


def refine(case: ToleranceCase, accuracy: float, share: float = 1.0) -> bd.results.Solution:
    """Refine the positions, angles and deflections of a case for a share of its duration."""
    t_end = share * duration(case)
    return bd.simulate(
        case.build(),
        bd.Auto(time_limit=TIME_LIMIT),
        t_end=t_end,
        output_step=t_end / 1000,
        accuracy=accuracy,
        accuracy_columns=[*case.columns, *case.deflections],
    )


def duration(case: ToleranceCase) -> float:
    """Return the end time of a case [s]."""
    return DURATIONS.get(case.name, case.duration)


def integrate_reference(
    case: ToleranceCase, times: np.ndarray, elements: int, rtol: float
) -> pd.DataFrame | None:
    """Return the columns of a run with exact strains, or None if it does not reach the end."""
    equations = equations_of_motion(case.build())
    beams = [x for x in equations.mechanism.parts.values() if isinstance(x, bd.Beam)]
    fewest = min((beam.mesh.elements for beam in beams), default=elements)
    for _ in range(max(int(np.ceil(np.log2(elements / fewest))), 1 if beams else 0)):
        start = equations.mechanism.start or "as drawn"
        equations = refinement.refine(equations, start).equations
    integrator = bd.Radau(rtol, time_limit=REFERENCE_TIME_LIMIT)
    solution = integrator.integrate(equations, times)
    return solution.observed if solution.status.success else None


def load_references(case: ToleranceCase, times: np.ndarray, folder: Path | None) -> list:
    """Return the reference and its check, from files of `folder` if they exist."""
    path = None if folder is None else folder / f"{case.name}.pkl"
    if path is not None and path.exists():
        return pd.read_pickle(path)
    tables = [integrate_reference(case, times, *settings) for settings in REFERENCES]
    if path is not None:
        path.parent.mkdir(exist_ok=True)
        pd.to_pickle(tables, path)
    return tables


def true_errors(rows: pd.DataFrame, reference: pd.DataFrame | None) -> pd.DataFrame:
    """Return the errors of columns as in `Errors`: "total" and "rows"."""
    if reference is None:
        return pd.DataFrame({"total": np.nan, "rows": np.nan}, index=rows.columns)
    count = min(len(rows), len(reference))
    rows, reference = rows.iloc[:count], reference.iloc[:count].set_axis(rows.index[:count])
    difference, half_range = rows - reference, 0.5 * (reference.max() - reference.min())
    peaks = [(rows.max() - reference.max()).abs(), (rows.min() - reference.min()).abs()]
    means = np.sqrt((difference**2).mean()) / reference.std(ddof=0)
    total = np.maximum(np.maximum(*peaks) / half_range, means)
    return pd.DataFrame({"total": total, "rows": difference.abs().max() / half_range})


def run_case(case: ToleranceCase, folder: Path | None = None) -> tuple[list[dict], list[dict]]:
    """Return the rows of both tables."""
    column_rows, run_rows, references = [], [], None
    refine(case, ACCURACIES[0], WARM_UP_SHARE)  # This compiles the kernels.
    for accuracy in ACCURACIES:
        begin = time.process_time()
        solution = refine(case, accuracy)
        seconds = time.process_time() - begin
        references = references or load_references(case, solution.t, folder)
        reference, check = references
        errors, stated = true_errors(solution.observed, reference), solution.errors
        uncertainty = true_errors(reference if check is None else check, reference)["rows"]
        mechanism = solution.equations.mechanism
        beams = [x for x in mechanism.parts.values() if isinstance(x, bd.Beam)]
        run_rows.append(
            {
                "case": case.name,
                "accuracy": accuracy,
                "status": stated.status.kind,
                "reason": stated.status.sentence,
                "t_end": duration(case),
                "rtol": solution.integrator["rtol"],
                "elements": sum(x.mesh.elements for x in beams),
                "processor time [s]": seconds,
            }
        )
        column_rows += [
            {
                "case": case.name,
                "accuracy": accuracy,
                "column": column,
                "is required": column in {*case.columns, *case.deflections},
                "status": stated.status.kind,
                "stated": total,
                "true": errors["total"].get(column, np.nan),
                "true rows": errors["rows"].get(column, np.nan),
                "uncertainty": np.nan if check is None else uncertainty.get(column, np.nan),
            }
            for column, total in zip(stated.headers, stated.total, strict=True)
        ]
    return column_rows, run_rows


def summarize(columns: pd.DataFrame, runs: pd.DataFrame) -> pd.DataFrame:
    """Return coverage and cost by accuracy; columns count if their reference is certain."""
    rows = []
    for accuracy, group in runs.groupby("accuracy", sort=False):
        x = columns[(columns["accuracy"] == accuracy) & (columns["status"] == "ok")]
        x = x[x["is required"] & (x["uncertainty"] <= accuracy / 3.0)]
        resolved = x[x["true"] > 3.0 * x["uncertainty"]]
        ratio = resolved["stated"] / resolved["true"]
        seconds = group["processor time [s]"]
        rows.append(
            {
                "accuracy": accuracy,
                "mechanisms": len(group),
                "reached": int((group["status"] == "ok").sum()),
                "columns": len(x),
                "within accuracy": float((x["true"] <= accuracy).mean()),
                "rows within accuracy": float((x["true rows"] <= accuracy).mean()),
                "stated / true, median": float(ratio.median()),
                "stated within a factor 2": float(ratio.between(0.5, 2.0).mean()),
                "processor time [s], median": float(seconds.median()),
                "processor time [s], largest": float(seconds.max()),
            }
        )
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", help="names of cases; default: all")
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--references", type=Path, help="folder of references to reuse and extend")
    parser.add_argument("--summary", action="store_true", help="print the stored results")
    arguments = parser.parse_args()
    if arguments.summary:
        tables = (pd.read_csv(arguments.out / f"{x}.csv") for x in ("columns", "runs"))
        print(summarize(*tables).T.to_string())
        return
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    cases = {case.name: case for case in ALL}
    column_rows, run_rows = [], []
    for name in arguments.cases or CASES:
        columns, runs = run_case(cases[name], arguments.references)
        column_rows += columns
        run_rows += runs
        print(name, [(x["status"], round(x["processor time [s]"], 2)) for x in runs], flush=True)
        arguments.out.mkdir(exist_ok=True)
        pd.DataFrame(column_rows).to_csv(arguments.out / "columns.csv", index=False)
        pd.DataFrame(run_rows).to_csv(arguments.out / "runs.csv", index=False)
    print(summarize(pd.DataFrame(column_rows), pd.DataFrame(run_rows)).T.to_string())


if __name__ == "__main__":
    main()
