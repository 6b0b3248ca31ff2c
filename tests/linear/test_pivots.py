"""Fill and elimination with given pivots, compared with LAPACK."""

import numpy as np
import pytest
import scipy.sparse as sp
from chains import backward_error, chain_of_beams, integrator_matrices
from hub_beam import hub_beam
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_system import LinearSystem, refactorize, solve
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.core.linear_solver import LinearSolver
from beamdae.core.return_codes import NEW_PIVOTS, SINGULAR
from beamdae.linear.elimination import allocate_factors
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.linear.pivots import compute_fill, propose_plans


def analyze(pattern, nonzeros):
    """Return the first plan that is suitable for these numbers, and its factors."""
    for plan in propose_plans(pattern, nonzeros):
        factors = allocate_factors(plan, nonzeros.dtype)
        if refactorize(plan, factors, nonzeros):
            return plan, factors
    raise SingularMatrixError("the matrix is singular to rounding")


def solve_with(plan, factors, right):
    x = right.astype(factors.x.dtype)
    solve(plan, factors, x)
    return x


def numbers(rng, shape, kind):
    real = rng.normal(size=shape)
    return real + 1j * rng.normal(size=shape) if kind is complex else real


def normwise_error(matrix, x, right):
    """Backward error of Rigal & Gaches."""
    terms = np.abs(matrix).sum(axis=1).max() * np.abs(x).max() + np.abs(right).max()
    return np.abs(matrix @ x - right).max() / terms


