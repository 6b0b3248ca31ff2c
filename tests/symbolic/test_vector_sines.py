"""Sines and cosines as polynomials."""

import casadi as ca
import numpy as np
import pytest
from hub_beam import hub_beam
from numpy.testing import assert_allclose, assert_array_equal

import beamdae as bd
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.sums.kernel_code import expand_sines, sine_and_cosine
from beamdae.symbolic.sums.kernel_sums import evaluate_sum, set_time

SX = ca.SX


def evaluate(x):
    angle = SX.sym("angle")
    function = ca.Function("pair", [angle], list(sine_and_cosine(angle)))
    return [result.full().ravel() for result in function(np.reshape(x, (1, -1)))]


@pytest.mark.parametrize(
    ("largest", "bound"), [(1e-8, 1.1), (0.7, 1.6), (3.0, 2.1), (1e3, 2.1), (1e6, 3.1)]
)
def test_errors_in_units_of_the_last_place(largest, bound):
    # The bounds contain the error of the C library, at most 0.6.
    random = np.random.default_rng(0)
    quarters = 0.5 * np.pi * np.round(random.uniform(-largest, largest, 200) / (0.5 * np.pi))
    x = np.concatenate([random.uniform(-largest, largest, 2000), quarters])
    for value, expected in zip(evaluate(x), (np.sin(x), np.cos(x)), strict=True):
        assert np.all(np.abs(value - expected) <= bound * np.spacing(np.abs(expected)))


def test_large_angles_have_the_error_of_their_rounding():
    x = np.random.default_rng(0).uniform(1e6, 1e12, 1000)
    for value, expected in zip(evaluate(x), (np.sin(x), np.cos(x)), strict=True):
        assert_allclose(value, expected, rtol=0.0, atol=2.0**-52 * 1e12)
        assert np.all(np.abs(value - expected) <= 2.0 * np.spacing(x))


def test_regression_huge_angles_have_no_sine():
    """Sines of angles of 1e17 rad were up to 6e6, of larger ones up to infinity."""
    for largest in (1e13, 9.99e14):
        x = np.random.default_rng(0).uniform(-largest, largest, 1000)
        for value, expected in zip(evaluate(x), (np.sin(x), np.cos(x)), strict=True):
            assert np.all(np.abs(value - expected) <= 2.0 * np.spacing(np.abs(x)))
            assert np.max(np.abs(value)) <= 1.0 + 1e-12
    x = np.array([1.001e15, -1e16, 1e17, -1e20, 1e100, -1e200, 1e308])
    assert np.isnan(evaluate(x)).all()


def test_special_values():
    sine, cosine = evaluate([0.0, np.inf, -np.inf, np.nan])
    assert_array_equal(sine, [0.0, np.nan, np.nan, np.nan])
    assert_array_equal(cosine, [1.0, np.nan, np.nan, np.nan])


def test_functions_share_the_polynomials_of_one_angle():
    shared, local = SX.sym("shared", 2), SX.sym("local", 2)
    angle = local[0] + shared[1]
    values = ca.vertcat(ca.sin(angle) * local[1], ca.cos(angle), ca.cos(shared[0]))
    function = ca.Function("turn", [shared, local], [values])
    expanded = expand_sines(function)
    codes = [expanded.instruction_id(k) for k in range(expanded.n_instructions())]
    assert not {ca.OP_SIN, ca.OP_COS}.intersection(codes)
    # The number of quarter turns, the quadrant and the half turns, for two angles.
    assert codes.count(ca.OP_FLOOR) == 6
    assert_allclose(expanded([0.5, 2.0], [0.7, 3.0]), function([0.5, 2.0], [0.7, 3.0]), rtol=1e-15)


@pytest.mark.slow(reason="compiles kernels")
@pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
@pytest.mark.parametrize("elements", [3, 20])
def test_machine_code_and_virtual_machine_return_the_same_bits(formulation, elements):
    equations = bd.equations_of_motion(hub_beam(elements=elements, formulation=formulation))
    form = formulate_step(equations, False)
    n, m = equations.n, equations.m
    x = np.random.default_rng(0).normal(size=4 * n + 2 * m)
    for plan, size in zip(form.sums[::2], (form.size, form.pattern.nnz), strict=True):
        results = np.zeros((2, size))
        for result, native in zip(results, (False, True), strict=True):
            total = plan.sum(native, equations.p)
            set_time(total, 0.1, 0.1)
            evaluate_sum(total, x, result)
        assert np.ptp(results[0]) > 0.0
        assert_array_equal(*results)
