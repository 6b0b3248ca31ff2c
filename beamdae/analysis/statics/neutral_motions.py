"""Motions that no force, joint or load resists, such as those of a cart on a rail.

The tangent stiffness is singular along the whole path. Such motions are held by springs that act on
the tangent alone, so that Newton's method does not move the mechanism along them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.analysis.eigenproblems.eigensolution import locate_largest
from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.equations.starts.rigid_motions import compute_rigid_motions

Array = np.ndarray

# Entries of the scaled tangent up to this fraction of the largest one are rounding errors.
_TANGENT_ROUNDING = 1e-12
# The same for changes of the scaled forces.
_FORCE_ROUNDING = 1e-13
# Displacements, in natural sizes, at which tangent and forces must be the same.
_DISPLACEMENTS = (0.13, -0.07)


def hold_neutral_motions(system: LoadedEquations, x: Array) -> LoadedEquations:
    """Return the system with its neutral motions held at the equilibrium x = (q, lam).

    Neutral motions are combinations of rigid motions of bodies, linear in the coordinates, along
    which neither forces with and without loads nor joints change. Loads must not act along them.
    Each is held by a spring on one of its coordinates.
    """
    e, n = system.equations, system.equations.n
    scale = e.position_scales
    motions = compute_rigid_motions(e, x[:n])
    size = 0.0
    for displacement in (0.0, *_DISPLACEMENTS):
        if not motions.shape[1]:
            return system
        weights = displacement * np.cos(1.0 + np.arange(motions.shape[1]))
        displaced = x.copy()
        displaced[:n] += scale * (motions @ weights)
        for mu in system.ends:
            tangent = system.matrix(displaced, mu)
            stiffness = sp.csc_array(tangent[:n, :n]) * scale * scale[:, None]
            gradients = sp.csr_array(tangent[n:, :n]) * scale
            size = max(size, float(np.max(np.abs(stiffness.data), initial=0.0)))
            joint_size = float(np.max(np.abs(gradients.data), initial=0.0)) or 1.0
            changes = np.vstack(
                [stiffness @ motions / (size or 1.0), gradients @ motions / joint_size]
            )
            if not np.all(np.isfinite(changes)):
                return system
            motions = la.qr(motions @ _null_space(changes), mode="economic")[0]
    if size == 0.0:
        return system
    if not all(_is_neutral(system, x, scale * motion, size) for motion in motions.T):
        return system
    indices = []
    for _ in range(motions.shape[1]):
        sizes = la.norm(motions, axis=1)
        index = int(locate_largest(sizes))
        row = motions[index] / sizes[index]
        motions = motions - np.outer(motions @ row, row)
        indices.append(index)
    return replace(system, held_coordinates=tuple(sorted(indices)))


def _null_space(matrix: Array) -> Array:
    _, values, right = la.svd(matrix, full_matrices=True)
    rank = int(np.sum(values > _TANGENT_ROUNDING))
    return right[rank:].T


def _is_neutral(system: LoadedEquations, x: Array, motion: Array, size: float) -> bool:
    """Return True if no load acts along a motion (n,) and forces do not change along it."""
    n, scale = len(motion), system.equations.position_scales
    last = system.ends[1]
    before, load = system.residual(x, last)
    power = abs(motion @ load[:n])
    if power > _TANGENT_ROUNDING * np.sum(np.abs(scale * load[:n])):
        return False
    for displacement in _DISPLACEMENTS:
        displaced = x.copy()
        displaced[:n] += displacement * motion
        change = system.residual(displaced, last)[0] - before
        if not np.max(np.abs(scale * change[:n]), initial=0.0) <= _FORCE_ROUNDING * size:
            return False
        if not np.max(np.abs(change[n:]), initial=0.0) <= _TANGENT_ROUNDING:
            return False
    return True