@st.composite
def patterns(draw):
    """Dense booleans of full structural rank, whose diagonal may have zeros."""
    size = draw(st.integers(1, 25))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    dense = rng.random((size, size)) < draw(st.floats(0.0, 0.5))
    if draw(st.booleans()):
        np.fill_diagonal(dense, False)
    dense[np.arange(size), rng.permutation(size)] = True
    return dense, rng


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("kind", [float, complex])
@given(given_pattern=patterns())
@settings(max_examples=80, deadline=None)
def test_random_matrices_are_solved_as_by_lapack(kind, given_pattern):
    dense, rng = given_pattern
    size = len(dense)
    pattern = sp.csc_array(dense.astype(float))
    analysis = None
    for _ in range(3):
        matrix = np.where(dense, numbers(rng, (size, size), kind), 0.0)
        right = numbers(rng, size, kind)
        if np.linalg.cond(matrix) > 1e8:
            continue
        nonzeros = matrix.T[dense.T]
        if analysis is None or not refactorize(*analysis, nonzeros):
            analysis = analyze(pattern, nonzeros)
        x = solve_with(*analysis, right)
        assert normwise_error(matrix, x, right) < 1e-9
        expected = np.linalg.solve(matrix, right)
        tolerance = 1e-9 * np.linalg.cond(matrix) * np.abs(expected).max()
        assert_allclose(x, expected, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("kind", [float, complex])
def test_one_plan_factorizes_all_matrices_with_suitable_pivots(kind):
    rng = np.random.default_rng(0)
    size = 40
    row, column = np.indices((size, size))
    dense = (np.abs(row - column) < 3) | (np.minimum(row, column) < 2)
    pattern = sp.csc_array(dense.astype(float))
    plan, factors = analyze(pattern, (10.0 * np.eye(size) + dense).astype(kind).T[dense.T])
    for _ in range(5):
        matrix = np.where(dense, numbers(rng, (size, size), kind), 0.0) + 20.0 * np.eye(size)
        assert refactorize(plan, factors, matrix.T[dense.T])
        right = numbers(rng, size, kind)
        x = solve_with(plan, factors, right)
        assert_allclose(x, np.linalg.solve(matrix, right), rtol=1e-12, atol=1e-15)
        assert_allclose(solve_with(plan, factors, right), x, rtol=0.0, atol=0.0)


@pytest.mark.parametrize("pivot", [0.0, 1e-320, 1e-30, 1e-14])
def test_unsuitable_pivots_are_rejected_without_side_effects(pivot):
    rng, size = np.random.default_rng(0), 12
    pattern = sp.csc_array(np.ones((size, size)))
    suitable = rng.normal(size=size * size)
    plan, factors = analyze(pattern, suitable)
    matrix = rng.normal(size=(size, size))
    # The first pivots are small, but not their rows.
    matrix[np.ix_(plan.rows[:4], plan.columns[:4])] *= pivot
    nonzeros, right = matrix.T.ravel(), rng.normal(size=size)
    assert not refactorize(plan, factors, nonzeros)
    assert not refactorize(plan, factors, np.nan * nonzeros)
    assert not refactorize(plan, factors, np.full_like(nonzeros, np.inf))
    assert refactorize(plan, factors, suitable)
    x = solve_with(plan, factors, right)
    assert_allclose(suitable.reshape(size, size).T @ x, right, rtol=1e-10)
    x = solve_with(*analyze(pattern, nonzeros), right)
    assert_allclose(x, np.linalg.solve(matrix, right), rtol=1e-12)


def test_refinement_recovers_digits_lost_by_small_pivots():
    pattern = sp.csc_array(np.ones((2, 2)))
    plan, factors = analyze(pattern, np.array([1.0, 2.0, 3.0, 1.0]))
    matrix = np.array([[2.0, 1.0], [1.0, 3.0]])
    matrix[plan.rows[0], plan.columns[0]] = 1e-9
    assert refactorize(plan, factors, matrix.T.ravel())
    assert factors.refinements[0] == 1
    right = np.array([1.0, 2.0])
    x = solve_with(plan, factors, right)
    assert_allclose(x, np.linalg.solve(matrix, right), rtol=1e-14)


MECHANISMS = {
    "hub beam": lambda: hub_beam(elements=4, damping=0.0),
    "welded, chord": lambda: chain_of_beams(3, bd.Weld, elements=2, frame="chord"),
}


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("name", MECHANISMS)
def test_iteration_matrices_keep_their_pivots_over_steps(name):
    equations = bd.equations_of_motion(MECHANISMS[name]())
    first, *others = (integrator_matrices(equations, step) for step in (1e-3, 3e-3, 3e-4))
    for kind, (pattern, nonzeros) in first.items():
        plan, factors = analyze(pattern, nonzeros)
        entries = len(plan.upper_rows) + len(plan.lower_rows) + len(plan.rows)
        # Measured: 1.2 to 2.0.
        assert entries < 2.2 * pattern.nnz
        contributions = np.random.default_rng(1).normal(size=pattern.shape[0])
        for other in (first, *others):
            assert refactorize(plan, factors, other[kind][1])
            # Forces of inertia and reactions of equal size, whatever the unit of multipliers is.
            matrix = sp.csc_array((other[kind][1], pattern.indices, pattern.indptr))
            sizes = np.abs(sp.diags_array(plan.scale) @ matrix).max(axis=0).toarray().ravel()
            right = matrix @ (contributions / sizes)
            x = solve_with(plan, factors, right)
            assert backward_error(*other[kind], x, right) < 1e-8


def test_pivots_may_be_fill():
    pattern = sp.csc_array(np.array([[1.0, 1.0], [1.0, 0.0]]))
    assert compute_fill(pattern.indptr.tolist(), pattern.indices.tolist()) == ([[], [0]], [[1], []])


def test_missing_plan_is_requested_and_singular_matrix_is_reported():
    system = LinearSystem(LinearSolver.empty(float), np.ones(1), np.ones(1))
    assert system.factorize() == NEW_PIVOTS
    system.linear.singular = 1
    assert system.factorize() == SINGULAR


@pytest.mark.parametrize("rest", [0.0, 1e-145, 1e-29, 1e-16])
def test_equations_whose_diagonal_is_a_rounding_error_have_pivots(rest):
    # Bodies without stiffness, held by two multipliers each, in a chain.
    size, rng = 6, np.random.default_rng(0)
    dense = np.diag(np.append(rest * rng.normal(size=size), np.zeros(size)))
    dense[size:, :size] = rng.normal(size=(size, size))
    dense[:size, size:] = dense[size:, :size].T
    matrix = sp.csc_array(dense)
    plan, factors = analyze(matrix, matrix.data)
    right = rng.normal(size=2 * size)
    assert_allclose(solve_with(plan, factors, right), np.linalg.solve(dense, right), rtol=1e-9)
