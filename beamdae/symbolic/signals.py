"""Signals and scalars: expressions of inputs, states and sensors in the formulas of parts.

A formula may contain the symbol of a signal. When a statement of such a formula is created, the
symbols are replaced: an input by a number of the statement, a state by its coordinate, and a sensor
by its expression in the coordinates that it measures. All parts therefore accept signals, without
further code.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, short_repr
from beamdae.symbolic.local_symbols import SX, Local

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


# Signals by the hash of their symbols.
_SIGNALS: WeakValueDictionary[int, Signal] = WeakValueDictionary()


class Signal(Scalar):
    """Scalar symbol in the formulas of parts; operators and NumPy functions return expressions.

    Attributes
    ----------
    name
        Name of the signal.
    """

    name: str

    @cached_property
    def value_symbol(self) -> SX:
        """Symbol that formulas contain until their statement is created."""
        return _create_symbol(self, self.name, self.size)

    @property
    def size(self) -> int:
        """Number of entries of the symbol."""
        return 1

    @property
    def reference(self) -> float | Sequence[float]:
        """Value or values at which formulas of the signal are checked."""
        return 0.0

    @property
    def table_call(self) -> Any:
        """Call of a table whose numbers the signal consists of; None for other signals."""
        return None

    @property
    def rows(self) -> int:
        """Number of local coordinates on which the signal depends."""
        return 0

    @property
    def pieces(self) -> tuple[Any, ...]:
        """Operators that select these local coordinates."""
        return ()

    @property
    def data(self) -> Sequence[float]:
        """Numbers of the signal in each statement that contains it."""
        return ()

    def keep(self, other: Signal) -> None:
        """Keep a signal that occurs only in expressions, which do not keep their signals."""
        vars(self).setdefault("_kept", []).append(other)

    def express(self, local: Local) -> SX:
        """Return the value in terms of `local`, which has the sizes of `pieces` and `data`."""
        raise NotImplementedError

    def __SX__(self) -> SX:
        return self.value_symbol

    def __reduce__(self) -> Any:
        # Symbols do not keep their identity in other processes; each creates its own. It exists
        # before the other fields, because laws among these may contain it.
        fields = {name: value for name, value in vars(self).items() if name != "value_symbol"}
        return _create_signal, (type(self), self.name, self.size), fields


def _create_symbol(signal: Signal, name: str, size: int) -> SX:
    symbol = SX.sym(name, size)
    for element in ca.vertsplit(symbol):
        _SIGNALS[element.element_hash()] = signal
    return symbol


def _create_signal(kind: type[Signal], name: str, size: int) -> Signal:
    """Return a signal with its symbol and without its other fields."""
    signal = object.__new__(kind)
    vars(signal)["value_symbol"] = _create_symbol(signal, name, size)
    return signal


def as_expression(value: Any) -> Any:
    """Return the symbol of a signal; other values are returned unchanged."""
    return value.value_symbol if isinstance(value, Signal) else value


def find_signals(*expressions: Any) -> tuple[Signal, ...]:
    """Return the signals whose symbols occur in expressions; other objects are ignored."""
    # Most models have no signals.
    symbolic = [x for x in expressions if isinstance(x, SX)] if _SIGNALS else []
    if not symbolic:
        return ()
    symbols = ca.symvar(ca.veccat(*symbolic))
    signals = (_SIGNALS.get(symbol.element_hash()) for symbol in symbols)
    return tuple(dict.fromkeys(signal for signal in signals if signal is not None))


def find_other_symbols(value: SX, symbols: Sequence[SX] = ()) -> list[str]:
    """Return the names of symbols in an expression besides `symbols` and those of signals."""
    signals = (signal.value_symbol for signal in find_signals(value))
    known = {x.element_hash() for y in (*symbols, *signals) for x in ca.symvar(SX(y))}
    return [x.name() for x in ca.symvar(value) if x.element_hash() not in known]


def select_table_calls(*expressions: Any) -> list[Any]:
    """Return the calls of tables in expressions of signals that were formed outside formulas."""
    calls = (signal.table_call for signal in find_signals(*expressions))
    return [call for call in calls if call is not None]


def with_references(expression: Any) -> Any:
    """Return an expression with the reference values of its signals; other values unchanged."""
    if not isinstance(expression, SX) or not (signals := find_signals(expression)):
        return expression
    symbols = ca.vertcat(*(signal.value_symbol for signal in signals))
    references = ca.vertcat(*(ca.DM(signal.reference) for signal in signals))
    return ca.substitute(expression, symbols, references)


class SignalNumbers(NamedTuple):
    """Rows of the data of a statement that belong to a signal."""

    signal: Signal
    rows: slice


class SignalBinding(NamedTuple):
    """Outputs of a kernel without symbols of signals, in terms of `local`.

    Attributes
    ----------
    local
        The original symbols, followed by the coordinates and data of the signals.
    outputs
        The outputs in terms of `local`.
    numbers
        Rows of the data of each signal.
    """

    local: Local
    outputs: list[SX]
    numbers: tuple[SignalNumbers, ...]

    @property
    def pieces(self) -> tuple[Any, ...]:
        """Pieces of the coordinates of the signals, for one copy."""
        return tuple(piece for one in self.numbers for piece in one.signal.pieces)

    @property
    def data(self) -> np.ndarray:
        """Data of the signals, for one copy."""
        return np.array([x for one in self.numbers for x in one.signal.data], float)


def bind_signals(local: Local, outputs: Sequence[SX], signals: Sequence[Signal]) -> SignalBinding:
    """Replace the symbols of signals in expressions of `local`.

    Raises
    ------
    BeamdaeError
        If a sensor measures a value that depends on the sensor.
    """
    signals = _add_measured_signals(signals)
    whole = Local(
        local.size + sum(signal.rows for signal in signals),
        local.n_data + sum(len(signal.data) for signal in signals),
        local.n_multipliers,
    )
    row, first = local.size, local.n_data
    expressions, numbers = [], []
    for signal in signals:
        end, last = row + signal.rows, first + len(signal.data)
        expressions.append(signal.express(LocalView(whole, slice(row, end), slice(first, last))))
        numbers.append(SignalNumbers(signal, slice(first, last)))
        row, first = end, last
    n = local.size
    motion = [_select_rows(x, slice(0, n)) for x in (whole.q, whole.v, whole.a)]
    data = _select_rows(whole.data, slice(0, local.n_data))
    values = [whole.time, *motion, whole.lam, data, *expressions]
    symbols = [local.time, local.q, local.v, local.a, local.lam, local.data]
    symbols += [signal.value_symbol for signal in signals]
    results = ca.substitute(list(outputs), [ca.vertcat(*symbols)], [ca.vertcat(*values)])
    # Sensors may measure forces that depend on further signals.
    inner = [ca.vertcat(*(x.value_symbol for x in signals))], [ca.vertcat(*expressions)]
    for _ in signals:
        if not find_signals(*results):
            return SignalBinding(whole, results, tuple(numbers))
        results = ca.substitute(results, *inner)
    if find_signals(*results):
        raise BeamdaeError(
            f"{signals[0].name}: the sensor measures a force that depends on the sensor; insert "
            "a state, such as a low-pass filter."
        )
    return SignalBinding(whole, results, tuple(numbers))


def _add_measured_signals(signals: Sequence[Signal]) -> list[Signal]:
    """Return signals, followed by those on which their expressions depend."""
    every = list(signals)
    for signal in every:
        expression = signal.express(Local(signal.rows, len(signal.data)))
        every += [other for other in find_signals(expression) if other not in every]
    return every


class LocalView(Local):
    """Some of the coordinates and data of a local statement, for the expression of a signal."""

    def __init__(self, whole: Local, rows: slice, data: slice) -> None:
        super().__init__(rows.stop - rows.start, data.stop - data.start)
        motion = {name: _select_rows(getattr(whole, name), rows) for name in ("q", "v", "a")}
        vars(self).update(motion, time=whole.time, data=_select_rows(whole.data, data))


def _select_rows(column: SX, rows: slice) -> SX:
    # An empty slice of a single entry would be a row.
    return column[rows] if rows.stop > rows.start else SX(0, 1)


def bind_laws(
    local: Local,
    outputs: Sequence[SX],
    numbers: Sequence[SignalNumbers],
    laws: Mapping[str, Callable[[SX], SX]],
) -> list[SX]:
    """Return outputs in which the numbers of inputs are increased by the laws of these inputs."""
    changed = [one for one in numbers if one.signal.name in laws and one.rows.stop > one.rows.start]
    data = SX(local.data)
    for one in changed:
        data[one.rows] += laws[one.signal.name](local.time)
    return ca.substitute(list(outputs), [local.data], [data]) if changed else list(outputs)
