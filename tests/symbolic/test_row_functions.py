"""Functions of many rows, compared with CasADi's virtual machine row by row."""

import casadi as ca
import numpy as np
import pytest

from beamdae.symbolic.functions.compiled import Compiled, RowFunction

X, Y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
EXPRESSIONS = ca.vertcat(
    ca.sqrt(ca.sumsqr(X)) + 2.0 * Y[0],
    ca.fmax(X[0] * Y[1], ca.fabs(X[1])) - ca.fmin(X[2], 0.3),
    ca.sin(X[0]) / (1.5 + ca.cos(Y[0])),
    -X[1],
    Y[1],
    4.0,
)
FUNCTION = ca.Function("f", [X, Y], [ca.densify(EXPRESSIONS)])


def evaluate_by_row(function, x, y):
    compiled = Compiled(function)
    return np.array([compiled(*row)[0].copy() for row in zip(x, y, strict=True)])


@pytest.mark.parametrize("rows", [200, 1024, 1025, 2500])
def test_many_rows_have_the_bits_of_the_virtual_machine(rows):
    rng = np.random.default_rng(rows)
    x, y = rng.standard_normal((rows, 3)), rng.standard_normal((rows, 2))
    values = RowFunction(FUNCTION)(x, y)
    np.testing.assert_array_equal(values, evaluate_by_row(FUNCTION, x, y))


def test_regression_extremes_of_zeros_have_the_sign_of_the_virtual_machine():
    """Signs of zeros depended on the number of rows."""
    function = ca.Function("f", [X], [ca.vertcat(ca.fmax(X[0], X[1]), ca.fmin(X[0], X[1]))])
    special = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan]
    pairs = np.array([(a, b, 0.0) for a in special for b in special] * 5)
    assert len(pairs) >= 200
    compiled = Compiled(function)
    expected = np.array([compiled(row)[0].copy() for row in pairs])
    values = RowFunction(function)(pairs)
    np.testing.assert_array_equal(values, expected)
    is_number = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(values)[is_number], np.signbit(expected)[is_number])


def test_rows_can_share_an_argument():
    x, y = np.random.default_rng(0).standard_normal((300, 3)), np.array([0.4, -2.0])
    values = RowFunction(FUNCTION)(x, y)
    expected = evaluate_by_row(FUNCTION, x, np.tile(y, (300, 1)))
    np.testing.assert_array_equal(values, expected)


@pytest.mark.parametrize(("copies", "rows"), [(8, 2001), (3, 300), (300, 513), (5, 7)])
def test_copies_have_the_bits_of_the_virtual_machine(copies, rows):
    rng = np.random.default_rng(copies)
    columns, data = rng.standard_normal((copies, 3, rows)), rng.standard_normal((2, copies))
    values = RowFunction(FUNCTION).on_copies(columns, data)
    assert values.shape == (6, copies, rows)
    for copy in {0, copies // 2, copies - 1}:
        expected = evaluate_by_row(FUNCTION, columns[copy].T, np.tile(data[:, copy], (rows, 1)))
        np.testing.assert_array_equal(values[:, copy].T, expected)


def test_divisions_by_zero_are_silent():
    reciprocal = ca.Function("f", [X, Y], [1.0 / X[0]])
    values = RowFunction(reciprocal)(np.zeros((300, 3)), np.zeros((300, 2)))
    assert np.all(np.isinf(values))
