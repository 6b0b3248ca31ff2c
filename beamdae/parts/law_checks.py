"""Refusals: what is given as a law has to be a smooth formula in t."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, as_real, format_exception, short_repr
from beamdae.symbolic.statements import SX

# Operations by which a formula can jump or kink where no integrator would stop.
_ROUGH = {
    getattr(ca, f"OP_{name}"): name.lower()
    for name in (
        "LT",
        "LE",
        "EQ",
        "NE",
        "IF_ELSE_ZERO",
        "FLOOR",
        "CEIL",
        "FMOD",
        "FABS",
        "SIGN",
        "COPYSIGN",
        "FMIN",
        "FMAX",
    )
}


def require_smooth(part: str, piece: Callable[[Any], Any], function: ca.Function) -> None:
    """Refuse a piece that jumps or kinks where no integrator would stop."""
    used = {function.instruction_id(i) for i in range(function.n_instructions())}
    rough = [name for operation, name in _ROUGH.items() if operation in used]
    if rough:
        raise BeamdaeError(
            f"{part}: {called(piece)} must be smooth, but it uses {', '.join(rough)}; "
            "give its pieces to bd.piecewise, so that no step runs over a jump or kink."
        )


_DECIDES = (
    "but it decides by the value of t (if, while, and, or, min, max); give its pieces to "
    "bd.piecewise((end time, law), ..., last law)"
)
_OF_NUMBERS = (
    "but it needs t as a number, as float, int, random numbers and the functions of math do; use "
    "numpy functions such as np.sin, and bd.table for tables"
)


def called(piece: Callable[[Any], Any]) -> str:
    """'the law', with the name of its function if that has one."""
    name = getattr(piece, "__name__", "<lambda>")
    return "the law" if "<" in name else f"the law {name}"


def expression_of(piece: Callable[[Any], Any], t: SX) -> Any:
    """What a piece makes of the symbol t, as an expression if it is a number or expression."""
    with warnings.catch_warnings():
        # CasADi 3.8 announces a change of numpy functions on its symbols; np.sin(t) and its
        # like give the same scalar expression before and after it.
        warnings.simplefilter("ignore", FutureWarning)
        value = piece(t)
    found = as_real(value)
    if found is not None:
        return SX(found)
    if getattr(value, "ndim", None) == 0:
        value = value.item()
    return SX(value) if isinstance(value, (SX, ca.DM)) else value


def _of_number(piece: Callable[[Any], Any], t: float) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return piece(t)


def require_formula(part: str, piece: Callable[[Any], Any], t: SX, start: float) -> None:
    """Refuse a piece that does not make one expression of the symbol t."""
    wanted = f"{part}: {called(piece)} must be a formula in t"
    try:
        value = expression_of(piece, t)
    except Exception as problem:
        try:
            _of_number(piece, start)
        except Exception as own:
            raise BeamdaeError(
                f"{wanted} that gives a number, but it failed at t = {start:g}, {format_exception(own)}."
            ) from own
        # Of bool() on a symbol; nothing else tells it from other failures.
        decides = "truth value" in str(problem)
        raise BeamdaeError(f"{wanted}, {_DECIDES if decides else _OF_NUMBERS}.") from None
    if not isinstance(value, SX) or value.shape != (1, 1):
        raise BeamdaeError(
            f"{part}: {called(piece)} must return one number, got {short_repr(value)}."
        )
    strange = [x.name() for x in ca.symvar(value) if x.element_hash() != t.element_hash()]
    if strange:
        raise BeamdaeError(
            f"{part}: {called(piece)} must depend on t alone, not on {', '.join(strange[:3])}."
        )


# Times [s] after the start at which a law is asked for numbers.
_ASKED = (0.0, 0.37, 1.9, 11.3)


def require_the_same_of_numbers(
    part: str, piece: Callable[[Any], Any], function: ca.Function, start: float
) -> None:
    """Refuse a formula that loses what the function does: float(t) is nan of a symbol."""
    times = start + np.array(_ASKED)
    try:
        by_number = np.array([as_real(_of_number(piece, t)) for t in times.tolist()], float)
    except Exception:
        # It takes symbols alone, or no time so late.
        return
    known = np.isfinite(by_number)
    by_formula = np.array([float(function([t, t])) for t in times[known]])
    size = np.max(np.abs(by_number[known]), initial=0.0)
    # What is not a number is not near.
    if not np.all(np.abs(by_formula - by_number[known]) <= 1e-6 * size):
        raise BeamdaeError(f"{part}: {called(piece)} must be a formula in t, {_OF_NUMBERS}.")
