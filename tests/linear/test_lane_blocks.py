"""Blocks that are eliminated in vector lanes."""

import numpy as np
import pytest
import scipy.sparse as sp
from chains import chain_of_beams, integrator_matrices, pattern_of_elements
from linear_system import refactorize, solve
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.linear.elimination import allocate_factors
from beamdae.linear.lane_blocks import find_blocks
from beamdae.linear.pivots import propose_plans

BORDER = 3


def random_matrix(dense, kind, seed=0):
    """Return pattern, non-zeros and matrix with dominant diagonal entries."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=dense.shape) + 20.0 * np.eye(len(dense))
    if kind is complex:
        values = values + 1j * rng.normal(size=dense.shape)
    matrix = np.where(dense, values, 0.0)
    return sp.csc_array(dense.astype(float)), matrix.T[dense.T], matrix


def test_blocks_are_the_interiors_of_elements_and_then_every_second_node():
    blocks = find_blocks(sp.csc_array(pattern_of_elements(32, BORDER).astype(float)))
    # Interior unknowns, neighbors and shared neighbors.
    sizes = [tuple(row[:3]) for row in blocks.batches]
    # Interiors, 17 of 33 nodes (the ends have one neighbor less), then 8 of 16 and 4 of 8.
    assert sizes[:4] == [(6, 9, 3)] * 4
    assert set(sizes[4:]) == {(3, 9, 3)}
    assert len(blocks.unknowns) < 10 * 3


@pytest.mark.parametrize("kind", [float, complex])
@pytest.mark.parametrize("elements", [4, 5, 13, 40])
def test_solutions_agree_with_lapack(kind, elements):
    pattern, nonzeros, matrix = random_matrix(pattern_of_elements(elements, BORDER), kind)
    plan = next(propose_plans(pattern, nonzeros))
    assert len(plan.batches) > 0
    factors = allocate_factors(plan, kind)
    for seed in range(3):
        pattern, nonzeros, matrix = random_matrix(pattern_of_elements(elements, BORDER), kind, seed)
        assert refactorize(plan, factors, nonzeros)
        right = np.random.default_rng(seed).normal(size=len(matrix)).astype(kind)
        x = right.copy()
        solve(plan, factors, x)
        assert_allclose(x, np.linalg.solve(matrix, right), rtol=1e-11, atol=1e-14)


def test_blocks_that_others_join_are_not_larger_than_the_work_arrays_of_the_core():
    """Blocks of 20 unknowns were written beyond work arrays of 16."""
    alike, joining, count = 14, 6, 8
    size = alike + joining
    star = np.eye(size, dtype=bool)
    star[:alike] = star[:, :alike] = True
    dense = np.zeros((count * size + BORDER,) * 2, bool)
    for k in range(count):
        dense[k * size : (k + 1) * size, k * size : (k + 1) * size] = star
        dense[k * size : k * size + alike, -BORDER:] = True
        dense[-BORDER:, k * size : k * size + alike] = True
    dense[-BORDER:, -BORDER:] = True
    pattern, nonzeros, matrix = random_matrix(dense, float)
    plan = next(propose_plans(pattern, nonzeros))
    assert alike < max(row[0] for row in plan.batches) <= 16
    factors = allocate_factors(plan, float)
    assert refactorize(plan, factors, nonzeros)
    x = np.ones(len(matrix))
    solve(plan, factors, x)
    assert_allclose(matrix @ x, 1.0, rtol=1e-12)


@pytest.mark.parametrize("pivot", [0.0, 1e-17])
def test_unsuitable_pivots_of_blocks_are_rejected(pivot):
    dense = pattern_of_elements(8, BORDER)
    pattern, nonzeros, matrix = random_matrix(dense, float)
    plan = next(propose_plans(pattern, nonzeros))
    factors = allocate_factors(plan, float)
    assert len(plan.batches) > 0
    assert refactorize(plan, factors, nonzeros)
    # The inner nodes of elements have large entries beside the diagonal only.
    for first in range(3, 72, 9):
        inner = slice(first, first + 6)
        matrix[inner, inner] = matrix[inner, inner][::-1]
        matrix[first, first] = pivot
    nonzeros = matrix.T[dense.T]
    assert not refactorize(plan, factors, nonzeros)
    for other in propose_plans(pattern, nonzeros):
        factors = allocate_factors(other, float)
        if refactorize(other, factors, nonzeros):
            break
    x = np.ones(len(matrix))
    solve(other, factors, x)
    assert_allclose(matrix @ x, 1.0, rtol=1e-9)


@pytest.mark.parametrize("joint", [bd.Revolute, bd.Weld])
def test_blocks_leave_few_unknowns_of_mechanisms(joint):
    equations = bd.equations_of_motion(chain_of_beams(4, joint, elements=8))
    pattern, nonzeros = integrator_matrices(equations, 1e-3)["index 3"]
    plan = next(propose_plans(pattern, nonzeros))
    factors = allocate_factors(plan, float)
    assert len(plan.rows) < pattern.shape[0] / 3
    assert refactorize(plan, factors, nonzeros)
    assert factors.refinements[0] == 0


def test_small_matrices_have_no_blocks():
    assert find_blocks(sp.csc_array(pattern_of_elements(3, BORDER).astype(float))) is None
