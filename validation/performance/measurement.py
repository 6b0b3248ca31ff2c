"""Processor times of actions that take turns, worker processes, and output of tables.

Processor times exclude time taken by other processes, but caches and clock rates are shared.
Therefore, actions take turns, and ratios are computed from the smallest time of each action. A
worker reads one job per line, as a JSON object of keyword arguments, and answers each job with one
line of JSON.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import beamdae as bd

Array = np.ndarray


def time_in_turns(actions: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, Array]:
    """Return times that the actions measure in turns [s], after one turn to warm up."""
    for action in actions.values():
        action()
    turns = [{name: action() for name, action in actions.items()} for _ in range(rounds)]
    return {name: np.array([turn[name] for turn in turns]) for name in actions}


def time_integration(
    equations: bd.results.EquationsOfMotion, integrator: bd.Integrator, times: Array
) -> tuple[float, bd.results.Solution]:
    """Return the processor time of the integration alone [s], and its solution.

    The share of preparing buffers and loops, by the solution's statistics, is subtracted.
    """
    begin = time.process_time()
    solution = integrator.integrate(equations, times)
    seconds, statistics = time.process_time() - begin, solution.statistics
    return seconds * statistics.wall_time / (statistics.wall_time + statistics.setup_time), solution


RESULTS = Path(__file__).parent / "results"


def write_table(folder: Path, name: str, table: pd.DataFrame) -> None:
    """Print a table and write it to a CSV file."""
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / f"{name}.csv", index=False, float_format="%.4g")
    text = table.to_string(index=False, na_rep="", float_format=lambda x: f"{x:.3g}")
    print(text, end="\n\n", flush=True)


HERE = Path(__file__).parent
EXUDYN_MISSING = "{python}: Exudyn's runs are skipped; install exudyn, pandas and scipy."


class Worker:
    """Process that runs a script of this folder."""

    def __init__(self, python: str, script: str, environment: Mapping[str, str] | None = None):
        self._process = subprocess.Popen(
            [python, str(HERE / script)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **(environment or {})},
        )

    def __call__(self, **run: Any) -> dict[str, Any]:
        """Return the answer of the script to a job."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(run), file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError(f"the process of {self._process.args} ended at {run}")
        return json.loads(answer)

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *problem: object) -> None:
        self._process.communicate()


def start_exudyn(python: str) -> Worker | None:
    """Start Exudyn in this interpreter; return None, with a message, if it is not installed."""
    command = [python, "-c", "import exudyn"]
    try:
        subprocess.run(command, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        print(EXUDYN_MISSING.format(python=python), file=sys.stderr)
        return None
    return Worker(python, "exudyn_peer.py")


def start_checkout(folder: Path) -> Worker:
    """Start this interpreter with the beamdae and the models of a checkout."""
    paths = os.pathsep.join((str(folder), str(folder / "models")))
    return Worker(sys.executable, "checkout_worker.py", {"PYTHONPATH": paths})
