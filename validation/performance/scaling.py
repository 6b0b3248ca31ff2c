"""Cost over the number of elements of one beam, and of beams in chains and rings.

    python validation/performance/scaling.py --peer PYTHON    five minutes
    python validation/performance/scaling.py --quick          up to a quarter of the size
    python validation/performance/scaling.py --exact          exact beams alone

PYTHON is an interpreter with Exudyn (`pip install exudyn`), which times 64 to 1024 elements for
comparison. Residual, iteration matrix, factorization and solution are those of generalized-alpha on
index 3 (`operations`). "step" is the additional time of a run per additional step of 1e-3 s.
"slope" is the slope of log(time) over log(size), between neighboring sizes and fitted to all sizes
from 32 elements (8 beams) on. Times are processor times, the smallest of several turns. "peak" is
the peak memory of a process that runs only the largest beam.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd

mpl.use("Agg")
import matplotlib.pyplot as plt
from benchmark_systems import beam, chain, exact, ring
from measurement import RESULTS, time_action, time_integration, write_table
from operations import OPERATIONS, time_step_operations
from workers import Worker, start_exudyn

import beamdae as bd
from beamdae.linear.blas_threads import single_threaded

ELEMENTS = (8, 32, 128, 512, 2048, 4096)
BEAMS = (2, 4, 8, 16, 32, 64)
RING_BEAMS = 32
STEP = 1e-3  # s
WARM_UP_STEPS = 20  # subtracted from a longer run, so that the setup cancels
EXUDYN_ELEMENTS = (64, 256, 1024)
MOTION_ELEMENTS = 64  # of the hub beam over 2 s
FIRST_ELEMENTS_OF_SLOPE = 32
FIRST_BEAMS_OF_SLOPE = 8
INTEGRATORS = (bd.GeneralizedAlpha(1e-3), bd.Radau(1e-4), bd.Ida(1e-5))
# With many short elements, rounding keeps Exudyn's residual above its usual tolerance.
EXUDYN_TOLERANCE = 1e-4
TIME_COLUMNS = (*(f"{piece} [us]" for piece in OPERATIONS), "step [us]")


@single_threaded
def measure_costs(model: Callable[[int], bd.Mechanism], size: int, turns: int) -> dict[str, object]:
    """Return a row of the table."""
    building = time_action(lambda: bd.equations_of_motion(model(size)))
    equations = bd.equations_of_motion(model(size))
    row: dict[str, object] = {
        f"{model.__name__}": size,
        "unknowns": equations.n + equations.m,
        "build [s]": building,
    }
    timers = time_step_operations(equations, STEP, max(2048 // size, 2))
    for operation in OPERATIONS:
        row[f"{operation} [us]"] = 1e6 * min(timers[operation]() for _ in range(3 * turns))
    row["step [us]"] = 1e6 * time_step(equations, turns)
    return row


def time_step(equations: bd.results.EquationsOfMotion, turns: int) -> float:
    """Return the additional time of a run per additional step [s]."""
    steps_added, smallest = count_steps(equations.n), []
    for steps in (WARM_UP_STEPS, WARM_UP_STEPS + steps_added):
        times = np.array([0.0, steps * STEP])
        runs = [
            time_integration(equations, bd.GeneralizedAlpha(STEP), times)[0] for _ in range(turns)
        ]
        smallest.append(min(runs))
    return (smallest[1] - smallest[0]) / steps_added


def count_steps(unknowns: int) -> int:
    """Return the number of additional steps, enough for a measurable time."""
    return int(np.clip(200_000 // unknowns, 40, 1000))


def fit_slopes(table: pd.DataFrame, size: str, first: int) -> pd.DataFrame:
    """Return slopes between neighboring sizes, and over all sizes from `first` on.

    A step is the difference of two runs: where the load of the machine makes it negative, its
    slopes are NaN.
    """
    numbers = table[[size, *TIME_COLUMNS]]
    logs = np.log(numbers.where(numbers > 0.0))
    slopes = logs[list(TIME_COLUMNS)].diff().div(logs[size].diff(), axis=0).iloc[1:]
    slopes.insert(0, "sizes", [f"{a} to {b}" for a, b in pairwise(table[size])])
    late = logs[table[size] >= first]
    if len(late) > 1:
        deviations = late[size] - late[size].mean()
        fits = {name: deviations @ late[name] / (deviations @ deviations) for name in TIME_COLUMNS}
        slopes.loc[len(table)] = {"sizes": f"from {first} on", **fits}
    return slopes


def compare_with_exudyn(peer: Worker, turns: int, elements: int) -> pd.DataFrame:
    """Return times of a step and of an unknown, beside Exudyn's elements of two nodes."""
    equations = bd.equations_of_motion(beam(elements))
    job = {
        "system": "hub beam",
        "elements": elements,
        "nodes": 2,
        "step": STEP,
        "tolerance": EXUDYN_TOLERANCE,
        "path": False,
    }
    steps_added = count_steps(equations.n)
    unknowns = peer(**job, end=STEP * WARM_UP_STEPS)["unknowns"]
    integrator = bd.GeneralizedAlpha(STEP)
    seconds: dict[tuple[str, int], list[float]] = {}
    for _ in range(turns):
        for steps in (WARM_UP_STEPS, WARM_UP_STEPS + steps_added):
            times = np.array([0.0, steps * STEP])
            own = time_integration(equations, integrator, times)[0]
            seconds.setdefault(("beamdae", steps), []).append(own)
            other = peer(**job, end=steps * STEP)["integrate"]
            seconds.setdefault(("Exudyn", steps), []).append(other)
    tools = ["beamdae", "Exudyn"]
    step_times = [
        (min(seconds[tool, WARM_UP_STEPS + steps_added]) - min(seconds[tool, WARM_UP_STEPS]))
        / steps_added
        for tool in tools
    ]
    table = pd.DataFrame(
        {
            "tool": tools,
            "elements": elements,
            "nodes": [4, 2],
            "unknowns": [equations.n, unknowns],
            "step [us]": [1e6 * step for step in step_times],
        }
    )
    table["step / unknown [us]"] = table["step [us]"] / table["unknowns"]
    table["ratio"] = table["step / unknown [us]"] / table["step / unknown [us]"].iloc[1]
    return table


