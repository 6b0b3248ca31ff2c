"""What becomes of small disturbances of a run: the equations linearized along it.

R(t, y, y') = 0 in the form of Gear, Gupta & Leimkuhler, linearized: R_y dy + R_y' dy' = 0, stepped
by Radau IIA of order 5 between the nodes of the run, many steps at a time.
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
_INVERSE = np.linalg.inv(A)
_SUMS = _INVERSE.sum(axis=1)
# A row of the constraints that is this small beside the largest one holds nothing.
_HELD = 1e-10
# Up to so many unknowns stages are solved for densely, many steps at once of so many numbers.
_MOST_DENSE, _AT_ONCE = 64, 2_000_000


@dataclass(frozen=True)
class VariationalEquations:
    """Equations of motion linearized along runs; without redundant constraints."""

    equations: EquationsOfMotion

    @cached_property
    def form(self) -> FirstOrderForm:
        """The first-order form, with R_y and R_y' apart."""
        return formulate_first_order(self.equations, _FORM, apart=True)

    @cached_property
    def _sums(self) -> FirstOrderBuffers:
        return self.form.buffers()

    @cached_property
    def _columns(self) -> Array:
        return column_indices(self.form.pattern)

    def _parts(self, interval: Interval, t: Array) -> Array:
        """Non-zeros of R_y and of R_y' at times inside an interval, (len(t), 2, non-zeros)."""
        found = np.empty((len(t), 2 * self.form.pattern.nnz))
        state = interval.at(t)
        for k, time in enumerate(t.tolist()):
            y, yp = self.form.pack(State(*(x[k] for x in state)))
            evaluate_jacobian_parts(self._sums, time, interval.branch, y, yp, found[k])
        return found.reshape(len(t), 2, -1)

    def free_motions(self, trajectory: Trajectory, scales: Array) -> Array:
        """Disturbances (q, v) the joints allow at the start of a run, (2 n, k).

        Orthonormal columns once divided by `scales` (2 n,).
        """
        n, interval = self.equations.n, trajectory.intervals[0]
        by_y = self._dense(self._parts(interval, interval.nodes[:1]))[0, 0]
        rows = by_y[2 * n :, : 2 * n] * scales
        size = np.linalg.norm(rows, axis=1, keepdims=True)
        held = rows[size[:, 0] > _HELD * np.max(size, initial=1e-300)]
        if not len(held):
            return np.diag(scales)
        return scales[:, None] * la.null_space(held / np.linalg.norm(held, axis=1, keepdims=True))

    def carried(self, trajectory: Trajectory, disturbances: Array, finer: int = 0) -> Array:
        """What becomes of disturbances (2 n, k) of (q, v) until the end of a run.

        They take four steps of the run at once, with `finer` half as many, and so on.
        """
        y = disturbances
        for interval in trajectory.intervals:
            nodes = _step_nodes(interval.t, finer)
            h = np.diff(nodes)
            # The last stage may lie a rounding beyond the end.
            at = np.minimum(nodes[:-1, None] + h[:, None] * C, interval.t[-1])
            if self.form.size <= _MOST_DENSE:
                y = self._densely(interval, h, at, y)
            else:
                for step, stages in zip(h.tolist(), at, strict=True):
                    y = self._sparsely(interval, step, stages, y)
        return y

    def _dense(self, parts: Array) -> Array:
        """As matrices, (..., size, size)."""
        size, pattern = self.form.size, self.form.pattern
        found = np.zeros((*parts.shape[:-1], size, size))
        found[..., pattern.indices, self._columns] = parts
        return found

    def _densely(self, interval: Interval, h: Array, at: Array, y: Array) -> Array:
        """All steps of an interval; stages Y_j: (E_i inverse(A)_ij / h + d_ij J_i) Y_j = ..."""
        size, own = self.form.size, len(y)
        most = max(_AT_ONCE // (9 * size**2), 1)
        for first in range(0, len(h), most):
            some = slice(first, first + most)
            count = len(h[some])
            parts = self._dense(self._parts(interval, at[some].ravel()))
            by_y, by_rate = np.moveaxis(parts.reshape(count, 3, 2, size, size), 2, 0)
            by_rate = by_rate / h[some, None, None, None]
            blocks = np.einsum("ij,sikl->sikjl", _INVERSE, by_rate)
            for i in range(3):
                blocks[:, i, :, i] += by_y[:, i]
            right = _SUMS[:, None, None] * by_rate[..., :own]
            matrix, right = blocks.reshape(count, 3 * size, -1), right.reshape(count, 3 * size, -1)
            # Multipliers are in other units, and far larger, than what they hold.
            across = np.max(np.abs(matrix), axis=2, keepdims=True)
            matrix = matrix / across
            down = np.max(np.abs(matrix), axis=1)[..., None]
            stages = np.linalg.solve(matrix / np.swapaxes(down, 1, 2), right / across) / down
            for step in stages[:, -size : -size + own or None]:
                y = step @ y
        return y

    def _sparsely(self, interval: Interval, h: float, at: Array, y: Array) -> Array:
        """One step."""
        size, pattern = self.form.size, self.form.pattern
        full = np.zeros((size, y.shape[1]))
        full[: len(y)] = y
        blocks, right = [], []
        for i, parts in enumerate(self._parts(interval, at)):
            by_y, by_rate = (
                sp.csc_array((values, pattern.indices, pattern.indptr), pattern.shape)
                for values in (parts[0], parts[1] / h)
            )
            row = [_INVERSE[i, j] * by_rate for j in range(3)]
            row[i] = row[i] + by_y
            blocks.append(row)
            right.append(_SUMS[i] * (by_rate @ full))
        matrix = sp.csr_array(sp.block_array(blocks, format="csr"))
        across = _row_maxima(matrix)
        matrix = sp.csr_array(sp.diags_array(1.0 / across) @ matrix)
        down = _row_maxima(sp.csr_array(matrix.T))
        scaled = sp.csc_array(matrix @ sp.diags_array(1.0 / down))
        stages = splu(scaled).solve(np.concatenate(right) / across[:, None])
        return (stages / down[:, None])[-size:][: len(y)]


def _step_nodes(t: Array, finer: int) -> Array:
    """Every fourth of the times of steps, every second of them, all, with those halfway, ..."""
    stride = 2 ** max(2 - finer, 0)
    nodes = t[np.unique(np.append(np.arange(0, len(t), stride), len(t) - 1))]
    parts = 2 ** max(finer - 2, 0)
    share = np.arange(parts) / parts
    return np.append((nodes[:-1, None] + np.diff(nodes)[:, None] * share).ravel(), nodes[-1])


def _row_maxima(matrix: sp.csr_array) -> Array:
    """The largest entry of each row."""
    return np.asarray(abs(matrix).max(axis=1).todense()).ravel()
