"""Newton's equations without velocities that q' = v defines, compared with all equations."""

import numpy as np
import pytest
import scipy.sparse as sp
from chains import chain_of_beams
from hub_beam import hub_beam
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.equations.formulations.first_order import (
    evaluate_jacobian_parts,
    formulate_first_order,
)
from beamdae.equations.formulations.kinematic_reduction import (
    expand_solution,
    reduce_kinematics,
    reduce_right,
)

MECHANISMS = {
    "hub beam": lambda: hub_beam(elements=3),
    "exact hub beam": lambda: hub_beam(elements=3, formulation="exact"),
    "two welded beams": lambda: chain_of_beams(2, bd.Weld, elements=2),
}


@pytest.mark.parametrize("rate", [1e3, 1e3 + 2e3j])
@pytest.mark.parametrize("name", MECHANISMS)
def test_reduced_equations_have_the_solution_of_all_equations(name, rate):
    form = formulate_first_order(
        bd.equations_of_motion(MECHANISMS[name]()), "stabilized-index1", apart=True
    )
    n, size, rng = form.equations.n, form.size, np.random.default_rng(0)
    y, yp = 1e-3 * rng.normal(size=size), 1e-3 * rng.normal(size=size)
    buffers = form.buffers()
    full = np.zeros(2 * form.pattern.nnz)
    evaluate_jacobian_parts(buffers, 0.1, 0.5, y, yp, full)
    state, of_rate = np.split(full, 2)
    pattern = form.pattern
    matrix = sp.csc_array((state + rate * of_rate, pattern.indices, pattern.indptr))

    pattern, plan, reduction = reduce_kinematics(form)
    assert len(reduction.defined) > n / 2
    buffers.jacobian = plan.sum(False, form.equations.p)
    parts = np.zeros(3 * pattern.nnz + 1)
    evaluate_jacobian_parts(buffers, 0.1, 0.5, y, yp, parts)
    a_0, a_1, a_2 = np.split(parts[:-1], 3)
    reduced = sp.csc_array(
        (a_0 + rate * a_1 + rate**2 * a_2, pattern.indices, pattern.indptr), pattern.shape
    )
    assert reduced.shape[0] == size - len(reduction.defined)

    solution = rng.normal(size=size) * (1.0 + 0.0 * rate)
    solution[reduction.defined_velocities] = rate * solution[reduction.defined]
    right = matrix @ solution
    x, expanded = np.zeros(pattern.shape[0], right.dtype), np.zeros(size, right.dtype)
    reduce_right(reduction, n, right, x)
    x = np.linalg.solve(reduced.toarray(), x)
    expand_solution(reduction, n, rate, x, expanded)
    # The residual, because the unknowns differ in size by many orders of magnitude.
    terms = abs(matrix) @ np.abs(solution)
    assert np.max(np.abs(matrix @ expanded - right) / terms) < 1e-9
    assert_allclose(
        expanded[reduction.defined_velocities], rate * expanded[reduction.defined], rtol=1e-15
    )
