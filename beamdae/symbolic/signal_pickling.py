"""Pickles of objects whose formulas contain symbols of signals."""

from __future__ import annotations

import io
from typing import Any

import casadi as ca

from beamdae.symbolic.local_symbols import SX
from beamdae.symbolic.signals import Signal, find_signals


def pickle_with_signals(value: Any) -> bytes:
    """Pickle a mechanism or an object that contains one; `pickle.loads` restores it.

    Laws may be local functions, which only cloudpickle supports. In the copy, expressions contain
    the symbols of the copied signals. Expressions with other symbols cannot be pickled.
    """
    # Imported here, because most runs are not pickled.
    import cloudpickle

    class Pickler(cloudpickle.Pickler):
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


def _depends_only_on(expression: SX, signals: tuple[Signal, ...]) -> bool:
    known = {x.element_hash() for s in signals for x in ca.vertsplit(s.value_symbol)}
    return all(x.element_hash() in known for x in ca.symvar(expression))


def _restore_expression(function: str, signals: tuple[Signal, ...]) -> SX:
    return SX(ca.Function.deserialize(function)(*(x.value_symbol for x in signals)))
