"""Statements: contributions of one part to the equations of motion, in a few coordinates.

A statement is a small symbolic kernel together with constant sparse operators that map the
coordinates of parts to its local coordinates. The equations of motion of a mechanism are the sum of
the force and constraint statements of its parts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from typing import Any, ClassVar, NamedTuple, TypeVar, cast

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import BeamdaeError, set_fields
from beamdae.read_only import read_only_data
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.constraint_kernel import ConstraintKernel, NonholonomicKernel
from beamdae.symbolic.force_kernel import ForceAtPoint, ForceKernel
from beamdae.symbolic.formula import FormulaExpression
from beamdae.symbolic.local_symbols import SX, Local
from beamdae.symbolic.signals import (
    LocalView,
    SignalBinding,
    SignalNumbers,
    bind_laws,
    bind_signals,
    find_signals,
    select_table_calls,
)
from beamdae.symbolic.table_lookups import TableCall

__all__ = [
    "SX",
    "AccelerationKernel",
    "ConstraintKernel",
    "ConstraintStatement",
    "ForceAtPoint",
    "ForceKernel",
    "ForceStatement",
    "Local",
    "NonholonomicKernel",
    "Piece",
    "Quantity",
    "QuantityKernel",
    "Variable",
    "add_quantities",
    "apply_laws",
    "forget_meshes",
    "formula_quantity",
    "rebuilt_for_mesh",
]


class Variable(NamedTuple):
    """Name and unit of a value, such as a coordinate, a multiplier or an observed column."""

    name: str
    unit: str

    @property
    def header(self) -> str:
        """Column header 'name [unit]'."""
        return f"{self.name} [{self.unit}]"

    @property
    def rate(self) -> Variable:
        """Name and unit of the time derivative, such as 'x_dot' [m/s]."""
        return Variable(f"{self.name}_dot", "1/s" if self.unit == "-" else f"{self.unit}/s")


class Piece(NamedTuple):
    """Constant operator that maps the coordinates of one owner, such as a body, to local ones.

    `s` is the arc length [m] if the local coordinates are those of a section of a beam, else None.
    """

    owner: Any
    operator: sp.csr_array
    s: float | None = None


class TableArgument(NamedTuple):
    """Table in the force formula of a part.

    Attributes
    ----------
    part
        Name of the part.
    call
        The table and its arguments, in terms of `local` and of signals.
    local, pieces, data
        Local coordinates and data, as in a `ForceStatement` with one copy.
    """

    part: str
    call: TableCall
    local: Local
    pieces: tuple[Piece, ...]
    data: np.ndarray


@dataclass(frozen=True)
class ForceStatement:
    """Forces of one part: copies of one kernel, with one column of `data` per copy.

    The operator of each piece stacks the rows of all copies; each copy has the same number of rows.
    The local coordinates of a copy are its rows of all pieces in sequence. `joint` is the name of
    the part whose multipliers are `local.lam`; None if the kernel has no multipliers. If the kernel
    contains signals, they become further coordinates and data; `signals` are the rows of these
    data. `tables` are the tables in the kernel.
    """

    part: str
    kernel: ForceKernel
    pieces: tuple[Piece, ...]
    data: np.ndarray
    joint: str | None = None
    signals: tuple[SignalNumbers, ...] = ()
    tables: tuple[TableArgument, ...] = ()

    def __post_init__(self) -> None:
        calls = self.kernel.table_calls
        if self.kernel.signal_binding is not None:
            calls = (*calls, *select_table_calls(*self.kernel.outputs))
        if calls:
            tables = []
            for k in range(self.count):
                copy = tuple(_select_copy(self.pieces, k, self.count)), self.data[:, k : k + 1]
                tables += [TableArgument(self.part, x, self.kernel.local, *copy) for x in calls]
            set_fields(self, tables=tuple(tables))
        if (binding := self.kernel.signal_binding) is not None:
            _set_binding(self, *binding)

    @property
    def count(self) -> int:
        """Number of copies of the kernel."""
        return self.data.shape[1]

    @property
    def separate_copies(self) -> list[ForceStatement]:
        """One statement per copy if copies have pieces of their own, because they read sensors."""
        if not any(x.signal.rows for x in self.signals):
            return [self]
        size, copies = len(self.pieces) // self.count, range(self.count)
        pieces = [self.pieces[k * size :][:size] for k in copies]
        return [replace(self, pieces=pieces[k], data=self.data[:, k : k + 1]) for k in copies]


@dataclass(frozen=True)
class ConstraintStatement:
    """Constraints of one part; `multipliers` has the name and unit of each multiplier.

    See `ForceStatement` for `signals`.
    """

    part: str
    kernel: ConstraintKernel
    pieces: tuple[Piece, ...]
    multipliers: tuple[Variable, ...]
    data: np.ndarray = field(default_factory=lambda: np.zeros((0, 1)))
    signals: tuple[SignalNumbers, ...] = ()

    def __post_init__(self) -> None:
        signals = find_signals(*self.kernel.outputs)
        if not signals:
            return
        moving = [signal.name for signal in signals if signal.rows]
        if moving:
            raise BeamdaeError(
                f"{self.part}: a constraint must not depend on the state or sensor {moving[0]!r}, "
                "because its reaction would act on the measured coordinates; control a force or "
                "a moment instead."
            )
        binding = bind_signals(self.kernel.local, self.kernel.outputs, signals)
        outputs: list[Any] = binding.outputs
        kernel = type(self.kernel)(binding.local, *outputs)
        _set_binding(self, binding, kernel)


_Statement = TypeVar("_Statement", ForceStatement, ConstraintStatement)


def _set_binding(
    statement: ForceStatement | ConstraintStatement,
    binding: SignalBinding,
    kernel: ForceKernel | ConstraintKernel,
) -> None:
    count = statement.data.shape[1]
    pieces: list[Piece] = list(statement.pieces)
    if binding.pieces:
        # The rows of each copy are followed by those of the signals, which all copies read.
        pieces = []
        for k in range(count):
            pieces += [*_select_copy(statement.pieces, k, count), *binding.pieces]
    set_fields(
        statement,
        kernel=kernel,
        pieces=tuple(pieces),
        data=np.concatenate([statement.data, np.repeat(binding.data[:, None], count, axis=1)]),
        signals=binding.numbers,
    )


def _select_copy(pieces: Sequence[Piece], k: int, count: int) -> list[Piece]:
    """Return the rows of copy number `k` in the pieces of `count` copies."""
    if count == 1:
        return list(pieces)
    rows = (piece.operator.shape[0] // count for piece in pieces)
    return [
        piece._replace(operator=sp.csr_array(piece.operator)[k * size : (k + 1) * size])
        for piece, size in zip(pieces, rows, strict=True)
    ]


def apply_laws(statement: _Statement, laws: Mapping[str, Callable[[SX], SX]]) -> _Statement:
    """Return a statement with these laws of inputs, by name of the input."""
    kernel = statement.kernel
    if not any(one.signal.name in laws for one in statement.signals):
        return statement
    outputs: list[Any] = bind_laws(kernel.local, kernel.outputs, statement.signals, laws)
    return replace(statement, kernel=type(kernel)(kernel.local, *outputs))


LOAD_UNITS = ("N", "N m", "W")  # of forces, moments and powers


@read_only_data
@dataclass(frozen=True)
class Quantity:
    """An observed quantity: columns computed from a few coordinates and multipliers.

    Attributes
    ----------
    columns
        Name and unit of each value. The column of an observable is named "observable.name", or
        "observable" if the name is empty.
    pieces
        Operators that select the local coordinates.
    expression
        Function of `Local` that returns an SX column with one entry per value.
    data
        Values of local.data, shape (n_data,).
    joint
        Name of the part whose multipliers are local.lam; None if the values depend on none.
    joint_part
        The part `joint`, to reject a part of another mechanism with the same name; None if unknown.
    recipe
        Function call that returned the quantity, see `rebuilt_for_mesh`; None if unknown.
    has_accelerations
        True if the values depend on local.a. Such quantities are columns of results only, not of
        events, controllers or FMUs, because accelerations follow from the forces.
    load_of
        Name of the force part that exerts the loads, which are the columns in `LOAD_UNITS`; they
        are zero while the part is inactive. None if the values are not loads.
    is_magnitude
        True if the values are magnitudes, or the largest of several ones: their derivatives jump,
        and their smallest values do not matter.
    is_elastic
        True for stresses, strains and section forces of beams, but not magnitudes of them, and for
        forces and moments of springs, dampers and bushings without formulas of the user. Between
        steps, they are interpolated themselves: stiffness would amplify errors of positions.
    """

    columns: tuple[Variable, ...]
    pieces: tuple[Piece, ...]
    expression: Callable[[Local], SX]
    data: np.ndarray = field(default_factory=lambda: np.zeros(0))
    joint: str | None = None
    joint_part: Any = field(default=None, repr=False, compare=False)
    recipe: _Recipe | None = field(default=None, repr=False, compare=False)
    has_accelerations: bool = False
    load_of: str | None = None
    is_magnitude: bool = False
    is_elastic: bool = False

    @property
    def can_be_rebuilt(self) -> bool:
        """True if the quantity can be rebuilt after the coordinates of beams have changed.

        A copy with other pieces, another expression or other data cannot be rebuilt.
        """
        return self.recipe is not None and all(
            mine is original
            for mine, original in zip(
                (self.pieces, self.expression, self.data), self.recipe.results, strict=True
            )
        )

    @cached_property
    def _built_for(self) -> object | None:
        """Meshes for which the quantity was built, see `forget_meshes`; None if unknown."""
        # A cached property because fingerprints of models omit these.
        return None

    @cached_property
    def _rebuilt(self) -> Quantity | None:
        """Result of the last call of `current` that rebuilt the quantity; None if there is none."""
        return None

    @property
    def current(self) -> Quantity:
        """The quantity, rebuilt for the present coordinates of the bodies if this is possible."""
        if self.recipe is None or self._built_for is _present_meshes or not self.can_be_rebuilt:
            return self
        # An assembly asks for the quantities of sensors several times.
        rebuilt = self._rebuilt
        if rebuilt is None or rebuilt._built_for is not _present_meshes:
            build, arguments, options, _ = self.recipe
            rebuilt = build(*arguments, **options)
            if rebuilt.columns != self.columns:
                rebuilt = replace(rebuilt, columns=self.columns)
                set_fields(rebuilt, _built_for=_present_meshes)
            set_fields(self, _rebuilt=rebuilt)
        return rebuilt


def formula_quantity(
    columns: Sequence[Variable],
    pieces: Sequence[Piece],
    build: Callable[..., SX],
    functions: Sequence[Callable[..., Any]] = (),
    **source: Any,
) -> Quantity:
    """Return the quantity of a `FormulaExpression`; `source` are further fields."""
    values, data = FormulaExpression.of(build, functions)
    return Quantity(tuple(columns), tuple(pieces), values, data, **source)


def add_quantities(quantities: Sequence[Quantity], columns: tuple[Variable, ...]) -> Quantity:
    """Return the sum of the first columns of quantities with one source, without multipliers."""
    views, row, first = [], 0, 0
    for x in quantities:
        end, last = row + sum(p.operator.shape[0] for p in x.pieces), first + len(x.data)
        views.append((x.expression, slice(row, end), slice(first, last)))
        row, first = end, last

    def add(local: Local) -> SX:
        values = [expression(LocalView(local, *rows)) for expression, *rows in views]
        return sum((x[: len(columns)] for x in values), SX.zeros(len(columns)))

    pieces = tuple(piece for x in quantities for piece in x.pieces)
    data = np.concatenate([x.data for x in quantities])
    return Quantity(columns, pieces, add, data, load_of=quantities[0].load_of)


class _Recipe(NamedTuple):
    """Function call that returned a quantity, and the pieces, expression and data it returned."""

    build: Callable[..., Quantity]
    arguments: tuple[Any, ...]
    options: dict[str, Any]
    results: tuple[Any, ...]


_Build = TypeVar("_Build", bound=Callable[..., Quantity])
# Replaced when meshes may have changed. An object, so that copies and pickled quantities differ.
_present_meshes = object()


def forget_meshes() -> None:
    """Let the quantities built so far be rebuilt, because meshes may have changed."""
    global _present_meshes
    _present_meshes = object()


def rebuilt_for_mesh(build: _Build) -> _Build:
    """Decorate a function that returns a quantity, so that assembly can rebuild the quantity.

    Assembly places the nodes of beams at their attachments, which changes the coordinates of
    sections to which earlier quantities refer.
    """

    @wraps(build)
    def build_and_remember(*arguments: Any, **options: Any) -> Quantity:
        meshes = _present_meshes
        quantity = build(*arguments, **options)
        results = (quantity.pieces, quantity.expression, quantity.data)
        recipe = _Recipe(build_and_remember, arguments, options, results)
        if quantity.recipe is not None:
            quantity = replace(quantity, recipe=recipe)
        else:
            # The quantity is new; a copy would convert its fields to read-only data again.
            set_fields(quantity, recipe=recipe)
        set_fields(quantity, _built_for=meshes)
        return quantity

    return cast("_Build", build_and_remember)


@dataclass(frozen=True)
class QuantityKernel:
    """Expressions of the values of a quantity.

    Attributes
    ----------
    local
        Symbols of the coordinates, multipliers and data.
    values
        Values in terms of time, q, v, data and lam of `local`, shape (number of columns,).
    """

    local: Local
    values: SX
    reused: ClassVar[bool] = False

    @property
    def inputs(self) -> list[SX]:
        """Symbols on which the values may depend: (time, q, v, data, lam)."""
        x = self.local
        return [x.time, x.q, x.v, x.data, x.lam]

    @property
    def outputs(self) -> list[SX]:
        """List that contains the column of values."""
        return [self.values]

    @cached_property
    def function(self) -> RowFunction:
        """Function from rows of `inputs` to rows of values."""
        return RowFunction(ca.Function("observed", self.inputs, [ca.densify(self.values)]))


@dataclass(frozen=True)
class AccelerationKernel(QuantityKernel):
    """Expressions of the values of a quantity that depend on accelerations."""

    @property
    def inputs(self) -> list[SX]:
        """Symbols on which the values may depend: (time, q, v, data, lam, a)."""
        return [*super().inputs, self.local.a]
