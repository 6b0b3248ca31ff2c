"""Checks of user-written force formulas, which are evaluated with symbols."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import (
    CASADI_MISMATCH,
    BeamdaeError,
    format_exception,
    short_repr,
)
from beamdae.native.instructions import by_operation, read_instructions
from beamdae.symbolic.signals import (
    SMOOTH_ALTERNATIVES,
    FormulaError,
    as_expression,
    as_scalar,
    find_other_symbols,
)
from beamdae.symbolic.statements import SX
from beamdae.symbolic.table_lookups import inside_formula

# Operations with jumps, as users write them; np.maximum and np.abs only have kinks.
JUMP_OPERATIONS = by_operation(
    LT="<",
    LE="<=",
    EQ="==",
    NE="!=",
    IF_ELSE_ZERO="np.where",
    FLOOR="np.floor",
    CEIL="np.ceil",
    FMOD="np.fmod",
    SIGN="np.sign",
)
_PERIODIC_ALTERNATIVE = (
    "for values that repeat with an angle or time, a sum of np.sin and np.cos or a table with "
    "outside='repeat'"
)
_PERIODIC_OPERATIONS = ("np.floor", "np.fmod")
_VECTOR_ADVICE = (
    "Use vectors of equal length, or write their product by components, such as "
    "a[0] * b[0] + a[1] * b[1]."
)


def as_vector(column: SX) -> np.ndarray:
    """Return a column as a NumPy array of expressions, which user code can unpack and add."""
    return np.array([as_scalar(column[k]) for k in range(column.numel())], dtype=object)


def list_entries(value: Any) -> list[Any]:
    """Return the entries of the value of a formula as a list, of one entry for a number."""
    value = as_expression(value)
    if isinstance(value, (ca.SX, ca.DM)):
        return [value[k] for k in range(value.numel())]
    if isinstance(value, np.ndarray):
        return list(value.ravel())
    return list(value) if isinstance(value, (tuple, list)) else [value]


def require_column(part: str, what: str, value: Any, rows: int) -> SX:
    """Return the value of a formula as a column with `rows` entries, or raise BeamdaeError."""
    try:
        column = ca.vertcat(*(SX(entry) for entry in list_entries(value)))
    except Exception:
        column = SX(0, 1)
    if column.shape != (rows, 1):
        expected = "one number" if rows == 1 else f"{rows} numbers"
        raise BeamdaeError(f"{part}: {what} must return {expected}, got {short_repr(value)}.")
    return column


def evaluate_formula(part: str, what: str, function: Callable[..., Any], *symbols: Any) -> Any:
    """Return the value of a user's function at symbols, or raise BeamdaeError if the call fails.

    `what` is the name of the function in messages.
    """
    try:
        with inside_formula():
            return function(*map(as_scalar, symbols))
    except FormulaError as problem:
        raise BeamdaeError(f"{part}: {what} must be a formula {problem.rule}.") from None
    except BeamdaeError:
        raise
    except Exception as problem:
        is_mismatch = CASADI_MISMATCH in format_exception(problem)
        advice = f" {_VECTOR_ADVICE}" if is_mismatch else ""
        raise BeamdaeError(
            f"{part}: {what} must be a formula of numpy functions such as np.sin, but "
            f"the call failed: {format_exception(problem)}.{advice}"
        ) from problem


def require_continuous_formula(
    part: str, what: str, value: SX, symbols: Sequence[SX], arguments: str = "its arguments"
) -> None:
    """Raise BeamdaeError if an expression has jumps, contains nan or depends on other symbols.

    Parameters
    ----------
    part, what
        Name of the part and of the formula, for messages.
    value
        The expression.
    symbols
        Symbols on which the expression may depend.
    arguments
        Description of these symbols in messages.
    """
    if others := find_other_symbols(value, symbols):
        raise BeamdaeError(
            f"{part}: {what} must depend only on {arguments}, not on {', '.join(others[:3])}."
        )
    formula = ca.Function("formula", [ca.vertcat(*ca.symvar(value))], [value])
    instructions = read_instructions(formula)
    if any(code == ca.OP_CONST and np.isnan(operands[0]) for code, operands, _ in instructions):
        raise BeamdaeError(f"{part}: {what} must be a formula without nan.")
    operations = [code for code, _, _ in instructions]
    jumps = [name for operation, name in JUMP_OPERATIONS.items() if operation in operations]
    if jumps:
        is_periodic = any(x in jumps for x in _PERIODIC_OPERATIONS)
        raise BeamdaeError(
            f"{part}: {what} must be continuous, but uses {', '.join(jumps)}; use "
            f"{_PERIODIC_ALTERNATIVE if is_periodic else SMOOTH_ALTERNATIVES}."
        )


def require_function(part: str, what: str, function: Any) -> None:
    """Raise BeamdaeError if a value cannot be called."""
    if not callable(function):
        raise BeamdaeError(f"{part}: {what} must be a function, got {short_repr(function)}.")
