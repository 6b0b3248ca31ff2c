"""Matrices factorized together have the factors of matrices factorized one by one."""

import numpy as np
import pytest
import scipy.sparse as sp

from beamdae.linear.elimination import allocate_factors, refactorize, solve
from beamdae.linear.lane_operations import LANES
from beamdae.linear.pivots import propose_plans
from beamdae.native.batch_elimination import (
    BatchSolver,
    factorize_batch,
    select_factors,
)

# In plain Python, unsuitable pivots cause warnings of NumPy.
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")


def chain_pattern(blocks: int) -> sp.csc_array:
    """Return the pattern of a chain of nodes of three unknowns, coupled with one constraint."""
    size = 3 * blocks
    rows, columns = np.indices((size, size))
    pattern = np.zeros((size + 1, size + 1), bool)
    pattern[:size, :size] = np.abs(rows // 3 - columns // 3) <= 1
    pattern[size, :3] = pattern[:3, size] = True
    return sp.csc_array(pattern.astype(float))


def random_matrices(pattern: sp.csc_array) -> list[np.ndarray]:
    random = np.random.default_rng(0)
    diagonal = pattern.indices == np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
    return [random.uniform(-1, 1, pattern.nnz) + 8.0 * diagonal for _ in range(LANES)]


def solver_for(pattern: sp.csc_array, nonzeros: np.ndarray, proposal: int = 0) -> BatchSolver:
    linear = BatchSolver.empty(float)
    linear.set_plan(list(propose_plans(pattern, nonzeros))[proposal])
    return linear


def factorize(linear: BatchSolver, matrices: list[np.ndarray]) -> list[bool]:
    """Factorize together; return whether the pivots suit each of the matrices."""
    lanes = np.stack(matrices, axis=1).ravel()
    linear.batch.entries[: len(lanes)] = lanes
    factorize_batch(linear)
    return [select_factors(linear, lane) for lane in range(LANES)]


@pytest.mark.parametrize("proposal", [0, 1, -1])
def test_factors_are_those_of_single_matrices(proposal):
    pattern = chain_pattern(11)
    matrices = random_matrices(pattern)
    linear = solver_for(pattern, matrices[0], proposal)
    # Twice: the second factorization does not depend on the arrays of the first.
    assert all(factorize(linear, matrices[::-1]))
    assert all(factorize(linear, matrices))
    assert linear.factorizations == 2 * LANES
    expected = allocate_factors(linear.plan, float)
    for lane, nonzeros in enumerate(matrices):
        assert refactorize(linear.plan, expected, nonzeros)
        assert select_factors(linear, lane)
        for name in ("blocks", "upper", "lower", "inverse"):
            one, other = (getattr(x, name) for x in (linear.factors, expected))
            np.testing.assert_array_equal(one, other)
        right = np.ones(pattern.shape[0])
        matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr)).toarray()
        solve(linear.plan, linear.factors, right)
        np.testing.assert_allclose(matrix @ right, np.ones(len(right)), rtol=0, atol=1e-12)


@pytest.mark.parametrize("lane", [0, 3, LANES - 1])
@pytest.mark.parametrize("pivot", [0.0, 1e-14, np.nan])
def test_matrix_with_unsuitable_pivots_is_found_in_any_lane(lane, pivot):
    pattern = chain_pattern(11)
    matrices = random_matrices(pattern)
    linear = solver_for(pattern, matrices[0])
    # The pivots of the first plan, which are on the diagonal, are tiny beside the other entries.
    diagonal = pattern.indices == np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
    unsuitable = [
        *matrices[:lane],
        np.where(diagonal, pivot, matrices[lane]),
        *matrices[lane + 1 :],
    ]
    assert np.flatnonzero(~np.array(factorize(linear, unsuitable))).tolist() == [lane]
    assert all(factorize(linear, matrices))


def test_refinement_uses_the_matrix_of_the_lane():
    pattern = chain_pattern(11)
    matrices = random_matrices(pattern)
    linear = solver_for(pattern, matrices[0])
    factorize(linear, matrices)
    for lane, nonzeros in enumerate(matrices):
        select_factors(linear, lane)
        expected = allocate_factors(linear.plan, float)
        assert refactorize(linear.plan, expected, nonzeros)
        linear.factors.refinements[0] = expected.refinements[0] = 1
        one, other = np.ones((2, pattern.shape[0]))
        solve(linear.plan, linear.factors, one)
        solve(linear.plan, expected, other)
        np.testing.assert_array_equal(one, other)
