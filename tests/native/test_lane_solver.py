"""Solution of sparse systems with one right-hand side per vector lane, compiled or interpreted."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from beamdae.linear.lane_operations import LANES, aligned_zeros, multiply_rows
from beamdae.native.loop_functions import factorize, solve_lanes
from numpy.testing import assert_allclose

from beamdae.core.return_codes import DONE
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.native.object_code import is_native_enabled

NATIVE = pytest.param(
    True, marks=pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")
)


@dataclass(slots=True)
class Systems:
    linear: Any
    nonzeros: np.ndarray
    right: np.ndarray


def solve_systems(run):
    code = factorize(run.linear, run.nonzeros)
    if code == DONE:
        solve_lanes(run.linear, run.right)
    return code


def random_entries(shape, dtype):
    random = np.random.default_rng(0)
    entries = random.standard_normal(shape)
    return entries + 1j * random.standard_normal(shape) if dtype is complex else entries


@pytest.mark.parametrize("native", [NATIVE, False])
@pytest.mark.parametrize("dtype", [float, complex])
@pytest.mark.parametrize("size", [1, 40, 300])
def test_all_lanes_are_solved(size, dtype, native):
    """The matrix has a band and full rows and columns, in an order that needs pivots."""
    row, column = np.indices((size, size))
    is_entry = (np.minimum(row, column) < 2) | (np.abs(row - column) <= 2)
    pattern = sp.csc_array(is_entry[::-1].astype(float))
    matrix = FactorizedMatrix.from_pattern(pattern, dtype, in_lanes=True)
    right = random_entries((size, LANES), dtype)
    loop = StepLoop(
        solve_systems,
        lambda native: Systems(
            matrix.make_solver(native, "auto"), matrix.nonzeros, right.ravel().copy()
        ),
        lambda run: [(run.linear, matrix)],
        native,
    )
    assert loop.is_native == native
    dense = random_entries((size, size), dtype) * is_entry[::-1]
    matrix.nonzeros[:] = dense.T[pattern.toarray().T > 0.0]
    assert loop() == DONE
    expected = np.linalg.solve(dense, right)
    actual = loop.work.right.reshape(size, LANES)
    assert_allclose(actual, expected, atol=1e-9 * np.max(np.abs(expected)))


@dataclass(slots=True)
class Product:
    out: np.ndarray
    starts: np.ndarray
    columns: np.ndarray
    nonzeros: np.ndarray
    sources: np.ndarray
    lanes: np.ndarray


def multiply_matrix(run):
    multiply_rows(run.out, run.starts, run.columns, run.nonzeros, run.sources, run.lanes)
    return DONE


@pytest.mark.parametrize("native", [NATIVE, False])
def test_products_of_a_sparse_matrix_with_all_lanes(native):
    random = np.random.default_rng(1)
    dense = random.standard_normal((7, 20)) * (random.random((7, 20)) < 0.4)
    dense[3] = 0.0
    matrix = sp.csr_array(dense)
    sources = random.permutation(matrix.nnz)
    nonzeros = np.zeros(matrix.nnz)
    nonzeros[sources] = matrix.data
    lanes = aligned_zeros(20 * LANES)
    lanes[:] = random.standard_normal(lanes.size)
    indices = (x.astype(np.uint32) for x in (matrix.indptr, matrix.indices, sources))
    starts, columns, sources = indices
    loop = StepLoop(
        multiply_matrix,
        lambda native: Product(np.full(7 * LANES, 9.0), starts, columns, nonzeros, sources, lanes),
        lambda run: [],
        native,
    )
    assert loop() == DONE
    expected = matrix @ lanes.reshape(-1, LANES)
    assert_allclose(loop.work.out, expected.ravel(), rtol=1e-13, atol=1e-14)
