"""Design of a compliant four-bar whose coupler point follows a given path, with a stress limit.

A crank moves a coupler that is welded to a flexible rocker. 100 heights of coupler and rocker are
optimized so that the middle of the coupler follows a path, with a limit of the stress at 50
sections at all times. The path and the limit are those of a reference design, so that a design
without deviation exists; it is not unique. Run

    python validation/design/compliant_four_bar.py

It writes a summary, a picture and an animation to `results/` and takes a few minutes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import beamdae as bd

RESULTS = Path(__file__).parent / "results"
COUNT = 50  # heights of each beam
FIRST_HEIGHT, HEIGHT_RANGE = 1.2e-3, (0.6e-3, 2.4e-3)  # m
DEVIATION = 1e-4  # m, unit of the deviations from the path
CRANK, SIDE = 0.05, 0.2  # m
STROKE = 0.7  # rad
STATIONS = np.linspace(0.02, 0.98, 25)
PATH = ("tracer.x", "tracer.y")
STRESSES = [f"{name} stress {k}" for name in ("rocker", "coupler") for k in range(len(STATIONS))]
TIMES = np.linspace(0.1, 1.0, 19)  # s
# Weight of the changes of height between neighboring points, in units of 0.1 mm. Without it,
# heights between integration points would be arbitrary.
ROUGHNESS_WEIGHT = 2e-2
ROUNDS = 2  # of optimization with a corrected limit, at most


@bd.model(t_end=1.0)
def four_bar(
    coupler: tuple[float, ...] = (FIRST_HEIGHT,) * COUNT,
    rocker: tuple[float, ...] = (FIRST_HEIGHT,) * COUNT,
) -> bd.Mechanism:
    """Compliant four-bar with piecewise linear heights of coupler and rocker."""
    steel = bd.Material.of("steel")
    mech = bd.Mechanism()
    foot, knee, pin = (0.0, 0.0), (0.0, SIDE), (SIDE, SIDE)
    shaft = (SIDE, SIDE - CRANK)
    beams = {}
    for name, line, heights in (
        ("rocker", bd.Line(foot, knee), rocker),
        ("coupler", bd.Line(knee, pin), coupler),
    ):

        def section(s: float, heights: tuple[float, ...] = heights) -> bd.Section:
            height = float(np.interp(s, np.linspace(0.0, SIDE, COUNT), heights))
            return bd.Section.rectangle(steel, width=0.02, height=height, damping=1e-3)

        beams[name] = mech.add(bd.Beam(name, line, section, elements=10, formulation="exact"))
    crank = mech.add(bd.RigidBody.rod("crank", shaft, pin, mass=0.1))
    mech.add(bd.Weld("foot", mech.ground.at(*foot), beams["rocker"].start))
    mech.add(bd.Weld("knee", beams["rocker"].end, beams["coupler"].start))
    mech.add(bd.Revolute("pin", beams["coupler"].end, crank.at(*pin)))
    mech.add(bd.Revolute("shaft", mech.ground.at(*shaft), crank.at(*shaft)))
    base, arm = mech.ground.at(*shaft), crank.at(*shaft)
    mech.add(bd.Driver("motor", base, arm, _turn))
    mech.observe("tracer", beams["coupler"].at(0.5 * SIDE))
    for name, beam in beams.items():
        for k, station in enumerate(STATIONS):
            mech.observe(f"{name} stress {k}", beam.stress(station * SIDE, "top"))
    return mech


def _turn(t: float) -> float:
    return -STROKE * t**2 * (3.0 - 2.0 * t)


def _reference_heights() -> dict[str, tuple[float, ...]]:
    """Return a coupler that is thin in the middle, and a rocker that is thin at its foot."""
    s = np.linspace(0.0, 1.0, COUNT)
    coupler = FIRST_HEIGHT * (1.2 - 0.5 * np.sin(np.pi * s))
    rocker = FIRST_HEIGHT * (0.7 + 0.6 * s)
    return {"coupler": tuple(coupler.tolist()), "rocker": tuple(rocker.tolist())}


def _measure_roughness(coupler: tuple[float, ...], rocker: tuple[float, ...]) -> float:
    """Return the sum of the squared changes of height between neighboring points, in 0.1 mm."""
    return sum(float(np.sum((np.diff(x) / 1e-4) ** 2)) for x in (coupler, rocker))


class Design(NamedTuple):
    """Result of the optimization, with the runs of the designs [m, Pa]."""

    result: bd.results.Optimization
    reference: bd.results.Solution
    first: bd.results.Solution
    limit: float
    evaluations: int

    def measure(self, run: bd.results.Solution) -> tuple[float, float]:
        """Return the largest deviation from the path and the largest stress of a run."""
        at, exact = run.at_times(TIMES), self.reference.at_times(TIMES)
        errors = [at[name].to_numpy() - exact[name].to_numpy() for name in PATH]
        return float(np.max(np.hypot(*errors))), _largest_stress(run)


def _largest_stress(run: bd.results.Solution) -> float:
    return max(float(run[name].abs().max()) for name in STRESSES)


def optimize_heights(
    evaluations: int = 120, progress: Callable[[int, float, float], None] | None = None
) -> Design:
    """Optimize the heights of coupler and rocker."""
    method = bd.GeneralizedAlpha(step=0.0125)
    reference = bd.simulate(four_bar(**_reference_heights()), method)
    exact = reference.at_times(TIMES)
    path = sum(
        bd.quantities.SquaredErrors(name, TIMES, exact[name].to_numpy(), DEVIATION) for name in PATH
    )
    roughness = ROUGHNESS_WEIGHT * bd.quantities.ParameterFunction(_measure_roughness, "roughness")
    stress = bd.quantities.LargestOf(
        [bd.quantities.SmoothMaximum(name, 100.0) for name in STRESSES], 30.0
    )
    limit = _largest_stress(reference)
    heights: dict[str, tuple[float, ...]] = {}
    # Smooth maxima over time are below the maxima: the ratio of both corrects the limit.
    correction, count = 1.0, 0
    for _ in range(ROUNDS):
        result = bd.optimize(
            four_bar,
            roughness + path,
            ["coupler", "rocker"],
            bd.quantities.at_most(stress, limit * correction),
            {"coupler": HEIGHT_RANGE, "rocker": HEIGHT_RANGE},
            method,
            parameters=heights,
            max_evaluations=evaluations,
            tolerance=1e-9,
            progress=progress,
        )
        count += result.evaluations
        largest = _largest_stress(result.solution)
        if largest <= limit:
            break
        correction = result.constraints[0].value / largest
        heights = dict(result.parameters)
    return Design(result, reference, bd.simulate(four_bar(), method), limit, count)


def main() -> None:
    """Optimize, and write the summary, the picture and the animation."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--evaluations", type=int, default=120)
    options = parser.parse_args()
    RESULTS.mkdir(exist_ok=True)
    begin = time.process_time(), time.perf_counter()

    def report(count: int, value: float, violation: float) -> None:
        print(f"{count:4d} {value:12.5g} {violation:10.2g} {time.process_time() - begin[0]:8.1f} s")

    design = optimize_heights(options.evaluations, report)
    result = design.result
    spent = time.process_time() - begin[0], time.perf_counter() - begin[1]
    text = "the largest stress of the reference design"
    lines = [f"stress limit {1e-6 * design.limit:.1f} MPa, {text}"]
    for label, run in (("first design", design.first), ("optimized design", result.solution)):
        deviation, largest = design.measure(run)
        lines.append(
            f"{label}: largest deviation {1e6 * deviation:.2f} um, "
            f"largest stress {1e-6 * largest:.1f} MPa"
        )
    lines.append(f"status: {result.status.kind}, {result.status.sentence}")
    lines.append(
        f"evaluated designs: {design.evaluations}; heights at a bound: "
        f"{len(result.at_bounds)} of {2 * COUNT}"
    )
    lines.append(f"processor time {spent[0]:.0f} s, wall time {spent[1]:.0f} s")
    print(*lines, sep="\n")
    (RESULTS / "compliant_four_bar.txt").write_text("\n".join(lines) + "\n", "utf-8")
    _draw(design.reference.at_times(TIMES), design.first, result)
    result.solution.animate(RESULTS / "compliant_four_bar.gif", frames=30)


def _draw(
    reference: bd.results.Solution, first: bd.results.Solution, result: bd.results.Optimization
) -> None:
    """Draw the paths of both designs and the optimized heights."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
    for label, run, style in (
        ("reference", reference, "o"),
        ("first design", first, "--"),
        ("optimized design", result.solution, "-"),
    ):
        x, y = (run[name].to_numpy() for name in PATH)
        left.plot(1e3 * x, 1e3 * (y - SIDE), style, label=label)
    left.set(xlabel="x [mm]", ylabel="y - 200 mm [mm]", title="path of the coupler point")
    s = np.linspace(0.0, 1e3 * SIDE, COUNT)
    for name, heights in result.parameters.items():
        (line,) = right.plot(s, 1e3 * np.array(heights), label=name)
        right.plot(s, 1e3 * np.array(_reference_heights()[name]), ":", color=line.get_color())
    right.set(
        xlabel="arc length [mm]",
        ylabel="height [mm]",
        title="optimized heights (dotted: reference)",
    )
    for axes in (left, right):
        axes.grid(True, alpha=0.3)
        axes.legend()
    figure.savefig(RESULTS / "compliant_four_bar.png", dpi=110)


if __name__ == "__main__":
    main()
