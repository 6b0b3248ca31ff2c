"""Print errors over rtol of the adaptive integrators, or recompute the stored references.

python validation/tolerances/run.py                  all cases (a quarter hour)
python validation/tolerances/run.py --case four_bar --integrator Radau --rtol 1e-4
python validation/tolerances/run.py --references     recompute the references (half an hour)

Options may be repeated.
"""

import argparse
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[2] / "models"), str(Path(__file__).parents[1])]

import pandas as pd
from tolerances.cases import ALL, ToleranceCase
from tolerances.references import measure_errors, store_reference

import beamdae as bd

TIME_LIMIT = 10.0  # wall time of a run [s]
INTEGRATORS: dict[str, Callable[[float], bd.Integrator]] = {
    "Ida": lambda rtol: bd.Ida(rtol, time_limit=TIME_LIMIT),
    "Radau": lambda rtol: bd.Radau(rtol, time_limit=TIME_LIMIT),
    "GeneralizedAlpha": lambda rtol: bd.GeneralizedAlpha(rtol=rtol, time_limit=TIME_LIMIT),
    "Auto": lambda rtol: bd.Auto(rtol, time_limit=TIME_LIMIT),
}
RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)


def tabulate_errors(
    case: ToleranceCase, names: list[str], rtols: list[float]
) -> Iterator[dict[str, object]]:
    """Yield the largest error over rtol of each run, or the status of one that did not end."""
    for name in names:
        for rtol in rtols:
            solution = case.run(INTEGRATORS[name](rtol))
            row = {"case": case.name, "bound": case.bound, "integrator": name, "rtol": rtol}
            row |= {"steps": solution.statistics.steps, "error / rtol": solution.status.kind}
            if solution.status.success:
                row["error / rtol"] = f"{measure_errors(case, solution)['error'].max() / rtol:.3g}"
            yield row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--case", action="append", help="this case only")
    parser.add_argument("--integrator", action="append", choices=INTEGRATORS, help="this one only")
    parser.add_argument("--rtol", action="append", type=float, help="this tolerance only")
    parser.add_argument("--references", action="store_true", help="recompute the references")
    options = parser.parse_args()
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    for case in ALL:
        if options.case and case.name not in options.case:
            continue
        if options.references:
            table = store_reference(case)
        else:
            names, rtols = options.integrator or list(INTEGRATORS), options.rtol or list(RTOLS)
            table = pd.DataFrame(tabulate_errors(case, names, rtols))
        print(table.to_string(index=False), flush=True)


if __name__ == "__main__":
    main()
