"""Matrices factorized together have the factors of matrices factorized one by one."""

import numpy as np
import pytest
import scipy.sparse as sp

from beamdae.linear.elimination import allocate_factors, refactorize, solve
from beamdae.linear.lane_operations import LANES
from beamdae.linear.pivots import propose_plans
from beamdae.native.batch_elimination import (
    BatchSolver,
    factorize_staged,
    select_factors,
    stage_matrix,
)
from beamdae.native.return_codes import DONE, NEW_PIVOTS, SINGULAR

# In plain Python, unsuitable pivots and unused lanes cause warnings of NumPy.
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")


def chain_pattern(blocks: int) -> sp.csc_array:
    """Return the pattern of a chain of nodes of three unknowns, coupled with one constraint."""
    size = 3 * blocks
    rows, columns = np.indices((size, size))
    pattern = np.zeros((size + 1, size + 1), bool)
    pattern[:size, :size] = np.abs(rows // 3 - columns // 3) <= 1
    pattern[size, :3] = pattern[:3, size] = True
    return sp.csc_array(pattern.astype(float))


def random_matrices(pattern: sp.csc_array, count: int) -> list[np.ndarray]:
    random = np.random.default_rng(0)
    diagonal = pattern.indices == np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
    return [random.uniform(-1, 1, pattern.nnz) + 8.0 * diagonal for _ in range(count)]


def solver_for(pattern: sp.csc_array, nonzeros: np.ndarray, proposal: int = 0) -> BatchSolver:
    linear = BatchSolver.empty(float)
    linear.set_plan(list(propose_plans(pattern, nonzeros))[proposal])
    return linear


@pytest.mark.parametrize("proposal", [0, 1, -1])
@pytest.mark.parametrize("count", [LANES, 3])
def test_factors_are_those_of_single_matrices(proposal, count):
    pattern = chain_pattern(11)
    matrices = random_matrices(pattern, count)
    linear = solver_for(pattern, matrices[0], proposal)
    for lane, nonzeros in enumerate(matrices):
        stage_matrix(linear.batch, lane, nonzeros)
    assert factorize_staged(linear, np.zeros(pattern.nnz), count, True) == DONE
    assert linear.factorizations == count
    expected = allocate_factors(linear.plan, float)
    for lane, nonzeros in enumerate(matrices):
        assert refactorize(linear.plan, expected, nonzeros)
        select_factors(linear.plan, linear.factors, linear.batch, lane)
        for name in ("blocks", "upper", "lower", "inverse"):
            one, other = (getattr(x, name) for x in (linear.factors, expected))
            np.testing.assert_array_equal(one, other)
        right = np.ones(pattern.shape[0])
        matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr)).toarray()
        solve(linear.plan, linear.factors, right)
        np.testing.assert_allclose(matrix @ right, np.ones(len(right)), rtol=0, atol=1e-12)


def test_the_first_unsuitable_matrix_is_returned():
    pattern = chain_pattern(11)
    matrices = random_matrices(pattern, LANES)
    linear = solver_for(pattern, matrices[0])
    matrices[5] = np.zeros(pattern.nnz)
    for lane, nonzeros in enumerate(matrices):
        stage_matrix(linear.batch, lane, nonzeros)
    failed = np.ones(pattern.nnz)
    assert factorize_staged(linear, failed, LANES, True) == NEW_PIVOTS
    assert linear.needs_pivots == 1
    np.testing.assert_array_equal(failed, matrices[5])
    # Lanes beyond the number of matrices do not count, whatever they contain.
    assert factorize_staged(linear, failed, 5, True) == DONE
    linear.singular = 1
    assert factorize_staged(linear, failed, 5, True) == SINGULAR


def test_inaccurate_factors_need_new_pivots():
    pattern = chain_pattern(11)
    matrices = random_matrices(pattern, LANES)
    linear = solver_for(pattern, matrices[0])
    # The pivots of the first plan, which are on the diagonal, are tiny beside the other entries.
    diagonal = pattern.indices == np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
    bad = np.where(diagonal, 1e-14, matrices[0])
    stage_matrix(linear.batch, 0, bad)
    for lane in range(1, LANES):
        stage_matrix(linear.batch, lane, matrices[lane])
    failed = np.ones(pattern.nnz)
    assert factorize_staged(linear, failed, LANES, False) == DONE
    assert factorize_staged(linear, failed, LANES, True) == NEW_PIVOTS
    np.testing.assert_array_equal(failed, bad)


def test_refinement_uses_the_matrix_of_the_lane():
    pattern = chain_pattern(11)
    matrices = random_matrices(pattern, LANES)
    linear = solver_for(pattern, matrices[0])
    for lane, nonzeros in enumerate(matrices):
        stage_matrix(linear.batch, lane, nonzeros)
    assert factorize_staged(linear, np.zeros(pattern.nnz), LANES, True) == DONE
    linear.factors.refinements[0] = 1
    for lane, nonzeros in enumerate(matrices):
        select_factors(linear.plan, linear.factors, linear.batch, lane)
        expected = allocate_factors(linear.plan, float)
        assert refactorize(linear.plan, expected, nonzeros)
        expected.refinements[0] = 1
        one, other = np.ones((2, pattern.shape[0]))
        solve(linear.plan, linear.factors, one)
        solve(linear.plan, expected, other)
        np.testing.assert_array_equal(one, other)
