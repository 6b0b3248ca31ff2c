"""Fill and accuracy of the factors of beams and chains."""

import numpy as np
import pytest
import scipy.sparse as sp
from chains import backward_error, chain_of_beams, integrator_matrices
from hub_beam import hub_beam
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.linear.factorizations import SparseFactorization, compute_bordered_ordering

STEPS = (1e-2, 1e-4, 1e-6)
MECHANISMS = {
    "tangent": lambda: chain_of_beams(1, elements=48),
    "chord": lambda: chain_of_beams(1, elements=48, frame="chord"),
    "long links": lambda: chain_of_beams(3, bd.Weld, elements=16, frame="chord"),
    "hinged": lambda: chain_of_beams(8),
    "welded": lambda: chain_of_beams(16, bd.Weld),
    "welded, chord": lambda: chain_of_beams(8, bd.Weld, frame="chord"),
}


def factorize(pattern, nonzeros):
    solver = SparseFactorization(pattern, nonzeros.dtype)
    solver.factorize(nonzeros)
    return solver


def compute_balanced_right_side(pattern, nonzeros):
    """Return a right-hand side to which all columns of the matrix contribute equally."""
    matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
    sizes = np.abs(matrix.toarray())
    columns = np.max(sizes / np.max(sizes, axis=1, keepdims=True), axis=0)
    return matrix @ (np.random.default_rng(1).normal(size=len(columns)) / columns)


@pytest.mark.parametrize(
    "name",
    # "welded" is like the last case, with twice the beams and the other frame.
    [
        pytest.param(m, marks=[pytest.mark.slow(reason="several runs")] if m == "welded" else [])
        for m in MECHANISMS
    ],
)
def test_fill_is_small_and_solutions_are_accurate(name):
    equations = bd.equations_of_motion(MECHANISMS[name]())
    for step in STEPS:
        for pattern, nonzeros in integrator_matrices(equations, step).values():
            solver = factorize(pattern, nonzeros)
            # Measured: 1.1 to 2.02; pivots that depend on no unit take up to a tenth more than
            # others. The default order of SuperLU fills a hundredfold, and more for longer beams.
            assert solver.fill < 2.2
            right = compute_balanced_right_side(pattern, nonzeros)
            # Measured: at most 5e-10. By default SuperLU leaves up to 3e-7 with the largest pivots,
            # and no correct digit on welded chains with diagonal pivots.
            assert backward_error(pattern, nonzeros, solver.solve(right), right) < 1e-8


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("joint", "frame"), [(bd.Revolute, "tangent"), (bd.Weld, "chord")])
def test_relative_fill_of_a_chain_is_independent_of_its_length(joint, frame):
    fills = []
    for beams in (6, 18):
        equations = bd.equations_of_motion(chain_of_beams(beams, joint, elements=2, frame=frame))
        fills.append([factorize(*m).fill for m in integrator_matrices(equations, 1e-3).values()])
    # The ends of the shorter chain matter; the default order of SuperLU doubles the fill.
    assert_allclose(fills[1], fills[0], rtol=0.15)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("name", ["Ida", "Radau", "Radau, complex"])
def test_relative_fill_of_an_undamped_beam_is_independent_of_its_elements(name):
    fills = []
    for elements in (24, 96):
        equations = bd.equations_of_motion(hub_beam(elements=elements, damping=0.0))
        fills.append(factorize(*integrator_matrices(equations, 1e-4)[name]).fill)
    # Velocities are coupled by mass alone; an order by mass broke the band: fills of 3 and 9.
    assert_allclose(fills[1], fills[0], rtol=0.15)


def test_useless_pivots_in_the_band_are_replaced():
    rng = np.random.default_rng(0)
    half = 30
    few, more = (rng.random((half, half)) * (rng.random((half, half)) < 0.1) for _ in range(2))
    links, others = np.eye(half) + few, more - np.diag(np.diag(more))
    # The pivots of the band are rounding noise, and the border is not.
    matrix = sp.csc_array(np.block([[1e-17 * np.eye(half), links], [links.T, others]]))
    assert compute_bordered_ordering(matrix).in_border.sum() == half
    right = rng.normal(size=2 * half)
    x = factorize(matrix, matrix.data).solve(right)
    assert backward_error(matrix, matrix.data, x, right) < 1e-10
