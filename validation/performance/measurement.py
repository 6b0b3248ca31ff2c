"""Processor times of actions that take turns, and output of tables.

Processor times exclude time taken by other processes, but caches and clock rates are shared.
Therefore, actions take turns, and ratios are computed from the smallest time of each action.
"""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

import beamdae as bd

Array = np.ndarray


@dataclass
class TimeSamples:
    """Times of one action, in turns [s]."""

    all: list[float] = field(default_factory=list)

    @property
    def least(self) -> float:
        """Smallest time [s]."""
        return float(np.min(self.all))

    @property
    def median(self) -> float:
        """Median time [s]."""
        return float(np.median(self.all))


def time_in_turns(
    actions: Mapping[str, Callable[[], float]], rounds: int
) -> dict[str, TimeSamples]:
    """Return times that the actions measure, after one turn to warm up."""
    for action in actions.values():
        action()
    times = {name: TimeSamples() for name in actions}
    for _ in range(rounds):
        for name, action in actions.items():
            times[name].all.append(action())
    return times


def environment_of_users() -> dict[str, str]:
    """Return the environment for measured processes, in which Python caches its bytecode."""
    return {k: x for k, x in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}


def processor_time_of_children() -> float:
    """Return the processor time of all child processes that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


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
