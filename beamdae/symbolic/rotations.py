"""Coordinates of copies as turned ones out of some of the global coordinates, inside kernels.

An operator from global to local coordinates has few columns a copy: x_e = T_e z_e, z_e picked out
of the global coordinates. With T_e among the data of a kernel its lanes turn what goes in and what
comes out; what is left to do one by one, from memory to memory, is to pick and to add up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.symbolic.kernel_sums import Kernel

Array = np.ndarray
SX = ca.SX


@dataclass(frozen=True)
class Turn:
    """Pattern of the T_e of all copies.

    Attributes
    ----------
    shape
        Local coordinates, and those picked.
    ones, others
        (row, column) of its ones, and of the entries that are data, in their order.
    """

    shape: tuple[int, int]
    ones: tuple[tuple[int, int], ...]
    others: tuple[tuple[int, int], ...]

    def matrix(self, data: SX) -> SX:
        """T_e."""
        matrix = SX(*self.shape)
        for row, column in self.ones:
            matrix[row, column] = 1.0
        for k, (row, column) in enumerate(self.others):
            matrix[row, column] = data[k]
        return matrix

    def operator(self, picked: sp.csr_array, data: Array) -> sp.csr_array:
        """What picks and turns, with the numbers of the copies, a column each."""
        copy, (rows, columns) = np.arange(data.shape[1]), self.shape
        i, j = np.array([*self.ones, *self.others]).T[:, :, None] + copy * np.array(
            [[[rows]], [[columns]]]
        )
        values = np.concatenate([np.ones((len(self.ones), len(copy))), data])
        shape = (rows * len(copy), columns * len(copy))
        turning = sp.csr_array((values.ravel(), (i.ravel(), j.ravel())), shape=shape)
        return sp.csr_array(turning @ picked)


class Turned(NamedTuple):
    """An operator of copies: what it picks, and how that is turned.

    Attributes
    ----------
    picked
        The operator that picks.
    turn, data
        How the copies turn it, and the numbers of each, a column a copy; None: not at all.
    """

    picked: sp.csr_array
    turn: Turn | None
    data: Array


def turned_operator(operator: sp.csr_array, count: int) -> Turned:
    """The operator of `count` copies, in coordinates that are picked.

    The columns of a copy take their places by the rows of their largest entries: those of copies
    that lack some of them then still agree.
    """
    rows, data, lengths = operator.shape[0] // count, operator.data, np.diff(operator.indptr)
    if np.all(data == 1.0) and np.all(lengths <= 1):
        return Turned(operator, None, np.zeros((0, count)))
    copy, row = np.divmod(np.repeat(np.arange(operator.shape[0]), lengths), rows)
    keys, column = np.unique(copy * operator.shape[1] + operator.indices, return_inverse=True)
    owner, of = np.divmod(keys, operator.shape[1])
    by_size = np.lexsort((row, -np.abs(data), column))
    main = row[by_size[np.unique(column[by_size], return_index=True)[1]]]
    # Of columns with the same main row each takes a place of its own.
    order = np.lexsort((of, main, owner))
    same = (np.diff(owner[order]) == 0) & (np.diff(main[order]) == 0)
    since = np.arange(len(order))
    since -= np.maximum.accumulate(np.where(np.r_[False, same], 0, since))
    kind = np.empty_like(main)
    kind[order] = main[order] + rows * since
    kinds, place = np.unique(kind, return_inverse=True)
    cells, cell = np.unique(row * len(kinds) + place[column], return_inverse=True)
    values = np.ones((len(cells), count))
    # One in all copies that have the column; what the others turn is not looked at.
    ones_of = np.bincount(cell, data == 1.0, len(cells))
    is_one = ones_of == np.bincount(place)[cells % len(kinds)]
    values[~is_one] = 0.0
    values[cell, copy] = data
    at = [(int(i), int(j)) for i, j in zip(*np.divmod(cells, len(kinds)), strict=True)]
    ones, others = ([x for x, one in zip(at, is_one, strict=True) if one == k] for k in (1, 0))
    # No two columns of a copy have one place.
    at_row = owner * len(kinds) + place
    by_row = np.argsort(at_row)
    starts = np.searchsorted(at_row[by_row], np.arange(count * len(kinds) + 1))
    parts = (np.ones(len(keys)), of[by_row], starts)
    picked = sp.csr_array(parts, shape=(count * len(kinds), operator.shape[1]))
    turn = Turn((rows, len(kinds)), tuple(ones), tuple(others))
    return Turned(picked, turn, values[~is_one])


def turned(kernel: Kernel, turn: Turn, vectors: int, scalars: int = 0) -> Kernel:
    """The kernel of (vectors, data) as one of (vectors picked, data, numbers of the turn).

    Its columns C become T^T C and its matrices V become T^T V T, but for its last outputs, as many
    as `scalars`, which stay as they are.
    """
    key = turn, vectors, scalars
    if key not in kernel.turned:
        kernel.turned[key] = _turned(kernel, turn, vectors, scalars)
    return kernel.turned[key]


def _turned(kernel: Kernel, turn: Turn, vectors: int, scalars: int) -> Kernel:
    function, (size, own) = kernel.function, turn.shape
    n_data = function.numel_in(1) - vectors * size
    shared, data = SX.sym("shared", function.numel_in(0)), SX.sym("data", n_data)
    numbers = SX.sym("turn", len(turn.others))
    picked = [SX.sym("picked", own) for _ in range(vectors)]
    matrix = turn.matrix(numbers)
    entries = function(shared, ca.vertcat(*(matrix @ x for x in picked), data))
    ends = np.cumsum([0, *(pattern.nnz() for pattern in kernel.outputs)]).tolist()
    values = [
        SX(pattern, entries[begin:end])
        for pattern, begin, end in zip(kernel.outputs, ends[:-1], ends[1:], strict=True)
    ]
    in_coordinates = len(values) - scalars
    outputs = [
        matrix.T @ value if value.shape[1] == 1 else matrix.T @ value @ matrix
        for value in values[:in_coordinates]
    ]
    outputs += values[in_coordinates:]
    local = ca.vertcat(*picked, data, numbers)
    return Kernel.of(function.name(), shared, local, outputs)
