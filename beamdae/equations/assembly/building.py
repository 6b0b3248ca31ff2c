"""From statements on bodies to terms in the global coordinates, and to equations of motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.assembly.configurations import Configurations
from beamdae.equations.assembly.coordinate_map import CoordinateMap
from beamdae.equations.assembly.statement_checks import (
    call_part,
    require_columns_fit,
    require_unique,
    select_multipliers,
)
from beamdae.equations.equations_of_motion import (
    EquationsOfMotion,
    EventTerm,
    Observable,
    PartCoordinates,
    RangeTerm,
)
from beamdae.equations.measures import LEDGER_COLUMNS, TIME
from beamdae.equations.singular_laws import PartLaw
from beamdae.equations.structure import (
    ConstraintTerm,
    ForceTerm,
    Structure,
    intern_structure,
)
from beamdae.errors import BeamdaeError, short_repr, suggest
from beamdae.parts.events import DIRECTIONS, Event
from beamdae.symbolic.formulas import MAX_SHARED_KERNELS, FormulaExpression
from beamdae.symbolic.kernel_groups import KernelGroup, generalize_quantity, group_by_kernel
from beamdae.symbolic.rotations import RotatedOperator, factor_operator
from beamdae.symbolic.statements import (
    SX,
    ConstraintStatement,
    ForceStatement,
    Local,
    Named,
    Quantity,
    QuantityKernel,
    RangeStatement,
)


def build_event_terms(
    events: Sequence[Event],
    observed: Sequence[Observable],
    stated: Callable[[str, Quantity], Observable],
) -> tuple[EventTerm, ...]:
    """The events on the global coordinates.

    Parameters
    ----------
    observed
        What the columns are that they name.
    stated
        Makes an observable of a quantity.

    Raises
    ------
    BeamdaeError
        If there is no such column, a quantity has several, or two events have one name.
    """
    found: list[EventTerm] = []
    columns = {
        ".".join(filter(None, (o.name, column.name))): (o, k)
        for o in observed
        for k, column in enumerate(o.columns)
    }
    for event in events:
        name = str(event.name)
        if name in (other.name for other in found):
            raise BeamdaeError(f"event: the name {name!r} is taken, every event needs its own.")
        if isinstance(event.what, str):
            if event.what not in columns:
                near = suggest(event.what, columns)
                raise BeamdaeError(f"{name}: no column {short_repr(event.what)} is observed{near}.")
            observable, column = columns[event.what]
        else:
            if len(event.what.columns) != 1:
                told = ", ".join(column.name for column in event.what.columns)
                raise BeamdaeError(
                    f"{name}: its quantity has several columns ({told}); observe it, and name one."
                )
            observable, column = stated(name, event.what), 0
        direction = DIRECTIONS[event.direction]
        found.append(EventTerm(name, observable, column, event.crosses, direction, event.do))
    return tuple(found)


Array = np.ndarray


def build_equations(
    *,
    coordinates: tuple[Named, ...],
    q0: Array,
    v0: Array,
    length: float,
    parts: tuple[PartCoordinates, ...],
    breakpoints: tuple[float, ...],
    time_scale: float | None,
    forces: list[ForceStatement],
    constraints: list[ConstraintStatement],
    observables: dict[str, Quantity],
    owners: CoordinateMap,
    ranges: Sequence[RangeStatement] = (),
    scales: Array | None = None,
    laws: tuple[PartLaw, ...] = (),
    events: Sequence[Event] = (),
    configurations: Configurations | None = None,
) -> EquationsOfMotion:
    """Resolve statements on bodies to terms in the global coordinates."""
    numbers = NumberStore()
    held = [Named(f"{s.part}.{x.name}", x.unit) for s in constraints for x in s.multipliers]
    ends = np.cumsum([0, *(len(statement.multipliers) for statement in constraints)])
    places = [np.arange(first, last) for first, last in pairwise(ends)]
    rows: dict[str, slice] = {}
    for statement, (first, last) in zip(constraints, pairwise(ends.tolist()), strict=True):
        # A part may state several constraints, one after the other.
        rows[statement.part] = slice(rows.get(statement.part, slice(first, last)).start, last)
    force_terms = [
        _force_term(
            alike,
            owners.globally([piece for k in alike.members for piece in forces[k].pieces]),
            numbers,
            select_multipliers([forces[k] for k in alike.members], rows),
            len(held),
        )
        for alike in group_by_kernel(forces)
    ]
    constraint_terms = [
        ConstraintTerm(
            alike.kernel,
            owners.globally([piece for k in alike.members for piece in constraints[k].pieces]),
            numbers.store(alike.data),
            _selection(np.concatenate([places[k] for k in alike.members]), len(held)),
            alike.data.shape[1],
        )
        for alike in group_by_kernel(constraints)
    ]
    observed = [
        build_observable(name, quantity, owners, numbers, rows)
        for name, quantity in observables.items()
    ]
    require_unique_headers(coordinates, held, observed)
    watched = build_event_terms(
        events, observed, lambda name, what: build_observable(name, what, owners, numbers, rows)
    )
    terms = (tuple(force_terms), tuple(constraint_terms))
    return EquationsOfMotion(
        coordinates=coordinates,
        multipliers=tuple(held),
        q0=read_only_copy(q0),
        v0=read_only_copy(v0),
        p=read_only_copy(numbers.all),
        length=length,
        parts=parts,
        breakpoints=breakpoints,
        time_scale=time_scale,
        scales=None if scales is None else read_only_copy(scales),
        observables=tuple(observed),
        structure=intern_structure(Structure(len(coordinates), len(held), *terms)),
        ranges=tuple(RangeTerm(said, owners.globally(said.pieces)) for said in ranges),
        laws=laws,
        events=watched,
        configurations=configurations,
    )


def _force_term(
    alike: KernelGroup,
    operator: sp.csr_array,
    numbers: NumberStore,
    multipliers: Array | None,
    m: int,
) -> ForceTerm:
    """Elements and whatever else is of a kind turn within, by numbers of the model."""
    count = alike.data.shape[1]
    by = RotatedOperator(operator, None, np.zeros((0, count)))
    if alike.kernel.reused and multipliers is None:
        by = factor_operator(operator, count)
    stored = numbers.store(np.concatenate([alike.data, by.data]))
    rows = None if multipliers is None else _selection(multipliers, m)
    return ForceTerm(alike.kernel, by.selection, by.rotation, stored, count, rows)


def require_unique_headers(
    coordinates: Sequence[Named], multipliers: Sequence[Named], observed: Sequence[Observable]
) -> None:
    """Refuse columns that could not be told apart in a table."""
    own = [header for observable in observed for header in observable.headers]
    require_unique("observed columns", "headers", [*own, *LEDGER_COLUMNS, TIME])
    rates = [coordinate.rate for coordinate in coordinates]
    held = [Named(f"lam.{multiplier.name}", multiplier.unit) for multiplier in multipliers]
    headers = [column.header for column in (*coordinates, *rates, *held)]
    require_unique("coordinates and multipliers", "headers", [*headers, TIME])


def read_only_copy(values: Array) -> Array:
    """A copy that nobody can change."""
    copy = np.array(values, float)
    copy.setflags(write=False)
    return copy


class NumberStore:
    """The numbers of the model, one after the other."""

    def __init__(self, stored: Array | None = None) -> None:
        self._stored: list[Array] = [] if stored is None else [stored]
        self._end = sum(map(len, self._stored))

    @property
    def all(self) -> Array:
        """Those stored so far."""
        return np.concatenate([np.zeros(0), *self._stored])

    def store(self, values: Array) -> slice:
        """Where the values are from now on, column after column."""
        begin = self._end
        self._stored.append(np.asarray(values, float).ravel(order="F"))
        self._end += len(self._stored[-1])
        return slice(begin, self._end)


def _selection(picked: Array, size: int) -> sp.csr_array:
    """The operator that picks these of so many rows."""
    parts = (np.ones(len(picked)), picked, np.arange(len(picked) + 1))
    return sp.csr_array(parts, shape=(len(picked), size))


def build_observable(
    name: str,
    quantity: Quantity,
    owners: CoordinateMap,
    numbers: NumberStore,
    rows: dict[str, slice],
) -> Observable:
    """A quantity in the global coordinates; `rows` are those of the multipliers of each part."""
    if quantity.joint is not None and quantity.joint not in rows:
        raise BeamdaeError(f"{name}: {quantity.joint!r} holds nothing, it has no reaction.")
    lam_rows = slice(0, 0) if quantity.joint is None else rows[quantity.joint]
    operator = owners.globally(quantity.pieces)
    data = np.asarray(quantity.data, float)
    require_columns_fit(name, quantity.columns)
    sizes = (operator.shape[0], len(data), lam_rows.stop - lam_rows.start)
    expression = quantity.expression
    if isinstance(expression, FormulaExpression) and expression.is_shareable:
        kernel, more = _build_combined_kernel(expression, *sizes), np.zeros(0)
    else:
        kernel, more = generalize_quantity(_build_kernel(name, expression, Local(*sizes)))
    if kernel.values.shape != (len(quantity.columns), 1):
        columns = ", ".join(column.header for column in quantity.columns)
        raise BeamdaeError(
            f"{name}: the quantity must give one value for each of its columns ({columns}), "
            f"got shape {kernel.values.shape}."
        )
    stored = numbers.store(np.concatenate([data, more]))
    return Observable(name, quantity.columns, kernel.function, operator, stored, lam_rows)


def _build_kernel(name: str, expression: Callable[[Local], SX], local: Local) -> QuantityKernel:
    return QuantityKernel(
        local, call_part(name, "expression", lambda: ca.densify(SX(expression(local))))
    )


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def _build_combined_kernel(
    combined: FormulaExpression, size: int, n_data: int, n_multipliers: int
) -> QuantityKernel:
    local = Local(size, n_data, n_multipliers)
    return QuantityKernel(local, combined(local))
