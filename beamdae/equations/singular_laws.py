"""Time laws that may become infinite, or have short pulses."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import casadi as ca
import numpy as np

from beamdae.native.instructions import trace_dependence
from beamdae.parts.gravity import GravityLaws
from beamdae.parts.laws import Law
from beamdae.parts.part import Part
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formula import Formula, compile_kind
from beamdae.symbolic.signals import with_references

Array = np.ndarray

# Operations that are finite at all finite operands, but for tanh, whose products are short pulses.
_FINITE_OPERATIONS = frozenset(
    getattr(ca, f"OP_{name}")
    for name in (
        *("ASSIGN", "ADD", "SUB", "MUL", "NEG", "TWICE", "SQ", "SIN", "COS", "ATAN"),
        *("FABS", "FMIN", "FMAX", "LT", "LE", "EQ", "NE", "NOT", "AND", "OR", "IF_ELSE_ZERO"),
        # Lookups in tables.
        "CALL",
    )
)


class PartLaw(NamedTuple):
    """Law that depends on time and may become infinite.

    Attributes
    ----------
    part
        Name of the part or, in a constrained system, of the symbol.
    function
        Function of rows of (t, branch) and of `numbers`.
    numbers
        Numbers in the law, (k,).
    """

    part: str
    function: RowFunction
    numbers: Array

    def values(self, times: Array, branches: Array) -> Array:
        """Return the law at each of `times` [s], with one branch time per row."""
        rows = np.empty((*times.shape, 2))
        rows[..., 0], rows[..., 1] = times, branches[:, None]
        return np.reshape(self.function(rows.reshape(-1, 2), self.numbers), times.shape)


def collect_unbounded_laws(parts: Iterable[Part | GravityLaws]) -> tuple[PartLaw, ...]:
    """Return the laws of parts and of gravity that may become infinite, each law once."""
    return select_unbounded_laws((part.name, law) for part in parts for law in part.laws)


def select_unbounded_laws(laws: Iterable[tuple[str, Law]]) -> tuple[PartLaw, ...]:
    """Return those laws of pairs (name of the part, law) that may become infinite, each once."""
    part_laws: dict[int, PartLaw] = {}
    for part, law in laws:
        if id(law) in part_laws:
            continue
        formula, numbers = law.formula, np.zeros(0)
        if isinstance(formula, Formula):
            numbers = np.array(formula.numbers, float)
            function = compile_kind(_compile_law, formula.kind, len(numbers))
        else:
            function = _compile_law(formula, ca.SX(0, 1))
        if function is not None:
            part_laws[id(law)] = PartLaw(part, function, numbers)
    return tuple(part_laws.values())


def _compile_law(law: Callable[[ca.SX], ca.SX], numbers: ca.SX) -> RowFunction | None:
    """Compile a law as a function of (t, branch) and numbers; None if it is always finite."""
    time = ca.SX.sym("t", 2)
    function = ca.Function("law", [time, numbers], [ca.densify(with_references(law(time)))])
    # Divisions by numbers are finite.
    may_become_infinite = any(
        any(flags[1:] if code == ca.OP_DIV else flags) and code not in _FINITE_OPERATIONS
        for code, flags in trace_dependence(function, {(0, 0), (0, 1)})
    )
    return RowFunction(function) if may_become_infinite else None
