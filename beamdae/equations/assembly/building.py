"""Equations of motion built from statements: terms and observables on all coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from types import MappingProxyType

import casadi as ca
import numpy as np

from beamdae.equations.assembly.coordinate_map import CoordinateMap, map_coordinates
from beamdae.equations.assembly.statement_checks import (
    call_part,
    require_columns_fit,
    require_pieces_fit,
    require_unique,
    select_multipliers,
)
from beamdae.equations.equations_of_motion import (
    Configurations,
    ControllerTerm,
    EquationsOfMotion,
    EventTerm,
    InputTerm,
    Observable,
    PartCoordinates,
    PartStatements,
    format_headers,
)
from beamdae.equations.measures import LEDGER_COLUMNS, TIME
from beamdae.equations.singular_laws import PartLaw
from beamdae.equations.structure import (
    ConstraintTerm,
    ForceTerm,
    Structure,
    intern_structure,
)
from beamdae.errors import BeamdaeError, require_name, short_repr, suggest
from beamdae.parts.attachments import Attachment
from beamdae.parts.control.controller import Controller
from beamdae.parts.events import DIRECTIONS, Event
from beamdae.parts.forces.load_observables import FormulaLoad
from beamdae.parts.laws import Law
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.observables import as_quantity
from beamdae.parts.signals import Activity, Input
from beamdae.read_only import ReadOnlyDict, read_only_copy
from beamdae.symbolic.formula import MAX_SHARED_KERNELS, FormulaExpression
from beamdae.symbolic.kernel_groups import Statement, generalize_quantity, group_by_kernel
from beamdae.symbolic.signals import SignalNumbers, bind_laws, bind_signals, find_signals
from beamdae.symbolic.sparse_operators import build_selection
from beamdae.symbolic.statements import (
    LOAD_UNITS,
    SX,
    AccelerationKernel,
    ConstraintStatement,
    ForceStatement,
    Local,
    Quantity,
    QuantityKernel,
    Variable,
)
from beamdae.symbolic.sums.rotations import RotatedOperator, factor_operator

Array = np.ndarray

# Share of deformations relative to a floating frame in the correction q' - v by joints. With 1, the
# share of rigid motions, stiff deformations took over errors of the much faster rigid motion, and
# stresses in slow presses were wrong by 5 to 300 % between the steps. The force in a slow rod was
# wrong by 3.6 % with 1e-4 at rtol 1e-3, and is exact to 0.5 % with 1e-6. Results with 1e-9 are
# equally accurate.
_DEFORMATION_SHARE = 1e-6
_MAX_CACHED_CHECKS = 64  # models with different coordinates or multipliers
_TIME = Variable("t", "s")  # name of the time in events


def build_equations(
    *,
    coordinates: tuple[Variable, ...],
    q0: Array,
    v0: Array,
    length: float,
    parts: tuple[PartCoordinates, ...],
    breakpoints: tuple[float, ...],
    time_scale: float | None,
    forces: list[ForceStatement],
    constraints: list[ConstraintStatement],
    observables: dict[str, Quantity],
    coordinate_map: CoordinateMap,
    scales: Array | None = None,
    laws: tuple[PartLaw, ...] = (),
    events: Sequence[Event] = (),
    configurations: Configurations | None = None,
    inputs: Mapping[str, Input] | None = None,
    controllers: Sequence[Controller] = (),
    mechanism: Mechanism | None = None,
    statements: tuple[PartStatements, ...] = (),
) -> EquationsOfMotion:
    """Build equations of motion from the statements of parts.

    Statements that share a kernel become one term. Its copies differ in their numbers and in the
    rows of the operator that gathers their local coordinates. For arguments that are not
    statements, see `EquationsOfMotion`.

    Raises
    ------
    BeamdaeError
        If observables, events or multipliers do not fit the parts, or headers occur twice.
    """
    inputs = {} if inputs is None else inputs
    laws_of_inputs = select_input_laws(inputs)
    forces = [statement.with_laws(laws_of_inputs) for statement in forces]
    constraints = [statement.with_laws(laws_of_inputs) for statement in constraints]
    switched_parts = () if configurations is None else configurations.switched_parts
    numbers = NumberStore(switched_parts=switched_parts)
    multipliers = [
        Variable(f"{s.part}.{x.name}", x.unit) for s in constraints for x in s.multipliers
    ]
    ends = np.cumsum([0, *(len(statement.multipliers) for statement in constraints)])
    multiplier_rows = [np.arange(first, last) for first, last in pairwise(ends)]
    rows: dict[str, slice] = {}
    for statement, (first, last) in zip(constraints, pairwise(ends.tolist()), strict=True):
        # The constraints of a part are contiguous.
        rows[statement.part] = slice(rows.get(statement.part, slice(first, last)).start, last)
    force_terms = []
    for group in group_by_kernel(forces):
        members = [forces[k] for k in group.members]
        operator = coordinate_map.global_operator([piece for x in members for piece in x.pieces])
        count = group.data.shape[1]
        depends_on = select_multipliers(members, rows)
        rotated = RotatedOperator(operator, None, np.zeros((0, count)))
        if group.kernel.reused and depends_on is None:
            rotated = factor_operator(operator, count)
        data = numbers.store_copies(np.concatenate([group.data, rotated.data]), members)
        force_rows = None if depends_on is None else build_selection(depends_on, len(multipliers))
        force_terms.append(
            ForceTerm(group.kernel, rotated.selection, rotated.rotation, data, count, force_rows)
        )
    constraint_terms = []
    for group in group_by_kernel(constraints):
        pieces = [piece for k in group.members for piece in constraints[k].pieces]
        own_rows = np.concatenate([multiplier_rows[k] for k in group.members])
        constraint_terms.append(
            ConstraintTerm(
                group.kernel,
                coordinate_map.global_operator(pieces),
                numbers.store_copies(group.data, [constraints[k] for k in group.members]),
                build_selection(own_rows, len(multipliers)),
                group.data.shape[1],
            )
        )

    def observe(name: str, quantity: Quantity) -> Observable:
        return build_observable(
            name, quantity, coordinate_map, numbers, rows, laws_of_inputs, statements
        )

    observable_terms = [observe(name, quantity) for name, quantity in observables.items()]
    require_unique_headers(coordinates, multipliers, observable_terms)
    event_terms = _build_event_terms(events, observable_terms, observe)
    controller_terms = tuple(
        ControllerTerm(
            controller,
            coordinate_map.slice_of(controller),
            tuple(observe(controller.name, quantity) for quantity in controller.quantities),
        )
        for controller in controllers
    )
    structure = Structure(
        len(coordinates),
        len(multipliers),
        tuple(force_terms),
        tuple(constraint_terms),
        _correction_factors(coordinates, parts),
        tuple(k for part in parts if part.is_state for k in _indices(part.rows)),
    )
    return EquationsOfMotion(
        coordinates=coordinates,
        multipliers=tuple(multipliers),
        q0=read_only_copy(q0),
        v0=read_only_copy(v0),
        p=read_only_copy(numbers.all(inputs)),
        length=length,
        parts=parts,
        breakpoints=breakpoints,
        time_scale=time_scale,
        scales=None if scales is None else read_only_copy(scales),
        observables=tuple(observable_terms),
        structure=intern_structure(structure),
        laws=laws,
        events=event_terms,
        configurations=configurations,
        inputs=numbers.input_terms(inputs),
        controllers=controller_terms,
        mechanism=mechanism,
        statements=statements,
        activities=numbers.activities,
    )


def _correction_factors(coordinates: Sequence[Variable], parts: Sequence[PartCoordinates]) -> Array:
    """Return the diagonal P of the corrections q' = v - P G^T mu by joints, (n,).

    The factors of angles are those of lengths divided by the square of the size of the connected
    parts, so that results do not depend on the unit of length. With equal factors, the angles of
    beams of 0.1 mm took over the corrections, and runs failed. The size is rounded to powers of
    1000, because models with equal factors share their plans. Deformations relative to a floating
    frame have factors that are smaller by 1e-6.
    """
    factors = np.ones(len(coordinates))
    for part in parts:
        size = 1000.0 ** round(math.log(part.group_size, 1000.0))
        for k in _indices(part.rows):
            if coordinates[k].unit == "rad":
                factors[k] = size**-2
        factors[part.deformations] *= _DEFORMATION_SHARE
    return factors


def _indices(coordinates: slice) -> range:
    return range(coordinates.start, coordinates.stop)


def remove_forces(e: EquationsOfMotion, parts: Collection[str]) -> EquationsOfMotion | None:
    """Return the equations of a mechanism without the forces and observables of some parts.

    The numbers remain. The result is None if a force of another part shares a kernel with them.
    """
    laws_of_inputs = select_input_laws({} if e.mechanism is None else e.mechanism.inputs)
    owned = [
        (s.part.name, force.with_laws(laws_of_inputs)) for s in e.statements for force in s.forces
    ]
    forces = []
    groups = group_by_kernel([force for _, force in owned])
    for term, group in zip(e.structure.forces, groups, strict=True):
        is_removed = {owned[k][0] in parts for k in group.members}
        if len(is_removed) > 1:
            return None
        if is_removed == {False}:
            forces.append(term)
    return replace(
        e,
        structure=intern_structure(replace(e.structure, forces=tuple(forces))),
        statements=tuple(s for s in e.statements if s.part.name not in parts),
        observables=(),
        events=(),
    )


def select_input_laws(inputs: Mapping[str, Input]) -> dict[str, Law]:
    """Return the laws of the inputs that are not numbers, by name of the input."""
    return {name: x.law for name, x in inputs.items() if x.law is not None}


def build_observable(
    name: str,
    quantity: Quantity,
    coordinate_map: CoordinateMap,
    numbers: NumberStore,
    rows: dict[str, slice],
    laws_of_inputs: Mapping[str, Law] = MappingProxyType({}),
    statements: Sequence[PartStatements] = (),
) -> Observable:
    """Return the observable of a quantity; append the numbers of the quantity to `numbers`.

    `rows` maps the name of each part with constraints to the slice of its multipliers. Loads of
    formulas with functions of the user follow from their `statements`, if there are any, so that
    these functions are called once.

    Raises
    ------
    BeamdaeError
        If the quantity has invalid columns, the wrong shape, or a joint without constraints.
    """
    if quantity.joint is not None and quantity.joint not in rows:
        raise BeamdaeError(
            f"{name}: {quantity.joint!r} has no constraints and therefore no reaction; observe "
            "the reaction of a joint."
        )
    if isinstance(formula := quantity.expression, FormulaLoad):
        for statement in statements:
            if statement.part is formula.part:
                quantity = formula.use_statements(quantity, statement.forces)
    lam_rows = slice(0, 0) if quantity.joint is None else rows[quantity.joint]
    operator = coordinate_map.global_operator(quantity.pieces)
    data = np.asarray(quantity.data, float)
    signal_numbers: tuple[SignalNumbers, ...] = ()
    require_columns_fit(name, quantity.columns)
    sizes = (operator.shape[0], len(data), lam_rows.stop - lam_rows.start)
    expression = quantity.expression
    kernel_type = AccelerationKernel if quantity.has_accelerations else QuantityKernel
    load = quantity.load_of
    is_switched = load is not None and load in numbers.switched_parts
    if isinstance(expression, FormulaExpression) and expression.is_shareable:
        kernel, more = _build_shared_kernel(kernel_type, expression, *sizes), np.zeros(0)
    else:
        local = Local(*sizes)
        values = call_part(name, "expression", lambda: ca.densify(SX(expression(local))))
        if signals := find_signals(values):
            binding = bind_signals(local, [values], signals)
            signal_numbers, local = binding.numbers, binding.local
            data = np.append(data, binding.data)
            (values,) = bind_laws(local, binding.outputs, signal_numbers, laws_of_inputs)
            operator = coordinate_map.global_operator([*quantity.pieces, *binding.pieces])
        kernel, more = generalize_quantity(kernel_type(local, values))
    if kernel.values.shape != (len(quantity.columns), 1):
        columns = ", ".join(column.header for column in quantity.columns)
        raise BeamdaeError(
            f"{name}: the quantity must return one value per column ({columns}), got "
            f"shape {kernel.values.shape}."
        )
    if is_switched:
        kernel, more = _with_activity(kernel, quantity.columns), np.append(more, 1.0)
    data_slice = numbers.store(np.concatenate([data, more]))
    numbers.record_signals(signal_numbers, data_slice.start)
    if load is not None and is_switched:
        numbers.record_activity(load, data_slice.stop - 1)
    return Observable(
        name,
        quantity.columns,
        kernel.function,
        operator,
        data_slice,
        lam_rows,
        quantity.has_accelerations,
        quantity.is_magnitude,
    )


def add_observable(
    e: EquationsOfMotion, name: str, what: Attachment | Quantity
) -> EquationsOfMotion:
    """Return the equations of motion of a mechanism with one more observable.

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
    quantity, coordinate_map = as_quantity(name, what), map_coordinates(mechanism)
    for piece in quantity.pieces:
        if id(piece.owner) not in coordinate_map.sizes:
            raise BeamdaeError(
                f"{name}: {piece.owner.name!r} is not part of the mechanism that ran; "
                "observe a part of that mechanism."
            )
    require_pieces_fit(name, quantity.pieces, coordinate_map.sizes)
    switched_parts = () if e.configurations is None else e.configurations.switched_parts
    numbers = NumberStore(e.p, switched_parts)
    numbers.activities |= e.activities
    rows: dict[str, slice] = {}
    for row, multiplier in enumerate(e.lam_names):
        part = multiplier.rpartition(".")[0]
        rows[part] = slice(rows.get(part, slice(row, row)).start, row + 1)
    laws_of_inputs = select_input_laws(mechanism.inputs)
    new_observable = build_observable(
        name, quantity, coordinate_map, numbers, rows, laws_of_inputs, e.statements
    )
    observables = (*e.observables, new_observable)
    require_unique_headers(e.coordinates, e.multipliers, observables)
    observed = copy(mechanism)
    observed.observables = ReadOnlyDict({**mechanism.observables, name: quantity})
    added = {term.name: term.indices for term in numbers.input_terms(mechanism.inputs)}
    inputs = tuple(x._replace(indices=(*x.indices, *added[x.name])) for x in e.inputs)
    p = read_only_copy(numbers.all(mechanism.inputs))
    return replace(
        e,
        observables=observables,
        p=p,
        inputs=inputs,
        mechanism=observed,
        activities=numbers.activities,
    )


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


