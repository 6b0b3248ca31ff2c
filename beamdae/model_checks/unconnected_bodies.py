"""Warnings about bodies that rest, or only fall, because no joint, driver or force acts on them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.mobility import find_loose_groups
from beamdae.errors import list_first
from beamdae.parts.bodies.point_mass import PointMass
from beamdae.parts.bodies.rigid_body import RigidBody
from beamdae.parts.events import have_actions
from beamdae.parts.joints.joint import Joint
from beamdae.results.trajectory import Trajectory

_MAX_NAMES = 4
_BODIES = (RigidBody, PointMass, Beam)


def idle_body_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning per body, or group of joined bodies, that nothing holds or moves.

    Models with events that act, inputs and controllers are exempt: their parts may act later. So
    are models without any joint to the ground, and bodies that are observed or thrown.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    e, mechanism, first = equations, equations.mechanism, trajectory.intervals[0]
    if mechanism is None or mechanism.inputs or e.controllers or have_actions(mechanism.events):
        return
    bodies, loose = [x for x in e.parts if not x.is_state], find_loose_groups(e)
    if len(bodies) == sum(map(len, loose)) or any(x.inactive for x in trajectory.intervals):
        return
    observed = mechanism.observables.values()
    used = {x.owner.name for what in observed for x in what.pieces}
    used |= {x.name for x in bodies if np.any(first.state.v[0, x.rows])}
    reactions = {what.joint for what in observed}
    for part in mechanism.parts.values():
        acts = part.laws or part.gaps or not isinstance(part, (Joint, *_BODIES))
        if acts or part.name in reactions:
            used.update(body.name for body in part.bodies)
    for group in loose:
        if used.isdisjoint(group) and {x.name for x in bodies}.issuperset(group):
            them = "it" if len(group) == 1 else "them"
            yield (
                f"{list_first(group, _MAX_NAMES)}: no joint holds {them} and no force but weight "
                f"moves {them}; add a joint, observe {them}, or remove {them}."
            )
