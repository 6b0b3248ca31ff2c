"""Functions of many rows: the bits of CasADi's virtual machine, in machine code if it pays off."""

import pickle

import casadi as ca
import numpy as np
import pytest

from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic import compiled as row_kernels
from beamdae.symbolic.compiled import Compiled, RowFunction

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