def _express_time(local: Local) -> SX:
    return local.time[0]


def _build_event_terms(
    events: Sequence[Event],
    observed: Sequence[Observable],
    observe: Callable[[str, Quantity], Observable],
) -> tuple[EventTerm, ...]:
    """Return the terms of events; `observe` builds the observable of a quantity."""
    terms: dict[str, EventTerm] = {}
    columns = {
        ".".join(filter(None, (o.name, column.name))): (o, k)
        for o in observed
        for k, column in enumerate(o.columns)
    }
    for event in events:
        name = str(event.name)
        if name in terms:
            raise BeamdaeError(
                f"event: the name {name!r} is in use; give every event a different name."
            )
        if event.what == _TIME.name:
            observable, column = observe(name, Quantity((_TIME,), (), _express_time)), 0
        elif isinstance(event.what, str):
            if event.what not in columns:
                near = suggest(event.what, columns)
                raise BeamdaeError(
                    f"{name}: the column {short_repr(event.what)} is not observed{near}; "
                    "observe the column or pass a quantity."
                )
            observable, column = columns[event.what]
        else:
            if len(event.what.columns) != 1:
                names = ", ".join(column.name for column in event.what.columns)
                raise BeamdaeError(
                    f"{name}: the quantity has several columns ({names}); observe the "
                    "quantity and name one column."
                )
            observable, column = observe(name, event.what.current), 0
        if observable.has_accelerations:
            raise BeamdaeError(
                f"{name}: an event cannot depend on accelerations, which follow from the forces; "
                "monitor a position, a velocity or a force."
            )
        direction = DIRECTIONS[event.direction]
        terms[name] = EventTerm(name, observable, column, event.crosses, direction, event.do)
    return tuple(terms.values())


