"""Sweeps: many cases of the hub beam that differ in numbers only, through the study engine.

    python validation/performance/sweeps.py --before PATH    ten minutes
    python validation/performance/sweeps.py --quick          a tenth of the cases, once

Torques and densities, steps of 1e-3 s, over 2 s and over 20 s, in one process a core. Cases a
second are of wall time; processor times a case are those of loops in machine code, of all else in
the processes that run cases, and of the process that hands out and keeps. Checkouts take turns, the
least of several is told; PATH is one of another version, whose studies without references are
studies over the density. Then the same cases without the engine, in two threads of one process and
in two processes.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tables import RESULTS, write

import beamdae as bd
from beamdae.studies.execution import study_run
from beamdae.studies.execution.executors import LocalPool
from beamdae.studies.run_values import tabulate_trajectory

STEP = 1e-3
ROWS = 400
# Cases by length of motion [s].
SIZES = {2.0: (200, 1000), 20.0: (100,)}
BESIDE = {2.0: 60, 20.0: 24, 100.0: 8}
WORKERS = 2
HERE = Path(__file__).resolve()
_hub = bd.load_model(HERE.parents[2] / "models" / "hub_beam.py")


@bd.model(t_end=2.0)
def hub(torque=10.0, density=2766.7, counted=""):
    """The hub beam, in a process that counts what its loops take if `counted` is a folder."""
    if counted:
        count(counted)
    return _hub(torque=torque, density=density)


def count(folder: str) -> None:
    """Write what all loops of this process take to a file there, if it has such loops."""
    try:
        from beamdae.native.loops import CompiledLoop
    except ImportError:
        return
    if hasattr(CompiledLoop, "taken"):
        return
    run, CompiledLoop.taken = CompiledLoop.__call__, 0.0
    file = os.open(Path(folder) / str(os.getpid()), os.O_CREAT | os.O_RDWR)

    def timed(loop: Any) -> int:
        begin = time.thread_time()
        code = run(loop)
        CompiledLoop.taken += time.thread_time() - begin
        os.pwrite(file, f"{CompiledLoop.taken:20.9f}".encode(), 0)
        return code

    CompiledLoop.__call__ = timed


def study(number: int, t_end: float, counted: str) -> bd.Study:
    """The sweep."""
    values = bd.grid(
        torque=np.linspace(5.0, 10.0, max(number // 20, 1)).tolist(),
        density=np.linspace(2000.0, 3000.0, 20).tolist(),
    )
    cases = tuple(bd.Case(hub, x | {"counted": counted}, bd.GeneralizedAlpha(STEP)) for x in values)
    try:
        return bd.Study("sweep", cases, references=(), t_end=t_end)
    except bd.BeamdaeError:
        return bd.Study("sweep", cases, over="density", t_end=t_end)


def swept(number: int, t_end: float) -> dict[str, float]:
    """What a sweep takes a case, by the beamdae that is imported."""
    with tempfile.TemporaryDirectory() as counted, tempfile.TemporaryDirectory() as folder:
        planned = study(number, t_end, counted)
        wall, main = time.perf_counter(), time.process_time()
        results = study_run.run_study(planned, Path(folder), LocalPool(WORKERS))
        wall, main = time.perf_counter() - wall, time.process_time() - main
        assert (results.table["status"] == "ok").all()
        of_workers = resource.getrusage(resource.RUSAGE_CHILDREN)
        loops = sum(float(file.read_text()) for file in Path(counted).iterdir())
    rest = of_workers.ru_utime + of_workers.ru_stime - loops
    cases = len(results.table)
    return {
        "cases / s": cases / wall,
        "loops [ms]": 1e3 * loops / cases,
        "rest of workers [ms]": 1e3 * rest / cases,
        "main process [ms]": 1e3 * main / cases,
        "in loops": loops / (loops + rest + main),
    }


def asked(checkout: Path, number: int, t_end: float) -> dict[str, float]:
    """The same of a checkout."""
    command = [sys.executable, str(HERE), "--one", json.dumps([number, t_end])]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    found = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(found.stdout.splitlines()[-1])


def sweeps(checkouts: dict[str, Path], sizes: dict[float, list[int]], rounds: int) -> pd.DataFrame:
    """A line a checkout and sweep."""
    lines = []
    for t_end, numbers in sizes.items():
        for number in numbers:
            turns = [
                {name: asked(path, number, t_end) for name, path in checkouts.items()}
                for _ in range(rounds)
            ]
            for name in checkouts:
                best = max((turn[name] for turn in turns), key=lambda x: x["cases / s"])
                lines.append({"motion [s]": t_end, "cases": number, "beamdae": name} | best)
    return pd.DataFrame(lines)


@dataclass(frozen=True)
class Plain:
    """A case without the engine."""

    t_end: float

    def __call__(self, k: int) -> None:
        """Run the case of that number, and make its table."""
        mechanism = hub(torque=5.0 + 0.01 * k, density=2000.0 + k)
        tabulate_trajectory(
            bd.simulate(mechanism, bd.GeneralizedAlpha(STEP), self.t_end, self.t_end / ROWS)
        )


def beside(number: int, t_end: float, executor: Executor) -> float:
    """Cases a second of wall time, once each worker has run one."""
    with executor:
        list(executor.map(Plain(t_end), range(WORKERS)))
        begin = time.perf_counter()
        list(executor.map(Plain(t_end), range(number)))
        return number / (time.perf_counter() - begin)


def threads(rounds: int, share: float) -> pd.DataFrame:
    """Threads of one process beside processes, in cases a second."""
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    lines = []
    for t_end, number in BESIDE.items():
        line: dict[str, float] = {"motion [s]": t_end}
        for _ in range(rounds):
            ways: dict[str, Executor] = {
                "one thread": ThreadPoolExecutor(1),
                "two threads": ThreadPoolExecutor(WORKERS),
                "two processes": ProcessPoolExecutor(WORKERS, get_context("spawn")),
            }
            for way, executor in ways.items():
                found = beside(max(int(share * number), WORKERS), t_end, executor)
                line[way] = max(found, line.get(way, 0.0))
        lines.append(line)
    return pd.DataFrame(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", action="append", default=[], type=Path)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(swept(*json.loads(arguments.one))))
        return
    checkouts = {"now": HERE.parents[2]} | {path.name: path for path in arguments.before}
    share, rounds = (0.1, 1) if arguments.quick else (1.0, arguments.rounds)
    sizes = {t: [max(int(share * n), 20) for n in numbers] for t, numbers in SIZES.items()}
    write(arguments.out, "sweeps", sweeps(checkouts, sizes, rounds))
    write(arguments.out, "sweeps_threads", threads(rounds, share))


if __name__ == "__main__":
    main()
