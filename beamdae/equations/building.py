"""From statements on bodies to terms in the global coordinates, and to equations of motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.configurations import Configurations
from beamdae.equations.coordinate_map import Owners
from beamdae.equations.equations_of_motion import (
    EquationsOfMotion,
    Observable,
    PartCoordinates,
    RangeTerm,
)
from beamdae.equations.event_terms import event_terms
from beamdae.equations.measures import LEDGER_COLUMNS, TIME
from beamdae.equations.singular_laws import LawOfPart
from beamdae.equations.statement_checks import (
    asked,
    asked_multipliers,
    require_columns_fit,
    require_unique,
)
from beamdae.equations.structure import (
    ConstraintTerm,
    ForceTerm,
    Structure,
    interned,
)
from beamdae.errors import BeamdaeError
from beamdae.parts.events import Event
from beamdae.symbolic.formulas import MOST_KINDS, Combined
from beamdae.symbolic.kernel_groups import Alike, by_kernel, recognized
from beamdae.symbolic.rotations import Turned, turned_operator
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

Array = np.ndarray


def build(
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
    owners: Owners,
    ranges: Sequence[RangeStatement] = (),
    scales: Array | None = None,
    laws: tuple[LawOfPart, ...] = (),
    events: Sequence[Event] = (),
    configurations: Configurations | None = None,
) -> EquationsOfMotion:
    """Resolve statements on bodies to terms in the global coordinates."""
    numbers = Numbers()
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
            asked_multipliers([forces[k] for k in alike.members], rows),
            len(held),
        )
        for alike in by_kernel(forces)
    ]
    constraint_terms = [
        ConstraintTerm(
            alike.kernel,
            owners.globally([piece for k in alike.members for piece in constraints[k].pieces]),
            numbers.store(alike.data),
            _rows(np.concatenate([places[k] for k in alike.members]), len(held)),
            alike.data.shape[1],
        )
        for alike in by_kernel(constraints)
    ]
    observed = [
        observable(name, quantity, owners, numbers, rows) for name, quantity in observables.items()
    ]
    require_headers(coordinates, held, observed)
    watched = event_terms(
        events, observed, lambda name, what: observable(name, what, owners, numbers, rows)
    )
    terms = (tuple(force_terms), tuple(constraint_terms))
    return EquationsOfMotion(
        coordinates=coordinates,
        multipliers=tuple(held),
        q0=frozen(q0),
        v0=frozen(v0),
        p=frozen(numbers.all),
        length=length,
        parts=parts,
        breakpoints=breakpoints,
        time_scale=time_scale,
        scales=None if scales is None else frozen(scales),
        observables=tuple(observed),
        structure=interned(Structure(len(coordinates), len(held), *terms)),
        ranges=tuple(RangeTerm(said, owners.globally(said.pieces)) for said in ranges),
        laws=laws,
        events=watched,
        configurations=configurations,
    )


def _force_term(
    alike: Alike, operator: sp.csr_array, numbers: Numbers, multipliers: Array | None, m: int
) -> ForceTerm:
    """Elements and whatever else is of a kind turn within, by numbers of the model."""
    count = alike.data.shape[1]
    by = Turned(operator, None, np.zeros((0, count)))
    if alike.kernel.reused and multipliers is None:
        by = turned_operator(operator, count)
    stored = numbers.store(np.concatenate([alike.data, by.data]))
    rows = None if multipliers is None else _rows(multipliers, m)
    return ForceTerm(alike.kernel, by.picked, by.turn, stored, count, rows)


def require_headers(
    coordinates: Sequence[Named], multipliers: Sequence[Named], observed: Sequence[Observable]
) -> None:
    """Refuse columns that could not be told apart in a table."""
    own = [header for observable in observed for header in observable.headers]
    require_unique("observed columns", "headers", [*own, *LEDGER_COLUMNS, TIME])
    rates = [coordinate.rate for coordinate in coordinates]
    held = [Named(f"lam.{multiplier.name}", multiplier.unit) for multiplier in multipliers]
    headers = [column.header for column in (*coordinates, *rates, *held)]
    require_unique("coordinates and multipliers", "headers", [*headers, TIME])


def frozen(values: Array) -> Array:
    """A copy that nobody can change."""
    copy = np.array(values, float)
    copy.setflags(write=False)
    return copy


class Numbers:
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


def _rows(picked: Array, size: int) -> sp.csr_array:
    """The operator that picks these of so many rows."""
    parts = (np.ones(len(picked)), picked, np.arange(len(picked) + 1))
    return sp.csr_array(parts, shape=(len(picked), size))


def observable(
    name: str, quantity: Quantity, owners: Owners, numbers: Numbers, rows: dict[str, slice]
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
    if isinstance(expression, Combined) and expression.is_kind:
        kernel, more = _kept_values(expression, *sizes), np.zeros(0)
    else:
        kernel, more = recognized(_values(name, expression, Local(*sizes)))
    if kernel.values.shape != (len(quantity.columns), 1):
        columns = ", ".join(column.header for column in quantity.columns)
        raise BeamdaeError(
            f"{name}: the quantity must give one value for each of its columns ({columns}), "
            f"got shape {kernel.values.shape}."
        )
    stored = numbers.store(np.concatenate([data, more]))
    return Observable(name, quantity.columns, kernel.function, operator, stored, lam_rows)


def _values(name: str, expression: Callable[[Local], SX], local: Local) -> QuantityKernel:
    return QuantityKernel(
        local, asked(name, "expression", lambda: ca.densify(SX(expression(local))))
    )


@lru_cache(maxsize=MOST_KINDS)
def _kept_values(combined: Combined, size: int, n_data: int, n_multipliers: int) -> QuantityKernel:
    local = Local(size, n_data, n_multipliers)
    return QuantityKernel(local, combined(local))
