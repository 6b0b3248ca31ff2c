"""Compiled CasADi functions: arguments, buffers and evaluation by rows."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from beamdae.symbolic.compiled import Compiled, RowFunction

X, Y, P = ca.MX.sym("x", 2), ca.MX.sym("y"), ca.MX.sym("p", 2)
FUNCTION = ca.Function("f", [X, Y, P], [X * Y + P, ca.dot(X, P)])


def test_calls_copy_their_arguments_into_buffers_of_the_object():
    """Last inputs that are not passed keep their values."""
    one, other = Compiled(FUNCTION, np.array([10.0, 20.0])), Compiled(FUNCTION, np.zeros(2))
    x = np.array([1.0, 2.0])
    first, second = one(x, 3.0)
    other(x, 5.0)
    x[:] = 7.0
    assert_allclose(first, [13.0, 26.0], rtol=1e-15)
    assert_allclose(second, [50.0], rtol=1e-15)
    one.inputs[-1][:] = 0.0
    assert one(one.inputs[0], 3.0)[0] is first
    assert_allclose(first, [3.0, 6.0], rtol=1e-15)
    assert one.calls == 2
    with pytest.raises(ValueError, match="broadcast"):
        one(np.ones(3), 1.0)


def test_rows_are_evaluated_with_shared_arguments():
    rows, p = np.arange(6.0).reshape(3, 2), np.array([10.0, 20.0])
    factors = np.array([[1.0], [2.0], [3.0]])
    for count in (1, 3):
        values = RowFunction(FUNCTION)(rows[:count], factors[:count], p)
        assert_allclose(values, rows[:count] * factors[:count] + p, rtol=1e-15)


def test_one_output_has_the_values_of_its_entry():
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    whole = RowFunction(ca.Function("f", [x, y], [ca.vertcat(x[0] * y, ca.sin(x[1]), x[0] + y)]))
    arguments = np.random.default_rng(0).uniform(size=(5, 2)), np.linspace(0.0, 1.0, 5)[:, None]
    for k in range(3):
        part = whole.output(k)
        assert part is whole.output(k)
        np.testing.assert_array_equal(part(*arguments), whole(*arguments)[:, [k]])
