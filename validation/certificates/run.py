"""Coverage, tightness and cost of certificates.

    python validation/certificates/run.py [--set SET] [--second] [--summary] [CASE ...]

Each case is certified at 1 % and 0.1 %. The reference has geometrically exact beams, elements of a
quarter of the length and Radau at a hundredth of the rtol of the certificate at 0.1 %; it is
rejected if its own difference to a run with elements of half the length and ten times its rtol is
larger than a third of a budget. Results are in results/columns.csv (a row per column) and
results/certificates.csv (a row per certificate). With --second, references by Ida are compared
with those by Radau (results/second_method.csv); --summary prints the table of stored results.
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
from beamdae.beams.remeshing import choose_base_meshes, with_meshes
from beamdae.equations.assembly.assemble import equations_of_motion

RESULTS = Path(__file__).parent / "results"
ACCURACIES = (0.01, 0.001)
# Wall time of a certificate and of a reference run [s].
TIME_LIMIT, REFERENCE_TIME_LIMIT = 60.0, 45.0
WARM_UP_SHARE = 0.02  # of the duration of a case
# Budgets above this part of the accuracy are not dominated by the smallest stated errors.
FLOOR_RATIO = 4e-3
RTOL_RATIO = 1e-2  # reference / certificate
MIN_RTOL = 1e-10
MAX_ELEMENTS = 32
# End times [s] of cases whose reference would take too long.
DURATIONS = {
    "bead_in_bowl": 0.3,
    "clock_pendulum": 6.0,
    "drag_flag": 1.5,
    "falling_mast": 1.0,
    "hanging_four_bar": 1.5,
    "jib_crane": 2.0,
    "leaf_spring_vehicle": 0.5,
    "pendulum_damped": 2.0,
    "pendulum_undamped": 1.0,
    "rolling_arm": 2.0,
    "spin_up_damped": 5.0,
    "tethered_satellites": 6.0,
    "tutorial_four_bar": 2.0,
    "watt_six_bar": 0.8,
    "watt_six_bar_undamped": 0.6,
    "wound_spiral": 0.2,
}
# Mechanisms with which the safety factors of beamdae.certification were chosen: every second one of
# the 46 mechanisms that were certified by earlier versions, in alphabetical order.
TUNED = (
    "bead_in_bowl",
    "bouncing_beam",
    "cantilever_10N_damped",
    "clock_pendulum",
    "double_strips_damped",
    "exact_chain",
    "example_four_bar",
    "five_bar",
    "four_bar_damped",
    "hammered_cantilever",
    "hub_beam",
    "jib_crane",
    "magnet_strip",
    "peaucellier",
    "pendulum_undamped",
    "running_blade",
    "shallow_arch",
    "spin_up_damped",
    "step_on_tip_mass",
    "thick_strip_damped",
    "tutorial_four_bar",
    "watt_six_bar_undamped",
    "wiper",
)
# The others of them.
HELD_OUT = (
    "blade_in_gusts",
    "bow",
    "cart_mast",
    "crossed_bridge",
    "drag_flag",
    "exact_pendulum",
    "falling_mast",
    "flexible_crank_damped",
    "gas_engine",
    "hanging_four_bar",
    "hub_fast_damped",
    "leaf_spring_vehicle",
    "micro_resonator",
    "pendulum_damped",
    "rolling_arm",
    "scotch_yoke",
    "slider_crank_chord",
    "spinning_beam",
    "tethered_satellites",
    "tuning_fork",
    "watt_six_bar",
    "whip",
    "wound_spiral",
)
# Mechanisms that were first certified after all constants were chosen.
FRESH = (
    "spinning_beam_damped",
    "thin_strip_damped",
    "cantilever_small_damped",
    "cantilever_30mm_damped",
    "no_tip_mass_damped",
    "step_on_beam_damped",
    "slider_crank_tangent",
    "hub_slow",
    "hub_weak",
    "tutorial_four_bar_undamped",
    "governor",
    "geared_rotors",
    "quick_return",
    "spring_pendulum",
    "driven_pendulum",
    "magnet_ball",
    "kepler",
    "figure_eight",
    "bouncing_ball",
    "stick_slip",
)
SETS = {"tuned": TUNED, "held out": HELD_OUT, "fresh": FRESH}

# Mechanisms of which a second method confirms the reference.
SECOND = (
    "four_bar_damped",
    "slider_crank_chord",
    "hub_fast_damped",
    "micro_resonator",
    "cart_mast",
)


def certify(case: ToleranceCase, accuracy: float, share: float = 1.0) -> bd.Certificate:
    """Certify the positions, angles and deflections of a case for a share of its duration."""
    t_end = share * duration(case)
    return bd.certify(
        case.build(),
        accuracy,
        columns=[*case.columns, *case.deflections],
        t_end=t_end,
        output_step=t_end / 1000,
        time_limit=TIME_LIMIT,
    )


def set_of(case: ToleranceCase) -> str:
    """Return the name of the set of a case."""
    return next(name for name, cases in SETS.items() if case.name in cases)


def duration(case: ToleranceCase) -> float:
    """Return the end time of a case [s]."""
    return DURATIONS.get(case.name, case.duration)


def integrate_reference(
    case: ToleranceCase,
    certificate: bd.Certificate,
    refinement: int,
    rtol_ratio: float,
    method: type[bd.Integrator] = bd.Radau,
) -> pd.DataFrame:
    """Return the columns of a run with finer meshes and a smaller rtol than a certificate."""
    mechanism = case.build()
    meshes = {}
    for name, base in choose_base_meshes(mechanism, 4).items():
        needed = min(refinement * certificate.elements[name], MAX_ELEMENTS)
        halvings = int(np.ceil(np.log2(max(needed / base.mesh.elements, 1.0))))
        meshes[name] = base.refined(halvings)
    exact = with_meshes(mechanism, meshes, dict.fromkeys(meshes, "exact"))
    rtol = max(certificate.runs[-1].rtol * rtol_ratio, MIN_RTOL)
    integrator = method(rtol, time_limit=REFERENCE_TIME_LIMIT)
    solution = integrator.integrate(equations_of_motion(exact), certificate.solution.t)
    if not solution.status.success:
        raise RuntimeError(f"{case.name}: reference: {solution.status.sentence}")
    return solution.observed


def relative_errors(rows: pd.DataFrame, reference: pd.DataFrame) -> pd.Series:
    """Return the largest difference of each column relative to half its range."""
    count = min(len(rows), len(reference))
    difference = (rows[:count] - reference[:count]).abs().max()
    return difference / (0.5 * (reference.max() - reference.min()))


def integrate_or_load_references(
    case: ToleranceCase, certificate: bd.Certificate, folder: Path | None
) -> tuple[pd.DataFrame | None, pd.DataFrame | None]:
    """Return the reference and the coarser run that shows its uncertainty, or None if one fails.

    Files of `folder` are loaded and, if they do not exist, written.
    """
    path = None if folder is None else folder / f"{case.name}.npz"
    if path is not None and path.exists():
        stored = np.load(path)
        names = stored["columns"].tolist()
        return tuple(pd.DataFrame(stored[key], columns=names) for key in ("reference", "check"))
    try:
        reference = integrate_reference(case, certificate, 4, RTOL_RATIO)
        check = integrate_reference(case, certificate, 2, 10.0 * RTOL_RATIO)
    except RuntimeError as problem:
        print(problem, flush=True)
        return None, None
    if path is not None:
        path.parent.mkdir(exist_ok=True)
        names = list(reference.columns)
        np.savez_compressed(path, columns=names, reference=reference, check=check)
    return reference, check


def run_case(case: ToleranceCase, references: Path | None = None) -> tuple[list[dict], list[dict]]:
    """Return the rows of both tables; `references` is a folder with stored references."""
    column_rows, certificate_rows = [], []
    certificates = {}
    for accuracy in ACCURACIES:
        # The first certificate compiles the kernels, which later runs share.
        if not certificates:
            certify(case, accuracy, WARM_UP_SHARE)
        begin = time.perf_counter()
        certificates[accuracy] = certify(case, accuracy)
        seconds = time.perf_counter() - begin
        c = certificates[accuracy]
        certificate_rows.append(
            {
                "case": case.name,
                "set": set_of(case),
                "accuracy": accuracy,
                "status": c.status.kind,
                "reason": c.status.sentence,
                "good until": c.good_until,
                "growth rate": c.growth_rate,
                "t_end": duration(case),
                "rtol": c.runs[-1].rtol,
                "elements": sum(c.elements.values()),
                "theory": "/".join(sorted(set(c.formulations.values()))),
                "runs": len(c.runs),
                "cost": c.cost,
                "seconds": seconds,
            }
        )
    finest = certificates[min(ACCURACIES)]
    reference, check = integrate_or_load_references(case, finest, references)
    kinds = {
        name: kind
        for kind in ("columns", "deflections", "rates", "reactions")
        for name in getattr(case, kind)
    }
    for accuracy, c in certificates.items():
        budget = c.budget
        true = uncertainty = pd.Series(np.nan, index=budget.index)
        if reference is not None:
            true = relative_errors(c.solution.observed, reference).reindex(budget.index)
            uncertainty = relative_errors(check, reference).reindex(budget.index)
        for column in budget.index:
            row = budget.loc[column]
            column_rows.append(
                {
                    "case": case.name,
                    "set": set_of(case),
                    "accuracy": accuracy,
                    "kind": kinds.get(column, "other"),
                    "column": column,
                    "status": c.status.kind,
                    **{x: row[x] for x in ("time", "mesh", "theory", "total", "theory as written")},
                    "true error": true[column],
                    "uncertainty": uncertainty[column],
                    "certified": row["certified"].strip("()"),
                }
            )
    return column_rows, certificate_rows


def compare_methods(case: ToleranceCase) -> list[dict]:
    """Return the difference of references by Ida and Radau, with the budget at 0.1 %."""
    # The first certificate compiles the kernels, which may take longer than the time limit.
    _, certificate = (certify(case, min(ACCURACIES)) for _ in range(2))
    radau = integrate_reference(case, certificate, 2, RTOL_RATIO)
    ida = integrate_reference(case, certificate, 2, RTOL_RATIO, bd.Ida)
    difference = relative_errors(ida, radau)
    return [
        {
            "case": case.name,
            "column": column,
            "Ida and Radau": difference[column],
            "budget": certificate.budget["total"][column],
        }
        for column in (*case.columns, *case.deflections)
    ]


def summarize(columns: pd.DataFrame, certificates: pd.DataFrame) -> pd.DataFrame:
    """Return coverage, tightness and cost by set and accuracy."""
    rows = []
    required = columns[columns["kind"].isin(["columns", "deflections"])]
    for (name, accuracy), group in certificates.groupby(["set", "accuracy"], sort=False):
        x = required[(required["set"] == name) & (required["accuracy"] == accuracy)]
        x = x[(x["status"] == "ok") & (x["uncertainty"] <= x["total"] / 3.0)]
        ratio = x["total"] / x["true error"]
        is_above_floor = x["total"] > FLOOR_RATIO * accuracy
        done = group[group["status"] == "ok"]
        rows.append(
            {
                "set": name,
                "accuracy": accuracy,
                "mechanisms": len(group),
                "certified": len(done),
                "columns": len(x),
                "within budget": float((x["true error"] <= x["total"]).mean()),
                "within accuracy": float((x["true error"] <= accuracy).mean()),
                "false certificates": x[x["true error"] > accuracy]["case"].nunique(),
                "budget / error, median": float(ratio.median()),
                "columns above the floor": int(is_above_floor.sum()),
                "budget / error above the floor, median": float(ratio[is_above_floor].median()),
                "budget / error above the floor, 90 %": float(ratio[is_above_floor].quantile(0.9)),
                "cost, median": float(done["cost"].median()),
                "cost, worst": float(done["cost"].max()),
                "seconds, median": float(done["seconds"].median()),
            }
        )
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--set", choices=[*SETS], help="default: all")
    parser.add_argument("cases", nargs="*", help="names of cases")
    parser.add_argument("--second", action="store_true", help="compare references by two methods")
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--references", type=Path, help="folder of references to reuse and extend")
    parser.add_argument("--summary", action="store_true", help="print the stored results")
    arguments = parser.parse_args()
    if arguments.summary:
        tables = (pd.read_csv(arguments.out / f"{x}.csv") for x in ("columns", "certificates"))
        print(summarize(*tables).T.to_string())
        return
    names = SETS.get(arguments.set, sum(SETS.values(), ()))
    cases = {case.name: case for case in ALL}
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    if arguments.second:
        rows = [row for name in arguments.cases or SECOND for row in compare_methods(cases[name])]
        pd.DataFrame(rows).to_csv(arguments.out / "second_method.csv", index=False)
        print(pd.DataFrame(rows).to_string())
        return
    column_rows, certificate_rows = [], []
    for name in arguments.cases or names:
        begin = time.perf_counter()
        try:
            more_columns, more_certificates = run_case(cases[name], arguments.references)
        except (bd.BeamdaeError, KeyError) as problem:
            print(f"{name}: {problem!r}", flush=True)
            continue
        column_rows += more_columns
        certificate_rows += more_certificates
        print(
            name,
            f"{time.perf_counter() - begin:.1f} s",
            [(x["status"], round(x["cost"], 2)) for x in more_certificates],
            flush=True,
        )
        arguments.out.mkdir(exist_ok=True)
        pd.DataFrame(column_rows).to_csv(arguments.out / "columns.csv", index=False)
        pd.DataFrame(certificate_rows).to_csv(arguments.out / "certificates.csv", index=False)
    print(summarize(pd.DataFrame(column_rows), pd.DataFrame(certificate_rows)).T.to_string())


if __name__ == "__main__":
    main()
