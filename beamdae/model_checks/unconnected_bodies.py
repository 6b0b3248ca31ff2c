"""Warnings about bodies that rest, or only fall, because no joint, driver or force acts on them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import scipy.linalg as la

from beamdae.beams.beam import Beam
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.mobility import find_loose_groups, select_free_groups
from beamdae.equations.starts.rank import RANK_TOLERANCE
from beamdae.equations.starts.rigid_motions import compute_rigid_motions
from beamdae.errors import list_first
from beamdae.parts.bodies.point_mass import PointMass
from beamdae.parts.bodies.rigid_body import RigidBody
from beamdae.parts.events import have_actions
from beamdae.parts.joints.guides import PointOnLine, Prismatic
from beamdae.parts.joints.joint import Joint, Weld
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.results.trajectory import Trajectory

_MAX_NAMES = 4
_MAX_MOTION = 1e-9  # during the run, relative to the scale of the coordinate
_MIN_ROTATION = 1e-9  # of a free motion, relative to its largest component
_BODIES = (RigidBody, PointMass, Beam)
# Joints along which weight neither holds nor drives bodies that rest.
_STRAIGHT_JOINTS = (Prismatic, PointOnLine, Weld)


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
        yield from _falling_body_warnings(equations, mechanism, trajectory)
        return
    resting = [x for x in find_loose_groups(equations) if _rests(equations, trajectory, x)]
    time, q = intervals[0].times[0], intervals[0].state.q[0]
    for group in select_free_groups(equations, time, q, duration, resting):
        them, they = ("it", "it rests") if len(group) == 1 else ("them", "they rest")
        yield (
            f"{list_first(group, _MAX_NAMES)}: no joint connects {them} to other parts and no "
            f"force acts on {them}, so {they} during the whole run; add a joint or a force, or "
            f"remove {them}."
        )


def _falling_body_warnings(
    equations: EquationsOfMotion, mechanism: Mechanism, trajectory: Trajectory
) -> Iterator[str]:
    bodies = {part.name: part for part in mechanism.parts.values() if part.coordinates}
    loose = find_loose_groups(equations)
    are_bodies = all(isinstance(x, _BODIES) for x in bodies.values())
    may_depend = (
        have_actions(mechanism.events)
        or mechanism.inputs
        or equations.controllers
        or not are_bodies
    )
    if may_depend or len(bodies) == sum(map(len, loose)):
        return
    observed = mechanism.observables.values()
    used = {x.owner.name for what in observed for x in what.pieces}
    with_reactions = {what.joint for what in observed}
    for part in mechanism.parts.values():
        if part.name in with_reactions or not _is_passive(part, has_gravity=False):
            used.update(body.name for body in part.bodies)
    velocity = trajectory.intervals[0].state.v[0]
    for group in loose:
        if used.isdisjoint(group) and not np.any(velocity[_rows_of(equations, group)]):
            them, they = ("it", "it only falls") if len(group) == 1 else ("them", "they only fall")
            yield (
                f"{list_first(group, _MAX_NAMES)}: no joint and no force connects {them} to other "
                f"parts, so {they}, and no column depends on {them}; add a joint, observe {them}, "
                f"or remove {them}."
            )


def undriven_body_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning per group of bodies that joints with the ground let move, but nothing moves.

    No driver and no force but weight acts on them. With gravity, only translations along straight
    guides have a warning: other bodies may hang at rest. Mechanisms with events that act are
    exempt.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    mechanism, intervals = equations.mechanism, trajectory.intervals
    if mechanism is None or have_actions(mechanism.events) or mechanism.gravity_laws:
        return
    if any(x.inactive for x in intervals) or not trajectory.end > trajectory.start:
        return
    groups = {x for x in _group_passive_bodies(mechanism) if _rests(equations, trajectory, x)}
    if not groups:
        return
    loose = {name for group in find_loose_groups(equations) for name in group}
    time, q = intervals[0].times[0], intervals[0].state.q[0]
    constraints = ConsistencySolver(equations).constraint_matrix(time, q)
    motions = compute_rigid_motions(equations, q) * equations.position_scales[:, None]
    for group in sorted(x for x in groups if loose.isdisjoint(x)):
        others = np.setdiff1d(np.arange(equations.n), _rows_of(equations, group))
        of_group = motions[:, ~np.any(motions[others], axis=0)]
        if not of_group.shape[1]:
            continue
        free = of_group @ la.null_space(constraints @ of_group, rcond=RANK_TOLERANCE)
        rotations = np.abs(free[equations.is_angle])
        if not free.shape[1] or (
            np.any(mechanism.gravity)
            and np.max(rotations, initial=0.0) > _MIN_ROTATION * np.max(np.abs(free))
        ):
            continue
        them, they = ("it", "it rests") if len(group) == 1 else ("them", "they rest")
        yield (
            f"{list_first(group, _MAX_NAMES)}: no driver and no force moves {them}, so {they} "
            "during the whole run; add a driver, a force, an initial velocity, or a joint with "
            "another body."
        )


def _rows_of(equations: EquationsOfMotion, names: Iterable[str]) -> np.ndarray:
    parts = [equations.coordinates_of_part(name) for name in names]
    return np.concatenate([np.arange(x.rows.start, x.rows.stop) for x in parts])


def _rests(equations: EquationsOfMotion, trajectory: Trajectory, names: Iterable[str]) -> bool:
    """Return True if no coordinate of the parts changes during the run."""
    rows = _rows_of(equations, names)
    q = np.concatenate([x.state.q[:, rows] for x in trajectory.intervals])
    return bool(np.max(np.ptp(q, axis=0) / equations.position_scales[rows]) <= _MAX_MOTION)


def _group_passive_bodies(mechanism: Mechanism) -> set[tuple[str, ...]]:
    """Return the groups of bodies, by name, with joints but without drivers and forces."""
    groups: dict[str, frozenset[str]] = {}
    excluded: set[str] = set()
    for part in mechanism.parts.values():
        bodies = [x for x in (part, *part.bodies) if x.coordinates]
        connected = frozenset(x.name for x in bodies)
        connected = connected.union(*(groups.get(x, ()) for x in connected))
        groups |= dict.fromkeys(connected, connected)
        if not _is_passive(part, bool(np.any(mechanism.gravity))):
            excluded |= connected
    return {tuple(sorted(x)) for x in groups.values() if excluded.isdisjoint(x)}


def _is_passive(part: Part, has_gravity: bool) -> bool:
    if isinstance(part, Joint):
        return not part.laws and (not has_gravity or isinstance(part, _STRAIGHT_JOINTS))
    return isinstance(part, _BODIES) and not part.gaps
