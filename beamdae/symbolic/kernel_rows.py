"""Kernels at many states at once: copies of every row side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from beamdae.native.lanes import padded
from beamdae.symbolic.kernel_sums import Kernel

Array = np.ndarray

# As many lanes at a time [numbers of one component] as stay in the caches.
_LANES_AT_ONCE = 1024


@dataclass(frozen=True)
class KernelRows:
    """Copies of a kernel without shared numbers, at rows of states.

    Attributes
    ----------
    kernel
        Of local (t, branch, vectors, data); all of its outputs are columns.
    operators
        Of each of the vectors: rows of all copies, one copy after the other.
    data
        Numbers of the copies, a column each.
    count
        Number of copies.
    """

    kernel: Kernel
    operators: tuple[sp.csr_array, ...]
    data: Array
    count: int

    def __call__(self, times: Array, vectors: Sequence[Array]) -> list[Array]:
        """Outputs (rows, count * size of the column), copies one after the other.

        Parameters
        ----------
        times
            (t, branch), (rows, 2).
        vectors
            (rows, .) each.
        """
        at_once = max(_LANES_AT_ONCE // self.count, 1)
        starts = range(0, len(times), at_once)
        parts = [
            self._chunk(times[i : i + at_once], [x[i : i + at_once] for x in vectors])
            for i in starts
        ]
        return [np.concatenate(columns) for columns in zip(*parts, strict=True)]

    def _chunk(self, times: Array, vectors: list[Array]) -> list[Array]:
        rows, count = len(times), self.count
        local = [np.repeat(times, count, axis=0).T]
        for operator, x in zip(self.operators, vectors, strict=True):
            # (row, copy, component) -> (component, row and copy)
            gathered = np.asarray(operator @ x.T).T.reshape(rows * count, -1)
            local.append(gathered.T)
        local.append(np.tile(self.data, rows))
        found = self._evaluated(np.concatenate(local))
        sizes = [pattern.numel() for pattern in self.kernel.outputs]
        ends = np.cumsum(sizes)[:-1]
        return [block.T.reshape(rows, -1) for block in np.split(found, ends)]

    def _evaluated(self, local: Array) -> Array:
        """(results, copies) at (numbers, copies)."""
        native, copies = self.kernel.native, local.shape[1]
        if native is None:
            function = self.kernel.function
            return np.array(function(np.zeros((0, 1)), local))
        spare = np.repeat(local[:, -1:], padded(copies) - copies, axis=1)
        none = np.zeros(0)
        return native(none, np.concatenate([local, spare], axis=1))[:, :copies]
