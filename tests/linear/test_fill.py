"""Which entries factors have."""

import numpy as np
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from beamdae.linear.pivots import compute_fill


def eliminated(pattern):
    """What Gaussian elimination fills, on booleans."""
    full = pattern.copy()
    for k in range(len(full)):
        full[k + 1 :, k + 1 :] |= np.outer(full[k + 1 :, k], full[k, k + 1 :])
    return full


@given(size=st.integers(1, 14), share=st.floats(0.0, 0.6), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=200, deadline=None)
def test_the_fill_is_that_of_gaussian_elimination(size, share, seed):
    dense = np.random.default_rng(seed).random((size, size)) < share
    np.fill_diagonal(dense, True)
    pattern = sp.csc_array(dense.astype(float))
    above, below = compute_fill(pattern.indptr.tolist(), pattern.indices.tolist())
    full = eliminated(dense)
    for j in range(size):
        assert above[j] == np.flatnonzero(full[:j, j]).tolist()
        assert below[j] == (j + 1 + np.flatnonzero(full[j + 1 :, j])).tolist()


def test_the_pivots_themselves_may_be_fill():
    pattern = sp.csc_array(np.array([[1.0, 1.0], [1.0, 0.0]]))
    assert compute_fill(pattern.indptr.tolist(), pattern.indices.tolist()) == ([[], [0]], [[1], []])
