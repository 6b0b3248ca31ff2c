"""Stiffness matrices of one part at many states, solved as one band."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from scipy.linalg.lapack import dgbsv
from scipy.sparse.csgraph import reverse_cuthill_mckee

from beamdae.bounded_cache import bounded_cache
from beamdae.equations.structure import comparison_key
from beamdae.read_only import read_only_data

Array = np.ndarray

# Largest total number of coordinates of the cached plans, which take about 5 kB per coordinate.
_MAX_CACHED_COORDINATES = 4000


@read_only_data
@dataclass(frozen=True, eq=False)
class BandedStiffness:
    """Plan for the assembly of element matrices on the coordinates of a part.

    Attributes
    ----------
    to_local
        Operator (elements * size, n) from the coordinates, ordered for a small bandwidth, to the
        local coordinates of all elements.
    bandwidth
        Number of diagonals above and below the main diagonal.
    entries, sources, factors
        Entry `entries` of the flattened band, in the storage of LAPACK's factors, receives
        `factors` times entry `sources` of the flattened element matrices.
    """

    to_local: sp.csr_array
    bandwidth: int
    entries: Array
    sources: Array
    factors: Array

    def solve(self, matrices: Array, right: Array) -> Array:
        """Return the solutions (k n,) of k systems.

        Parameters
        ----------
        matrices
            Symmetric element matrices (k, elements, size, size).
        right
            Right-hand sides (k n,).

        Raises
        ------
        LinAlgError
            If a matrix is singular, or a number is not finite.
        """
        count, n, height = len(matrices), self.to_local.shape[1], 3 * self.bandwidth + 1
        values = np.take(matrices.reshape(count, -1), self.sources, axis=1) * self.factors
        entries = self.entries + n * height * np.arange(count)[:, None]
        band = np.bincount(entries.ravel(), values.ravel(), count * n * height)
        if not (np.isfinite(band).all() and np.isfinite(right).all()):
            raise np.linalg.LinAlgError("numbers that are not finite")
        band = band.reshape(count * n, height).T
        # `solve_banded` would copy the band, which has space for the factors already.
        _, _, solution, info = dgbsv(self.bandwidth, self.bandwidth, band, right, overwrite_ab=True)
        if info:
            raise np.linalg.LinAlgError("singular matrix")
        return np.asarray(solution)


@dataclass(frozen=True)
class _Operator:
    """Operator on the coordinates of a part; equal operators have the same key."""

    key: object
    matrix: sp.csr_array = field(compare=False)


def plan_banded_stiffness(
    operator: sp.csr_array, element_size: int, rows: slice
) -> BandedStiffness:
    """Return the plan for the coordinates `rows` of the `element_size` ones of each element.

    `operator` maps the coordinates of the mechanism to the coordinates of all elements. Plans are
    cached, because the runs of a sweep share them.
    """
    key, (start, stop, _) = comparison_key(operator), rows.indices(element_size)
    return _plan_operator(_Operator(key, operator), element_size, start, stop)


@bounded_cache(_MAX_CACHED_COORDINATES, lambda plan: plan.to_local.shape[1])
def _plan_operator(
    operator: _Operator, element_size: int, start: int, stop: int
) -> BandedStiffness:
    size = stop - start
    starts = np.arange(0, operator.matrix.shape[0], element_size)
    matrix = sp.csr_array(operator.matrix)[(starts[:, None] + np.arange(start, stop)).ravel()]
    matrix = matrix[:, np.unique(matrix.nonzero()[1])]
    elements = matrix.shape[0] // size
    couplings = sp.kron(sp.eye_array(elements), np.ones((size, size)), "csr")
    pattern = sp.csr_array(abs(matrix).T @ couplings @ abs(matrix))
    to_local = sp.csr_array(matrix[:, reverse_cuthill_mckee(pattern, symmetric_mode=True)])
    rows, columns, sources, factors = [], [], [], []
    for k in range(elements):
        block = to_local[k * size : (k + 1) * size].tocoo()
        (local, coordinate), weight = block.coords, block.data
        rows.append(np.repeat(coordinate, len(coordinate)))
        columns.append(np.tile(coordinate, len(coordinate)))
        sources.append(np.ravel((k * size + local[:, None]) * size + local))
        factors.append(np.ravel(np.outer(weight, weight)))
    row, column = np.concatenate(rows).astype(np.intp), np.concatenate(columns)
    bandwidth = int(np.max(np.abs(row - column)))
    entries = column * (3 * bandwidth + 1) + 2 * bandwidth + row - column
    return BandedStiffness(
        to_local, bandwidth, entries, np.concatenate(sources), np.concatenate(factors)
    )
