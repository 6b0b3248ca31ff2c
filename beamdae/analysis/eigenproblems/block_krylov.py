"""Block Krylov method for the eigenvalues of a linear operator with the largest magnitudes.

The operator is applied to blocks of vectors, and the basis is not restarted (Golub & Underwood, in
Mathematical Software III, 1977, 361; Saad, Numerical Methods for Large Eigenvalue Problems, SIAM
2011, chapter 6). If the first block has as many columns as eigenvalues are wanted, multiple
eigenvalues are found with their multiplicity. Approximate eigenvectors as first block save most of
the work.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

Array = np.ndarray

# Residual, relative to the eigenvalue, of an accurate eigenpair.
_TOLERANCE = 1e-11
# A larger residual is accepted up to this size if it has not halved in this number of blocks,
# because rounding errors of the operator are then larger than estimated.
_STAGNATION_TOLERANCE = 1e-6
_STAGNATION_RATIO = 0.5
_STAGNATION_BLOCKS = 3
# Largest size of a space: number of its first vectors times the first number, plus the second.
_MAX_BLOCKS = 15
_MAX_EXTRA_SIZE = 150
# A vector depends on the basis if orthogonalization leaves less than this fraction of it, or less
# than this fraction of its length in the metric of absolute values: subtraction leaves rounding
# errors, whose lengths in a stiff metric exceed the first fraction. Vectors of rounding errors that
# are similar would be appended without being orthogonal.
_DEPENDENCE_RATIO = 1e-13
_ROUNDING_RATIO = 1e-14

# A search takes as long as all dense eigenvalues if the cubes of its sizes add up to this multiple
# of the cube of the dimension, because each block also takes solutions (measured).
_DENSE_WORK_RATIO = 0.6


class BlockKrylov:
    """Block Krylov space of an operator, with a basis that is orthonormal in a metric.

    Parameters
    ----------
    operator
        Maps a vector (n,) to its image (n,).
    start
        First block, (n, k).
    metric
        Symmetric matrix (n, n) of the inner product x^T metric y, positive definite on the range of
        the operator.
    is_symmetric
        True if the operator is self-adjoint in this inner product.
    blocks
        Number of blocks of the space, including the first one.

    Attributes
    ----------
    values
        Eigenvalues of the operator projected onto the space, (d,), in descending order of the
        magnitude.
    residuals
        Lengths of the residuals of the projected eigenpairs, relative to the magnitudes of the
        eigenvalues, (d,).
    """

    def __init__(
        self,
        operator: Callable[[Array], Array],
        start: Array,
        metric: sp.sparray,
        is_symmetric: bool,
        blocks: int = 1,
    ) -> None:
        self._operator, self._metric, self._is_symmetric = operator, metric, is_symmetric
        empty = np.zeros((len(start), 0))
        self._basis, self._weighted_basis, self._images = empty, empty, empty
        self._append(start)
        for _ in range(blocks - 1):
            self._append(self._last_images)
        self._project()

    @property
    def dimension(self) -> int:
        """Number of components of each vector."""
        return self._basis.shape[0]

    @property
    def size(self) -> int:
        """Dimension of the space."""
        return self._basis.shape[1]

    @property
    def _last_images(self) -> Array:
        return self._images[:, self.size - self._block_size :]

    def expand(self) -> bool:
        """Append the images of the last block to the basis.

        Return False if they depend on the basis, which then spans an invariant space.
        """
        self._append(self._last_images)
        self._project()
        return self._block_size > 0

    def vectors(self, selection: Array) -> Array:
        """Return the approximate eigenvectors, of unit length, at these indices, (n, k)."""
        return self._basis @ self._coordinates[:, selection]

    def _append(self, block: Array) -> None:
        """Append the part of the columns that is independent of the basis, and its images."""
        basis, weighted_basis = self._basis, self._weighted_basis
        columns, weighted = np.empty_like(block), np.empty_like(block)
        min_lengths, count = self._rounding_lengths(block), 0
        # Once is not enough, twice is (Parlett, The Symmetric Eigenvalue Problem, section 6.9).
        block = block - basis @ (weighted_basis.T @ block)
        for column, min_length in zip(block.T, min_lengths, strict=True):
            vector = column
            for _ in range(2):
                vector = vector - columns[:, :count] @ (weighted[:, :count].T @ vector)
            vector = vector - basis @ (weighted_basis.T @ vector)
            image = self._metric @ vector
            length = np.sqrt(max(vector @ image, 0.0))
            if length > min_length:
                columns[:, count], weighted[:, count] = vector / length, image / length
                count += 1
        self._block_size = count
        if count:
            new = columns[:, :count]
            self._basis = np.hstack([basis, new])
            self._weighted_basis = np.hstack([weighted_basis, weighted[:, :count]])
            images = np.stack([self._operator(column) for column in new.T], axis=1)
            self._images = np.hstack([self._images, images])

    def _rounding_lengths(self, block: Array) -> Array:
        """Return the lengths (k,) up to which rests of the columns are rounding errors."""
        sizes = np.abs(block)
        squares = np.einsum("ij,ij->j", block, self._metric @ block)
        bounds = np.einsum("ij,ij->j", sizes, abs(self._metric) @ sizes)
        return np.maximum(
            _DEPENDENCE_RATIO * np.sqrt(np.maximum(squares, 0.0)),
            _ROUNDING_RATIO * np.sqrt(bounds),
        )

    def _project(self) -> None:
        """Compute the eigenpairs of the operator projected onto the basis (Rayleigh-Ritz)."""
        projected = self._weighted_basis.T @ self._images
        if self._is_symmetric:
            values, coordinates = la.eigh(0.5 * (projected + projected.T))
        else:
            values, coordinates = la.eig(projected)
        order = np.argsort(-np.abs(values), kind="stable")
        self.values, self._coordinates = values[order], coordinates[:, order]
        # Only images of the last block leave the space.
        last = slice(len(values) - self._block_size, None)
        outside = self._images[:, last] - self._basis @ projected[:, last]
        gram, last_coordinates = outside.T @ (self._metric @ outside), self._coordinates[last]
        squares = np.einsum("ij,ij->j", last_coordinates.conj(), gram @ last_coordinates).real
        sizes = np.maximum(np.abs(self.values), np.finfo(float).tiny)
        self.residuals = np.sqrt(np.maximum(squares, 0.0)) / sizes


def takes_longer_than_dense(work: int, dimension: int) -> bool:
    """Return True if projections take longer than all eigenvalues of a dense matrix.

    `work` is the sum of the cubes of their sizes.
    """
    return work > _DENSE_WORK_RATIO * dimension**3


def converge(
    krylov: BlockKrylov,
    required_accuracy: Callable[[Array], Array],
    rounding: Callable[[Array, Array], Array],
    confirmations: int = 0,
) -> bool:
    """Expand a Krylov space until the residuals of the wanted eigenpairs are small.

    Parameters
    ----------
    krylov
        The space.
    required_accuracy
        Function from the eigenvalues (d,) to the largest permitted residuals (d,): zero for full
        accuracy, infinity for eigenpairs that are not wanted.
    rounding
        Function from eigenvalues (k,) and eigenvectors (n, k) to the residuals (k,) that rounding
        errors of the operator explain.
    confirmations
        Number of further blocks after which the residuals must still be small.

    Returns
    -------
    bool
        False if the residuals remain large, or if dense eigenvalues of the operator take less time
        than those of further projections.
    """
    excesses: list[float] = []
    confirmed = 0
    max_size = _MAX_BLOCKS * krylov.size + _MAX_EXTRA_SIZE
    work = 0
    while krylov.size <= max_size and not takes_longer_than_dense(work, krylov.dimension):
        work += krylov.size**3
        permitted = np.maximum(required_accuracy(krylov.values), _TOLERANCE)
        excesses.append(float(np.max(krylov.residuals / permitted)))
        is_accurate = excesses[-1] <= 1.0
        if is_accurate and confirmed == confirmations:
            return True
        confirmed = confirmed + 1 if is_accurate else 0
        recent = min(excesses[-_STAGNATION_BLOCKS:])
        if recent > _STAGNATION_RATIO * min(excesses[:-_STAGNATION_BLOCKS], default=np.inf):
            (large,) = np.nonzero(krylov.residuals > permitted)
            explained = rounding(krylov.values[large], krylov.vectors(large))
            is_explained = krylov.residuals[large] <= np.maximum(explained, _STAGNATION_TOLERANCE)
            if not is_accurate and np.all(is_explained):
                return True
        if not krylov.expand():
            return True
    return False
