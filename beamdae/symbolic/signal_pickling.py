"""Pickles and copies of objects whose formulas contain symbols of signals."""

from __future__ import annotations

import io
import pickle
import sys
from collections.abc import Mapping
from functools import lru_cache
from operator import attrgetter
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any

import casadi as ca

from beamdae.symbolic.constraint_kernel import ConstraintKernel
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.local_symbols import SX
from beamdae.symbolic.signals import Signal, find_signals

_PACKAGE = __name__.partition(".")[0]
# Python pickles functions with a cache only by their names.
_CACHED_FUNCTION = type(lru_cache(len))


def pickle_with_signals(value: Any) -> bytes:
    """Pickle a mechanism or an object that contains one; `pickle.loads` restores it.

    Laws may be local functions, which only cloudpickle supports. In the copy, expressions contain
    the symbols of the copied signals. Expressions with other symbols cannot be pickled.
    """
    # Imported here, because most runs are not pickled.
    from beamdae.function_pickler import FunctionPickler

    class Pickler(FunctionPickler):
        def reducer_override(self, value: Any) -> Any:
            if isinstance(value, SX):
                signals = find_signals(value)
                if _depends_only_on(value, signals):
                    symbols = [x.value_symbol for x in signals]
                    function = ca.Function("expression", symbols, [value])
                    return _restore_expression, (function.serialize(), signals)
            return super().reducer_override(value)

    stream = io.BytesIO()
    Pickler(stream).dump(value)
    return stream.getvalue()


def copy_with_signals(value: Any, replacements: Mapping[int, Any]) -> Any:
    """Return a copy whose expressions and functions contain the copied signals.

    Python's `deepcopy` does not copy functions, whose signals would remain the original ones.

    Parameters
    ----------
    value
        A mechanism, or an object that contains one.
    replacements
        Objects of the copy by the `id` of the original objects.
    """
    objects = dict(replacements)

    class Copier(pickle.Pickler):
        def persistent_id(self, value: Any) -> int | None:
            if id(value) in replacements:
                return id(value)
            if isinstance(value, _SharedObject):
                value = value.value
            elif not _is_shared(value):
                return None
            objects[id(value)] = value
            return id(value)

        def reducer_override(self, value: Any) -> Any:
            if isinstance(value, SX):
                signals = find_signals(value)
                symbols = [x.value_symbol for x in signals]
                return _exchange_signals, (_SharedObject(value), _SharedObject(symbols), signals)
            if isinstance(value, FunctionType):
                contents = [_read_cell(x) for x in value.__closure__ or ()]
                defaults = (value.__defaults__, value.__kwdefaults__, value.__dict__)
                state = (contents, _find_global_signals(value), *defaults)
                return _create_function, (_SharedObject(value),), state, None, None, _fill_function
            return NotImplemented

    class Restorer(pickle.Unpickler):
        def persistent_load(self, pid: int) -> Any:
            return objects[pid]

    stream = io.BytesIO()
    Copier(stream, pickle.HIGHEST_PROTOCOL).dump(value)
    return Restorer(io.BytesIO(stream.getvalue())).load()


class _SharedObject:
    """Reference to an object that is not copied."""

    def __init__(self, value: Any) -> None:
        self.value = value


def _is_shared(value: Any) -> bool:
    """Return True for types, shared kernels, and expressions and functions without signals."""
    if isinstance(value, SX):
        return not find_signals(value)
    if isinstance(value, FunctionType):
        has_content = value.__closure__ or value.__defaults__ or value.__kwdefaults__
        return _is_of_package(value) or not (has_content or _find_global_signals(value))
    if isinstance(value, (ForceKernel, ConstraintKernel)):
        return value.reused  # Shared kernels contain no signals.
    return isinstance(value, (type, ModuleType, ca.Function, _CACHED_FUNCTION))


def _is_of_package(function: FunctionType) -> bool:
    """Return True for functions with a name in this package, by which quantities are recognized."""
    if str(function.__module__).partition(".")[0] != _PACKAGE:
        return False
    try:
        named = attrgetter(function.__qualname__)(sys.modules[function.__module__])
    except AttributeError:  # local functions
        return False
    return named is function


def _find_global_signals(function: FunctionType) -> dict[str, Any]:
    """Return the signals and their expressions among the global names that a function uses."""
    names, codes = set[str](), [function.__code__]
    for code in codes:
        names.update(code.co_names)
        codes += [x for x in code.co_consts if isinstance(x, CodeType)]
    values = function.__globals__
    return {x: values[x] for x in names if isinstance(values.get(x), (Signal, SX))}


def _read_cell(cell: CellType) -> list[Any]:
    """Return the content of a cell in a list, which is empty if a variable has no value yet."""
    try:
        return [cell.cell_contents]
    except ValueError:
        return []


def _create_function(function: FunctionType) -> FunctionType:
    """Return a function with empty cells, which `_fill_function` fills."""
    code, closure = function.__code__, tuple(CellType() for _ in function.__closure__ or ())
    global_names = function.__globals__
    if _find_global_signals(function):
        global_names = dict(global_names)
    other = FunctionType(code, global_names, function.__name__, None, closure)
    other.__qualname__, other.__module__ = function.__qualname__, function.__module__
    other.__doc__ = function.__doc__
    return other


def _fill_function(function: FunctionType, state: tuple[Any, ...]) -> None:
    contents, global_signals, defaults, keyword_defaults, attributes = state
    for cell, content in zip(function.__closure__ or (), contents, strict=True):
        for value in content:
            cell.cell_contents = value
    function.__globals__.update(global_signals)
    function.__defaults__, function.__kwdefaults__ = defaults, keyword_defaults
    function.__dict__.update(attributes)


def _exchange_signals(expression: SX, symbols: list[SX], signals: tuple[Signal, ...]) -> SX:
    return SX(ca.substitute([expression], symbols, [x.value_symbol for x in signals])[0])


def _depends_only_on(expression: SX, signals: tuple[Signal, ...]) -> bool:
    known = {x.element_hash() for s in signals for x in ca.vertsplit(s.value_symbol)}
    return all(x.element_hash() in known for x in ca.symvar(expression))


def _restore_expression(function: str, signals: tuple[Signal, ...]) -> SX:
    return SX(ca.Function.deserialize(function)(*(x.value_symbol for x in signals)))
