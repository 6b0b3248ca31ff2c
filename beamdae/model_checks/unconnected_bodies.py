"""Warnings about bodies that rest, or only fall, because no joint, driver or force acts on them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.mobility import find_loose_groups, find_unheld_motions
from beamdae.equations.starts.rank import analyze_constraint_rank
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.errors import list_first
from beamdae.parts.bodies.point_mass import PointMass
from beamdae.parts.bodies.rigid_body import RigidBody
from beamdae.parts.events import have_actions
from beamdae.parts.joints.joint import Joint
from beamdae.results.trajectory import Trajectory

_MAX_NAMES = 4
_MAX_MOTION = 1e-9  # of a body at rest during the run, relative to the scale of the coordinate
_FORCE_SAMPLES = 7  # times at which forces are evaluated
_MAX_CONSTRAINTS = 1500  # for dense matrices
_BODIES = (RigidBody, PointMass, Beam)


def idle_body_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning per body, or group of joined bodies, that nothing holds or moves.

    Models with events that act, inputs and controllers are exempt: their parts may act later.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    e, mechanism, first = equations, equations.mechanism, trajectory.intervals[0]
    duration = trajectory.end - trajectory.start
    if mechanism is None or mechanism.inputs or e.controllers or not duration > 0.0:
        return
    if have_actions(mechanism.events) or any(x.inactive for x in trajectory.intervals):
        return
    q = np.concatenate([x.state.q for x in trajectory.intervals])
    rests = np.ptp(q, axis=0) <= _MAX_MOTION * e.position_scales
    bodies = [x for x in e.parts if not x.is_state]
    if any(np.all(rests[x.rows]) for x in bodies) and e.m <= _MAX_CONSTRAINTS:
        times = [
            time_on_branch(e.breakpoints, t, trajectory.end)
            for t in np.linspace(trajectory.start, trajectory.end, _FORCE_SAMPLES)
        ]
        rank = analyze_constraint_rank(StateEvaluator(e), times[0], q[0])
        motions = find_unheld_motions(
            e, times, q[0], first.rows.lam[0], rank, duration, is_at_rest=True
        )
        groups = {
            tuple(x.name for x in bodies if np.any(motion[x.rows]))
            for motion in motions
            if not np.any(motion[~rests])
        }
        for group in sorted(groups):
            them, they = ("it", "it rests") if len(group) == 1 else ("them", "they rest")
            yield (
                f"{list_first(group, _MAX_NAMES)}: no joint holds {them} and no force moves "
                f"{them}, so {they} during the whole run; add a joint, a driver or a force, or "
                f"remove {them}."
            )
    if not np.any(mechanism.gravity):
        return
    # Parts that are observed, or on which other parts than joints and bodies act.
    observed = mechanism.observables.values()
    used = {x.owner.name for what in observed for x in what.pieces}
    reactions = {what.joint for what in observed}
    for part in mechanism.parts.values():
        if (
            part.name in reactions
            or part.laws
            or part.gaps
            or not isinstance(part, (Joint, *_BODIES))
        ):
            used.update(body.name for body in part.bodies)
    loose = find_loose_groups(e)
    if len(bodies) == sum(map(len, loose)):
        return
    moves = {x.name for x in bodies if np.any(first.state.v[0, x.rows])}
    for group in loose:
        if (used | moves).isdisjoint(group) and {x.name for x in bodies}.issuperset(group):
            them, they = ("it", "it only falls") if len(group) == 1 else ("them", "they only fall")
            yield (
                f"{list_first(group, _MAX_NAMES)}: no joint holds {them} and no force but weight "
                f"moves {them}, so {they}; add a joint, observe {them}, or remove {them}."
            )
