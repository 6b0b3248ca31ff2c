"""Scalar expressions in formulas of users, which NumPy arrays multiply to arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.symbolic.local_symbols import SX

_OPERATORS = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "truediv": np.true_divide,
    "pow": np.power,
}
# NumPy calls these methods of the entries of an array.
_METHODS = (
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh", "tanh"),
    *("arcsinh", "arccosh", "arctanh", "exp", "expm1", "log", "log10", "log1p", "sqrt"),
    *("fabs", "fmin", "fmax", "hypot"),
)


class ScalarExpression(SX):
    """Scalar expression, which NumPy treats as a number.

    CasADi converts an array that is multiplied by an `SX` to a matrix, which has no products with
    other arrays. Operations of these expressions with arrays return arrays of them.
    """

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if any(isinstance(x, np.ndarray) and x.ndim for x in inputs):
            by_entry = np.frompyfunc(lambda *entries: ufunc(*entries), ufunc.nin, ufunc.nout)
            return by_entry(*map(_as_array, inputs))
        return as_scalar(getattr(ufunc, method)(*map(_as_plain, inputs), **options))

    def __array_function__(self, function: Any, types: Any, inputs: Any, options: Any) -> Any:
        return as_scalar(function(*map(_as_plain, inputs), **options))

    def __neg__(self) -> Any:
        return as_scalar(SX.__neg__(self))

    def __abs__(self) -> Any:
        return as_scalar(SX.fabs(self))


def as_scalar(value: Any) -> Any:
    """Return a scalar `SX` as a `ScalarExpression`; other values are returned unchanged."""
    return ScalarExpression(value) if type(value) is SX and value.is_scalar(True) else value


def _as_plain(value: Any) -> Any:
    # Methods of `SX` call its operators, which must not be those of `ScalarExpression`.
    return SX(value) if isinstance(value, ScalarExpression) else value


def _as_array(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value
    array = np.empty((), object)
    array[()] = value
    return array


def _define_operations() -> None:
    for name, ufunc in _OPERATORS.items():
        setattr(ScalarExpression, f"__{name}__", lambda x, y, f=ufunc: f(x, y))
        setattr(ScalarExpression, f"__r{name}__", lambda x, y, f=ufunc: f(y, x))
    for name in _METHODS:
        method = getattr(SX, name)
        setattr(ScalarExpression, name, lambda *x, f=method: as_scalar(f(*x)))


_define_operations()
