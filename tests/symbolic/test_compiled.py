"""Compiled CasADi functions: arguments, buffers and evaluation by rows."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from beamdae.symbolic.functions.compiled import Compiled, RowFunction

X, Y, P = ca.MX.sym("x", 2), ca.MX.sym("y"), ca.MX.sym("p", 2)
FUNCTION = ca.Function("f", [X, Y, P], [X * Y + P, ca.dot(X, P)])


def test_call_accepts_and_returns_numpy_arrays():
    compiled = Compiled(FUNCTION)
    first, second = compiled(np.array([1.0, 2.0]), 3.0, np.array([10.0, 20.0]))
    assert_allclose(first, [13.0, 26.0], rtol=1e-15)
    assert_allclose(second, [50.0], rtol=1e-15)


def test_last_inputs_keep_their_values():
    compiled = Compiled(FUNCTION, np.array([10.0, 20.0]))
    assert_allclose(compiled(np.array([1.0, 2.0]), 3.0)[0], [13.0, 26.0], rtol=1e-15)
    compiled.inputs[-1][:] = 0.0
    assert_allclose(compiled(np.array([1.0, 2.0]), 3.0)[0], [3.0, 6.0], rtol=1e-15)
    assert compiled.calls == 2


def test_calls_return_the_same_buffers():
    compiled = Compiled(FUNCTION, np.zeros(2))
    first = compiled(np.ones(2), 1.0)[0]
    second = compiled(np.ones(2), 2.0)[0]
    assert first is second
    assert_allclose(first, [2.0, 2.0], rtol=0.0, atol=0.0)


def test_objects_of_one_function_have_separate_buffers():
    one, other = Compiled(FUNCTION, np.zeros(2)), Compiled(FUNCTION, np.ones(2))
    first = one(np.ones(2), 1.0)[0]
    other(np.ones(2), 5.0)
    assert_allclose(first, [1.0, 1.0], rtol=0.0, atol=0.0)
    assert_allclose(one(np.ones(2), 1.0)[0], [1.0, 1.0], rtol=0.0, atol=0.0)


def test_arguments_are_copied():
    compiled = Compiled(FUNCTION, np.zeros(2))
    x = np.array([1.0, 2.0])
    compiled(x, 1.0)
    x[:] = 7.0
    assert_allclose(compiled.inputs[0], [1.0, 2.0], rtol=0.0, atol=0.0)


def test_argument_of_wrong_size_is_rejected():
    with pytest.raises(ValueError, match="broadcast"):
        Compiled(FUNCTION)(np.ones(3), 1.0, np.ones(2))


def test_rows_are_evaluated_with_shared_arguments():
    rows = np.arange(6.0).reshape(3, 2)
    factors = np.array([[1.0], [2.0], [3.0]])
    p = np.array([10.0, 20.0])
    assert_allclose(RowFunction(FUNCTION)(rows, factors, p), rows * factors + p, rtol=1e-15)
    first = ca.Function("g", [X, Y, P], [X * Y + P])
    assert_allclose(RowFunction(first)(rows, factors, p), rows * factors + p, rtol=1e-15)


def test_single_row_has_two_dimensions():
    rows = np.array([[1.0, 2.0]])
    assert RowFunction(FUNCTION)(rows, np.ones((1, 1)), np.zeros(2)).shape == (1, 2)


def test_one_output_has_the_values_of_its_entry():
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    whole = RowFunction(ca.Function("f", [x, y], [ca.vertcat(x[0] * y, ca.sin(x[1]), x[0] + y)]))
    arguments = np.random.default_rng(0).uniform(size=(5, 2)), np.linspace(0.0, 1.0, 5)[:, None]
    for k in range(3):
        part = whole.output(k)
        assert part is whole.output(k)
        np.testing.assert_array_equal(part(*arguments), whole(*arguments)[:, [k]])
