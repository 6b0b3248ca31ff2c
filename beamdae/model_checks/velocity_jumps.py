"""Warnings about laws of drivers with jumps of the slope, whose impulses reactions do not show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.results.trajectory import Trajectory

_PLACES = np.array([0.0, 1.0 / 3.0, 1.0])  # in intervals, at which slopes are evaluated
_MIN_JUMP = 1e-6  # relative to the largest slope; less is rounding


def velocity_jump_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning about each driver whose law makes velocities jump.

    The force that changes a velocity at once is infinite for an instant. The energy balance
    contains its work, but reactions, powers and their peaks do not contain it.
    """
    e, intervals = equations, trajectory.intervals
    if e.mechanism is None or len(intervals) == 1:
        return
    evaluator, still = StateEvaluator(e), np.zeros(e.n)
    # Rates of the constraints of bodies at rest: those of the laws, at both ends of each interval
    # and in between.
    rates = np.array(
        [
            [
                evaluator.constraint_levels(np.array([t, x.branch]), x.rows.q[0], still)[1]
                for t in x.nodes[0] + _PLACES * (x.nodes[-1] - x.nodes[0])
            ]
            for x in intervals
        ]
    )
    jumps = np.abs(rates[1:, 0] - rates[:-1, -1]) > _MIN_JUMP * np.max(np.abs(rates), axis=(0, 1))
    times = np.array([x.nodes[0] for x in intervals[1:]])
    for k in np.flatnonzero(jumps.any(axis=0)):
        first, *others = times[jumps[:, k]]
        number = f"{len(others) + 1} times, first " if others else ""
        yield (
            f"{e.lam_names[k].rpartition('.')[0]}: the slope of its law jumps {number}at "
            f"t = {first:.6g} s, so that velocities change at once; reactions and powers do not "
            "contain the infinite forces of these instants: use a law with a continuous slope."
        )
