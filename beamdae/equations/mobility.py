"""What can move at the start of a mechanism: free motions, loose parts, mass and frequencies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from beamdae.equations.consistent_start import Starter
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State, first_order
from beamdae.equations.motions import free_motion, rigid_columns
from beamdae.equations.redundancy import ScaledJoints
from beamdae.equations.start_sums import start_sums
from beamdae.symbolic.sparse_sums import column_of

Array = np.ndarray

# Singular values of the scaled joints, and shares of a motion, that are none.
_NONE = 1e-9
# Beside the largest stiffness over mass: what rounding leaves of a motion that nothing holds.
_SLACK = 1e-12


def free_motions(e: EquationsOfMotion, q: Array, joints: ScaledJoints) -> tuple[str, ...]:
    """Motions of the bodies that no joint and no driver holds, in words; beams are stiff in them.

    As many as are independent of each other, each of as few bodies as can be.
    """
    columns = rigid_columns(e)
    space = la.null_space(joints.matrix[:, columns], rcond=_NONE)
    count = space.shape[1]
    if not count:
        return ()
    _, _, order = la.qr(space.T, mode="economic", pivoting=True)
    apart = space @ la.inv(space[order[:count]])
    apart[np.abs(apart) < _NONE * np.max(np.abs(apart))] = 0.0
    found = []
    for k in np.argsort(order[:count]):
        motion = np.zeros(e.n)
        motion[columns] = apart[:, k]
        found.append(free_motion(e, q, motion * e.position_scales))
    return tuple(found)


def rigid_mobility(e: EquationsOfMotion, joints: ScaledJoints) -> int:
    """Degrees of freedom that are left to the bodies if beams are rigid."""
    columns = rigid_columns(e)
    matrix = joints.matrix[:, columns]
    rank = int(np.sum(la.svdvals(matrix) > _NONE)) if matrix.size else 0
    return len(columns) - rank


def loose_groups(e: EquationsOfMotion) -> tuple[tuple[str, ...], ...]:
    """Groups of parts that joints and forces tie to each other, but no joint to the ground."""
    owner = np.zeros(e.n, int)
    for k, part in enumerate(e.parts):
        owner[part.rows] = k
    grounded, ties = set(), []
    for joint in e.joints:
        entries = sp.coo_array(joint.operator)
        copies = entries.coords[0] // (joint.operator.shape[0] // joint.count)
        for copy in range(joint.count):
            tied = np.unique(owner[entries.coords[1][copies == copy]])
            ties += [(tied[0], other) for other in tied]
            if len(tied) == 1:
                grounded.add(int(tied[0]))
    block = start_sums(e.structure).block
    ties += list(zip(owner[block.pattern.indices], owner[column_of(block.pattern)], strict=True))
    pairs = np.array(ties, int).reshape(-1, 2).T
    graph = sp.coo_array((np.ones(pairs.shape[1]), pairs), shape=(len(e.parts), len(e.parts)))
    count, group = connected_components(graph.tocsr(), directed=False)
    held = {group[k] for k in grounded}
    names = np.array([part.name for part in e.parts], object)
    return tuple(tuple(names[group == k]) for k in range(count) if k not in held)


@dataclass(frozen=True)
class Spectrum:
    """Natural frequencies at the start.

    Attributes
    ----------
    lowest, highest
        Of vibrations [Hz], or None where there are none.
    damping_ratio
        Of the fastest.
    loose
        Motions that nothing drives back.
    falling
        The fastest rate at which a motion leaves the start [1/s], or 0.
    massless
        The coordinate that moves without inertia, or "".
    """

    lowest: float | None
    highest: float | None
    damping_ratio: float
    loose: int
    falling: float
    massless: str


def spectrum(starter: Starter, time: Array, state: State, joints: ScaledJoints) -> Spectrum:
    """Natural frequencies about a consistent state, of the motions its joints allow."""
    e = starter.equations
    free = la.null_space(joints.matrix, rcond=_NONE) if e.m else np.eye(e.n)
    free = free * e.position_scales[:, None]
    stiffness, damping, mass = (
        free.T @ (matrix @ free)
        for matrix in (_stiffness(e, time, state), *starter.linearized(time, state)[1:])
    )
    if not free.shape[1]:
        return Spectrum(None, None, 0.0, 0, 0.0, "")
    weight, across = la.eigh(0.5 * (mass + mass.T))
    if weight[0] <= _SLACK * max(weight[-1], 1e-300):
        without = free @ across[:, 0] / e.position_scales
        return Spectrum(None, None, 0.0, 0, 0.0, e.q_names[int(np.argmax(np.abs(without)))])
    squares, modes = la.eigh(0.5 * (stiffness + stiffness.T), 0.5 * (mass + mass.T))
    slack = max(_SLACK * float(np.max(np.abs(squares))), 1e-9)
    rates = np.sqrt(squares[squares > slack])
    ratio = 0.0
    if len(rates):
        fastest = modes[:, -1]
        ratio = float(fastest @ damping @ fastest / (2.0 * rates[-1]))
    hertz = rates / (2.0 * np.pi)
    return Spectrum(
        float(hertz[0]) if len(rates) else None,
        float(hertz[-1]) if len(rates) else None,
        ratio,
        int(np.sum(np.abs(squares) <= slack)),
        float(np.sqrt(max(-squares[0], 0.0))) if squares[0] < -slack else 0.0,
        "",
    )


def _stiffness(e: EquationsOfMotion, time: Array, state: State) -> sp.csc_array:
    """d(F + G^T lam)/dq: with what the reactions do as the joints turn."""
    form = first_order(e, "index3")
    y, rates = form.pack(state)
    own = (form.jacobian(time, y, rates, 0.0), form.pattern.indices, form.pattern.indptr)
    whole = sp.csc_array(own, shape=form.pattern.shape)
    return sp.csc_array(whole[:, : e.n].tocsr()[e.n : 2 * e.n])
