"""Cost over the number of elements of one beam, and over the number of beams of chains and rings.

    python validation/performance/scaling.py --peer PYTHON    five minutes
    python validation/performance/scaling.py --quick          up to a quarter of the size
    python validation/performance/scaling.py --exact          exact beams alone

PYTHON is an interpreter with Exudyn (`pip install exudyn`), beside which 256 elements are timed if
it is there. Residual, iteration matrix, factorization and solution are those of generalized-alpha
on index 3 (`pieces`); "step" is what a step of 1e-3 s adds to a run, with all that belongs to it.
"slope" is that of the logarithm of a time over that of the size, between neighboring sizes and of
all from 32 elements (8 beams) on. Processor times, the least of several turns. "peak" is the memory
of a process that does nothing else.
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
from pieces import PIECES, step_pieces
from systems import beam, chain, exact, ring
from tables import RESULTS, write
from timing import integrated, taken
from workers import Worker, exudyn

import beamdae as bd
from beamdae.linear.blas_threads import single_threaded

ELEMENTS = (8, 32, 128, 512, 2048, 4096)
BEAMS = (2, 4, 8, 16, 32, 64)
RING = 32
STEP = 1e-3
# A run of the first steps is taken from one of more: what is left is steps alone.
FIRST = 20
BESIDE = 256
# 2 s of motion of the hub beam by so many elements.
LONG = 64
INTEGRATORS = (bd.GeneralizedAlpha(1e-3), bd.Radau(1e-4), bd.Ida(1e-5))
# With so many short elements Exudyn's iteration cannot leave less, from rounding.
LEFT = 1e-4
TIMES = (*(f"{piece} [us]" for piece in PIECES), "step [us]")


@single_threaded
def measured(model: Callable[[int], bd.Mechanism], size: int, turns: int) -> dict[str, object]:
    """A line of the table."""
    building = taken(lambda: bd.equations_of_motion(model(size)))
    equations = bd.equations_of_motion(model(size))
    line: dict[str, object] = {
        f"{model.__name__}": size,
        "unknowns": equations.n + equations.m,
        "build [s]": building,
    }
    pieces = step_pieces(equations, STEP, max(2048 // size, 2))
    for piece in PIECES:
        line[f"{piece} [us]"] = 1e6 * min(pieces[piece]() for _ in range(3 * turns))
    line["step [us]"] = 1e6 * step_time(equations, turns)
    return line


def step_time(equations: bd.EquationsOfMotion, turns: int) -> float:
    """What a step adds to a run [s]."""
    more, least = more_steps(equations.n), []
    for steps in (FIRST, FIRST + more):
        times = np.array([0.0, steps * STEP])
        runs = [integrated(equations, bd.GeneralizedAlpha(STEP), times)[0] for _ in range(turns)]
        least.append(min(runs))
    return (least[1] - least[0]) / more


def more_steps(unknowns: int) -> int:
    """How many steps take long enough to be told from all else."""
    return int(np.clip(200_000 // unknowns, 40, 1000))


def slopes(lines: pd.DataFrame, size: str, first: int) -> pd.DataFrame:
    """Slopes between neighbors, and over all from a size on."""
    logs = np.log(lines[[size, *TIMES]])
    found = logs[list(TIMES)].diff().div(logs[size].diff(), axis=0).iloc[1:]
    found.insert(0, "sizes", [f"{a} to {b}" for a, b in pairwise(lines[size])])
    late = logs[lines[size] >= first]
    if len(late) > 1:
        fits = {name: np.polyfit(late[size], late[name], 1)[0] for name in TIMES}
        found.loc[len(lines)] = {"sizes": f"from {first} on", **fits}
    return found


def beside(peer: Worker, turns: int, elements: int = BESIDE) -> pd.DataFrame:
    """A step and a degree of freedom, beside Exudyn's elements of two nodes."""
    equations = bd.equations_of_motion(beam(elements))
    asked = {"system": "hub beam", "elements": elements, "nodes": 2, "step": STEP}
    asked = {**asked, "tolerance": LEFT, "path": False}
    more = more_steps(equations.n)
    unknowns = peer(**asked, end=STEP * FIRST)["unknowns"]
    theirs: list[list[float]] = [[], []]
    own = []
    for _ in range(turns):
        own.append(step_time(equations, 1))
        for k, steps in enumerate((FIRST, FIRST + more)):
            theirs[k].append(peer(**asked, end=steps * STEP)["integrate"])
    step = (min(theirs[1]) - min(theirs[0])) / more
    lines = pd.DataFrame(
        {
            "tool": ["beamdae", "Exudyn"],
            "elements": elements,
            "nodes": [4, 2],
            "unknowns": [equations.n, unknowns],
            "step [us]": [1e6 * float(np.median(own)), 1e6 * step],
        }
    )
    lines["step / unknown [us]"] = lines["step [us]"] / lines["unknowns"]
    lines["ratio"] = lines["step / unknown [us]"] / lines["step / unknown [us]"].iloc[1]
    return lines


