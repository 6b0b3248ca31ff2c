"""How near the joints of a mechanism are to losing rank: singular values of G over a run."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, once
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.sparse_sums import SparseSum

Array = np.ndarray
MX = ca.MX

# Of matrices that are in memory at once.
_ENTRIES = 2_000_000
# Stands for what has no coordinates.
_GROUND = ""


@dataclass(frozen=True)
class JointMatrix:
    """G = dg/dq in natural units: coordinates by their scales, rows of length one.

    Attributes
    ----------
    equations
        Whose joints they are.
    function
        Rows of (time, q, p) -> non-zeros of G on `pattern`.
    pattern
        CSC pattern of G.
    """

    equations: EquationsOfMotion
    function: RowFunction
    pattern: sp.csc_array

    def at(self, times: Array, q: Array) -> Array:
        """G at rows of (t, branch) and q, columns of zeros left out, shape (rows, m, .)."""
        pattern = self.pattern
        count = np.diff(pattern.indptr)
        (held,) = np.nonzero(count)
        column = np.repeat(np.arange(len(held)), count[held])
        values = self.function(times, q, self.equations.p)
        values *= np.repeat(self.equations.position_scales[held], count[held])
        matrix = np.zeros((len(q), self.equations.m, len(held)))
        matrix[:, pattern.indices, column] = values
        length = np.linalg.norm(matrix, axis=2, keepdims=True)
        return matrix / np.where(length > 0.0, length, 1.0)

    def smallest(self, times: Array, q: Array) -> Array:
        """Smallest singular value of G at rows of (t, branch) and q, shape (rows,)."""
        at_once = max(1, _ENTRIES // (self.equations.m * max(self.pattern.nnz, 1)))
        parts = range(0, len(q), at_once)
        return np.concatenate(
            [_smallest(self.at(times[i : i + at_once], q[i : i + at_once])) for i in parts]
        )

    def losing(self, time: Array, q: Array) -> list[str]:
        """Names of the joints whose reactions balance each other where G has lost rank."""
        left, _, _ = np.linalg.svd(self.at(time[None], q[None])[0])
        share = np.abs(left[:, self.equations.m - 1])
        names = [name.rpartition(".")[0] or name for name in self.equations.lam_names]
        # A tenth of the largest, so that rounding names nobody.
        return list(
            dict.fromkeys(
                name for name, s in zip(names, share, strict=True) if s > 0.1 * share.max()
            )
        )


@once
def joint_matrix(e: EquationsOfMotion) -> JointMatrix:
    """The joint matrix of a mechanism."""
    time, q, p = MX.sym("time", 2), MX.sym("q", e.n), MX.sym("p", len(e.p))
    blocks, _, _ = e.constraint_blocks(time, q, MX.zeros(e.n), p, MX.zeros(e.m))
    pattern, nonzeros = SparseSum.of((e.m, e.n), blocks).assemble()
    function = ca.Function("joints", [time, q, p], [nonzeros])
    return JointMatrix(e, RowFunction(function), pattern)


def _smallest(matrices: Array) -> Array:
    squares = np.linalg.eigvalsh(matrices @ np.swapaxes(matrices, 1, 2))
    return np.sqrt(np.maximum(squares[:, 0], 0.0))


def has_loops(e: EquationsOfMotion) -> bool:
    """Whether joints close a loop: those of an open chain never lose rank."""
    owner = [name.rpartition(".")[0] for name in e.q_names]
    group = {body: body for body in (*owner, _GROUND)}

    def root(body: str) -> str:
        while group[body] != body:
            body = group[body]
        return body

    for joint in e.joints:
        tied = {owner[column] for column in joint.operator.indices}
        first, *others = [root(body) for body in (tied if len(tied) > 1 else {*tied, _GROUND})]
        if not others or first in others or len(set(others)) < len(others):
            return True
        for other in others:
            group[other] = first
    return False
