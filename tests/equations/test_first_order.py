"""First-order forms: their Jacobian as one matrix and as two."""

import numpy as np
import pytest
from chains import chain_of_beams
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.equations.formulations.first_order import (
    FIRST_ORDER,
    evaluate_jacobian,
    evaluate_jacobian_parts,
    formulate_first_order,
)


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_the_parts_of_the_jacobian_add_up_to_it(name):
    equations = bd.equations_of_motion(chain_of_beams(2, elements=2))
    whole, apart = (
        formulate_first_order(equations, name),
        formulate_first_order(equations, name, apart=True),
    )
    assert (whole.pattern != apart.pattern).nnz == 0
    y, yp = np.random.default_rng(0).normal(size=(2, whole.size))
    of_y, of_yp = parts = np.zeros((2, whole.pattern.nnz))
    evaluate_jacobian_parts(apart.buffers(), 0.3, 0.5, y, yp, parts.ravel())
    expected = np.zeros(whole.pattern.nnz)
    for c in (0.0, 40.0):
        evaluate_jacobian(whole.buffers(), 0.3, 0.5, c, y, yp, expected)
        assert_allclose(of_y + c * of_yp, expected, rtol=1e-12, atol=1e-12 * abs(expected).max())
    assert np.any(of_yp != 0.0)
