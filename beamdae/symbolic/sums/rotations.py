"""Rotation of local coordinates inside kernels.

The local coordinates x_e of a copy depend on few global coordinates: x_e = T_e z_e, where z_e is a
selection of global coordinates. With T_e in its data, a kernel rotates inputs and outputs in
vector lanes, and only selection and addition remain to be done entry by entry in memory.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.symbolic.sums.kernel_sums import Kernel

Array = np.ndarray
SX = ca.SX


@dataclass(frozen=True)
class LocalRotation:
    """Common pattern of the matrices T_e of all copies.

    Attributes
    ----------
    shape
        Number of local coordinates, and number of selected coordinates.
    ones, others
        (row, column) of the entries equal to 1, and of the entries given by data, in the order of
        the data.
    """

    shape: tuple[int, int]
    ones: tuple[tuple[int, int], ...]
    others: tuple[tuple[int, int], ...]

    def matrix(self, data: SX) -> SX:
        """Return T_e of one copy, given its column of data."""
        matrix = SX(*self.shape)
        for row, column in self.ones:
            matrix[row, column] = 1.0
        for k, (row, column) in enumerate(self.others):
            matrix[row, column] = data[k]
        return matrix

    @property
    def arrays(self) -> tuple[Array, Array]:
        """Matrix of the ones, and matrix of the indices + 1 of the numbers."""
        ones, numbers = np.zeros(self.shape), np.zeros(self.shape, int)
        ones[tuple(np.array(self.ones, int).reshape(-1, 2).T)] = 1.0
        numbers[tuple(np.array(self.others, int).reshape(-1, 2).T)] = 1 + np.arange(
            len(self.others)
        )
        return ones, numbers


class RotatedOperator(NamedTuple):
    """An operator of several copies, factored into a selection and a rotation.

    Attributes
    ----------
    selection
        Operator that selects the global coordinates z_e of all copies.
    rotation, data
        Pattern of the rotation, and its numbers, one column per copy. If the operator only selects,
        `rotation` is None and `data` has no rows.
    """

    selection: sp.csr_array
    rotation: LocalRotation | None
    data: Array


def factor_operator(operator: sp.csr_array, count: int) -> RotatedOperator:
    """Factor the operator of `count` copies into a selection and a rotation.

    The columns of a copy are arranged by the rows of their largest entries, so that copies which
    lack some columns still share the pattern.
    """
    if np.all(operator.data == 1.0) and np.all(np.diff(operator.indptr) <= 1):
        return RotatedOperator(operator, None, np.zeros((0, count)))
    shape, indptr, indices, data = (
        operator.shape,
        operator.indptr,
        operator.indices,
        operator.data,
    )
    rows, lengths = shape[0] // count, np.diff(indptr).astype(np.intp)
    copy, row = np.divmod(np.repeat(np.arange(shape[0]), lengths), rows)
    keys, column = np.unique(copy * shape[1] + indices, return_inverse=True)
    column_copy, global_column = np.divmod(keys, shape[1])
    by_size = np.lexsort((row, -np.abs(data), column))
    main_row = row[by_size[np.unique(column[by_size], return_index=True)[1]]]
    # Columns of one copy with the same main row are numbered to keep them apart.
    order = np.lexsort((global_column, main_row, column_copy))
    is_repeated = (np.diff(column_copy[order]) == 0) & (np.diff(main_row[order]) == 0)
    repetition = np.arange(len(order))
    repetition -= np.maximum.accumulate(np.where(np.r_[False, is_repeated], 0, repetition))
    kind = np.empty_like(main_row)
    kind[order] = main_row[order] + rows * repetition
    kinds, slot = np.unique(kind, return_inverse=True)
    cells, cell = np.unique(row * len(kinds) + slot[column], return_inverse=True)
    values = np.ones((len(cells), count))
    # An entry is 1 in the pattern if it is 1 in every copy that has the column; copies without
    # the column select zero there, so the value of the entry is irrelevant.
    one_count = np.bincount(cell, data == 1.0, len(cells))
    is_one = one_count == np.bincount(slot)[cells % len(kinds)]
    values[~is_one] = 0.0
    values[cell, copy] = data
    entries = [(int(i), int(j)) for i, j in zip(*np.divmod(cells, len(kinds)), strict=True)]
    ones = [entry for entry, one in zip(entries, is_one, strict=True) if one]
    others = [entry for entry, one in zip(entries, is_one, strict=True) if not one]
    # Each slot of a copy belongs to at most one column.
    selected_row = column_copy * len(kinds) + slot
    by_row = np.argsort(selected_row)
    starts = np.searchsorted(selected_row[by_row], np.arange(count * len(kinds) + 1))
    parts = (np.ones(len(keys)), global_column[by_row], starts)
    selection = sp.csr_array(parts, shape=(count * len(kinds), shape[1]))
    rotation = LocalRotation((rows, len(kinds)), tuple(ones), tuple(others))
    return RotatedOperator(selection, rotation, values[~is_one])


def rotate_kernel(
    kernel: Kernel, rotation: LocalRotation, vectors: int, scalars: int = 0
) -> Kernel:
    """Return the kernel in selected coordinates; equal arguments return the same object.

    A kernel of `vectors` local vectors and data becomes a kernel of (selected vectors, data,
    rotation numbers). Its columns C become T^T C and its matrices V become T^T V T. The last
    `scalars` outputs, which do not depend on the choice of coordinates, remain unchanged.
    """
    key = rotation, vectors, scalars
    build = partial(_build_rotated_kernel, kernel, rotation, vectors, scalars)
    return kernel.derive(key, build)


def _build_rotated_kernel(
    kernel: Kernel, rotation: LocalRotation, vectors: int, scalars: int
) -> Kernel:
    function, (size, n_selected) = kernel.source, rotation.shape
    n_data = function.numel_in(1) - vectors * size
    shared, data = SX.sym("shared", function.numel_in(0)), SX.sym("data", n_data)
    numbers = SX.sym("rotation", len(rotation.others))
    selected_vectors = [SX.sym("selected", n_selected) for _ in range(vectors)]
    matrix = rotation.matrix(numbers)
    entries = function(shared, ca.vertcat(*(matrix @ x for x in selected_vectors), data))
    ends = np.cumsum([0, *(pattern.nnz() for pattern in kernel.outputs)]).tolist()
    values = [
        SX(pattern, entries[begin:end])
        for pattern, begin, end in zip(kernel.outputs, ends[:-1], ends[1:], strict=True)
    ]
    n_rotated = len(values) - scalars
    outputs = [
        matrix.T @ value if value.shape[1] == 1 else matrix.T @ value @ matrix
        for value in values[:n_rotated]
    ]
    outputs += values[n_rotated:]
    local = ca.vertcat(*selected_vectors, data, numbers)
    points = kernel.points
    if points is not None:
        points = replace(points, rotation=rotation.arrays)
    return Kernel.of(function.name(), shared, local, outputs, points)
