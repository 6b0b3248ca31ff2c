"""Mobility of a mechanism at its start: free motions, degrees of freedom and loose parts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.equations.starts.dependent_constraints import (
    RANK_TOLERANCE,
    ConstraintRank,
    group_tied,
    list_tied_parts,
)
from beamdae.equations.starts.rigid_motions import collect_bodies, compute_rigid_motions
from beamdae.equations.starts.state_evaluator import StateEvaluator, plan_state_sums
from beamdae.parts.mechanism import Mechanism

Array = np.ndarray

# Stiffness against translations that is a rounding error (below 4e-16 for beams with 4 to 32 exact
# elements), relative to the largest stiffness and to the inertia of a motion that lasts as long as
# the run.
_STIFFNESS_ROUNDING = 1e-13
_DURATION = 1.0  # of a motion from a state [s], if there is no run
# Displacements along a free motion at which forces are evaluated, relative to the length of the
# mechanism: springs with a clearance act later.
_DISPLACEMENTS = (0.0, 1e-3, -1e-3, 0.1, -0.1, 1.0, -1.0)
_MIN_SHARE = 1e-9  # smaller coefficients of rigid motions, relative to the largest, are zero


def find_unheld_motions(
    e: EquationsOfMotion,
    times: Sequence[Array],
    q: Array,
    reactions: Array,
    constraint_rank: ConstraintRank,
    duration: float,
) -> list[Array]:
    """Return those of the `find_free_motions` along which no force and no damping acts.

    Bodies of contacts are excluded, because contacts may hold them later.

    Parameters
    ----------
    e
        The equations of motion.
    times, q
        Times (t, branch) of forces that depend on time, and coordinates of the start.
    reactions
        Multipliers (m,), whose changes of direction hold a pendulum; zero to disregard them.
    constraint_rank
        Rank of the constraints at the start.
    duration
        Time of the run [s].
    """
    mechanism = e.mechanism
    motions = find_free_motions(e, q, constraint_rank)
    if mechanism is None or mechanism.inactive or not motions:
        return []
    waiting = _list_bodies_of_contacts(mechanism)
    rows = [np.arange(x.rows.start, x.rows.stop) for x in e.parts if x.name in waiting]
    of_contacts = np.concatenate([np.zeros(0, int), *rows])
    evaluator, scales, zero = StateEvaluator(e), e.position_scales, np.zeros(e.n)
    stiffness, damping, mass = _scaled_matrices(e, times[0], q, reactions)
    inertia, matrices = abs(mass).max() / duration, [stiffness, damping]
    limits = [_STIFFNESS_ROUNDING * (abs(x).max() + inertia) for x in matrices]
    limit_of_force = _STIFFNESS_ROUNDING * (abs(stiffness).max() + inertia / duration)
    unheld = []
    for motion in motions:
        shape = motion / scales
        shape /= np.max(np.abs(shape))
        forces = (
            (scales * evaluator.force(time, q + factor * scales * shape, zero)) @ shape
            for time in times
            for factor in _DISPLACEMENTS
        )
        if (
            not np.any(motion[of_contacts])
            and all(
                max(np.abs(x @ shape).max(), np.abs(x.T @ shape).max()) <= limit
                for x, limit in zip(matrices, limits, strict=True)
            )
            and all(abs(force) <= limit_of_force for force in forces)
        ):
            unheld.append(motion)
    return unheld


def _scaled_matrices(
    e: EquationsOfMotion, time: Array, q: Array, reactions: Array
) -> list[sp.csr_array]:
    """Return stiffness, damping and mass at rest with scaled rows and columns, (n, n) each."""
    to_scaled, zero = sp.diags_array(e.position_scales), np.zeros(e.n)
    tangent = compute_tangent(e, time, State(q, zero, zero, reactions))
    matrices = tangent.stiffness, tangent.damping, tangent.mass
    return [sp.csr_array(to_scaled @ x @ to_scaled) for x in matrices]


def find_free_motions(
    e: EquationsOfMotion, q: Array, constraint_rank: ConstraintRank
) -> list[Array]:
    """Return a basis of the rigid motions that no joint or driver blocks, as changes (n,) of q.

    Beams are treated as rigid, and first-order states do not move. The basis is chosen so that each
    motion involves few bodies.
    """
    motions = compute_rigid_motions(e, q)
    motions = motions[:, ~np.any(motions[e.states], axis=0)]
    space = la.null_space(constraint_rank.matrix @ motions, rcond=RANK_TOLERANCE)
    count = space.shape[1]
    if not count:
        return []
    _, _, order = la.qr(space.T, mode="economic", pivoting=True)
    basis = space @ la.inv(space[order[:count]])
    basis[np.abs(basis) < _MIN_SHARE * np.max(np.abs(basis))] = 0.0
    return [motions @ basis[:, k] * e.position_scales for k in np.argsort(order[:count])]


def _find_parts_on_ground(e: EquationsOfMotion) -> set[int]:
    """Return the indices of the parts that active joints connect directly to the ground."""
    mechanism = e.mechanism
    if mechanism is None:
        return set()
    numbers = {part.name: k for k, part in enumerate(e.parts)}
    return {
        numbers[attachment.body.name]
        for joint in mechanism.parts.values()
        if joint.name not in mechanism.inactive
        and any(attachment.body is mechanism.ground for attachment in joint.attachments)
        and joint.constraints()
        for attachment in joint.attachments
        if attachment.body.name in numbers
    }


def find_loose_groups(e: EquationsOfMotion) -> tuple[tuple[str, ...], ...]:
    """Return the groups of connected parts, by name, that no joint connects to the ground.

    Joints and forces connect parts to each other; a force does not connect a part to the ground.
    """
    ground, coupled = len(e.parts), plan_state_sums(e.structure).block.tocoo()
    first, second = (e.part_indices[x] for x in coupled.coords)
    pairs = np.column_stack(np.divmod(np.unique(first * ground + second), ground))
    on_ground = (np.array([k, ground]) for k in _find_parts_on_ground(e))
    groups = group_tied(ground + 1, [*list_tied_parts(e), *pairs, *on_ground])
    of_parts, names = groups[:ground], np.array([part.name for part in e.parts], object)
    loose = np.unique(of_parts[of_parts != groups[ground]])
    return tuple(tuple(names[of_parts == k]) for k in loose)


def _list_bodies_of_contacts(mechanism: Mechanism) -> set[str]:
    return {body.name for part in mechanism.parts.values() if part.gaps for body in part.bodies}


def find_free_groups(
    e: EquationsOfMotion, time: Array, q: Array, duration: float = _DURATION
) -> tuple[tuple[str, ...], ...]:
    """Return those of the `find_loose_groups` that can move away, because nothing holds them.

    Forces that change with the translation of a group hold it. Bodies of contacts may be held
    later, as may all bodies in models with inactive parts: they are excluded.

    Parameters
    ----------
    e
        The equations of motion.
    time, q
        (t, branch) and coordinates of the state in which the stiffness is evaluated.
    duration
        Time of the run [s].
    """
    mechanism = e.mechanism
    if mechanism is None or mechanism.inactive:
        return ()
    waiting = _list_bodies_of_contacts(mechanism)
    bodies = {x.name: x for x in collect_bodies(e)}
    candidates = {
        group: positions
        for group in find_loose_groups(e)
        if waiting.isdisjoint(group)
        and (positions := [x for name in group if (x := bodies.get(name)) and x.position])
    }
    if not candidates:
        return ()
    stiffness, _, mass = _scaled_matrices(e, time, q, np.zeros(e.m))
    rows_of = {part.name: np.arange(part.rows.start, part.rows.stop) for part in e.parts}
    free = []
    for group, positions in candidates.items():
        translations = np.zeros((e.n, 2))
        for body in positions:
            translations[body.points, [0, 1]] = e.length
        forces = stiffness @ (translations / e.position_scales[:, None])
        forces[e.states] = 0.0
        rows = np.concatenate([rows_of[name] for name in group])
        size = abs(stiffness[rows]).max() + abs(mass[rows]).max() / duration**2
        if np.abs(forces).max() <= _STIFFNESS_ROUNDING * size:
            free.append(group)
    return tuple(free)
