"""Motions that no force, joint or load resists, such as those of a cart on a rail.

The tangent stiffness is singular along the whole path. Such motions are held by springs that act on
the tangent alone, so that Newton's method does not move the mechanism along them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la

from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.equations.starts.rigid_motions import compute_rigid_motions, move_rigidly

Array = np.ndarray

# Forces up to the first fraction of their sizes are rounding errors, and powers and gaps of joints
# up to the second one: motions contain parts of soft ones.
_ROUNDING, _ROUNDING_OF_MOTIONS = 1e-12, 1e-9
# Displacements, in natural sizes, after which the mechanism must still be in equilibrium.
_DISPLACEMENTS = (0.0, 0.13, -0.07)
# Decimals of motions that are not rounding errors.
_DECIMALS = 9
# Step of central differences, which have the direction of a finite rotation.
_STEP = 0.01


def hold_neutral_motions(system: LoadedEquations, x: Array, mu: float) -> LoadedEquations:
    """Return the system with its neutral motions held at x = (q, lam), near an equilibrium at `mu`.

    Neutral motions are rigid motions of bodies along which the mechanism stays in equilibrium, and
    on which loads do no work. Each is held by a spring on one of its coordinates, but none if there
    is another motion without stiffness.
    """
    motions = _find_motions_without_stiffness(system, x, mu)
    if not all(_is_neutral(system, x, mu, motion) for motion in motions.T):
        return system
    # Of coordinates that move equally but for rounding, the first one is held.
    order = la.qr(motions.T.round(_DECIMALS), mode="r", pivoting=True)[1]
    return replace(system, held_coordinates=tuple(sorted(order[: motions.shape[1]].tolist())))


def _find_motions_without_stiffness(system: LoadedEquations, x: Array, mu: float) -> Array:
    """Return the rigid motions that joints allow without a change of forces, (n, k).

    Columns are orthonormal after division by `position_scales`; reactions may change.
    """
    e, n = system.equations, system.equations.n
    sizes = np.append(e.position_scales, np.ones(len(x) - n))
    matrix = system.at_factor(mu).matrix(*np.split(x, [n]))
    tangent = (matrix * sizes * sizes[:, None]).toarray()
    stiffness, gradients = (y / (_size(y) or 1.0) for y in (tangent[:n, :n], tangent[n:, :n]))
    rigid = compute_rigid_motions(e, x[:n])
    # Motions and reactions that leave joints closed and forces unchanged.
    changes = np.block(
        [[stiffness @ rigid, gradients.T], [gradients @ rigid, np.zeros((len(x) - n,) * 2)]]
    )
    _, values, right = la.svd(changes)
    free = right[int(np.sum(values > _ROUNDING)) :, : rigid.shape[1]]
    return la.qr(rigid @ free.T, mode="economic")[0]


def _size(entries: Array) -> float:
    return float(np.max(np.abs(entries), initial=0.0))


def _without_reactions(gradients: Array, forces: Array) -> Array:
    """Return the part of forces (n, ...) that no reactions balance, given the gradients (m, n)."""
    return forces - gradients.T @ la.lstsq(gradients.T, forces)[0]


def _is_neutral(system: LoadedEquations, x: Array, mu: float, motion: Array) -> bool:
    """Return True if forces stay in equilibrium, and loads do no work, along a scaled motion."""
    e, n = system.equations, system.equations.n
    here, scale, lam = system.at_factor(mu), e.position_scales, np.zeros(len(x) - n)

    def move(displacement: float) -> Array:
        return move_rigidly(e, x[:n], displacement * scale * motion)

    for displacement in _DISPLACEMENTS:
        moved = move(displacement)
        velocity = move(displacement + _STEP) - move(displacement - _STEP)
        tangent = here.matrix(moved, lam)
        gradients = (tangent[n:, :n] * scale).toarray()
        forces, load = here.residual(moved, lam), here.by_factor(moved, lam)
        unbalanced = _without_reactions(gradients, scale * forces[:n])
        stiffness = _size((tangent[:n, :n] * scale * scale[:, None]).data)
        power, largest = abs(velocity @ load[:n]), _size(velocity / scale)
        if displacement == 0.0:
            # Components of forces that turn with the mechanism change.
            bound = max(2.0 * float(la.norm(unbalanced)), _ROUNDING * stiffness)
        if (
            _size(forces[n:]) > _ROUNDING_OF_MOTIONS * e.length
            or _size(unbalanced) > bound
            or power > _ROUNDING_OF_MOTIONS * largest * float(np.sum(np.abs(scale * load[:n])))
        ):
            return False
    return True
