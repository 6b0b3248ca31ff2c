"""Time a step of mechanisms with springs, contact and friction over what their size predicts.

    python validation/performance/mechanisms.py [--quick]

What it predicts is the time of the same bodies and joints without forces between them: as many
unknowns, the same pattern of the matrix. Each is run from the same start over the same time with
the same steps, and what is compared is the time of an evaluation and solution: runs with stiff
forces may take more of these a step, which is told apart.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from tables import RESULTS, write
from timing import in_turns, integrated, within_loops

import beamdae as bd
from beamdae.linear.blas_threads import single_threaded

STEP, STEPS = 1e-3, 20_000
# By name: whether the coupler is a beam, and which forces there are.
SPRINGS = ("spring", "damper")
ALL = (*SPRINGS, "contact")
CASES = {
    "rigid, springs": (False, SPRINGS),
    "rigid, springs, contact": (False, ALL),
    "rigid, springs, contact, friction": (False, (*ALL, "friction")),
    "flexible, springs": (True, SPRINGS),
    "flexible, springs, contact": (True, ALL),
    "flexible, springs, contact, friction": (True, (*ALL, "friction")),
}


def four_bar(flexible: bool = False, forces: tuple[str, ...] = ()) -> bd.Mechanism:
    """A crank-rocker whose coupler is rigid or a beam of 4 elements, with forces by name."""
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
        mech.add(bd.Spring("spring", ground.at(1.4, 0.3), rocker.at(0.8, 0.28), 150.0, 0.3))
    if "damper" in forces:
        mech.add(bd.Damper("damper", ground.at(-0.3, 0.4), crank.at(*crank_end), 2.0))
    if "contact" in forces:
        stop = bd.LineSurface(ground.at(0.9, 0.4), (0.3, -1.0))
        tip = rocker.at(*rocker_end)
        mech.add(bd.Contact("stop", tip, stop, 2e5, restitution=0.6, impact_speed=1.0))
    if "friction" in forces:
        mech.add(bd.Friction("rubbing", bearing, 0.2, regularization=0.01, radius=0.02))
    return mech


@single_threaded
def compared(rounds: int) -> pd.DataFrame:
    """Time of an iteration with and without forces, of every case."""
    lines, times = [], np.linspace(0.0, STEP * STEPS, 2)
    integrator = bd.GeneralizedAlpha(STEP)
    for name, (flexible, forces) in CASES.items():
        both = {
            "forces": bd.equations_of_motion(four_bar(flexible, forces)),
            "plain": bd.equations_of_motion(four_bar(flexible)),
        }
        taken = in_turns(
            {x: partial(_inside, e, integrator, times) for x, e in both.items()}, rounds
        )
        counts = {
            x: integrated(e, integrator, times)[1].statistics.residual_calls / STEPS
            for x, e in both.items()
        }
        step = {x: 1e6 * found.least / STEPS for x, found in taken.items()}
        iteration = {x: step[x] / counts[x] for x in step}
        lines.append(
            {
                "four-bar": name,
                "unknowns": both["plain"].n + both["plain"].m,
                "step [us]": step["forces"],
                "predicted [us]": step["plain"],
                "ratio": step["forces"] / step["plain"],
                "residuals a step": counts["forces"],
                "predicted": counts["plain"],
                "ratio by residual": iteration["forces"] / iteration["plain"],
            }
        )
    return pd.DataFrame(lines)


def _inside(equations: bd.EquationsOfMotion, integrator: bd.Integrator, times: np.ndarray) -> float:
    return within_loops(equations, integrator, times)[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer turns")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the table")
    options = parser.parse_args()
    write(options.out, "mechanisms", compared(2 if options.quick else 10))


if __name__ == "__main__":
    main()
