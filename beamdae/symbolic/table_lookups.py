"""Tables in expressions: records of their calls, lookups and derivatives.

A lookup finds the row of an argument by bisection and picks the numbers of this row, from which an
expression that is smooth within the row is formed. Derivatives with respect to the argument regard
the numbers as constant. With respect to the numbers of the table, picking is linear, and its
transpose is spreading.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

import casadi as ca

from beamdae.errors import BeamdaeError
from beamdae.native.instructions import rebuild_output, repeat_operation
from beamdae.native.lane_code import (
    FIND,
    PICK,
    SPREAD,
    find_function,
    pick_function,
    spread_function,
)
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


LOOKUPS = (FIND, PICK)
# CasADi's name of the derivative of a function along a direction, its last inputs.
_DERIVATIVE = "fwd"


def find_row(x: SX, axis: SX) -> SX:
    """Return the last row k with axis[k] <= x, but at least 0 and at most len(axis) - 2."""
    return find_function(axis.numel())(x, axis)


def pick_numbers(row: SX, numbers: SX, width: int = 1) -> SX:
    """Return `width` entries of a column, starting at `row`."""
    return pick_function(numbers.numel(), width)(row, numbers)


def look_up(name: str, argument: SX, numbers: SX, count: int) -> SX:
    """Return `find_row` or `pick_numbers`, by a name among `LOOKUPS`."""
    if name == FIND:
        return find_row(argument, numbers)
    return pick_numbers(argument, numbers, count)


def has_lookups(function: ca.Function) -> bool:
    """Return True if a function contains calls, of which lookups are the only ones."""
    return bool(function.find_functions(0))


def remove_zero_lookups(function: ca.Function) -> ca.Function:
    """Return a function of one output without derivatives of lookups that are zero.

    CasADi calls the derivative of a lookup even if the numbers of its table are constant.
    """
    inputs = function.sx_in()
    value, _ = _repeat_instructions(function, inputs, separates=False)
    return ca.Function(function.name(), inputs, [value])


class _Lookup(NamedTuple):
    """A call that is linear in `numbers`; `symbols` stand for its results."""

    is_spread: bool
    row: SX
    numbers: SX
    symbols: SX

    def apply(self, numbers: SX) -> SX:
        """Return the results for other numbers."""
        if self.is_spread:
            return spread_function(self.symbols.numel(), numbers.numel())(self.row, numbers)
        return pick_numbers(self.row, numbers, self.symbols.numel())

    def transpose(self, weights: SX) -> SX:
        """Return the derivatives of weights . results with respect to the numbers."""
        if self.is_spread:
            return pick_numbers(self.row, weights, self.numbers.numel())
        return spread_function(self.numbers.numel(), weights.numel())(self.row, weights)


def directional_derivative(value: SX, x: SX, direction: SX) -> SX:
    """Return the derivative of a column with respect to symbols x along a direction."""
    value, lookups = _separate_lookups(value)
    for lookup in lookups:
        change = ca.densify(ca.jtimes(lookup.numbers, x, direction))
        x, direction = ca.vertcat(x, lookup.symbols), ca.vertcat(direction, lookup.apply(change))
    return _insert_lookups(ca.jtimes(value, x, direction), lookups)


def weighted_derivative(value: SX, x: SX, weights: SX) -> SX:
    """Return the gradient of weights . value with respect to symbols x."""
    value, lookups = _separate_lookups(value)
    size, every = x.numel(), ca.vertcat(x, *(lookup.symbols for lookup in lookups))
    gradient, end = ca.densify(ca.jtimes(value, every, weights, True)), every.numel()
    for lookup in reversed(lookups):
        first = end - lookup.symbols.numel()
        by_numbers = lookup.transpose(gradient[first:end])
        gradient += ca.jtimes(lookup.numbers, every, by_numbers, True)
        end = first
    return _insert_lookups(gradient[:size], lookups)


def jacobian(value: SX, x: SX) -> SX:
    """Return the Jacobian of a column with respect to symbols x."""
    rows = ca.vertsplit(ca.densify(value))
    return ca.vertcat(*(ca.densify(weighted_derivative(row, x, SX(1.0))).T for row in rows))


def _separate_lookups(value: SX) -> tuple[SX, list[_Lookup]]:
    """Return an expression with symbols for the results of lookups, and these lookups in order."""
    symbols = ca.vertcat(*ca.symvar(value))
    function = ca.Function("value", [symbols], [ca.densify(value)])
    if not has_lookups(function):
        return value, []
    return _repeat_instructions(function, [symbols], separates=True)


def _repeat_instructions(
    function: ca.Function, inputs: Sequence[SX], separates: bool
) -> tuple[SX, list[_Lookup]]:
    """Return the output of a function, and the lookups in it if symbols replace their results."""
    lookups: list[_Lookup] = []

    def repeat(operation: Any, operands: list[SX], count: int) -> Sequence[SX]:
        if isinstance(operation, int):
            return repeat_operation(operation, operands, count)
        name = operation.name()
        direction = operands[-operation.nnz_in(operation.n_in() - 1) :]
        if name.startswith(_DERIVATIVE) and all(x.is_constant() and x.is_zero() for x in direction):
            return [SX(0.0)] * count
        if separates and name in (PICK, SPREAD):
            symbols = SX.sym("lookup", count)
            lookups.append(_Lookup(name == SPREAD, operands[0], ca.vertcat(*operands[1:]), symbols))
            return ca.vertsplit(symbols)
        return repeat_operation(operation, operands, count)

    return rebuild_output(function, inputs, repeat), lookups


def _insert_lookups(value: SX, lookups: Sequence[_Lookup]) -> SX:
    for lookup in reversed(lookups):
        value = ca.substitute(value, lookup.symbols, lookup.apply(lookup.numbers))
    return value
