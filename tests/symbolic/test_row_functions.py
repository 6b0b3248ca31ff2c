"""Functions of many rows: the bits of CasADi's virtual machine, in machine code if it pays off."""

import pickle

import casadi as ca
import numpy as np
import pytest
from hub_beam import hub_beam
from numpy.testing import assert_allclose, assert_array_equal

import beamdae as bd
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic import compiled as row_kernels
from beamdae.symbolic.compiled import Compiled, RowFunction
from beamdae.symbolic.sums.kernel_code import expand_sines, sine_and_cosine
from beamdae.symbolic.sums.kernel_sums import evaluate_sum, set_time

X, Y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
EXPRESSIONS = ca.vertcat(
    ca.sqrt(ca.sumsqr(X)) + 2.0 * Y[0],
    ca.fmax(X[0] * Y[1], ca.fabs(X[1])) - ca.fmin(X[2], 0.3),
    ca.sin(X[0]) / (1.5 + ca.cos(Y[0])) + ca.atan2(X[1], X[2]),
    -X[1],
    Y[1],
    4.0,
)
FUNCTION = ca.Function("f", [X, Y], [ca.densify(EXPRESSIONS)])
SHARED = np.array([0.4, -2.0])


@pytest.fixture
def compiled_at_once(monkeypatch):
    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_LOADING", 0.0)
    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_COMPILING", 0.0)
    monkeypatch.setattr(row_kernels, "_MIN_ROWS", 1)


@pytest.fixture(params=["interpreted", "compiled"])
def evaluator(request):
    """A function whose rows are evaluated by the virtual machine or by machine code."""
    if request.param == "compiled":
        request.getfixturevalue("compiled_at_once")
    return RowFunction(FUNCTION)


@pytest.fixture
def builds(monkeypatch):
    """Calls of the compiler: True if it may compile, False to look into the cache only."""
    calls = []
    monkeypatch.setattr(
        row_kernels, "build_lane_kernel", lambda function, compiles: calls.append(compiles)
    )
    return calls


def evaluate_by_row(function, *arguments):
    compiled = Compiled(function)
    return np.array([compiled(*row)[0].copy() for row in zip(*arguments, strict=True)])


@pytest.mark.parametrize("rows", [32, 200, 1024, 1025, 2500])
def test_many_rows_have_the_bits_of_the_virtual_machine(evaluator, rows):
    rng = np.random.default_rng(rows)
    x, y = rng.standard_normal((rows, 3)), rng.standard_normal((rows, 2))
    x[3, 1], y[5, 0] = np.inf, np.nan
    for second in (y, SHARED):
        expected = evaluate_by_row(FUNCTION, x, np.broadcast_to(second, y.shape))
        np.testing.assert_array_equal(evaluator(x, second), expected)


@pytest.mark.parametrize(("copies", "rows"), [(8, 1), (8, 2001), (3, 300), (300, 513), (5, 7)])
def test_copies_have_the_bits_of_the_virtual_machine(evaluator, copies, rows):
    rng = np.random.default_rng(copies)
    columns, data = rng.standard_normal((copies, 3, rows)), rng.standard_normal((2, copies))
    values = evaluator.on_copies(columns, data)
    assert values.shape == (6, copies, rows)
    for copy in {0, copies // 2, copies - 1}:
        expected = evaluate_by_row(FUNCTION, columns[copy].T, np.tile(data[:, copy], (rows, 1)))
        np.testing.assert_array_equal(values[:, copy].T, expected)


def test_regression_extremes_of_zeros_have_the_sign_of_the_virtual_machine():
    """Signs of zeros depended on the number of rows."""
    function = ca.Function("f", [X], [ca.vertcat(ca.fmax(X[0], X[1]), ca.fmin(X[0], X[1]))])
    special = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan]
    pairs = np.array([(a, b, 0.0) for a in special for b in special] * 5)
    assert len(pairs) >= 200
    expected, values = evaluate_by_row(function, pairs), RowFunction(function)(pairs)
    np.testing.assert_array_equal(values, expected)
    is_number = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(values)[is_number], np.signbit(expected)[is_number])


def test_divisions_by_zero_are_silent():
    reciprocal = ca.Function("f", [X], [1.0 / X[0]])
    assert np.all(np.isinf(RowFunction(reciprocal)(np.zeros((300, 3)))))


def test_compiled_functions_have_machine_code_and_can_be_pickled(compiled_at_once):
    evaluate, x = RowFunction(FUNCTION), np.ones((100, 3))
    values = evaluate(x, SHARED)
    (kernel,) = evaluate._kernels._kernels.values()
    assert (kernel is not None) is is_native_enabled()
    copied = pickle.loads(pickle.dumps(evaluate))
    np.testing.assert_array_equal(copied(x, SHARED), values)


def test_one_run_does_not_compile(builds):
    evaluate = RowFunction(FUNCTION)
    for _ in range(3):
        evaluate(np.ones((10_000, 3)), SHARED)
    assert builds == []


# The stress along 32 elements was compiled for 18 s in a run whose rows take half a second: a row
# of a large function counts as a tenth of its operations.
@pytest.mark.parametrize("is_large", [False, True])
def test_functions_are_loaded_after_some_rows_and_compiled_after_many(
    monkeypatch, builds, is_large
):
    evaluate, instructions = RowFunction(FUNCTION), FUNCTION.n_instructions()
    if is_large:
        monkeypatch.setattr(row_kernels, "_MANY_INSTRUCTIONS", 0.5 * instructions)
        monkeypatch.setattr(row_kernels, "_TOO_MANY_INSTRUCTIONS", 0.25 * instructions)
    operations = instructions * (10.0 if is_large else 100.0)
    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_LOADING", 2.5 * operations)
    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_COMPILING", 6.5 * operations)
    for number in range(1, 20):
        evaluate(np.ones((100, 3)), SHARED)
        assert builds == [False] * (number > 2) + [True] * (number > 6)


def test_functions_of_expression_graphs_are_not_compiled(compiled_at_once, builds):
    x = ca.MX.sym("x", 3)
    evaluate = RowFunction(ca.Function("g", [x], [ca.sum1(x)]))
    np.testing.assert_array_equal(evaluate(np.ones((100, 3))), np.full((100, 1), 3.0))
    assert builds == []


# Sines and cosines as polynomials.

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
