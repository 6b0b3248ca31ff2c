"""Warnings about bodies without joints that rest during a run because no force acts on them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.mobility import find_loose_groups, select_free_groups
from beamdae.errors import list_first
from beamdae.results.trajectory import Trajectory

_MAX_NAMES = 4
_MAX_MOTION = 1e-9  # during the run, relative to the scale of the coordinate


def unconnected_body_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[str]:
    """Yield a warning per body, or group of joined bodies, that nothing holds or moves.

    Bodies that springs hold at rest have a stiffness against translations and are exempt. So are
    bodies of contacts, which may wait for an impact, and models with inactive parts, whose joints
    may become active later.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    mechanism, intervals = equations.mechanism, trajectory.intervals
    duration = trajectory.end - trajectory.start
    if mechanism is None or any(x.inactive for x in intervals) or not duration > 0.0:
        return
    if np.any(mechanism.gravity) or mechanism.gravity_laws:
        return
    scales, by_name = equations.position_scales, {x.name: x for x in equations.parts}
    resting = []
    for group in find_loose_groups(equations):
        parts = [by_name[name] for name in group]
        rows = np.concatenate([np.arange(x.rows.start, x.rows.stop) for x in parts])
        q = np.concatenate([x.state.q[:, rows] for x in intervals])
        if np.max(np.ptp(q, axis=0) / scales[rows]) <= _MAX_MOTION:
            resting.append(group)
    time, q = intervals[0].times[0], intervals[0].state.q[0]
    for group in select_free_groups(equations, time, q, duration, resting):
        them, they = ("it", "it rests") if len(group) == 1 else ("them", "they rest")
        yield (
            f"{list_first(group, _MAX_NAMES)}: no joint connects {them} to other parts and no "
            f"force acts on {them}, so {they} during the whole run; add a joint or a force, or "
            f"remove {them}."
        )
