"""Models that differ only in numbers are independent of each other, also in threads."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hub_beam import hub_beam
from slider_crank import slider_crank

import beamdae as bd

# Fixed steps, adaptive steps, and both integrators of first-order forms.
METHODS = [
    bd.GeneralizedAlpha(step=2e-3),
    bd.GeneralizedAlpha(rtol=1e-3),
    bd.Ida(rtol=1e-3),
    bd.Radau(rtol=1e-3),
]


def rows(method, case):
    """Return all results of a run; cases are two structures with two sets of numbers each."""
    model, scale = divmod(case, 2)
    if model:
        mechanism, t_end = slider_crank(elements=2, speed=2.0 + scale), 0.05
    else:
        mechanism, t_end = hub_beam(elements=2, torque=5.0 * (1.0 + scale)), 0.2
    solution = bd.simulate(mechanism, method, t_end)
    assert solution.status.success, solution.status.sentence
    columns = np.column_stack(list(solution.all_columns().values()))
    return np.hstack([columns, solution.q, solution.v, solution.lam])


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS, ids=lambda method: repr(method)[:24])
def test_no_number_of_one_model_leaks_into_another(method):
    first = rows(method, 0)
    other = rows(method, 1)
    assert not np.array_equal(other, first)
    assert np.array_equal(rows(method, 0), first)
    assert np.array_equal(rows(method, 1), other)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS, ids=lambda method: repr(method)[:24])
def test_threads_that_share_a_structure_are_independent(method):
    cases = [0, 1, 2, 3] * 2
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda case: rows(method, case), cases))
    expected = [rows(method, case) for case in range(4)]
    # Without machine code, rounding in LAPACK and NumPy depends on the alignment of arrays, which
    # differs between threads: about 1e-7, against differences of order 1 between cases.
    tolerance = 1e-4 if os.environ.get("BEAMDAE_NATIVE") == "off" else 0.0
    for case, actual in zip(cases, results, strict=True):
        size = np.max(np.abs(expected[case]))
        assert np.all(np.abs(actual - expected[case]) <= tolerance * size)
