"""Print the table behind the defaults of Ida's error control.

python validation/tolerances/run.py                  error over rtol, default settings
python validation/tolerances/run.py --alternatives   other error controls and orders
python validation/tolerances/run.py --damping        steps of orders 2 and 5 over damping (minutes)
python validation/tolerances/run.py --references     recompute the stored references (minutes)
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[2] / "models"), str(Path(__file__).parents[1])]

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from pendulum import pendulum
from slider_crank import slider_crank

import beamdae as bd
from tolerances.cases import CASES
from tolerances.tolerance_case import FOLDER, ToleranceCase

RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)


def row(case: ToleranceCase, integrator: bd.Ida) -> dict[str, object]:
    """One line of the table."""
    solution = case.run(integrator)
    line: dict[str, object] = {
        "case": case.name,
        "rtol": f"{integrator.rtol:.0e}",
        "control": solution.integrator["error_control"],
        "order": solution.integrator["max_order"],
    }
    if solution.status.success:
        ratio = case.errors(solution).max() / integrator.rtol
        line |= {"error / rtol": f"{ratio:.1f}", "bound": case.bound}
    else:
        reached = f"stopped at {solution.trajectory.end:.2g} s"
        line |= {"error / rtol": reached, "bound": case.bound}
    statistics = solution.statistics
    return line | {
        "steps": statistics.steps,
        "residuals": statistics.residual_calls,
        "jacobians": statistics.jacobian_calls,
        "wall [s]": f"{statistics.wall_time:.2f}",
        "energy imbalance": f"{solution.quality.energy_imbalance:.1e}",
    }


def defaults() -> list[dict[str, object]]:
    """Default settings over rtol."""
    return [row(case, bd.Ida(rtol)) for case in CASES for rtol in RTOLS]


def alternatives() -> list[dict[str, object]]:
    """What else could have been the default, at one tolerance and at most 10 s a run."""
    choices = [(c, o) for c in ("positions", "velocities", "all") for o in (2, 3, 5)]
    return [
        row(case, bd.Ida(1e-4, error_control=control, max_order=order, time_limit=10.0))
        for case in CASES
        for control, order in choices
    ]


def damping() -> list[dict[str, object]]:
    """Steps of orders 2 and 5 over the Kelvin-Voigt time, positions tested."""
    lines = []
    for model in (slider_crank, pendulum, hub_beam):
        for rtol in (1e-4, 1e-6):
            for time in (1e-6, 1e-5, 1e-4, 1e-3):
                line: dict[str, object] = {"case": model.name, "damping [s]": time, "rtol": rtol}
                for order in (2, 5):
                    integrator = bd.Ida(
                        rtol, error_control="positions", max_order=order, max_steps=60_000
                    )
                    solution = bd.simulate(model(damping=time), integrator, t_end=2.0)
                    line[f"order {order}"] = solution.statistics.steps
                lines.append(line)
    return lines


def references() -> list[dict[str, object]]:
    """Recompute the references: Richardson on generalized-alpha, checked by IDA at 1e-7."""
    lines = []
    for case in CASES:
        coarse, fine = (
            case.observed(
                case.run(bd.GeneralizedAlpha(k * case.fine_step, 0.9, newton_tolerance=1e-7))
            )
            for k in (2.0, 1.0)
        )
        reference = fine + (fine - coarse) / 3.0
        disagreement = case.errors(case.run(bd.Ida(1e-7)), reference).max()
        if disagreement > 1e-4:
            raise SystemExit(f"{case.name}: the two methods disagree by {disagreement:.1e}")
        change = np.max(np.abs(reference - fine) / (0.5 * np.ptp(reference, axis=0)))
        lines.append(
            {
                "case": case.name,
                "last extrapolation": f"{change:.1e}",
                "against IDA at 1e-7": f"{disagreement:.1e}",
            }
        )
        FOLDER.mkdir(exist_ok=True)
        table = pd.DataFrame(reference, columns=list(case.columns))
        times = np.linspace(0.0, case.model.t_end, len(table))
        table.insert(0, "t [s]", times)
        table.to_csv(FOLDER / f"{case.name}.csv", index=False, float_format="%.9g")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--references", action="store_true")
    parser.add_argument("--alternatives", action="store_true")
    parser.add_argument("--damping", action="store_true")
    options = parser.parse_args()
    lines = (
        references()
        if options.references
        else alternatives()
        if options.alternatives
        else damping()
        if options.damping
        else defaults()
    )
    print(pd.DataFrame(lines).to_string(index=False))


if __name__ == "__main__":
    main()
