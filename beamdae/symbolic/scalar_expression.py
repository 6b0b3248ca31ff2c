"""Scalars in formulas of users: expressions and signals, with the operators of numbers."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError, short_repr
from beamdae.symbolic.local_symbols import SX

# NumPy calls these methods of the entries of an array.
_METHODS = (
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh", "tanh"),
    *("arcsinh", "arccosh", "arctanh", "exp", "expm1", "log", "log10", "log1p", "sqrt"),
    *("fabs", "fmin", "fmax", "hypot"),
)
SMOOTH_ALTERNATIVES = "np.maximum(x, 0.0) for one-sided terms and np.tanh(x / scale) for signs"
_MAX_TEXT_LENGTH = 60  # of an expression in a message


class FormulaError(BeamdaeError):
    """A formula needs the value of an expression, which is unknown before a run.

    Attributes
    ----------
    rule
        How to write the formula.
    """

    def __init__(self, rule: str) -> None:
        super().__init__(f"formula: it must be written {rule}.")
        self.rule = rule


def _forward(ufunc: np.ufunc) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return the methods of a binary operator, with the scalar as its first and second operand."""
    return lambda x, y: ufunc(x, y), lambda x, y: ufunc(y, x)


class Scalar:
    """Operators and NumPy functions of scalars, whose results are expressions.

    CasADi converts an array that is multiplied by an `SX` to a matrix, which has no products with
    other arrays. Operations of scalars with arrays return arrays of expressions.
    """

    def __SX__(self) -> SX:
        # CasADi converts an operand by this method.
        raise NotImplementedError

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if any(isinstance(x, np.ndarray) and x.ndim for x in inputs):
            by_entry = np.frompyfunc(lambda *entries: ufunc(*entries), ufunc.nin, ufunc.nout)
            return by_entry(*map(_as_array, inputs))
        function = ufunc if method == "__call__" else getattr(ufunc, method)
        return _call_numpy(function, inputs, options)

    def __array_function__(self, function: Any, types: Any, inputs: Any, options: Any) -> Any:
        return _call_numpy(function, inputs, options)

    __add__, __radd__ = _forward(np.add)
    __sub__, __rsub__ = _forward(np.subtract)
    __mul__, __rmul__ = _forward(np.multiply)
    __truediv__, __rtruediv__ = _forward(np.true_divide)
    __mod__, __rmod__ = _forward(np.remainder)
    __pow__, __rpow__ = _forward(np.power)
    __lt__, __gt__ = _forward(np.less)
    __le__, __ge__ = _forward(np.less_equal)

    def __neg__(self) -> Any:
        return as_scalar(-self.__SX__())

    def __pos__(self) -> Any:
        return as_scalar(self.__SX__())

    def __abs__(self) -> Any:
        return as_scalar(self.__SX__().fabs())

    def __bool__(self) -> bool:
        value = self.__SX__()
        if value.is_constant():
            return bool(value)
        raise FormulaError(
            f"without branches on {_describe(value)} (if, while, and, or, min, max); use "
            f"{SMOOTH_ALTERNATIVES}"
        )

    def __float__(self) -> float:
        value = self.__SX__()
        if value.is_constant():
            return float(value)
        raise FormulaError(
            f"without conversions of {_describe(value)} to a number (float, int, functions of "
            "math); use numpy functions such as np.sin"
        )

    def __int__(self) -> int:
        return math.trunc(float(self))

    def __round__(self, *digits: Any) -> Any:
        return round(float(self), *digits)


class ScalarExpression(Scalar, SX):
    """Scalar expression, which NumPy treats as a number."""

    __hash__ = SX.__hash__
    # Signals are compared as objects.
    __eq__ = _forward(np.equal)[0]
    __ne__ = _forward(np.not_equal)[0]

    def __SX__(self) -> SX:
        # Methods of `SX` call its operators, which must not be those of `Scalar`.
        return SX(self)


def as_scalar(value: Any) -> Any:
    """Return a scalar `SX` as a `ScalarExpression`; other values are returned unchanged."""
    return ScalarExpression(value) if type(value) is SX and value.is_scalar(True) else value


def _describe(value: SX) -> str:
    text = str(value)
    return text if len(text) <= _MAX_TEXT_LENGTH else f"{text[:_MAX_TEXT_LENGTH]}..."


def _call_numpy(function: Any, inputs: Any, options: Any) -> Any:
    with warnings.catch_warnings():
        # CasADi 3.8 warns that NumPy functions of its symbols will change. Those of scalars stay
        # the same.
        warnings.simplefilter("ignore", FutureWarning)
        try:
            return as_scalar(function(*map(_as_plain, inputs), **options))
        except TypeError:
            others = ", ".join(short_repr(x) for x in inputs if not isinstance(x, Scalar))
            raise FormulaError(
                "with NumPy functions of signals and numbers, which do not include "
                f"{function.__name__} of {others or 'signals'}"
            ) from None


def _as_plain(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [_as_plain(x) for x in value]
    return value.__SX__() if isinstance(value, Scalar) else value


def _as_array(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value
    array = np.empty((), object)
    array[()] = value
    return array


def _define_methods() -> None:
    for name in _METHODS:
        method = getattr(SX, name)
        setattr(Scalar, name, lambda *x, f=method: as_scalar(f(*map(_as_plain, x))))


_define_methods()
