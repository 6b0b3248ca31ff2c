"""Growing motions about an equilibrium: M q'' + D q' + K q + G^T lam = 0, G q - C lam = 0.

Eigenvalues are computed from the flexibility, the inverse of the saddle-point matrix of K, G and C:
slow motions are then its largest ones, whatever the stiffest ones are.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg as la

from beamdae.analysis.continuation.critical import Count

Array = np.ndarray

# Motions with the least stiffness, and the asymmetry in them below which forces have a potential:
# forces normal to sections instead of the axis do work on shear strains.
_SOFT_COUNT = 6
_MIN_ASYMMETRY = 1e-3
# Imaginary parts below this fraction of the eigenvalue are rounding errors; and real parts below
# this fraction of the largest eigenvalue.
_ROUNDING, _ROUNDING_OF_GROWTH = 1e-6, 1e-13
# Motions that are faster by the reciprocal of this ratio are rounding errors of the slowest ones.
_NEGLIGIBLE = 1e-7
# Eigenvalues of the mass, with ones on its diagonal, up to this size are rounding errors.
_NEGLIGIBLE_MASS = 1e-12


class Flexibility(NamedTuple):
    """Response of a structure to forces, with the motions that its joints allow.

    Attributes
    ----------
    size
        Number of coordinates n.
    respond
        Function from forces and changes of constraints (n + m, k) to displacements (n, k).
    """

    size: int
    respond: Callable[[Array], Array]

    def respond_to_forces(self, forces: Array, m: int) -> Array:
        """Return the displacements due to forces (n, k) alone."""
        return self.respond(np.vstack([forces, np.zeros((m, forces.shape[1]))]))


def has_potential(flexibility: Flexibility, m: int) -> bool:
    """Return True if soft motions feel no asymmetry of the stiffness; m is the number of rows."""
    size = flexibility.size
    vectors = np.cos(np.outer(np.arange(size) ** 2.0, np.arange(1.0, min(_SOFT_COUNT, size) + 1.0)))
    for _ in range(2):
        vectors = np.linalg.qr(flexibility.respond_to_forces(vectors, m))[0]
    reduced = vectors.T @ flexibility.respond_to_forces(vectors, m)
    return bool(np.abs(reduced - reduced.T).max() <= _MIN_ASYMMETRY * np.abs(reduced).max())


def count_growing(flexibility: Flexibility, mass: Array, damping: Array) -> Count:
    """Return the number of growing motions for a mass matrix (n, n).

    `damping`, (n + m, n), are forces and changes of constraints in proportion to velocities.
    """
    root = _take_root(mass)
    by_mass = flexibility.respond_to_forces(root, len(damping) - len(mass))
    if not damping.any():
        # Reciprocals of squared eigenvalues: real ones do not oscillate if they are positive.
        squares = _select_slow(la.eigvals(-root.T @ by_mass))
        is_real = np.abs(squares.imag) <= _ROUNDING * np.abs(squares)
        growing = is_real & (squares.real > 0.0)
        return Count(int(growing.sum()), int(np.sum(~is_real)) // 2)
    rank = root.shape[1]
    # Reciprocal eigenvalues of the motion q and the momenta L^T q', M = L L^T: with velocities in
    # place of momenta, zeros would be defective where mass vanishes.
    none = np.zeros((rank, rank))
    values = la.eigvals(np.block([[-flexibility.respond(damping), -by_mass], [root.T, none]]))
    values = _select_slow(values)
    growing = values[values.real > _ROUNDING_OF_GROWTH * np.abs(values).max(initial=0.0)]
    is_real = np.abs(growing.imag) <= _ROUNDING * np.abs(growing)
    return Count(int(is_real.sum()), int(np.sum(~is_real)) // 2)


def _select_slow(values: Array) -> Array:
    """Return the reciprocal eigenvalues that are not rounding errors of the slowest one."""
    return values[np.abs(values) > _NEGLIGIBLE * np.abs(values).max(initial=0.0)]


def _take_root(mass: Array) -> Array:
    """Return L (n, rank) with L L^T = `mass`."""
    sizes = np.sqrt(np.abs(mass.diagonal()))
    has_mass = sizes > 0.0
    scaled = mass[np.ix_(has_mass, has_mass)] / sizes[has_mass] / sizes[has_mass, None]
    values, vectors = la.eigh(scaled)
    is_kept = values > _NEGLIGIBLE_MASS
    root = np.zeros((len(mass), int(is_kept.sum())))
    root[has_mass] = sizes[has_mass, None] * vectors[:, is_kept] * np.sqrt(values[is_kept])
    return root
