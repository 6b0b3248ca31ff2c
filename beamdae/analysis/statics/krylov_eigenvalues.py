"""Largest eigenvalues of a symmetric operator, by block Krylov subspaces.

Blocks of two vectors find double eigenvalues, such as those of rings. All vectors are kept and
orthogonalized twice, so that Rayleigh-Ritz values need no recurrence. For the inverse of a
stiffness, whose eigenvalues decay with the fourth power of their number, ten blocks suffice.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la

Array = np.ndarray

_BLOCK_SIZE = 2
_MAX_BLOCKS = 60
_CONFIRMATIONS = 2
# Vectors that orthogonalization shortens below this fraction depend on the previous ones.
_DEPENDENCE = 1e-10


def largest_eigenvalues(
    apply: Callable[[Array], Array], n: int, count: int, tolerance: float
) -> tuple[Array, Array]:
    """Return the eigenvalues of largest magnitude and their orthonormal vectors, (n, k).

    k is smaller than `count` if the rank of the operator is.

    Parameters
    ----------
    apply
        The operator, a function of a vector (n,).
    n, count
        Size of the operator, and number of eigenvalues.
    tolerance
        Largest permitted relative change of the eigenvalues by each of the last two blocks.
        (Residuals are not used: rounding errors of a nearly singular operator exceed its small
        eigenvalues.)

    Raises
    ------
    ArithmeticError
        If the eigenvalues do not converge.
    """
    phases = np.arange(n) ** 2.0
    # Deterministic vectors that are unlikely to be orthogonal to a mode.
    block = [apply(np.cos(phases + k)) for k in range(_BLOCK_SIZE)]
    basis, images = np.zeros((0, n)), np.zeros((0, n))
    last, confirmations = np.zeros(0), 0
    for _ in range(_MAX_BLOCKS):
        new: list[Array] = []
        for vector in block:
            size = la.norm(vector)
            known = np.vstack([basis, *new]) if new else basis
            for _ in range(2):
                vector = vector - known.T @ (known @ vector)
            rest = la.norm(vector)
            if rest > _DEPENDENCE * size:
                new.append((vector / rest)[None])
        if new:
            block = [apply(vector[0]) for vector in new]
            basis, images = np.vstack([basis, *new]), np.vstack([images, *block])
        projected = basis @ images.T
        values, shares = la.eigh(0.5 * (projected + projected.T))
        order = np.argsort(-np.abs(values))[:count]
        values, shares = values[order], shares[:, order]
        is_unchanged = len(last) == count and np.all(
            np.abs(values - last) <= tolerance * np.abs(values)
        )
        confirmations = confirmations + 1 if is_unchanged else 0
        if not new or confirmations == _CONFIRMATIONS:
            return values, basis.T @ shares
        last = values
    raise ArithmeticError("the eigenvalues do not converge")
