"""Sweeps: many cases of the hub beam that differ in numbers only, by the study engine.

    python validation/performance/sweeps.py --before PATH    ten minutes
    python validation/performance/sweeps.py --quick          a tenth of the cases, once

Torques and densities vary; runs cover 2 s and 20 s with steps of 1e-3 s, in two processes.
Processor times per case are those of compiled loops, of everything else in the worker processes,
and of the main process; their sum gives the cases per second of one core. Checkouts take turns, and
the best of several turns is reported. PATH is a checkout of another version; if its studies require
references, the sweep becomes a convergence study over the density. Similar cases also run without
the engine, in one thread, two threads and two processes; these rates refer to wall time.
"""

from __future__ import annotations

import argparse
import json
import os
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
from measurement import (
    RESULTS,
    environment_of_users,
    processor_time_of_children,
    write_table,
)

import beamdae as bd
from beamdae.studies.execution import study_run
from beamdae.studies.execution.executors import LocalPool
from beamdae.studies.run_values import tabulate_trajectory

STEP = 1e-3  # s
OUTPUT_ROWS = 400
# Numbers of cases by duration of the motion [s].
SWEEP_SIZES = {2.0: (200, 1000), 20.0: (100,)}
THREAD_SIZES = {2.0: 60, 20.0: 24, 100.0: 8}
WORKERS = 2
HERE = Path(__file__).resolve()
_hub = bd.load_model(HERE.parents[2] / "models" / "hub_beam.py")


@bd.model(t_end=2.0)
def recorded_hub(torque=10.0, density=2766.7, loop_folder=""):
    """Return the hub beam; `loop_folder` gets the loop times of the process."""
    if loop_folder:
        record_loop_times(loop_folder)
    return _hub(torque=torque, density=density)


def record_loop_times(folder: str) -> None:
    """Write the total time of all compiled loops of this process to a file."""
    try:
        from beamdae.core.tables import Loop
    except ImportError:
        return
    if hasattr(Loop, "total_time"):
        return
    run, Loop.total_time = Loop.__call__, 0.0
    file = os.open(Path(folder) / str(os.getpid()), os.O_CREAT | os.O_RDWR)

    def timed(loop: Any) -> int:
        begin = time.thread_time()
        code = run(loop)
        Loop.total_time += time.thread_time() - begin
        os.pwrite(file, f"{Loop.total_time:20.9f}".encode(), 0)
        return code

    Loop.__call__ = timed


def make_study(number: int, t_end: float, loop_folder: str) -> bd.results.Study:
    """Return the study of the sweep."""
    values = bd.grid(
        torque=np.linspace(5.0, 10.0, max(number // 20, 1)).tolist(),
        density=np.linspace(2000.0, 3000.0, 20).tolist(),
    )
    cases = tuple(
        bd.Case(recorded_hub, x | {"loop_folder": loop_folder}, bd.GeneralizedAlpha(STEP))
        for x in values
    )
    return bd.results.Study("sweep", cases, references=(), t_end=t_end)


def run_sweep(number: int, t_end: float) -> dict[str, float]:
    """Return times per case of a sweep by the imported beamdae."""
    with tempfile.TemporaryDirectory() as loop_folder, tempfile.TemporaryDirectory() as folder:
        study = make_study(number, t_end, loop_folder)
        begin = time.process_time()
        results = study_run.run_study(study, Path(folder), LocalPool(WORKERS))
        main = time.process_time() - begin
        assert (results.table["status"] == "ok").all()
        of_workers = processor_time_of_children()
        loops = sum(float(file.read_text()) for file in Path(loop_folder).iterdir())
    rest = of_workers - loops
    cases = len(results.table)
    return {
        "cases / s a core": cases / (loops + rest + main),
        "loops [ms]": 1e3 * loops / cases,
        "rest of workers [ms]": 1e3 * rest / cases,
        "main process [ms]": 1e3 * main / cases,
        "in loops": loops / (loops + rest + main),
    }


def run_in_checkout(checkout: Path, number: int, t_end: float) -> dict[str, float]:
    """Return times per case of a sweep by the beamdae of a checkout."""
    command = [sys.executable, str(HERE), "--one", json.dumps([number, t_end])]
    environment = {**environment_of_users(), "PYTHONPATH": str(checkout)}
    process = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(process.stdout.splitlines()[-1])


def compare_sweeps(
    checkouts: dict[str, Path], sizes: dict[float, list[int]], rounds: int
) -> pd.DataFrame:
    """Return a row for each checkout and sweep."""
    rows = []
    for t_end, numbers in sizes.items():
        for number in numbers:
            turns = [
                {name: run_in_checkout(path, number, t_end) for name, path in checkouts.items()}
                for _ in range(rounds)
            ]
            for name in checkouts:
                best = max((turn[name] for turn in turns), key=lambda x: x["cases / s a core"])
                rows.append({"motion [s]": t_end, "cases": number, "beamdae": name} | best)
    return pd.DataFrame(rows)


@dataclass(frozen=True)
class PlainCase:
    """Case without the engine."""

    t_end: float

    def __call__(self, k: int) -> None:
        """Run the case of that number, and make its table."""
        mechanism = recorded_hub(torque=5.0 + 0.01 * k, density=2000.0 + k)
        tabulate_trajectory(
            bd.simulate(mechanism, bd.GeneralizedAlpha(STEP), self.t_end, self.t_end / OUTPUT_ROWS)
        )


def count_cases_per_second(number: int, t_end: float, executor: Executor) -> float:
    """Return cases per second of wall time, after each worker has run one case."""
    with executor:
        list(executor.map(PlainCase(t_end), range(WORKERS)))
        begin = time.perf_counter()
        list(executor.map(PlainCase(t_end), range(number)))
        return number / (time.perf_counter() - begin)


def compare_threads(rounds: int, share: float) -> pd.DataFrame:
    """Return cases per second of threads and of processes."""
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    rows = []
    for t_end, number in THREAD_SIZES.items():
        row: dict[str, float] = {"motion [s]": t_end}
        for _ in range(rounds):
            executors: dict[str, Executor] = {
                "one thread": ThreadPoolExecutor(1),
                "two threads": ThreadPoolExecutor(WORKERS),
                "two processes": ProcessPoolExecutor(WORKERS, get_context("spawn")),
            }
            for kind, executor in executors.items():
                rate = count_cases_per_second(max(int(share * number), WORKERS), t_end, executor)
                row[kind] = max(rate, row.get(kind, 0.0))
        rows.append(row)
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", action="append", default=[], type=Path)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(run_sweep(*json.loads(arguments.one))))
        return
    checkouts = {"now": HERE.parents[2]} | {path.name: path for path in arguments.before}
    share, rounds = (0.1, 1) if arguments.quick else (1.0, arguments.rounds)
    sizes = {t: [max(int(share * n), 20) for n in numbers] for t, numbers in SWEEP_SIZES.items()}
    write_table(arguments.out, "sweeps", compare_sweeps(checkouts, sizes, rounds))
    write_table(arguments.out, "sweeps_threads", compare_threads(rounds, share))


if __name__ == "__main__":
    main()
