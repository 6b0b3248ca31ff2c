"""Observables: columns of quantities of a mechanism, on all coordinates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from beamdae.equations.assembly.coordinate_map import (
    CoordinateMap,
    NumberStore,
    map_coordinates,
    select_input_laws,
)
from beamdae.equations.assembly.statement_checks import (
    call_part,
    require_columns_fit,
    require_pieces_fit,
    require_unique,
)
from beamdae.equations.equations_of_motion import (
    EquationsOfMotion,
    Observable,
    PartStatements,
    State,
    format_headers,
)
from beamdae.equations.measures import LEDGER_COLUMNS, TIME
from beamdae.errors import BeamdaeError, require_name
from beamdae.parts.attachments import Attachment
from beamdae.parts.forces.load_observables import LoadValues
from beamdae.parts.laws import Law
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.observables import as_quantity
from beamdae.read_only import ReadOnlyDict, read_only_copy
from beamdae.symbolic.formula import MAX_SHARED_KERNELS, FormulaExpression
from beamdae.symbolic.kernel_groups import generalize_quantity
from beamdae.symbolic.signals import SignalNumbers, bind_laws, bind_signals, find_signals
from beamdae.symbolic.statements import (
    LOAD_UNITS,
    SX,
    AccelerationKernel,
    Local,
    Quantity,
    QuantityKernel,
    Variable,
)

Array = np.ndarray

_MAX_CACHED_CHECKS = 64  # models with different coordinates or multipliers


@dataclass(frozen=True)
class ObservableBuilder:
    """Builds observables of quantities on all coordinates.

    Attributes
    ----------
    coordinate_map
        Coordinates of the parts.
    numbers
        Numbers of the model, to which those of the quantities are appended.
    laws
        Laws of the inputs.
    rows
        Slice of the multipliers of each part with constraints, by its name.
    statements
        Loads follow from these statements, if there are any.
    """

    coordinate_map: CoordinateMap
    numbers: NumberStore
    laws: Mapping[str, Law]
    rows: Mapping[str, slice] = field(default_factory=dict)
    statements: Sequence[PartStatements] = ()

    def build(self, name: str, quantity: Quantity) -> Observable:
        """Return the observable of a quantity.

        Raises
        ------
        BeamdaeError
            If the quantity has invalid columns, the wrong shape, or a joint without constraints.
        """
        if quantity.joint is not None and quantity.joint not in self.rows:
            raise BeamdaeError(
                f"{name}: {quantity.joint!r} has no constraints and therefore no reaction; observe "
                "the reaction of a joint."
            )
        if isinstance(load_values := quantity.expression, LoadValues):
            for statement in self.statements:
                if statement.part.name == quantity.load_of:
                    quantity = load_values.use_statements(quantity, statement.forces)
        lam_rows = slice(0, 0) if quantity.joint is None else self.rows[quantity.joint]
        require_pieces_fit(name, quantity.pieces, self.coordinate_map.sizes)
        operator = self.coordinate_map.global_operator(quantity.pieces)
        data = np.asarray(quantity.data, float)
        signal_numbers: tuple[SignalNumbers, ...] = ()
        require_columns_fit(name, quantity.columns)
        sizes = (operator.shape[0], len(data), lam_rows.stop - lam_rows.start)
        expression = quantity.expression
        kernel_type = AccelerationKernel if quantity.has_accelerations else QuantityKernel
        load = quantity.load_of
        is_switched = load is not None and load in self.numbers.switched_parts
        if isinstance(expression, FormulaExpression) and expression.is_shareable:
            kernel, more = _build_shared_kernel(kernel_type, expression, *sizes), np.zeros(0)
        else:
            local = Local(*sizes)
            values = call_part(name, "expression", lambda: ca.densify(SX(expression(local))))
            if signals := find_signals(values):
                binding = bind_signals(local, [values], signals)
                signal_numbers, local = binding.numbers, binding.local
                data = np.append(data, binding.data)
                (values,) = bind_laws(local, binding.outputs, signal_numbers, self.laws)
                require_pieces_fit(name, binding.pieces, self.coordinate_map.sizes)
                operator = self.coordinate_map.global_operator([*quantity.pieces, *binding.pieces])
            kernel, more = generalize_quantity(kernel_type(local, values))
        if kernel.values.shape != (len(quantity.columns), 1):
            columns = ", ".join(column.header for column in quantity.columns)
            raise BeamdaeError(
                f"{name}: the quantity must return one value per column ({columns}), got "
                f"shape {kernel.values.shape}."
            )
        if is_switched:
            kernel, more = _with_activity(kernel, quantity.columns), np.append(more, 1.0)
        data_slice = self.numbers.store(np.concatenate([data, more]))
        self.numbers.record_signals(signal_numbers, data_slice.start)
        if load is not None and is_switched:
            self.numbers.record_activity(load, data_slice.stop - 1)
        return Observable(
            name,
            quantity.columns,
            kernel.function,
            operator,
            data_slice,
            lam_rows,
            quantity.has_accelerations,
            quantity.is_magnitude,
            quantity.is_elastic,
        )


@dataclass(frozen=True, eq=False)
class CompiledQuantity:
    """Quantity of a mechanism, compiled outside its equations of motion.

    Attributes
    ----------
    observable, numbers
        Columns of the quantity, and the numbers to which they refer.
    """

    observable: Observable
    numbers: Array

    def rows(self, times: Array, q: Array, v: Array) -> Array:
        """Return the columns, (rows, columns), at rows (t, branch) and rows of states."""
        no_multipliers = np.zeros((len(times), 0))
        return self.observable.evaluate(self.numbers, times, q, v, no_multipliers)

    def values(self, times: Array, state: State) -> Array:
        """Return the only column, (rows,), at rows (t, branch) and states in rows."""
        return self.rows(times, state.q, state.v)[:, 0]


def compile_quantities(
    mechanism: Mechanism, quantities: Iterable[tuple[str, Quantity]]
) -> list[CompiledQuantity]:
    """Return quantities that do not depend on multipliers, given with the names of their parts."""
    coordinates, laws = map_coordinates(mechanism), select_input_laws(mechanism.inputs)
    compiled = []
    for name, quantity in quantities:
        numbers = NumberStore()
        observable = ObservableBuilder(coordinates, numbers, laws).build(name, quantity)
        compiled.append(CompiledQuantity(observable, numbers.all(mechanism.inputs)))
    return compiled


def add_observable(
    e: EquationsOfMotion, name: str, what: Attachment | Quantity | SX, unit: str | None = None
) -> EquationsOfMotion:
    """Return the equations of motion of a mechanism with one more observable.

    See `Mechanism.observe` for `what` and `unit`.

    Raises
    ------
    BeamdaeError
        If the equations were not assembled from a mechanism, the quantity refers to a part of
        another mechanism or is invalid, or a column of this name exists.
    """
    name, mechanism = require_name("observe", name), e.mechanism
    if mechanism is None:
        raise BeamdaeError(
            f"{name}: the run has no mechanism; for a ConstrainedSystem, define the column with "
            "its parameter observe."
        )
    quantity, coordinate_map = as_quantity(name, what, unit), map_coordinates(mechanism)
    for piece in quantity.pieces:
        if id(piece.owner) not in coordinate_map.sizes:
            raise BeamdaeError(
                f"{name}: {piece.owner.name!r} is not part of the mechanism that ran; "
                "observe a part of that mechanism."
            )
    switched_parts = () if e.configurations is None else e.configurations.switched_parts
    numbers = NumberStore(e.p, switched_parts)
    numbers.activities |= e.activities
    rows = locate_parts(multiplier.rpartition(".")[0] for multiplier in e.lam_names)
    laws = select_input_laws(mechanism.inputs)
    builder = ObservableBuilder(coordinate_map, numbers, laws, rows, e.statements)
    new_observable = builder.build(name, quantity)
    observables = (*e.observables, new_observable)
    require_unique_headers(e.coordinates, e.multipliers, observables)
    observed = copy(mechanism)
    observed.observables = ReadOnlyDict({**mechanism.observables, name: quantity})
    inputs = tuple(
        x._replace(indices=(*x.indices, *numbers.input_indices(x.name))) for x in e.inputs
    )
    p = read_only_copy(numbers.all(mechanism.inputs))
    return replace(
        e,
        observables=observables,
        p=p,
        inputs=inputs,
        mechanism=observed,
        activities=numbers.activities,
    )


def locate_parts(names: Iterable[str]) -> dict[str, slice]:
    """Return the slice of each part, given the name of the part of each multiplier."""
    rows: dict[str, slice] = {}
    for row, part in enumerate(names):
        rows[part] = slice(rows.get(part, slice(row, row)).start, row + 1)
    return rows


def _with_activity(kernel: QuantityKernel, columns: Sequence[Variable]) -> QuantityKernel:
    """Return a kernel with one more number, whose loads are zero if this number is zero."""
    old = kernel.local
    local = Local(old.size, old.n_data + 1, old.n_multipliers)
    whole = [local.time, local.q, local.v, local.a, local.lam, local.data[: old.n_data]]
    symbols = [old.time, old.q, old.v, old.a, old.lam, old.data]
    values = ca.substitute(kernel.values, ca.vertcat(*symbols), ca.vertcat(*whole))
    is_active = local.data[old.n_data]
    # Formulas of inactive forces need not be finite, so a factor would not suffice.
    rows = [
        SX.binary(ca.OP_IF_ELSE_ZERO, is_active, value) if column.unit in LOAD_UNITS else value
        for value, column in zip(ca.vertsplit(values), columns, strict=True)
    ]
    return type(kernel)(local, ca.vertcat(*rows))


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def _build_shared_kernel(
    kernel_type: type[QuantityKernel],
    expression: FormulaExpression,
    size: int,
    n_data: int,
    n_multipliers: int,
) -> QuantityKernel:
    local = Local(size, n_data, n_multipliers)
    return kernel_type(local, expression(local))


def require_unique_headers(
    coordinates: Sequence[Variable], multipliers: Sequence[Variable], observed: Sequence[Observable]
) -> None:
    """Reject duplicate headers of observed columns, and of coordinates and multipliers."""
    columns = tuple((observable.name, observable.columns) for observable in observed)
    try:
        _require_unique(columns, tuple(coordinates), tuple(multipliers))
    except TypeError:  # names of other types than str
        _require_unique.__wrapped__(columns, tuple(coordinates), tuple(multipliers))


# Models are often built again with the same coordinates and columns.
@lru_cache(maxsize=_MAX_CACHED_CHECKS)
def _require_unique(
    observed: tuple[tuple[str, tuple[Variable, ...]], ...],
    coordinates: tuple[Variable, ...],
    multipliers: tuple[Variable, ...],
) -> None:
    headers = [header for name, columns in observed for header in format_headers(name, columns)]
    require_unique("observed columns", "headers", [*headers, *LEDGER_COLUMNS, TIME])
    rates = [coordinate.rate for coordinate in coordinates]
    lam = [Variable(f"lam.{multiplier.name}", multiplier.unit) for multiplier in multipliers]
    headers = [column.header for column in (*coordinates, *rates, *lam)]
    require_unique("coordinates and multipliers", "headers", [*headers, TIME])
