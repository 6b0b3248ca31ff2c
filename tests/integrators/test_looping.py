"""Matrices of loops, and the pivots they are given."""

import numpy as np
import scipy.sparse as sp

from beamdae.integrators.looping import Matrix


def test_pivots_of_a_matrix_serve_another_of_its_pattern_and_its_own_follow():
    pattern = sp.csc_array(np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]))
    real = Matrix.of(pattern)
    pair = Matrix.of(pattern, complex, like=real)
    real.nonzeros[:] = [4.0, 1.0, 1.0, 5.0, 1.0, 1.0, 6.0]
    pair.nonzeros[:] = real.nonzeros * (1.0 + 2.0j)
    factors, pair_factors = (matrix.linear(True, "auto") for matrix in (real, pair))
    real.renew(factors)
    pair.renew(pair_factors)
    assert pair_factors.plan is factors.plan
    assert pair_factors.factors.matrix.dtype == complex
    # Where they have served, but do no longer, they are not given once more.
    pair_factors.fresh = 0
    pair.renew(pair_factors)
    assert pair_factors.plan is not factors.plan
    assert pair_factors.singular == 0


def test_a_matrix_alone_is_given_its_own_pivots():
    matrix = Matrix.of(sp.csc_array(np.eye(2)))
    matrix.nonzeros[:] = [2.0, np.nan]
    factors = matrix.linear(True, "auto")
    matrix.renew(factors)
    assert factors.singular == 1
    matrix.nonzeros[:] = 2.0
    factors.singular = 0
    matrix.renew(factors)
    assert factors.singular == 0
    assert factors.plan.rows.size == 2
