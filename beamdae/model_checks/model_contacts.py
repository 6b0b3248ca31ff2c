"""Contacts of a model, and their gaps during a run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.surface_gaps import SurfaceGapTerm
from beamdae.parts.bodies.point_mass import PointMass
from beamdae.parts.bodies.rigid_body import Ground, RigidBody
from beamdae.parts.joints.joint import Joint
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    from beamdae.parts.forces.contact import Contact


def contacts_of(equations: EquationsOfMotion) -> dict[str, Contact]:
    """Return the contacts of the mechanism by name, without an import if there are none."""
    parts = {} if equations.mechanism is None else equations.mechanism.parts
    if not any(part.gaps for part in parts.values()):
        return {}
    from beamdae.parts.forces.contact import Contact

    return {name: part for name, part in parts.items() if isinstance(part, Contact)}


def gaps_of_run(gap: SurfaceGapTerm, trajectory: Trajectory) -> np.ndarray:
    """Return a gap [m] at the steps of a run at which its part is active, (k,)."""
    intervals = [x for x in trajectory.intervals if gap.part not in x.inactive]
    values = [gap.evaluate(x.t, x.branch, x.state.q) for x in intervals]
    return np.concatenate([np.zeros(0), *values])


def attached_mass(
    equations: EquationsOfMotion, beam: Beam, s: float | None, stop: object = None
) -> float:
    """Return the mass of particles and rigid bodies fixed or joined to a section of a beam [kg].

    Infinite for a section that is joined to the ground, but `stop` is no such joint.
    """
    mechanism = equations.mechanism
    mass = 0.0
    for part in ({} if mechanism is None else mechanism.parts).values():
        bodies = [x.body for x in part.attachments if not (x.body is beam and x.s == s)]
        if part is stop or len(bodies) == len(part.attachments):
            continue
        if isinstance(part, PointMass):
            mass += part.mass
        elif isinstance(part, Joint):
            mass += sum(
                math.inf if isinstance(x, Ground) else x.mass
                for x in bodies
                if isinstance(x, (Ground, PointMass, RigidBody))
            )
    return mass
