"""Kernels that are sums over points, such as those of elements, as loops in machine code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from beamdae.native.lane_kernels import LaneKernel, Rewrite, build_lane_kernel, build_loop_kernel
from beamdae.native.point_code import write_point_module
from beamdae.native.point_programs import Output, PointLoop, Program, write_point_program
from beamdae.symbolic.sums.vector_sines import expand_all_sines

Array = np.ndarray


class PointTerm(NamedTuple):
    """Points with one kernel in a `PointSum`.

    Attributes
    ----------
    source, rewrites, outputs
        Those of the kernel of a point; its local inputs are the coordinates of the point for each
        local vector, then data.
    differences
        Matrix D that is applied to the local vectors first.
    weights
        Matrices W (points, rows, local coordinates): the coordinates of a point are W D x.
    data
        Rows of the local data of each point (points, data).
    """

    source: ca.Function
    rewrites: tuple[Rewrite, ...]
    outputs: tuple[ca.Sparsity, ...]
    differences: Array
    weights: Array
    data: Array


@dataclass(frozen=True, eq=False)
class PointSum:
    """Sum over points that equals a kernel.

    Attributes
    ----------
    terms
        The points.
    vectors
        Number of local vectors.
    n_data
        Number of data of a copy, before the numbers of a rotation.
    rotation
        Matrix T of ones and zeros (local coordinates, inputs), and matrix of the indices + 1 of the
        entries that are numbers of the rotation; None if the inputs are the local coordinates.
    """

    terms: tuple[PointTerm, ...]
    vectors: int
    n_data: int
    rotation: tuple[Array, Array] | None = None

    def compile(
        self, function: ca.Function, outputs: Sequence[ca.Sparsity], compiles: bool
    ) -> LaneKernel | None:
        """Return machine code of `function`, the whole sum, as `build_lane_kernel` does."""
        called = {}
        for symbol, term in zip(self.symbols, self.terms, strict=True):
            steps = (*term.rewrites, expand_all_sines)
            code = build_lane_kernel(term.source, compiles, steps)
            if code is None:
                return None
            called[symbol] = code
        text = write_point_module(function.name(), self.program(outputs))
        return build_loop_kernel(function, text, called, compiles)

    @property
    def symbols(self) -> list[str]:
        """Names of the kernels of points."""
        return [f"{term.source.name()}{k}" for k, term in enumerate(self.terms)]

    def program(self, outputs: Sequence[ca.Sparsity]) -> Program:
        """Return the program of the sum with these outputs."""
        size = self.terms[0].weights.shape[2]
        n_inputs = size if self.rotation is None else self.rotation[0].shape[1]
        loops = []
        for symbol, term in zip(self.symbols, self.terms, strict=True):
            height, source = term.weights.shape[1], term.source
            starts = source.jac_sparsity(0, 1).colind()[: self.vectors * height + 1 : height]
            used = tuple(k for k, (a, b) in enumerate(pairwise(starts)) if a < b)
            patterns = tuple(map(_locate_nonzeros, term.outputs))
            data = term.data + self.vectors * n_inputs
            sizes = source.numel_in(1), source.numel_out(0)
            matrices = term.differences, term.weights
            loops.append(PointLoop(symbol, *sizes, used, *matrices, data, patterns))
        results = []
        for pattern in outputs:
            is_column = pattern.shape == (n_inputs, 1)
            kind = "column" if is_column else "matrix" if pattern.size2() > 1 else "numbers"
            results.append(Output(*_locate_nonzeros(pattern), kind))
        sizes_of_sum = (self.vectors, size, self.n_data)
        return write_point_program(sizes_of_sum, self.rotation, loops, results)


def _locate_nonzeros(pattern: ca.Sparsity) -> tuple[Array, Array]:
    """Return the rows and columns of the non-zeros."""
    rows, columns = pattern.get_triplet()
    return np.array(rows, int), np.array(columns, int)