@single_threaded
def motions(turns: int, elements: int = LONG) -> pd.DataFrame:
    """Integration of 2 s, of the exact beam and of one in a chord frame."""
    lines, times = [], np.linspace(0.0, 2.0, 401)
    for model in (exact, beam):
        equations = bd.equations_of_motion(model(elements))
        for integrator in INTEGRATORS:
            runs = [integrated(equations, integrator, times) for _ in range(turns)]
            line: dict[str, object] = {"model": model.__name__, "elements": elements}
            line |= {"integrator": integrator.label, "steps": runs[0][1].statistics.steps}
            lines.append(line | {"integration [s]": min(run[0] for run in runs)})
    return pd.DataFrame(lines)


def exacts(out: Path, sizes: Sequence[int], turns: int) -> None:
    """The tables of exact beams."""
    lines = pd.DataFrame([measured(exact, size, turns) for size in sizes])
    write(out, "scaling_exact", lines)
    write(out, "scaling_exact_slopes", slopes(lines, "exact", 32))
    write(out, "motions_exact", motions(turns))


def draw(tables: Sequence[tuple[pd.DataFrame, str, str]], path: Path) -> None:
    """Times over sizes, and a line of slope 1."""
    figure, axes = plt.subplots(1, len(tables), figsize=(5.0 * len(tables), 4.2), squeeze=False)
    for axis, (lines, size, label) in zip(axes.flat, tables, strict=True):
        x = lines[size].to_numpy(float)
        for name, marker in zip(TIMES, "osv^D", strict=True):
            axis.plot(x, lines[name], marker=marker, markersize=4, label=name.split(" [")[0])
        linear = lines["residual [us]"].iloc[-1] * x / x[-1] * 0.5
        axis.plot(x, linear, color="0.5", linestyle="--", label="slope 1")
        axis.set(xscale="log", yscale="log", xlabel=label, ylabel="processor time [us]")
        axis.set_xticks(x, [f"{size:g}" for size in x])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
        axis.legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    plt.close(figure)


def peak(elements: int) -> None:
    """Print the peak memory of a run, of this process."""
    bd.GeneralizedAlpha(STEP).integrate(
        bd.equations_of_motion(beam(elements)), np.array([0.0, FIRST * STEP])
    )
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"peak of {FIRST} steps with {elements} elements: {used / 2**20:.2f} GB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peer", default=sys.executable, help="an interpreter with Exudyn")
    parser.add_argument("--quick", action="store_true", help="up to a quarter of the size")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the tables")
    parser.add_argument("--exact", action="store_true", help="exact beams alone")
    parser.add_argument("--peak", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak:
        peak(options.peak)
        return
    last, turns = (-2, 3) if options.quick else (None, 5)
    if options.exact:
        exacts(options.out, ELEMENTS[:last], turns)
        return
    # First of all: a process counts what the one had in use that started it.
    command = [sys.executable, __file__, "--peak", str(ELEMENTS[:last][-1])]
    print(subprocess.run(command, check=True, capture_output=True, text=True).stdout, flush=True)
    beams = pd.DataFrame([measured(beam, size, turns) for size in ELEMENTS[:last]])
    chains = pd.DataFrame([measured(chain, size, turns) for size in BEAMS[:last]])
    write(options.out, "scaling_elements", beams)
    write(options.out, "scaling_elements_slopes", slopes(beams, "beam", 32))
    write(options.out, "scaling_beams", chains)
    write(options.out, "scaling_beams_slopes", slopes(chains, "chain", 8))
    write(options.out, "scaling_ring", pd.DataFrame([measured(ring, RING, turns)]))
    exacts(options.out, ELEMENTS[:last], turns)
    peer = exudyn(options.peer)
    if peer is not None:
        with peer:
            write(options.out, "scaling_beside_exudyn", beside(peer, turns))
    tables = ((beams, "beam", "elements of a beam"), (chains, "chain", "beams of a chain"))
    draw(tables, options.out / "scaling.png")


if __name__ == "__main__":
    main()
