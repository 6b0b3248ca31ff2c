"""Warnings about bodies without joints that rest during a run because no force acts on them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.mobility import find_loose_groups
from beamdae.equations.starts.rigid_motions import compute_rigid_motions
from beamdae.errors import list_first
from beamdae.results.trajectory import Trajectory

_MAX_NAMES = 4
_MAX_MOTION = 1e-9  # during the run, relative to the scale of the coordinate
# Stiffness against rigid motions that is a rounding error (below 4e-16 for beams with 4 to 32 exact
# elements), relative to the largest stiffness and to the inertia of a motion that lasts as long as
# the run.
_STIFFNESS_ROUNDING = 1e-13


def unconnected_body_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[str]:
    """Yield a warning per body, or group of joined bodies, that nothing holds or moves.

    Bodies that springs hold at rest have a stiffness against rigid motions and are exempt. So are
    bodies of contacts, which may wait for an impact, and models with inactive parts, whose joints
    may become active later.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    mechanism, intervals = equations.mechanism, trajectory.intervals
    duration = trajectory.end - trajectory.start
    if mechanism is None or mechanism.inactive or any(x.inactive for x in intervals):
        return
    if not duration > 0.0 or np.any(mechanism.gravity) or mechanism.gravity_laws:
        return
    waiting = {body.name for part in mechanism.parts.values() if part.gaps for body in part.bodies}
    scales, by_name = equations.position_scales, {x.name: x for x in equations.parts}
    resting = []
    for group in find_loose_groups(equations):
        parts = [by_name[name] for name in group]
        if waiting.isdisjoint(group) and not any(x.is_state for x in parts):
            rows = np.concatenate([np.arange(x.rows.start, x.rows.stop) for x in parts])
            q = np.concatenate([x.state.q[:, rows] for x in intervals])
            if np.max(np.ptp(q, axis=0) / scales[rows]) <= _MAX_MOTION:
                resting.append((group, rows))
    if not resting:
        return
    q = intervals[0].state.q[0]
    solver = ConsistencySolver(equations)
    stiffness, _, mass = (
        x.toarray() * scales * scales[:, None]
        for x in solver.linearize_forces(intervals[0].times[0], solver.rest_state(q))
    )
    motions = compute_rigid_motions(equations, q)
    for group, rows in resting:
        of_group = motions[:, np.any(motions[rows], axis=0)]
        size = np.max(np.abs(stiffness[rows])) + np.max(np.abs(mass[rows])) / duration**2
        if np.max(np.abs(stiffness @ of_group)) <= _STIFFNESS_ROUNDING * size:
            them, they = ("it", "it rests") if len(group) == 1 else ("them", "they rest")
            yield (
                f"{list_first(group, _MAX_NAMES)}: no joint connects {them} to other parts and no "
                f"force acts on {them}, so {they} during the whole run; add a joint or a force, or "
                f"remove {them}."
            )
