"""What factors of beams and chains hold, and how well they solve."""

import numpy as np
import pytest
import scipy.sparse as sp
from chains import backward_error, chain, matrices
from hub_beam import hub_beam
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.linear.factorizations import SparseFactorization
from beamdae.linear.orderings import compute_bordered_ordering

STEPS = (1e-2, 1e-4, 1e-6)
MECHANISMS = {
    "tangent": lambda: chain(1, elements=48),
    "chord": lambda: chain(1, elements=48, frame="chord"),
    "long links": lambda: chain(3, bd.Weld, elements=16, frame="chord"),
    "hinged": lambda: chain(8),
    "welded": lambda: chain(16, bd.Weld),
    "welded, chord": lambda: chain(8, bd.Weld, frame="chord"),
}


def factors(pattern, nonzeros):
    solver = SparseFactorization(pattern, nonzeros.dtype)
    solver.factorize(nonzeros)
    return solver


def balanced(pattern, nonzeros):
    """A right-hand side whose solution has the sizes of the unknowns: columns contribute alike."""
    matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
    sizes = np.abs(matrix.toarray())
    columns = np.max(sizes / np.max(sizes, axis=1, keepdims=True), axis=0)
    return matrix @ (np.random.default_rng(1).normal(size=len(columns)) / columns)


@pytest.mark.parametrize(
    "name",
    # As the last one, with twice the beams and in the other frame.
    [pytest.param(m, marks=[pytest.mark.slow] if m == "welded" else []) for m in MECHANISMS],
)
def test_factors_hold_little_more_than_the_matrix_and_solve_it(name):
    equations = bd.equations_of_motion(MECHANISMS[name]())
    for step in STEPS:
        for form, (pattern, nonzeros) in matrices(equations, step).items():
            solver = factors(pattern, nonzeros)
            # From 1.1 to 1.8, to 2.02 on index 2, whose matrix has products not yet multiplied out.
            # SuperLU on its own fills a hundredfold, and more the longer a beam.
            assert solver.fill < (2.2 if form == "index 2" else 2.0)
            right = balanced(pattern, nonzeros)
            # At most 5e-10. SuperLU on its own, with the largest pivots, leaves up to 3e-7, and on
            # welded chains no digit at all where it keeps to the diagonal.
            assert backward_error(pattern, nonzeros, solver.solve(right), right) < 1e-8


@pytest.mark.parametrize(("joint", "frame"), [(bd.Revolute, "tangent"), (bd.Weld, "chord")])
def test_the_fill_of_a_chain_does_not_grow_with_its_length(joint, frame):
    fills = []
    for beams in (6, 18):
        equations = bd.equations_of_motion(chain(beams, joint, elements=2, frame=frame))
        fills.append([factors(*m).fill for m in matrices(equations, 1e-3).values()])
    # Up to what its two ends are of the shorter one; SuperLU left to itself doubles them.
    assert_allclose(fills[1], fills[0], rtol=0.15)


@pytest.mark.parametrize("name", ["Ida", "Radau", "Radau, complex"])
def test_the_fill_of_an_undamped_beam_does_not_grow_with_its_elements(name):
    fills = []
    for elements in (24, 96):
        equations = bd.equations_of_motion(hub_beam(elements=elements, damping=0.0))
        fills.append(factors(*matrices(equations, 1e-4)[name]).fill)
    # Velocities are coupled by mass alone: ordered by that, their band tore and fills were 3 and 9.
    assert_allclose(fills[1], fills[0], rtol=0.15)


def test_frames_and_multipliers_come_last():
    equations = bd.equations_of_motion(chain(2, elements=8))
    form = formulate_step(equations, False)
    order, border = compute_bordered_ordering(form.pattern)
    assert sorted(order) == list(range(form.size))
    names = [*equations.q_names, *equations.lam_names]
    last = {names[k] for k in order[form.size - border :]}
    frames = {f"link {k}.{x}" for k in (0, 1) for x in ("x0", "y0", "theta")}
    assert last == {*frames, *equations.lam_names}


def test_what_pivots_in_the_band_cannot_solve_is_solved_all_the_same():
    rng = np.random.default_rng(0)
    half = 30
    few, more = (rng.random((half, half)) * (rng.random((half, half)) < 0.1) for _ in range(2))
    links, others = np.eye(half) + few, more - np.diag(np.diag(more))
    # Pivots of the band that are all rounding, and a border that is none.
    matrix = sp.csc_array(np.block([[1e-17 * np.eye(half), links], [links.T, others]]))
    assert compute_bordered_ordering(matrix).border == half
    right = rng.normal(size=2 * half)
    x = factors(matrix, matrix.data).solve(right)
    assert backward_error(matrix, matrix.data, x, right) < 1e-10


def test_matrices_without_an_equation_or_an_unknown_are_singular():
    for empty in ([[1.0, 1.0], [0.0, 0.0]], [[1.0, 0.0], [1.0, 0.0]]):
        matrix = sp.csc_array(np.array(empty))
        with pytest.raises(ArithmeticError, match="singular"):
            factors(matrix, matrix.data)
