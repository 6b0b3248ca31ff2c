"""Print the accuracy tables behind the error control of the adaptive integrators.

python validation/tolerances/run.py                  Ida: error over rtol, default settings
python validation/tolerances/run.py --alternatives   Ida: other error controls and orders
python validation/tolerances/run.py --damping        steps of orders 2 and 5 over damping (minutes)
python validation/tolerances/run.py --wide           wide set, all integrators (a quarter hour)
python validation/tolerances/run.py --new            newer set, all integrators (minutes)
python validation/tolerances/run.py --all            both sets
python validation/tolerances/run.py --random         random mechanisms, all integrators (minutes)
python validation/tolerances/run.py --references     recompute the stored references (half an hour)
python validation/tolerances/run.py --random-references 200 210   add references of these seeds

--case, --integrator and --rtol select runs of --wide and --random (--case also of --references) and
may be repeated; tables without a selection are written to results/.
--no-estimate leaves out the error estimates, which take half of the time; --store NAME names the
table.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[2] / "models"), str(Path(__file__).parents[1])]

import pandas as pd
from hub_beam import hub_beam
from pendulum import pendulum
from slider_crank import slider_crank

import beamdae as bd
from tolerances import error_tables
from tolerances.cases import ALL, CASES, NEW, WIDE
from tolerances.random_cases import random_cases, store_random_references
from tolerances.references import Effort, store_reference
from tolerances.tolerance_case import ToleranceCase

RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
RESULTS = Path(__file__).parent / "results"
SETS = {"wide": WIDE, "new": NEW, "all": ALL}


def tabulate_ida_run(case: ToleranceCase, integrator: bd.Ida) -> dict[str, object]:
    """Return error, statistics and energy imbalance of one run as a row."""
    solution = case.run(integrator)
    row: dict[str, object] = {
        "case": case.name,
        "rtol": f"{integrator.rtol:.0e}",
        "control": solution.integrator["error_control"],
        "order": solution.integrator["max_order"],
    }
    if solution.status.success:
        ratio = case.errors(solution).max() / integrator.rtol
        row |= {"error / rtol": f"{ratio:.1f}", "bound": case.bound}
    else:
        outcome = f"stopped at {solution.trajectory.end:.2g} s"
        row |= {"error / rtol": outcome, "bound": case.bound}
    statistics = solution.statistics
    return row | {
        "steps": statistics.steps,
        "residuals": statistics.residual_calls,
        "jacobians": statistics.jacobian_calls,
        "wall [s]": f"{statistics.wall_time:.2f}",
        "energy imbalance": f"{solution.quality.energy_imbalance:.1e}",
    }


def tabulate_defaults() -> list[dict[str, object]]:
    """Return rows of the default settings over rtol."""
    return [tabulate_ida_run(case, bd.Ida(rtol)) for case in CASES for rtol in RTOLS]


def tabulate_alternatives() -> list[dict[str, object]]:
    """Return rows of other error controls and orders at rtol 1e-4, at most 10 s a run."""
    settings = [(c, o) for c in ("positions", "velocities", "all") for o in (2, 3, 5)]
    return [
        tabulate_ida_run(
            case, bd.Ida(1e-4, error_control=control, max_order=order, time_limit=10.0)
        )
        for case in CASES
        for control, order in settings
    ]


def tabulate_damping() -> list[dict[str, object]]:
    """Return steps of orders 2 and 5 over the Kelvin-Voigt time, with positions tested."""
    rows = []
    for model in (slider_crank, pendulum, hub_beam):
        for rtol in (1e-4, 1e-6):
            for time in (1e-6, 1e-5, 1e-4, 1e-3):
                row: dict[str, object] = {"case": model.name, "damping [s]": time, "rtol": rtol}
                for order in (2, 5):
                    integrator = bd.Ida(
                        rtol, error_control="positions", max_order=order, max_steps=60_000
                    )
                    solution = bd.simulate(model(damping=time), integrator, t_end=2.0)
                    row[f"order {order}"] = solution.statistics.steps
                rows.append(row)
    return rows


def measure_cases(
    options: argparse.Namespace, cases: Iterable[ToleranceCase], rtols: tuple[float, ...]
) -> pd.DataFrame:
    """Return the table of the selected runs; rows are printed as they are computed."""
    selected_cases = [case for case in cases if not options.case or case.name in options.case]
    names = options.integrator or list(error_tables.INTEGRATORS)
    rows = []
    runs = (names, options.rtol or rtols, options.estimate)
    for row in error_tables.error_rows(selected_cases, *runs):
        rows.append(row)
        print(*(f"{x:.3g}" if isinstance(x, float) else x for x in row.values()), flush=True)
    return pd.DataFrame(rows)


def store_table(options: argparse.Namespace, table: pd.DataFrame, name: str) -> None:
    """Write a table to `--store`, or to its name if no option restricts it."""
    if options.store or not (options.case or options.integrator or options.rtol):
        RESULTS.mkdir(exist_ok=True)
        path = RESULTS / f"{options.store or name}.csv"
        table.to_csv(path, index=False, float_format="%.3g")


def tabulate_set(options: argparse.Namespace) -> pd.DataFrame:
    """Return error over rtol of a set of cases by all integrators, after printing summaries."""
    name = next(name for name in SETS if getattr(options, name))
    table = measure_cases(options, SETS[name], RTOLS)
    store_table(options, table, name)
    summaries = [error_tables.summarize_errors(table)]
    if "Auto" in set(table["integrator"]):
        summaries.append(error_tables.summarize_auto_cost(table))
    if options.estimate:
        summaries.append(error_tables.summarize_coverage(table))
    summaries.append(error_tables.pivot_errors(table, "r of deflections"))
    for summary in summaries:
        print(summary.to_string(float_format="{:.3g}".format), end="\n\n")
    return error_tables.pivot_errors(table)


def tabulate_random_set(options: argparse.Namespace) -> pd.DataFrame:
    """Print the worst random mechanisms; return quantiles of error over rtol over its bound."""
    table = measure_cases(options, random_cases(), RTOLS[:3])
    store_table(options, table, "random")
    print(error_tables.select_violations(table).head(30).to_string(index=False), end="\n\n")
    return error_tables.summarize_quantiles(table)


def recompute_references(options: argparse.Namespace) -> pd.DataFrame:
    """Recompute the stored references of the selected cases and return their summary."""
    effort = Effort(patience=options.patience)
    selected_cases = [case for case in ALL if not options.case or case.name in options.case]
    return pd.concat([store_reference(case, effort) for case in selected_cases])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tables = parser.add_mutually_exclusive_group()
    for name in ("alternatives", "damping", *SETS, "random", "references"):
        tables.add_argument(f"--{name}", action="store_true")
    tables.add_argument("--random-references", type=int, nargs=2, metavar=("FIRST", "END"))
    parser.add_argument("--case", action="append", help="run this case only")
    parser.add_argument(
        "--integrator",
        action="append",
        choices=error_tables.INTEGRATORS,
        help="run this integrator only",
    )
    parser.add_argument("--rtol", action="append", type=float, help="run this tolerance only")
    parser.add_argument(
        "--no-estimate", dest="estimate", action="store_false", help="skip the error estimates"
    )
    parser.add_argument("--store", metavar="NAME", help="write the table to results/NAME.csv")
    parser.add_argument(
        "--patience",
        type=float,
        default=Effort().patience,
        help="processor time per refinement of a reference [s]",
    )
    options = parser.parse_args()
    if options.random_references:
        table = pd.concat(store_random_references(range(*options.random_references)))
    elif any(getattr(options, name) for name in SETS):
        table = tabulate_set(options)
    elif options.random:
        table = tabulate_random_set(options)
    elif options.references:
        table = recompute_references(options)
    else:
        if options.alternatives:
            rows = tabulate_alternatives()
        elif options.damping:
            rows = tabulate_damping()
        else:
            rows = tabulate_defaults()
        table = pd.DataFrame(rows)
    print(table.to_string(index=table.index.nlevels > 1))


if __name__ == "__main__":
    main()
