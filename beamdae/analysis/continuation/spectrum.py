"""Growing motions about an equilibrium: M q'' + D q' + K q + G^T lam = 0, G q = 0."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as la

from beamdae.analysis.continuation.critical import Count

Array = np.ndarray

# Motions with the least stiffness, and the asymmetry in them below which forces have a potential:
# forces normal to sections instead of the axis do work on shear strains.
_SOFT_COUNT = 6
_MIN_ASYMMETRY = 1e-3
# Real parts below this fraction of the eigenvalue are rounding errors.
_ROUNDING, _ROUNDING_OF_GROWTH = 1e-6, 1e-10


class Matrices(NamedTuple):
    """Dense stiffness, damping and mass in the motions that the joints allow."""

    stiffness: Array
    damping: Array
    mass: Array


def reduce_matrices(gradients: Array, *matrices: Array) -> list[Array]:
    """Return matrices (n, n) in an orthonormal basis of the null space of `gradients` (m, n)."""
    basis = la.null_space(gradients) if len(gradients) else np.eye(matrices[0].shape[0])
    return [basis.T @ x @ basis for x in matrices]


def has_potential(stiffness: Array) -> bool:
    """Return True if soft motions feel no asymmetry of a stiffness."""
    if not len(stiffness):
        return True
    values, vectors = la.eigh(0.5 * (stiffness + stiffness.T))
    soft = vectors[:, np.argsort(np.abs(values))[:_SOFT_COUNT]]
    reduced = soft.T @ stiffness @ soft
    return bool(
        np.abs(reduced - reduced.T).max() <= _MIN_ASYMMETRY * np.abs(reduced).max()
    )


def count_negative(stiffness: Array) -> Count:
    """Return the number of directions in which a symmetric stiffness is negative."""
    values = la.eigvalsh(0.5 * (stiffness + stiffness.T))
    return Count(int(np.sum(values < 0.0)), 0)


def count_growing(matrices: Matrices) -> Count:
    """Return the number of growing motions."""
    stiffness, damping, mass = matrices
    if not damping.any():
        # Squares of eigenvalues: real ones do not oscillate if they are positive.
        squares = la.eigvals(-stiffness, mass)
        is_real = np.abs(squares.imag) <= _ROUNDING * np.abs(squares)
        growing = is_real & (squares.real > 0.0)
        return Count(int(growing.sum()), int(np.sum(~is_real)) // 2)
    size = len(stiffness)
    zero, one = np.zeros((size, size)), np.eye(size)
    first = np.block([[zero, one], [-stiffness, -damping]])
    values = la.eigvals(first, la.block_diag(one, mass))
    growing = values[values.real > _ROUNDING_OF_GROWTH * np.abs(values)]
    is_real = np.abs(growing.imag) <= _ROUNDING * np.abs(growing)
    return Count(int(is_real.sum()), int(np.sum(~is_real)) // 2)
