"""How near the joints of a mechanism are to losing rank: singular values of G over a run."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.sums import term_data
from beamdae.equations.starts.state_evaluator import plan_state_sums
from beamdae.equations.structure import ConstraintTerm, Structure, cache_on_owner
from beamdae.symbolic.sparse_operators import column_indices, multiply_entries

Array = np.ndarray

# Of matrices that are in memory at once.
_ENTRIES = 2_000_000
# Singular values of rows of length one that are none.
_DEPENDENT = 1e-9
# Stands for what has no coordinates.
_GROUND = ""


@dataclass(frozen=True)
class ConstraintJacobian:
    """G = dg/dq in natural units: coordinates by their scales, rows of length one.

    Attributes
    ----------
    equations
        Whose joints they are.
    pattern
        CSC pattern of G.
    placed
        Of each of the joints: from the gradients of its copies to the non-zeros of G.
    rank
        Of G where it is not singular: less than m where constraints follow from others.
    """

    equations: EquationsOfMotion
    pattern: sp.csc_array
    placed: tuple[sp.csr_array, ...]
    rank: int

    def of_rank_at(self, time: Array, q: Array) -> ConstraintJacobian:
        """The same, its rank that of G at (t, branch) and q."""
        singular = np.linalg.svd(self.at(time[None], q[None])[0], compute_uv=False)
        return replace(self, rank=int(np.sum(singular > _DEPENDENT)))

    def at(self, times: Array, q: Array) -> Array:
        """G at rows of (t, branch) and q, columns of zeros left out, shape (rows, m, .)."""
        pattern = self.pattern
        count = np.diff(pattern.indptr)
        (held,) = np.nonzero(count)
        column = np.repeat(np.arange(len(held)), count[held])
        values = self._nonzeros(times, q)
        values *= np.repeat(self.equations.position_scales[held], count[held])
        matrix = np.zeros((len(q), self.equations.m, len(held)))
        matrix[:, pattern.indices, column] = values
        length = np.linalg.norm(matrix, axis=2, keepdims=True)
        return matrix / np.where(length > 0.0, length, 1.0)

    def _nonzeros(self, times: Array, q: Array) -> Array:
        """Non-zeros of G at rows of (t, branch) and q, a row each."""
        total = np.zeros((len(q), self.pattern.nnz))
        for joint, placed in zip(self.equations.joints, self.placed, strict=True):
            count, size = joint.count, joint.kernel.local.size
            local = np.asarray(joint.operator @ q.T).T.reshape(len(q) * count, size)
            data = np.tile(term_data(self.equations, joint).T, (len(q), 1))
            own = joint.kernel.gradients(np.repeat(times, count, axis=0), local, data)
            total += own.reshape(len(q), -1) @ placed
        return total

    def smallest(self, times: Array, q: Array) -> Array:
        """Smallest singular value of G at rows of (t, branch) and q, shape (rows,).

        Of those that are none of redundant constraints.
        """
        at_once = max(1, _ENTRIES // (self.equations.m * max(self.pattern.nnz, 1)))
        parts = range(0, len(q), at_once)
        which = self.equations.m - self.rank
        return np.concatenate(
            [
                _singular_values(self.at(times[i : i + at_once], q[i : i + at_once]), which)
                for i in parts
            ]
        )

    def losing(self, time: Array, q: Array) -> list[str]:
        """Names of the joints whose reactions balance each other where G has lost rank."""
        left, _, _ = np.linalg.svd(self.at(time[None], q[None])[0])
        share = np.abs(left[:, self.rank - 1])
        names = [name.rpartition(".")[0] or name for name in self.equations.lam_names]
        # A tenth of the largest, so that rounding names nobody.
        return list(
            dict.fromkeys(
                name for name, s in zip(names, share, strict=True) if s > 0.1 * share.max()
            )
        )


def build_constraint_jacobian(e: EquationsOfMotion) -> ConstraintJacobian:
    """The joint matrix of a mechanism, all of whose constraints are independent."""
    return ConstraintJacobian(
        e, plan_state_sums(e.structure).gradient_pattern, _scatter_operators(e.structure), e.m
    )


@cache_on_owner
def _scatter_operators(structure: Structure) -> tuple[sp.csr_array, ...]:
    pattern = plan_state_sums(structure).gradient_pattern
    place = column_indices(pattern) * structure.m + pattern.indices
    return tuple(_scatter_operator(joint, structure.m, place) for joint in structure.joints)


def _scatter_operator(joint: ConstraintTerm, m: int, place: Array) -> sp.csr_array:
    """From the gradients of all copies to entries of G, which are at column * m + row = `place`."""
    own = joint.kernel.gradient_pattern
    row, column = (np.array(x, int) for x in own.get_triplet())
    copy = np.repeat(np.arange(joint.count), len(row))
    i, j, source, weight = multiply_entries(
        joint.rows,
        copy * own.size1() + np.tile(row, joint.count),
        joint.operator,
        copy * own.size2() + np.tile(column, joint.count),
    )
    to = np.searchsorted(place, j.astype(np.int64) * m + i)
    return sp.csr_array((weight, (source, to)), shape=(len(copy), len(place)))


def _singular_values(matrices: Array, which: int) -> Array:
    """Singular values of wide matrices, counted upwards from the smallest, 0."""
    squares = np.linalg.eigvalsh(matrices @ np.swapaxes(matrices, 1, 2))
    return np.sqrt(np.maximum(squares[:, which], 0.0))


def has_closed_loops(e: EquationsOfMotion) -> bool:
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
