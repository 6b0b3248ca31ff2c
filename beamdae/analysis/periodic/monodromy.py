"""Variational equations of a run: propagation of disturbances for the monodromy matrix.

The residual R(t, y, y') = 0 in the form of Gear, Gupta & Leimkuhler is linearized along the run,
R_y dy + R_y' dy' = 0, and integrated by Radau IIA of order 5 on nodes of the run. Small systems are
solved for many steps at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import (
    FirstOrderBuffers,
    FirstOrderForm,
    evaluate_jacobian_parts,
    formulate_first_order,
)
from beamdae.integrators.radau.coefficients import A, C
from beamdae.results.trajectory import Interval, Trajectory
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

_FORM = "ggl"
_STAGES = 3
_INVERSE_A = np.linalg.inv(A)
_INVERSE_A_ROW_SUMS = _INVERSE_A.sum(axis=1)
# Rows of the constraint Jacobian whose length is below this fraction of the longest are zero.
_ZERO_ROW_RATIO = 1e-10
# Largest number of unknowns for which stages are solved by dense matrices, and number of matrix
# entries of the steps that are solved together.
_MAX_DENSE_SIZE = 64
_MAX_BATCH_ENTRIES = 2_000_000
# At the coarsest level, one step covers 2**_COARSEST_LEVEL steps of the run.
_COARSEST_LEVEL = 2
# Prevents a threshold of zero if there are no constraints.
_TINY = 1e-300


@dataclass(frozen=True)
class VariationalEquations:
    """Equations of motion, without redundant constraints, linearized along runs."""

    equations: EquationsOfMotion

    @cached_property
    def form(self) -> FirstOrderForm:
        """First-order form with R_y and R_y' evaluated separately."""
        return formulate_first_order(self.equations, _FORM, apart=True)

    @cached_property
    def _buffers(self) -> FirstOrderBuffers:
        return self.form.buffers()

    @cached_property
    def _columns(self) -> Array:
        return column_indices(self.form.pattern)

    def _jacobians(self, interval: Interval, t: Array) -> Array:
        """Return the non-zeros of R_y and R_y' at times `t`, shape (len(t), 2, non-zeros)."""
        jacobians = np.empty((len(t), 2 * self.form.pattern.nnz))
        state = interval.at(t)
        for k, time in enumerate(t.tolist()):
            y, yp = self.form.pack(State(*(x[k] for x in state)))
            evaluate_jacobian_parts(self._buffers, time, interval.branch, y, yp, jacobians[k])
        return jacobians.reshape(len(t), 2, -1)

    def admissible_disturbances(self, trajectory: Trajectory, scales: Array) -> Array:
        """Return a basis (2 n, k) of the initial disturbances of (q, v) that the joints allow.

        The basis divided by the natural sizes `scales`, (2 n,), is orthonormal.
        """
        n, interval = self.equations.n, trajectory.intervals[0]
        by_y = self._to_dense(self._jacobians(interval, interval.nodes[:1]))[0, 0]
        rows = by_y[2 * n :, : 2 * n] * scales
        size = np.linalg.norm(rows, axis=1, keepdims=True)
        nonzero = rows[size[:, 0] > _ZERO_ROW_RATIO * np.max(size, initial=_TINY)]
        if not len(nonzero):
            return np.diag(scales)
        unit_rows = nonzero / np.linalg.norm(nonzero, axis=1, keepdims=True)
        return scales[:, None] * la.null_space(unit_rows)

    def propagate(self, trajectory: Trajectory, disturbances: Array, refinement: int = 0) -> Array:
        """Propagate initial `disturbances` (2 n, k) of (q, v) to the end of a run.

        Without refinement, each step covers up to four steps of the run; each level of `refinement`
        halves the steps.
        """
        y = disturbances
        for interval in trajectory.intervals:
            nodes = _step_nodes(interval.t, refinement)
            h = np.diff(nodes)
            # Rounding may put the last stage beyond the end.
            stage_times = np.minimum(nodes[:-1, None] + h[:, None] * C, interval.t[-1])
            if self.form.size <= _MAX_DENSE_SIZE:
                y = self._propagate_dense(interval, h, stage_times, y)
            else:
                for step, times in zip(h.tolist(), stage_times, strict=True):
                    y = self._propagate_sparse(interval, step, times, y)
        return y

    def _to_dense(self, nonzeros: Array) -> Array:
        """Convert non-zeros (..., nnz) to dense matrices (..., size, size)."""
        size, pattern = self.form.size, self.form.pattern
        matrices = np.zeros((*nonzeros.shape[:-1], size, size))
        matrices[..., pattern.indices, self._columns] = nonzeros
        return matrices

    def _propagate_dense(self, interval: Interval, h: Array, stage_times: Array, y: Array) -> Array:
        """Propagate disturbances through an interval by dense matrices, many steps at a time.

        The stages Y_j satisfy sum_j inverse(A)_ij E_i (Y_j - y) / h + J_i Y_i = 0 with E = R_y' and
        J = R_y; A is the Butcher matrix.
        """
        size, n_state = self.form.size, len(y)
        batch = max(_MAX_BATCH_ENTRIES // (_STAGES**2 * size**2), 1)
        for first in range(0, len(h), batch):
            steps = slice(first, first + batch)
            count = len(h[steps])
            jacobians = self._to_dense(self._jacobians(interval, stage_times[steps].ravel()))
            jacobians = jacobians.reshape(count, _STAGES, 2, size, size)
            by_y, by_rate = np.moveaxis(jacobians, 2, 0)
            by_rate = by_rate / h[steps, None, None, None]
            blocks = np.einsum("ij,sikl->sikjl", _INVERSE_A, by_rate)
            for i in range(_STAGES):
                blocks[:, i, :, i] += by_y[:, i]
            right = _INVERSE_A_ROW_SUMS[:, None, None] * by_rate[..., :n_state]
            matrix = blocks.reshape(count, _STAGES * size, -1)
            right = right.reshape(count, _STAGES * size, -1)
            # Rows are equilibrated, because multipliers differ from coordinates in units and
            # magnitude.
            row_sizes = np.max(np.abs(matrix), axis=2, keepdims=True)
            matrix = matrix / row_sizes
            column_sizes = np.max(np.abs(matrix), axis=1)[..., None]
            equilibrated = matrix / np.swapaxes(column_sizes, 1, 2)
            stages = np.linalg.solve(equilibrated, right / row_sizes) / column_sizes
            for step_matrix in stages[:, -size : -size + n_state or None]:
                y = step_matrix @ y
        return y

    def _propagate_sparse(
        self, interval: Interval, h: float, stage_times: Array, y: Array
    ) -> Array:
        size, pattern = self.form.size, self.form.pattern
        full = np.zeros((size, y.shape[1]))
        full[: len(y)] = y
        blocks, right = [], []
        for i, jacobians in enumerate(self._jacobians(interval, stage_times)):
            by_y, by_rate = (
                sp.csc_array((values, pattern.indices, pattern.indptr), pattern.shape)
                for values in (jacobians[0], jacobians[1] / h)
            )
            row = [_INVERSE_A[i, j] * by_rate for j in range(_STAGES)]
            row[i] = row[i] + by_y
            blocks.append(row)
            right.append(_INVERSE_A_ROW_SUMS[i] * (by_rate @ full))
        matrix = sp.csr_array(sp.block_array(blocks, format="csr"))
        row_sizes = _row_maxima(matrix)
        matrix = sp.csr_array(sp.diags_array(1.0 / row_sizes) @ matrix)
        column_sizes = _row_maxima(sp.csr_array(matrix.T))
        equilibrated = sp.csc_array(matrix @ sp.diags_array(1.0 / column_sizes))
        stages = splu(equilibrated).solve(np.concatenate(right) / row_sizes[:, None])
        return (stages / column_sizes[:, None])[-size:][: len(y)]


def _step_nodes(t: Array, refinement: int) -> Array:
    """Return every fourth of the times `t` and the last one; each refinement halves the steps."""
    stride = 2 ** max(_COARSEST_LEVEL - refinement, 0)
    nodes = t[np.unique(np.append(np.arange(0, len(t), stride), len(t) - 1))]
    parts = 2 ** max(refinement - _COARSEST_LEVEL, 0)
    share = np.arange(parts) / parts
    return np.append((nodes[:-1, None] + np.diff(nodes)[:, None] * share).ravel(), nodes[-1])


def _row_maxima(matrix: sp.csr_array) -> Array:
    return np.asarray(abs(matrix).max(axis=1).todense()).ravel()