def require_unique_headers(
    coordinates: Sequence[Variable], multipliers: Sequence[Variable], observed: Sequence[Observable]
) -> None:
    """Reject duplicate headers of observed columns, and of coordinates and multipliers."""
    columns = tuple((observable.name, observable.columns) for observable in observed)
    try:
        _require_unique_columns(columns)
    except TypeError:  # names of other types than str
        _require_unique_columns.__wrapped__(columns)
    _require_unique_coordinates(tuple(coordinates), tuple(multipliers))


# Models are often built again with the same coordinates and columns.
@lru_cache(maxsize=_MAX_CACHED_CHECKS)
def _require_unique_columns(observed: tuple[tuple[str, tuple[Variable, ...]], ...]) -> None:
    headers = [header for name, columns in observed for header in format_headers(name, columns)]
    require_unique("observed columns", "headers", [*headers, *LEDGER_COLUMNS, TIME])


@lru_cache(maxsize=_MAX_CACHED_CHECKS)
def _require_unique_coordinates(
    coordinates: tuple[Variable, ...], multipliers: tuple[Variable, ...]
) -> None:
    rates = [coordinate.rate for coordinate in coordinates]
    lam = [Variable(f"lam.{multiplier.name}", multiplier.unit) for multiplier in multipliers]
    headers = [column.header for column in (*coordinates, *rates, *lam)]
    require_unique("coordinates and multipliers", "headers", [*headers, TIME])


