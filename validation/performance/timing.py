"""Times of things that take turns on a machine that others use too.

Processor times, which do not count what other processes take away; they share caches and clock
rates all the same, so that everything takes turns and ratios are those of the least of each.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from unittest.mock import patch

import numpy as np

import beamdae as bd
from beamdae.native.loops import CompiledLoop

Array = np.ndarray


@dataclass
class Times:
    """Times of one thing, in turns [s]."""

    all: list[float] = field(default_factory=list)

    @property
    def least(self) -> float:
        """The least."""
        return float(np.min(self.all))

    @property
    def median(self) -> float:
        """The median."""
        return float(np.median(self.all))


def in_turns(actions: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, Times]:
    """Times that the actions tell, after one turn to warm up."""
    for action in actions.values():
        action()
    times = {name: Times() for name in actions}
    for _ in range(rounds):
        for name, action in actions.items():
            times[name].all.append(action())
    return times


def integrated(
    equations: bd.EquationsOfMotion, integrator: bd.Integrator, times: Array
) -> tuple[float, bd.Solution]:
    """Time of the integration alone, and its result.

    Buffers and loops are prepared within the call: by its own statistics, that share is left out.
    """
    begin = time.process_time()
    solution = integrator.integrate(equations, times)
    taken, found = time.process_time() - begin, solution.statistics
    return taken * found.wall_time / (found.wall_time + found.setup_time), solution


def within_loops(
    equations: bd.EquationsOfMotion, integrator: bd.Integrator, times: Array
) -> tuple[float, float]:
    """Time of the integration, as above, and that of it within compiled loops."""
    inside = 0.0
    call = CompiledLoop.__call__

    def timed(loop: CompiledLoop) -> int:
        nonlocal inside
        begin = time.process_time()
        code = call(loop)
        inside += time.process_time() - begin
        return code

    with patch.object(CompiledLoop, "__call__", timed):
        whole, _ = integrated(equations, integrator, times)
    return whole, inside


def taken(action: Callable[[], object]) -> float:
    """Time of an action."""
    begin = time.process_time()
    action()
    return time.process_time() - begin
