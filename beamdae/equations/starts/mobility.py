"""Mobility of a mechanism at its start: free motions, degrees of freedom and loose parts."""

from __future__ import annotations

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
from beamdae.equations.starts.state_evaluator import plan_state_sums

Array = np.ndarray

# Stiffness against translations that is a rounding error (below 4e-16 for beams with 4 to 32 exact
# elements), relative to the largest stiffness and to the inertia of a motion that lasts as long as
# the run.
_STIFFNESS_ROUNDING = 1e-13
_DURATION = 1.0  # of a motion from a state [s], if there is no run
_MIN_SHARE = 1e-9  # smaller coefficients of rigid motions, relative to the largest, are zero


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
    waiting = {body.name for part in mechanism.parts.values() if part.gaps for body in part.bodies}
    bodies = {x.name: x for x in collect_bodies(e)}
    candidates = {
        group: positions
        for group in find_loose_groups(e)
        if waiting.isdisjoint(group)
        and (positions := [x for name in group if (x := bodies.get(name)) and x.position])
    }
    if not candidates:
        return ()
    to_scaled, zero = sp.diags_array(e.position_scales), np.zeros(e.n)
    tangent = compute_tangent(e, time, State(q, zero, zero, np.zeros(e.m)))
    stiffness, mass = (
        sp.csr_array(to_scaled @ x @ to_scaled) for x in (tangent.stiffness, tangent.mass)
    )
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
