"""Record of the tables that formulas evaluate with symbols."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

from beamdae.errors import BeamdaeError
from beamdae.symbolic.local_symbols import SX


class TableCall(NamedTuple):
    """Call of a table in a formula.

    Attributes
    ----------
    table
        The table.
    arguments
        Expression of each argument.
    value
        Symbol or expression of the value in the formula.
    """

    table: Any
    arguments: tuple[SX, ...]
    value: SX


class _Recorder(NamedTuple):
    calls: list[TableCall]
    as_symbols: bool
    has_numbers_as_symbols: bool


_RECORDER: ContextVar[_Recorder | None] = ContextVar("_RECORDER", default=None)


@contextmanager
def record_calls(
    as_symbols: bool = False, has_numbers_as_symbols: bool = False
) -> Iterator[list[TableCall]]:
    """Return the list of all tables that formulas evaluate with symbols within the context.

    If `as_symbols`, the values of tables are new symbols in place of expressions. If
    `has_numbers_as_symbols`, these expressions contain symbols in place of the numbers of tables,
    which become data of statements, see `beamdae.symbolic.signals`.
    """
    calls: list[TableCall] = []
    token = _RECORDER.set(_Recorder(calls, as_symbols, has_numbers_as_symbols))
    try:
        yield calls
    finally:
        _RECORDER.reset(token)


def uses_symbols_for_numbers() -> bool:
    """Return True if tables must use symbols in place of their numbers."""
    recorder = _RECORDER.get()
    return recorder is not None and recorder.has_numbers_as_symbols


def is_inside_formula() -> bool:
    """Return True if calls of tables are recorded."""
    return _RECORDER.get() is not None


def is_inside_time_law() -> bool:
    """Return True if symbols replace the values of tables, to find the breakpoints of a law."""
    recorder = _RECORDER.get()
    return recorder is not None and recorder.as_symbols


@contextmanager
def inside_formula() -> Iterator[None]:
    """Mark the evaluation of a formula, even if its tables are not recorded."""
    if is_inside_formula():
        yield
        return
    with record_calls():
        yield


def record_call(table: Any, arguments: tuple[SX, ...], value: SX) -> SX:
    """Record a call of a table, and return the value that the formula contains."""
    recorder = _RECORDER.get()
    if recorder is None:
        if table.outside == "error":
            raise BeamdaeError(
                f"{table.name}: outside='error' requires that the table is evaluated by a time "
                "law, with sensors, states or inputs, or inside the formula of a force, where runs "
                "can be stopped; pass outside='hold'."
            )
        return value
    if recorder.as_symbols:
        value = SX.sym("table")
    recorder.calls.append(TableCall(table, arguments, value))
    return value