@single_threaded
def time_motions(turns: int, elements: int = MOTION_ELEMENTS) -> pd.DataFrame:
    """Return times of 2 s of motion, of the exact beam and of one in a chord frame."""
    rows, times = [], np.linspace(0.0, 2.0, 401)
    for model in (exact, beam):
        equations = bd.equations_of_motion(model(elements))
        for integrator in INTEGRATORS:
            runs = [time_integration(equations, integrator, times) for _ in range(turns)]
            row: dict[str, object] = {"model": model.__name__, "elements": elements}
            row |= {"integrator": integrator.label, "steps": runs[0][1].statistics.steps}
            rows.append(row | {"integration [s]": min(run[0] for run in runs)})
    return pd.DataFrame(rows)


def write_exact_tables(out: Path, sizes: Sequence[int], turns: int) -> None:
    """Write the tables of exact beams."""
    table = pd.DataFrame([measure_costs(exact, size, turns) for size in sizes])
    write_table(out, "scaling_exact", table)
    write_table(out, "scaling_exact_slopes", fit_slopes(table, "exact", FIRST_ELEMENTS_OF_SLOPE))
    write_table(out, "motions_exact", time_motions(turns))


def draw_scaling(tables: Sequence[tuple[pd.DataFrame, str, str]], path: Path) -> None:
    """Plot times over sizes, and a line of slope 1."""
    figure, axes = plt.subplots(1, len(tables), figsize=(5.0 * len(tables), 4.2), squeeze=False)
    for axis, (table, size, label) in zip(axes.flat, tables, strict=True):
        x = table[size].to_numpy(float)
        for name, marker in zip(TIME_COLUMNS, "osv^D", strict=True):
            axis.plot(x, table[name], marker=marker, markersize=4, label=name.split(" [")[0])
        linear = table["residual [us]"].iloc[-1] * x / x[-1] * 0.5
        axis.plot(x, linear, color="0.5", linestyle="--", label="slope 1")
        axis.set(xscale="log", yscale="log", xlabel=label, ylabel="processor time [us]")
        axis.set_xticks(x, [f"{size:g}" for size in x])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
        axis.legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    plt.close(figure)


def print_peak_memory(elements: int) -> None:
    """Print the peak memory of this process after a run."""
    bd.GeneralizedAlpha(STEP).integrate(
        bd.equations_of_motion(beam(elements)), np.array([0.0, WARM_UP_STEPS * STEP])
    )
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"peak of {WARM_UP_STEPS} steps with {elements} elements: {used / 2**20:.2f} GB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peer", default=sys.executable, help="an interpreter with Exudyn")
    parser.add_argument("--quick", action="store_true", help="up to a quarter of the size")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the tables")
    parser.add_argument("--exact", action="store_true", help="exact beams alone")
    parser.add_argument("--peak", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak:
        print_peak_memory(options.peak)
        return
    last, turns = (-2, 3) if options.quick else (None, 5)
    if options.exact:
        write_exact_tables(options.out, ELEMENTS[:last], turns)
        return
    # First, because the peak of a process includes the memory of its parent at the start.
    command = [sys.executable, __file__, "--peak", str(ELEMENTS[:last][-1])]
    print(subprocess.run(command, check=True, capture_output=True, text=True).stdout, flush=True)
    beams = pd.DataFrame([measure_costs(beam, size, turns) for size in ELEMENTS[:last]])
    chains = pd.DataFrame([measure_costs(chain, size, turns) for size in BEAMS[:last]])
    write_table(options.out, "scaling_elements", beams)
    write_table(
        options.out, "scaling_elements_slopes", fit_slopes(beams, "beam", FIRST_ELEMENTS_OF_SLOPE)
    )
    write_table(options.out, "scaling_beams", chains)
    write_table(
        options.out, "scaling_beams_slopes", fit_slopes(chains, "chain", FIRST_BEAMS_OF_SLOPE)
    )
    write_table(options.out, "scaling_ring", pd.DataFrame([measure_costs(ring, RING_BEAMS, turns)]))
    write_exact_tables(options.out, ELEMENTS[:last], turns)
    peer = start_exudyn(options.peer)
    if peer is not None:
        with peer:
            parts = [compare_with_exudyn(peer, turns, elements) for elements in EXUDYN_ELEMENTS]
            write_table(options.out, "scaling_beside_exudyn", pd.concat(parts))
    tables = ((beams, "beam", "elements of a beam"), (chains, "chain", "beams of a chain"))
    draw_scaling(tables, options.out / "scaling.png")


if __name__ == "__main__":
    main()
