"""Row functions in machine code: same bits as the virtual machine, and only if evaluated often."""

import pickle

import casadi as ca
import numpy as np
import pytest

from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.functions import row_kernels
from beamdae.symbolic.functions.compiled import Compiled, RowFunction

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


@pytest.fixture
def compiled_at_once(monkeypatch):
    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_COMPILING", 0.0)


@pytest.fixture
def builds(monkeypatch):
    """Calls of the compiler: True if it may compile, False to look into the cache only."""
    calls = []

    def build(function, compiles):
        calls.append(compiles)

    monkeypatch.setattr(row_kernels, "build_lane_kernel", build)
    return calls


def evaluate_by_row(function, x, y):
    compiled = Compiled(function)
    return np.array([compiled(*row)[0].copy() for row in zip(x, y, strict=True)])


@pytest.mark.parametrize("rows", [32, 129, 1024, 2500])
def test_rows_have_the_bits_of_the_virtual_machine(compiled_at_once, rows):
    rng = np.random.default_rng(rows)
    x, y = rng.standard_normal((rows, 3)), rng.standard_normal((rows, 2))
    x[3, 1], y[5, 0] = np.inf, np.nan
    evaluate = RowFunction(FUNCTION)
    np.testing.assert_array_equal(evaluate(x, y), evaluate_by_row(FUNCTION, x, y))
    shared = evaluate(x, y[0])
    np.testing.assert_array_equal(shared, evaluate_by_row(FUNCTION, x, np.tile(y[0], (rows, 1))))
    kernels = [code._code for code in evaluate._kernels._codes.values()]
    assert len(kernels) == 2
    assert all((kernel is not None) is is_native_enabled() for kernel in kernels)


@pytest.mark.parametrize(("copies", "rows"), [(8, 1), (8, 17), (3, 300), (2, 1500)])
def test_copies_have_the_bits_of_the_virtual_machine(monkeypatch, copies, rows):
    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_COMPILING", 0.0)
    monkeypatch.setattr(row_kernels, "_MIN_ROWS", 1)
    rng = np.random.default_rng(copies)
    columns, data = rng.standard_normal((copies, 3, rows)), rng.standard_normal((2, copies))
    values = RowFunction(FUNCTION).on_copies(columns, data)
    assert values.shape == (6, copies, rows)
    for copy in range(copies):
        expected = evaluate_by_row(FUNCTION, columns[copy].T, np.tile(data[:, copy], (rows, 1)))
        np.testing.assert_array_equal(values[:, copy].T, expected)


def test_one_run_does_not_compile(builds):
    evaluate, (x, y) = RowFunction(FUNCTION), (np.ones((10_000, 3)), np.ones(2))
    for _ in range(3):
        evaluate(x, y)
    assert builds == []


def test_functions_are_loaded_after_some_rows_and_compiled_after_many(monkeypatch, builds):
    evaluate, (x, y) = RowFunction(FUNCTION), (np.ones((100, 3)), np.ones(2))
    operations = 100 * FUNCTION.n_instructions()
    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_LOADING", 2.5 * operations)
    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_COMPILING", 6.5 * operations)
    for number in range(1, 20):
        evaluate(x, y)
        assert builds == [False] * (number > 2) + [True] * (number > 6)


def test_regression_large_functions_are_compiled_after_more_rows(monkeypatch, builds):
    """The stress along 32 elements was compiled for 18 s in a run whose rows take half a second."""
    evaluate, (x, y) = RowFunction(FUNCTION), (np.ones((100, 3)), np.ones(2))
    instructions = FUNCTION.n_instructions()
    monkeypatch.setattr(row_kernels, "_MANY_INSTRUCTIONS", 0.5 * instructions)
    monkeypatch.setattr(row_kernels, "_TOO_MANY_INSTRUCTIONS", 0.25 * instructions)
    # A row counts as a tenth of its operations.
    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_LOADING", 25.0 * instructions)
    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_COMPILING", 65.0 * instructions)
    for number in range(1, 20):
        evaluate(x, y)
        assert builds == [False] * (number > 2) + [True] * (number > 6)


def test_few_rows_are_left_to_the_virtual_machine(compiled_at_once, builds):
    evaluate = RowFunction(FUNCTION)
    for _ in range(5):
        evaluate(np.ones((8, 3)), np.ones(2))
    assert builds == []


def test_functions_of_expression_graphs_are_not_compiled(compiled_at_once, builds):
    x = ca.MX.sym("x", 3)
    evaluate = RowFunction(ca.Function("g", [x], [ca.sum1(x)]))
    np.testing.assert_array_equal(evaluate(np.ones((100, 3))), np.full((100, 1), 3.0))
    assert builds == []


def test_compiled_functions_can_be_pickled(compiled_at_once):
    evaluate, x, y = RowFunction(FUNCTION), np.ones((100, 3)), np.ones(2)
    values = evaluate(x, y)
    copied = pickle.loads(pickle.dumps(evaluate))
    assert copied._kernels._codes == {}
    np.testing.assert_array_equal(copied(x, y), values)
