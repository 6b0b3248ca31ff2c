"""Accuracy of factorizations, also as linear solvers of IDA."""

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

from beamdae.linear.factorizations import (
    DENSE_LIMIT,
    DenseFactorization,
    SingularMatrixError,
    SparseFactorization,
    create_factorization,
)


def numbers(size, rng, dtype):
    imaginary = 1j * rng.normal(size=size) if dtype is complex else 0.0
    return rng.normal(size=size) + imaginary


def arrow(size, rng, dtype=float):
    """Return a banded matrix with full first rows and columns, as floating frames cause."""
    row, column = np.indices((size, size))
    full = (np.minimum(row, column) < 3) | (np.abs(row - column) <= 2)
    pattern = sp.csc_array(full.astype(float))
    nonzeros = numbers(pattern.nnz, rng, dtype)
    matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
    return pattern, nonzeros, matrix.toarray()


@pytest.mark.parametrize("dtype", [float, complex])
@pytest.mark.parametrize("method", [DenseFactorization, SparseFactorization])
@pytest.mark.parametrize("size", [1, 4, 60])
def test_factorization_solves_every_matrix_of_its_pattern(method, size, dtype):
    rng = np.random.default_rng(size)
    pattern, _, _ = arrow(size, rng)
    ones = pattern.data.copy()
    solver = method(pattern, dtype)
    for _ in range(2):
        _, nonzeros, matrix = arrow(size, rng, dtype)
        solver.factorize(nonzeros)
        # Backward stability: the residual, not the solution, is at rounding.
        for shape in ((size,), (size, 3)):
            right = numbers(shape, rng, dtype)
            x = solver.solve(right)
            scale = np.abs(matrix).sum() * np.abs(x).max()
            assert_allclose(matrix @ x, right, rtol=0.0, atol=1e-14 * scale)
    assert (solver.factorizations, solver.solves) == (2, 4)
    assert method is DenseFactorization or solver.fill <= 2.0
    # The pattern is shared between factorizations.
    assert_allclose(pattern.data, ones, rtol=0.0, atol=0.0)


def test_auto_is_dense_for_small_systems_and_sparse_for_large_ones():
    for size, dense in ((DENSE_LIMIT, True), (DENSE_LIMIT + 1, False)):
        solver = create_factorization(sp.csc_array(sp.eye_array(size, format="csc")))
        assert isinstance(solver, DenseFactorization) == dense


@pytest.mark.parametrize("dtype", [float, complex])
@pytest.mark.parametrize("method", [DenseFactorization, SparseFactorization])
@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_singular_or_infinite_matrix_is_rejected(method, bad, dtype):
    pattern = sp.csc_array(sp.eye_array(3, format="csc"))
    solver = method(pattern, dtype)
    with pytest.raises(SingularMatrixError):
        solver.factorize(np.array([1.0, bad, 1.0]))
    # The bad matrix must not affect the next one.
    solver.factorize(np.array([1.0, 2.0, 4.0]))
    assert_allclose(solver.solve(np.ones(3)), [1.0, 0.5, 0.25], rtol=1e-15)


@pytest.mark.parametrize("method", [DenseFactorization, SparseFactorization])
@pytest.mark.parametrize(
    "matrix",
    [
        [[1.0, 2.0], [2.0, 4.0]],
        [[1.0, 1.0], [0.0, 0.0]],
        [[1.0, 0.0], [1.0, 0.0]],
        [[1.0, np.nan], [1.0, 2.0]],
        [[np.inf, 1.0], [1.0, 2.0]],
    ],
)
def test_rank_deficient_matrix_is_rejected(method, matrix):
    matrix = sp.csc_array(np.array(matrix))
    with pytest.raises(SingularMatrixError):
        method(matrix).factorize(matrix.data)


@pytest.mark.parametrize("method", [DenseFactorization, SparseFactorization])
def test_entries_near_the_largest_float_do_not_overflow(method):
    pattern = sp.csc_array(sp.eye_array(2, format="csc"))
    solver = method(pattern)
    solver.factorize(np.array([1.5e308, 1.5e308]))
    assert_allclose(solver.solve(np.array([1.5e308, 0.0])), [1.0, 0.0], rtol=1e-15)
