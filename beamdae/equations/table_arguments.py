"""Arguments of tables in force formulas, evaluated for many states at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.equations.assembly.observables import CompiledQuantity, compile_quantities
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.structure import cache_on_owner
from beamdae.symbolic.signals import find_signals
from beamdae.symbolic.statements import Local, Quantity, TableArgument, Variable

Array = np.ndarray

# Distance from the end of a table, relative to its range, that is a rounding error.
_ROUNDING = 1e-9
# Smaller values at the end of a table, or changes there, are zero: relative to the range of values,
# and to the largest value.
_ROUNDING_OF_RANGE = 1e-9
_ROUNDING_OF_VALUES = 1e-15


@dataclass(frozen=True, eq=False)
class TableArgumentTerm:
    """Argument of a table in the force formula of a part.

    Attributes
    ----------
    part
        Name of the part.
    table, axis
        The table, and the index of its argument.
    argument
        The compiled argument.
    depends_on_motion
        False if the argument depends on time and inputs only.
    """

    part: str
    table: Any
    axis: int
    argument: CompiledQuantity
    depends_on_motion: bool

    @property
    def is_limited(self) -> bool:
        """True if a run ends where the argument leaves the table."""
        return bool(self.table.outside == "error")

    @property
    def limits(self) -> tuple[float, float]:
        """First and last value of the argument in the table."""
        axis = self.table.axes[self.axis]
        return float(axis[0]), float(axis[-1])

    def continues_as_constant(self, side: int) -> bool:
        """Return True if the table is zero or constant at its first (0) or last (-1) row."""
        edge, neighbor, rounding = self._edge(side)
        return any(bool(np.max(np.abs(x)) <= rounding) for x in (edge, edge - neighbor))

    def _edge(self, side: int) -> tuple[Array, Array, float]:
        """Return the scaled values of a row at an edge and of its neighbor, and their rounding."""
        largest = float(np.max(np.abs(self.table.values))) or 1.0
        rows = np.moveaxis(self.table.values / largest, self.axis, 0)
        rounding = max(_ROUNDING_OF_RANGE * float(np.ptp(rows)), _ROUNDING_OF_VALUES)
        return rows[side], rows[1 if side == 0 else -2], rounding

    @property
    def rounding(self) -> float:
        """Distance from the end of the table that is a rounding error."""
        low, high = self.limits
        return _ROUNDING * (high - low)

    def clearance(self, times: Array, state: State) -> Array:
        """Return distances from the ends of the table at rows (t, branch) and of states, (rows,).

        They are negative outside.
        """
        values, (low, high) = self.argument.values(times, state), self.limits
        if self.table.is_repeated:
            return np.full(values.shape, high - low)
        return np.minimum(values - low, high - values)

    def reason_to_stop(self, t: float, branch: float, state: State) -> str:
        """Return the reason why a run cannot continue from a state at `t` [s]; "" if it can."""
        if not self.is_limited:
            return ""
        time, row = np.array([[t, branch]]), State(*(x[None] for x in state))
        is_outside = self.clearance(time, row)[0] < -self.rounding
        return self.describe(float(self.argument.values(time, row)[0])) if is_outside else ""

    def describe(self, value: float) -> str:
        """Return a phrase about a value outside the table."""
        return f"{self.part}: {self.table.describe_argument(self.axis, value)}"


@cache_on_owner
def compile_table_arguments(equations: EquationsOfMotion) -> tuple[TableArgumentTerm, ...]:
    """Return the arguments of the tables of all parts, active or not."""
    mechanism = equations.mechanism
    arguments = [
        argument
        for of_part in equations.statements
        for statement in of_part.forces
        for argument in statement.tables
    ]
    if mechanism is None or not arguments:
        return ()
    places = [
        (argument, axis, quantity)
        for argument in arguments
        for axis, quantity in _list_quantities(argument)
    ]
    compiled = compile_quantities(mechanism, [(x.part, quantity) for x, _, quantity in places])
    return tuple(
        TableArgumentTerm(
            argument.part, argument.call.table, axis, value, _depends_on_motion(argument, axis)
        )
        for (argument, axis, _), value in zip(places, compiled, strict=True)
    )


def _depends_on_motion(argument: TableArgument, axis: int) -> bool:
    motion, expression = (
        ca.vertcat(argument.local.q, argument.local.v),
        argument.call.arguments[axis],
    )
    has_measured = any(signal.rows for signal in find_signals(expression))
    return has_measured or bool(ca.depends_on(expression, motion))


def _list_quantities(argument: TableArgument) -> Iterator[tuple[int, Quantity]]:
    local = argument.local
    symbols = ca.vertcat(local.time, local.q, local.v, local.data)
    for axis, expression in enumerate(argument.call.arguments):
        if not ca.symvar(expression):
            continue

        def express(other: Local, expression: Any = expression) -> Any:
            values = ca.vertcat(other.time, other.q, other.v, other.data)
            return ca.substitute(expression, symbols, values)

        column = (Variable(f"argument {axis}", "-"),)
        yield axis, Quantity(column, argument.pieces, express, argument.data[:, 0])


def find_distinct(terms: Sequence[TableArgumentTerm]) -> tuple[TableArgumentTerm, ...]:
    """Return one term for each distinct argument of each table."""
    distinct: dict[Any, TableArgumentTerm] = {}
    for term in terms:
        o = term.argument.observable
        operator = o.operator.tocsr()
        key = (
            id(term.table),
            term.axis,
            id(o.function),
            operator.indices.tobytes(),
            operator.data.tobytes(),
            term.argument.numbers[o.data].tobytes(),
        )
        distinct.setdefault(key, term)
    return tuple(distinct.values())


def list_arguments_outside(
    equations: EquationsOfMotion,
    time: Array,
    q: Array,
    v: Array | None = None,
    includes_held: bool = False,
) -> list[str]:
    """Return a warning about each argument that is outside its table.

    `time` is (t, branch); `q` and `v`, zero by default, have shape (rows, n). Tables with
    outside="hold" are considered if `includes_held` is True, except at sides where they are zero or
    constant.
    """
    phrases = []
    rest = np.zeros_like(q)
    rows = State(q, rest if v is None else v, rest, np.zeros((len(q), 0)))
    for term in find_distinct(compile_table_arguments(equations)):
        if term.is_limited or includes_held:
            times = np.tile(time, (len(q), 1))
            values = term.argument.values(times, rows)
            outside = term.clearance(times, rows) < -term.rounding
            if not term.is_limited:
                is_low = values < term.limits[0]
                outside &= ~np.where(is_low, *map(term.continues_as_constant, (0, -1)))
            phrases += [
                f"{term.describe(float(value))}, where its value is held; extend the table."
                for value in values[outside][:1]
            ]
    return phrases
