"""Cost over the number of elements of one beam, and over the number of beams of a chain.

    python validation/performance/scaling.py             all of both, about fifteen minutes
    python validation/performance/scaling.py --quick     up to a quarter of that

"build" is from a model to its compiled residual and Jacobian, "s / 100 steps" is what so many steps
add to a run, "slope" that of its logarithm over that of the size, over the last two doublings.
Processor times, the least of several. "peak" is the memory of a process that does nothing else.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd

import beamdae as bd
from beamdae.equations.consistent_start import Starter
from beamdae.equations.formulations import first_order
from beamdae.equations.step_equations import step_equations
from beamdae.integrators.radau_coefficients import GAMMA
from beamdae.symbolic.compiled import Compiled
from beamdae.symbolic.factorizations import SparseFactorization, single_threaded

INTEGRATORS = (bd.Ida(1e-4), bd.Radau(1e-4), bd.GeneralizedAlpha(rtol=1e-4))
ELEMENTS = (64, 128, 256, 512, 1024)
BEAMS = (6, 12, 24, 48, 96, 192)
# A run of the first steps is taken from one of 100 more: what is left is steps alone.
FIRST, MORE = 40, 100
STEP = 1e-4


def beam(elements: int) -> bd.Mechanism:
    """A curved, hinged beam with a mass at its tip, under gravity."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    arc = bd.Arc(radius=0.85, length=0.80, start=(0.0, 0.0), angle=-0.60)
    strip = mech.add(bd.Beam("beam", arc, _strip(), elements=elements))
    mech.add(bd.PointMass("tip mass", 0.060, on=strip.end))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), strip.start))
    return mech


def chain(beams: int) -> bd.Mechanism:
    """A hanging chain of straight beams of 4 elements, hinged to each other."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    before = mech.ground.at(0.0, 0.0)
    for k in range(beams):
        line = bd.Line((0.4 * k, 0.0), (0.4 * (k + 1), 0.0))
        link = mech.add(bd.Beam(f"link {k}", line, _strip(), elements=4))
        mech.add(bd.Revolute(f"hinge {k}", before, link.start))
        before = link.end
    return mech


def _strip() -> bd.Section:
    alloy = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
    return bd.Section.rectangle(alloy, width=0.03, height=0.0025, damping=1e-4)


def least_time(action: Callable[[], object], repeats: int) -> float:
    """Least processor time of an action [s]."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        action()
        times.append(time.process_time() - begin)
    return min(times)


def form_of(equations: bd.EquationsOfMotion, integrator: bd.Integrator) -> tuple[Compiled, ...]:
    """Compiled residual and Jacobian of an integrator at the consistent start, and its pattern."""
    start = Starter(equations).state(np.zeros(2), equations.q0, equations.v0)
    if isinstance(integrator, bd.GeneralizedAlpha):
        form = step_equations(equations, False)
        motion = (
            start.q,
            start.v,
            start.a,
            start.q,
            np.array([2.0 / STEP, 3.0 / STEP**2, STEP**2]),
        )
        arguments = (np.zeros(form.size), np.zeros(2), *motion)
        functions = (Compiled(form.residual, equations.p), Compiled(form.jacobian, equations.p))
    else:
        form = first_order(equations, "stabilized-index1")
        arguments = (np.zeros(2), *form.pack(start))
        rate = np.array([GAMMA / STEP])
        functions = (
            Compiled(form.residual, equations.p),
            Compiled(form.jacobian, equations.p, rate),
        )
    for function in functions:
        function(*arguments)
    return *functions, form.pattern


def added(integrator: bd.Integrator, equations: bd.EquationsOfMotion) -> tuple[float, float]:
    """Time and factorizations that `MORE` steps add to a run."""
    times, counts = [], []
    # With scales given no scout goes before the run.
    equations = replace(equations, scales=equations.position_scales)
    for steps in (FIRST, FIRST + MORE):
        limited = replace(integrator, max_steps=steps)
        found: list[bd.Solution] = []
        times.append(
            least_time(lambda run=limited, to=found: to.append(bd.simulate(equations, run, 5.0)), 4)
        )
        assert found[0].statistics.steps == steps, found[0].status
        counts.append(found[0].statistics.factorizations)
    return times[1] - times[0], counts[1] - counts[0]


@single_threaded
def measured(
    model: Callable[[int], bd.Mechanism], size: int, integrator: bd.Integrator
) -> dict[str, object]:
    """A line of the table."""
    build = least_time(lambda: form_of(bd.equations_of_motion(model(size)), integrator), 2)
    equations = bd.equations_of_motion(model(size))
    residual, jacobian, pattern = form_of(equations, integrator)
    factors = SparseFactorization(pattern)
    nonzeros = jacobian.outputs[0]
    factorize = least_time(lambda: [factors.factorize(nonzeros) for _ in range(5)], 5) / 5
    evaluate = least_time(lambda: [residual() for _ in range(50)], 5) / 50
    taken, factorizations = added(integrator, equations)
    return {
        "integrator": integrator.method,
        f"{model.__name__}": size,
        "unknowns": pattern.shape[0],
        "build [s]": build,
        "residual [us]": evaluate * 1e6,
        "factorization [ms]": factorize * 1e3,
        "fill": factors.fill,
        "factorizations / 100 steps": factorizations,
        "s / 100 steps": taken,
    }


SLOPES = ("build [s]", "residual [us]", "factorization [ms]", "s / 100 steps")


def table(model: Callable[[int], bd.Mechanism], sizes: tuple[int, ...]) -> None:
    """Print the lines of a model, and the slopes of its last doublings."""
    lines = pd.DataFrame(
        [measured(model, size, integrator) for integrator in INTEGRATORS for size in sizes]
    )
    print(lines.to_string(index=False, float_format=lambda x: f"{x:.3g}"), end="\n\n")
    doublings = np.log(sizes[-1] / sizes[-3])
    slopes = lines.groupby("integrator", sort=False)[list(SLOPES)].agg(
        lambda x: np.log(x.iloc[-1] / x.iloc[-3]) / doublings
    )
    print(f"slopes, {sizes[-3]} to {sizes[-1]}")
    print(slopes.to_string(float_format=lambda x: f"{x:.2f}"), end="\n\n")


def peak(elements: int) -> None:
    """Print the peak memory of a run, of this process."""
    bd.simulate(beam(elements), replace(INTEGRATORS[0], max_steps=MORE), 2.0)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"peak of Ida with {elements} elements: {used / 2**20:.2f} GB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="up to a quarter of the size")
    parser.add_argument("--peak", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak:
        peak(options.peak)
        return
    last = -2 if options.quick else None
    # First of all: a process counts what the one had in use that started it.
    command = [sys.executable, __file__, "--peak", str(ELEMENTS[:last][-1])]
    print(subprocess.run(command, check=True, capture_output=True, text=True).stdout, flush=True)
    table(beam, ELEMENTS[:last])
    table(chain, BEAMS[:last])


if __name__ == "__main__":
    main()
