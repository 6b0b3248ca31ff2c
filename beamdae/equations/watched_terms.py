"""Functions of the state that runs watch or sample: gaps, table arguments, formulas, readings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.assembly.building import list_force_statements
from beamdae.equations.assembly.observables import CompiledQuantity, compile_quantities
from beamdae.equations.equations_of_motion import ControllerTerm, EquationsOfMotion, State
from beamdae.equations.structure import cache_on_owner
from beamdae.symbolic.compiled import Compiled
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.signals import find_signals
from beamdae.symbolic.statements import Local, Quantity, TableArgument, Variable


class SurfaceGapTerm(NamedTuple):
    """Name of a part, and its compiled gap [m], which is negative inside the surface."""

    part: str
    distance: CompiledQuantity


@cache_on_owner
def compile_surface_gaps(equations: EquationsOfMotion) -> tuple[SurfaceGapTerm, ...]:
    """Return the gaps of all parts, active or not; an empty tuple for a constrained system."""
    mechanism = equations.mechanism
    if mechanism is None:
        return ()
    gaps = [(part.name, gap.quantity) for part in mechanism.parts.values() for gap in part.gaps]
    names, compiled = (name for name, _ in gaps), compile_quantities(mechanism, gaps)
    return tuple(map(SurfaceGapTerm, names, compiled))


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
        largest = float(np.max(np.abs(self.table.values))) or 1.0
        rows = np.moveaxis(self.table.values / largest, self.axis, 0)
        rounding = max(_ROUNDING_OF_RANGE * float(np.ptp(rows)), _ROUNDING_OF_VALUES)
        edge, neighbor = rows[side], rows[1 if side == 0 else -2]
        return any(bool(np.max(np.abs(x)) <= rounding) for x in (edge, edge - neighbor))

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
    """Return the distinct arguments of the tables of all parts, active or not."""
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
    distinct: dict[Any, TableArgumentTerm] = {}
    for (argument, axis, _), value in zip(places, compiled, strict=True):
        o, table = value.observable, argument.call.table
        operator, numbers = o.operator.tocsr(), value.numbers[o.data]
        key = (
            *(argument.part, id(table), axis, id(o.function)),
            *(x.tobytes() for x in (operator.indices, operator.data, numbers)),
        )
        term = TableArgumentTerm(
            argument.part, table, axis, value, _depends_on_motion(argument, axis)
        )
        distinct.setdefault(key, term)
    return tuple(distinct.values())


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
    for term in compile_table_arguments(equations):
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


@dataclass(frozen=True, eq=False)
class FormulaForceTerm:
    """One copy of a force that is a formula.

    Attributes
    ----------
    part
        Name of the part, see `_name_copies`.
    kernel
        Kernel of the force.
    operator
        Maps global to local coordinates.
    columns
        Indices of the global coordinates on which the force depends.
    to_local
        Columns of `operator` with these indices.
    numbers
        Numbers of the copy.
    """

    part: str
    kernel: ForceKernel
    operator: sp.csr_array
    columns: Array
    to_local: sp.csr_array
    numbers: Array

    def evaluate(self, times: Array, q: Array, v: Array) -> Array:
        """Return generalized forces (rows, size) at rows (t, branch), q and v of `columns`."""
        return self.kernel.load_function(times, *self._to_local(q, v), self.numbers)

    def evaluate_arguments(self, times: Array, q: Array, v: Array) -> Array:
        """Return the values of `ForceKernel.peak_arguments`, (rows, k), as `evaluate`."""
        return self.kernel.peak_arguments(times, *self._to_local(q, v), self.numbers)

    def _to_local(self, *rows: Array) -> list[Array]:
        return [np.asarray(self.to_local @ x.T).T for x in rows]


def _name_copies(equations: EquationsOfMotion) -> list[list[str]]:
    """Return the name of the part of each copy of each term in `equations.forces`.

    Equations of a `ConstrainedSystem` have no statements: their forces are called "force".
    """
    statements = list_force_statements(equations)
    if not statements:
        return [["force"] * term.count for term in equations.forces]
    return [[x.part for x in members for _ in range(x.count)] for members in statements]


def compile_formula_forces(
    equations: EquationsOfMotion,
    includes: Callable[[ForceKernel], bool] = attrgetter("may_have_peaks"),
) -> tuple[FormulaForceTerm, ...]:
    """Return the forces that may have narrow peaks over time or over the motion, or others."""
    terms = []
    for term, names in zip(equations.forces, _name_copies(equations), strict=True):
        if term.rotation is not None or not includes(term.kernel):
            continue
        size = term.kernel.local.size
        numbers = equations.p[term.data].reshape(term.count, -1)
        for k, name in enumerate(names):
            operator = term.operator[k * size : (k + 1) * size]
            columns = np.unique(operator.indices)
            to_local = operator[:, columns]
            terms.append(
                FormulaForceTerm(name, term.kernel, operator, columns, to_local, numbers[k])
            )
    return tuple(terms)


def compile_reads(term: ControllerTerm, p: Array) -> Callable[[float, float, Array, Array], Array]:
    """Return a function of t and branch [s], q and v that evaluates the reads of a controller.

    All reads are outputs of one function of the coordinates on which they depend.
    """
    if not term.reads:
        return lambda t, branch, q, v: np.zeros(0)
    columns = np.unique(np.concatenate([read.operator.indices for read in term.reads]))
    time, q_read, v_read = (
        ca.MX.sym(*x) for x in (("time", 2), ("q", len(columns)), ("v", len(columns)))
    )
    values = []
    for read in term.reads:
        to_local = ca.DM(sp.csc_matrix(read.operator[:, columns]))
        numbers = ca.MX(ca.DM(p[read.data]))
        values.append(read.function.apply(time, to_local @ q_read, to_local @ v_read, numbers))
    compiled = Compiled(ca.Function("reads", [time, q_read, v_read], [ca.vertcat(*values)]))
    (times, q_inputs, v_inputs), (outputs,) = compiled.inputs, compiled.outputs

    def read_values(t: float, branch: float, q: Array, v: Array) -> Array:
        times[0], times[1] = t, branch
        q_inputs[:] = q[columns]
        v_inputs[:] = v[columns]
        compiled.evaluate()
        return outputs.copy()

    return read_values
