"""Time steps of mechanisms with springs, contact and friction, relative to their size.

    python validation/performance/mechanisms.py [--quick]

The predicted time is that of the same bodies and joints without these forces, a mechanism with as
many unknowns and the same matrix pattern. Both mechanisms run from the same start over the same
time with the same steps. Stiff forces may require more iterations per step, so the ratio of the
times per residual evaluation is also reported.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from measurement import RESULTS, time_in_turns, time_integration, time_within_loops, write_table

import beamdae as bd
from beamdae.linear.blas_threads import single_threaded

STEP = 1e-3  # s
STEPS = 20_000
ROUNDS = 10
QUICK_ROUNDS = 2
SPRINGS = ("spring", "damper")
ALL = (*SPRINGS, "contact")
# By name: whether the coupler is flexible, and the names of the forces.
CASES = {
    "rigid, springs": (False, SPRINGS),
    "rigid, springs, contact": (False, ALL),
    "rigid, springs, contact, friction": (False, (*ALL, "friction")),
    "flexible, springs": (True, SPRINGS),
    "flexible, springs, contact": (True, ALL),
    "flexible, springs, contact, friction": (True, (*ALL, "friction")),
}


def four_bar(flexible: bool = False, forces: tuple[str, ...] = ()) -> bd.Mechanism:
    """Return a crank-rocker whose coupler is rigid or a beam of 4 elements, with named forces."""
    steel, mech = bd.Material.of("steel"), bd.Mechanism(gravity=(0.0, -9.81))
    strip = bd.Section.rectangle(steel, width=0.02, height=0.01, damping=1e-4)
    shaft, foot, crank_end, rocker_end = (0.0, 0.0), (0.9, 0.0), (0.0, 0.25), (0.7, 0.56)
    ground = mech.ground
    crank = mech.add(bd.RigidBody.rod("crank", shaft, crank_end, mass=0.4))
    rocker = mech.add(bd.RigidBody.rod("rocker", foot, rocker_end, mass=0.9))
    if flexible:
        line = bd.Line(crank_end, rocker_end)
        coupler = mech.add(bd.Beam("coupler", line, strip, elements=4))
        ends = (coupler.start, coupler.end)
    else:
        bar = mech.add(bd.RigidBody.rod("coupler", crank_end, rocker_end, mass=1.2))
        ends = (bar.at(*crank_end), bar.at(*rocker_end))
    mech.add(bd.Revolute("crank bearing", ground.at(*shaft), crank.at(*shaft)))
    mech.add(bd.Revolute("crank pin", crank.at(*crank_end), ends[0]))
    mech.add(bd.Revolute("rocker pin", ends[1], rocker.at(*rocker_end)))
    bearing = mech.add(bd.Revolute("rocker bearing", ground.at(*foot), rocker.at(*foot)))
    if "spring" in forces:
        mech.add(
            bd.Spring("spring", ground.at(1.4, 0.3), rocker.at(0.8, 0.28), 150.0, free_length=0.3)
        )
    if "damper" in forces:
        mech.add(bd.Spring("damper", ground.at(-0.3, 0.4), crank.at(*crank_end), damping=2.0))
    if "contact" in forces:
        stop = bd.LineSurface(ground.at(0.9, 0.4), (0.3, -1.0))
        tip = rocker.at(*rocker_end)
        mech.add(bd.Contact("stop", tip, stop, 2e5, restitution=0.6, impact_speed=1.0))
    if "friction" in forces:
        mech.add(bd.Friction("rubbing", bearing, 0.2, friction_speed=0.01, radius=0.02))
    return mech


@single_threaded
def compare_cases(rounds: int) -> pd.DataFrame:
    """Return times of a step with and without forces, for every case."""
    rows, times = [], np.linspace(0.0, STEP * STEPS, 2)
    integrator = bd.GeneralizedAlpha(STEP)
    for name, (flexible, forces) in CASES.items():
        equations = {
            "forces": bd.equations_of_motion(four_bar(flexible, forces)),
            "plain": bd.equations_of_motion(four_bar(flexible)),
        }
        times_by_case = time_in_turns(
            {x: partial(_time_loops, e, integrator, times) for x, e in equations.items()}, rounds
        )
        counts = {
            x: time_integration(e, integrator, times)[1].statistics.residual_calls / STEPS
            for x, e in equations.items()
        }
        step = {x: 1e6 * samples.least / STEPS for x, samples in times_by_case.items()}
        iteration = {x: step[x] / counts[x] for x in step}
        rows.append(
            {
                "four-bar": name,
                "unknowns": equations["plain"].n + equations["plain"].m,
                "step [us]": step["forces"],
                "predicted [us]": step["plain"],
                "ratio": step["forces"] / step["plain"],
                "residuals a step": counts["forces"],
                "predicted": counts["plain"],
                "ratio by residual": iteration["forces"] / iteration["plain"],
            }
        )
    return pd.DataFrame(rows)


def _time_loops(
    equations: bd.results.EquationsOfMotion, integrator: bd.Integrator, times: np.ndarray
) -> float:
    return time_within_loops(equations, integrator, times)[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the table")
    options = parser.parse_args()
    write_table(options.out, "mechanisms", compare_cases(QUICK_ROUNDS if options.quick else ROUNDS))


if __name__ == "__main__":
    main()
