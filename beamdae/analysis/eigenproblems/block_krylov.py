"""Block Krylov method for the eigenvalues of a linear operator with the largest magnitudes.

The operator is applied to blocks of vectors, and the basis is not restarted (Golub & Underwood, in
Mathematical Software III, 1977, 361; Saad, Numerical Methods for Large Eigenvalue Problems, SIAM
2011, chapter 6). If the first block has as many columns as eigenvalues are wanted, multiple
eigenvalues are found with their multiplicity.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

Array = np.ndarray

# Residual, relative to the eigenvalue, of an accurate eigenpair.
_TOLERANCE = 1e-11
# Residuals up to this size that have not halved in this number of blocks are rounding errors of the
# operator.
_STAGNATION_TOLERANCE, _STAGNATION_RATIO, _STAGNATION_BLOCKS = 1e-6, 0.5, 3
# Largest size of a space: number of its first vectors times the first number, plus the second.
_MAX_BLOCKS, _MAX_EXTRA_SIZE = 15, 150
# A vector depends on the basis if orthogonalization leaves less than these fractions of its length
# in the metric and in the metric of absolute values.
_DEPENDENCE_RATIO, _ROUNDING_RATIO = 1e-13, 1e-14
# A search takes as long as all dense eigenvalues if the cubes of its sizes add up to this multiple
# of the cube of the dimension.
_DENSE_WORK_RATIO = 0.6


class BlockKrylov:
    """Block Krylov space of an operator, with a basis that is orthonormal in a metric.

    Parameters
    ----------
    operator
        Maps vectors (n, k) to their images (n, k).
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
        self._sizes = abs(metric)
        empty = np.zeros((len(start), 0))
        self._basis, self._weighted, self._images = empty, empty, empty
        self._append(start)
        for _ in range(blocks - 1):
            self._append(self._last_images)
        self._project()

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

    def extend(self, block: Array) -> None:
        """Append other vectors (n, k) to the basis."""
        open_size = self._block_size
        self._append(block)
        self._project(open_size)

    def vectors(self, selection: Array) -> Array:
        """Return the approximate eigenvectors, of unit length, at these indices, (n, k)."""
        return self._basis @ self._coordinates[:, selection]

    def converge(self, required_accuracy: Callable[[Array], Array], confirmations: int = 0) -> bool:
        """Expand the space until the residuals of the wanted eigenpairs are small.

        Parameters
        ----------
        required_accuracy
            Function from the eigenvalues (d,) to the largest permitted residuals (d,): zero for
            full accuracy, infinity for eigenpairs that are not wanted.
        confirmations
            Number of further blocks after which the residuals must still be small.

        Returns
        -------
        bool
            False if the residuals remain large, or if dense eigenvalues of the operator take less
            time than those of further projections.
        """
        excesses: list[float] = []
        confirmed, work = 0, 0
        max_size = _MAX_BLOCKS * self.size + _MAX_EXTRA_SIZE
        while self.size <= max_size and not takes_longer_than_dense(work, len(self._basis)):
            work += self.size**3
            permitted = np.maximum(required_accuracy(self.values), _TOLERANCE)
            excesses.append(float(np.max(self.residuals / permitted)))
            is_accurate = excesses[-1] <= 1.0
            if is_accurate and confirmed == confirmations:
                return True
            confirmed = confirmed + 1 if is_accurate else 0
            before = min(excesses[:-_STAGNATION_BLOCKS], default=np.inf)
            if min(excesses[-_STAGNATION_BLOCKS:]) > _STAGNATION_RATIO * before:
                limits = np.maximum(permitted, _STAGNATION_TOLERANCE)
                if np.all(self.residuals <= limits):
                    return True
            if not self.expand():
                return True
        return False

    def _append(self, block: Array) -> None:
        """Append the part of the columns that is independent of the basis, and its images."""
        basis, weighted_basis = self._basis, self._weighted
        columns, weighted = np.empty_like(block), np.empty_like(block)
        sizes = np.abs(block)
        squares = np.einsum("ij,ij->j", block, self._metric @ block)
        bounds = np.einsum("ij,ij->j", sizes, self._sizes @ sizes)
        # Subtraction leaves rounding errors, whose lengths in a stiff metric exceed the fraction
        # of the length: similar vectors of rounding errors would be appended.
        min_lengths = np.maximum(
            _DEPENDENCE_RATIO * np.sqrt(np.maximum(squares, 0.0)),
            _ROUNDING_RATIO * np.sqrt(bounds),
        )
        count = 0
        # Once is not enough, twice is (Parlett, The Symmetric Eigenvalue Problem, section 6.9).
        for _ in range(2):
            block = block - basis @ (weighted_basis.T @ block)
        for column, min_length in zip(block.T, min_lengths, strict=True):
            vector = column
            for _ in range(2):
                vector = vector - columns[:, :count] @ (weighted[:, :count].T @ vector)
            image = self._metric @ vector
            length = np.sqrt(max(vector @ image, 0.0))
            if length > min_length:
                columns[:, count], weighted[:, count] = vector / length, image / length
                count += 1
        self._block_size = count
        if count:
            shares = weighted_basis.T @ columns[:, :count]
            new = columns[:, :count] - basis @ shares
            self._basis = np.hstack([basis, new])
            new_weighted = weighted[:, :count] - weighted_basis @ shares
            self._weighted = np.hstack([weighted_basis, new_weighted])
            self._images = np.hstack([self._images, self._operator(new)])

    def _project(self, open_size: int = 0) -> None:
        """Compute the eigenpairs of the operator projected onto the basis (Rayleigh-Ritz).

        Images of the last block, and of `open_size` vectors before it, leave the space.
        """
        projected = self._weighted.T @ self._images
        if self._is_symmetric:
            values, coordinates = la.eigh(0.5 * (projected + projected.T))
        else:
            values, coordinates = la.eig(projected)
        order = np.argsort(-np.abs(values), kind="stable")
        self.values, self._coordinates = values[order], coordinates[:, order]
        last = slice(len(values) - self._block_size - open_size, None)
        outside = self._images[:, last] - self._basis @ projected[:, last]
        gram, rows = outside.T @ (self._metric @ outside), self._coordinates[last]
        squares = np.einsum("ij,ij->j", rows.conj(), gram @ rows).real
        sizes = np.maximum(np.abs(self.values), np.finfo(float).tiny)
        self.residuals = np.sqrt(np.maximum(squares, 0.0)) / sizes


def takes_longer_than_dense(work: int, dimension: int) -> bool:
    """Return True if projections take longer than all eigenvalues of a dense matrix.

    `work` is the sum of the cubes of their sizes.
    """
    return work > _DENSE_WORK_RATIO * dimension**3