class NumberStore:
    """Collects the numbers p of a model.

    Attributes
    ----------
    switched_parts
        Names of the parts that are inactive at times.
    activities
        Indices of the numbers that are 0 while a part is inactive and otherwise 1, by part.
    """

    def __init__(
        self, initial_numbers: Array | None = None, switched_parts: Collection[str] = ()
    ) -> None:
        self.switched_parts = switched_parts
        self.activities: dict[str, tuple[int, ...]] = {}
        self._arrays: list[Array] = [] if initial_numbers is None else [initial_numbers]
        self._end = sum(map(len, self._arrays))
        self._inputs: dict[str, list[int]] = {}

    def all(self, inputs: Mapping[str, Input]) -> Array:
        """Return all numbers stored so far, with the values of `inputs`."""
        p = np.concatenate([np.zeros(0), *self._arrays])
        for name, indices in self._inputs.items():
            if name not in inputs:
                raise BeamdaeError(
                    f"{name}: the input is not part of this mechanism; add it with mech.input."
                )
            p[indices] = inputs[name].data[0]
        return p

    def store(self, values: Array) -> slice:
        """Append `values` column by column; return their slice of p."""
        begin = self._end
        self._arrays.append(np.asarray(values, float).ravel(order="F"))
        self._end += len(self._arrays[-1])
        return slice(begin, self._end)

    def store_copies(self, values: Array, statements: Sequence[Statement]) -> slice:
        """Append the data of the copies of statements, one column per copy; return their slice."""
        data = self.store(values)
        column = 0
        for statement in statements:
            for _ in range(statement.data.shape[1]):
                self.record_signals(statement.signals, data.start + column * len(values))
                column += 1
        return data

    def record_signals(self, signals: Sequence[SignalNumbers], begin: int) -> None:
        """Record the indices in p of the numbers of inputs and of activities.

        The data begin at index `begin`.
        """
        for signal, rows in signals:
            if isinstance(signal, Input) and rows.stop > rows.start:
                self._inputs.setdefault(signal.name, []).append(begin + rows.start)
            if isinstance(signal, Activity):
                self.record_activity(signal.name, begin + rows.start)

    def record_activity(self, part: str, index: int) -> None:
        """Record the index in p of a number that is 0 while `part` is inactive."""
        self.activities[part] = (*self.activities.get(part, ()), index)

    def input_terms(self, inputs: Mapping[str, Input]) -> tuple[InputTerm, ...]:
        """Return the inputs with the indices of their numbers in p."""
        return tuple(
            InputTerm(name, x.unit, x.reference, tuple(self._inputs.get(name, ())), x.law)
            for name, x in inputs.items()
        )
