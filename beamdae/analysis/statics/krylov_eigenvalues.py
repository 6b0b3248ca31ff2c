"""Largest eigenvalues of a symmetric operator, by block Krylov subspaces.

Blocks of two vectors find double eigenvalues, such as those of rings. All vectors are kept and
orthogonalized twice, so that Rayleigh-Ritz values need no recurrence. For the inverse of a
stiffness, whose eigenvalues decay with the fourth power of their number, ten blocks suffice. The
subspace is extended by plain loops over arrays that numba can compile.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg.lapack import dsyev, dsyevd

from beamdae.native.loop_functions import combine, inner_product

Array = np.ndarray

_BLOCK_SIZE = 2
_MAX_BLOCKS = 60
_CONFIRMATIONS = 2
# Number of blocks with which a search begins: most searches need five.
_FIRST_BLOCKS = 5
# Vectors that orthogonalization shortens below this fraction depend on the previous ones.
_DEPENDENCE = 1e-10


@dataclass(slots=True)
class KrylovSpace:
    """Orthonormal basis of a Krylov subspace.

    Attributes
    ----------
    basis, images
        Orthonormal vectors and their images, one per row.
    candidates
        Vectors of the next block, (2, n).
    ends
        Number of vectors after each block.
    vectors, blocks
        Numbers of vectors and of blocks.
    first, width
        Index of the first vector of the last block, and number of candidates of the next block.
    blocks_to_add
        Number of blocks to be added.
    """

    basis: Array
    images: Array
    candidates: Array
    ends: Array
    vectors: int = 0
    blocks: int = 0
    first: int = 0
    width: int = _BLOCK_SIZE
    blocks_to_add: int = 0

    @classmethod
    def allocate(cls, n: int) -> KrylovSpace:
        """Return an empty space for vectors of the size `n`."""
        size = min(n, _BLOCK_SIZE * _MAX_BLOCKS)
        basis, images = np.zeros((size, n)), np.zeros((size, n))
        return cls(basis, images, np.zeros((_BLOCK_SIZE, n)), np.zeros(_MAX_BLOCKS, np.intp))

    def restart(self) -> None:
        """Remove all vectors; choose the first candidates."""
        self.candidates[:] = _first_candidates(self.candidates.shape[1])
        self.vectors = self.blocks = self.first = 0
        self.width = _BLOCK_SIZE


@lru_cache(maxsize=8)
def _first_candidates(n: int) -> Array:
    # Deterministic vectors that are unlikely to be orthogonal to a mode.
    return np.cos(np.arange(n) ** 2.0 + np.arange(_BLOCK_SIZE)[:, None])


def begin_block(space: KrylovSpace) -> None:
    """Append the orthonormal parts of the candidates to the basis."""
    space.first = space.vectors
    for k in range(space.width):
        vector = space.candidates[k]
        size = inner_product(vector, vector)
        for _ in range(2):
            for j in range(space.vectors):
                known = space.basis[j]
                combine(vector, (1.0, -inner_product(known, vector)), (vector, known))
        rest = inner_product(vector, vector)
        if rest > _DEPENDENCE**2 * size and space.vectors < space.basis.shape[0]:
            combine(space.basis[space.vectors], (1.0 / np.sqrt(rest),), (vector,))
            space.vectors += 1


def end_block(space: KrylovSpace) -> None:
    """Choose the images of the last block as candidates of the next one."""
    space.width = space.vectors - space.first
    for k in range(space.width):
        combine(space.candidates[k], (1.0,), (space.images[space.first + k],))
    space.ends[space.blocks] = space.vectors
    space.blocks += 1


def largest_eigenvalues(
    space: KrylovSpace,
    extend: Callable[[int], None],
    count: int,
    tolerance: float,
    with_vectors: bool = True,
) -> tuple[Array, Array]:
    """Return the eigenvalues of largest magnitude and their orthonormal vectors, (n, k).

    k is smaller than `count` if the rank of the operator is.

    Parameters
    ----------
    space
        Space of vectors, which is restarted.
    extend
        Function that adds a number of blocks: `begin_block`, images, and `end_block`.
    count
        Number of eigenvalues.
    tolerance
        Largest permitted relative change of the eigenvalues by each of the last two blocks.
        (Residuals are not used: rounding errors of a nearly singular operator exceed its
        small eigenvalues.)
    with_vectors
        False to return no vectors, (n, 0).

    Raises
    ------
    ArithmeticError
        If the eigenvalues do not converge.
    """
    space.restart()
    extend(_FIRST_BLOCKS)
    confirmations, projected = 0, _project(space)
    # Lists, because operations on arrays of a few numbers take ten times as long.
    last: list[float] = []
    for block in range(_FIRST_BLOCKS - _CONFIRMATIONS - 1, _MAX_BLOCKS):
        if block == space.blocks:
            extend(1)
            projected = _project(space)
        previous, size = space.ends[block - 1 : block + 1].tolist()
        # `numpy.linalg.eigvalsh` takes twice as long for matrices of this size.
        eigenvalues, _, failure = dsyev(projected[:size, :size], compute_v=False)
        if failure:
            break
        values = sorted(eigenvalues.tolist(), key=abs, reverse=True)[:count]
        is_unchanged = len(last) == count and all(
            abs(value - before) <= tolerance * abs(value)
            for value, before in zip(values, last, strict=True)
        )
        confirmations = confirmations + 1 if is_unchanged else 0
        if size == previous or confirmations == _CONFIRMATIONS:
            if not with_vectors:
                return np.array(values), np.zeros((space.basis.shape[1], 0))
            eigenvalues, shares, failure = dsyevd(projected[:size, :size])
            if failure:
                break
            order = np.argsort(-np.abs(eigenvalues), kind="stable")[:count]
            return eigenvalues[order], space.basis[:size].T @ shares[:, order]
        last = values
    raise ArithmeticError("the eigenvalues do not converge")


def _project(space: KrylovSpace) -> Array:
    """Return the operator in the basis of the space, symmetrized."""
    projected = space.basis[: space.vectors] @ space.images[: space.vectors].T
    return np.asarray(0.5 * (projected + projected.T))
