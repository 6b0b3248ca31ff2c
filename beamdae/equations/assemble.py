"""From what the parts of a mechanism state to its equations of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import (
    ConstraintTerm,
    EquationsOfMotion,
    ForceTerm,
    Observable,
)
from beamdae.equations.fit import require_body_fits, require_pieces_fit, require_statements_fit
from beamdae.errors import BeamdaeError
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.sparse_sums import constant
from beamdae.symbolic.statements import (
    SX,
    ConstraintStatement,
    ForceStatement,
    Local,
    Named,
    Piece,
    Quantity,
)

Array = np.ndarray


@dataclass(frozen=True)
class Owners:
    """Whose coordinates stand where among those of all; the ground has none."""

    sizes: dict[int, int]

    @cached_property
    def offsets(self) -> dict[int, int]:
        """First coordinate of each owner."""
        starts = np.cumsum([0, *self.sizes.values()])[:-1]
        return dict(zip(self.sizes, starts.tolist(), strict=True))

    @cached_property
    def n(self) -> int:
        """Number of coordinates."""
        return sum(self.sizes.values())

    def globally(self, pieces: Sequence[Piece]) -> sp.csr_array:
        """The operators of the pieces on all coordinates, one above the other."""
        return _stack([self._shifted(piece) for piece in pieces] or [sp.csr_array((0, self.n))])

    def _shifted(self, piece: Piece) -> sp.csr_array:
        operator = sp.csr_array(piece.operator)
        offset = self.offsets[id(piece.owner)]
        parts = (operator.data, operator.indices + offset, operator.indptr)
        return sp.csr_array(parts, shape=(operator.shape[0], self.n))


def equations_of_motion(mechanism: Mechanism) -> EquationsOfMotion:
    """Equations of motion of a mechanism: the sum of what its parts state.

    Raises
    ------
    BeamdaeError
        If nothing can move, a part has nothing to say, or states what does not fit its bodies.
    """
    parts = list(mechanism.parts.values())
    for part in parts:
        require_body_fits(part)
    owners = _owners(mechanism)
    if owners.n == 0:
        raise BeamdaeError("Mechanism: it needs at least one body that can move.")
    forces: list[ForceStatement] = []
    constraints: list[ConstraintStatement] = []
    # Points that tell the size of the drawing: those of the bodies, and where they are joined.
    drawn = [part.outline for part in parts]
    for part in parts:
        own_forces, held = list(part.forces(mechanism.gravity)), list(part.constraints())
        require_statements_fit(part, own_forces, held, owners.sizes)
        forces += own_forces
        constraints += held
        if held:
            drawn += [np.reshape(attachment.point, (1, 2)) for attachment in part.attachments]
    for name, quantity in mechanism.observables.items():
        require_pieces_fit(name, quantity.pieces, owners.sizes)
    extent = float(np.max(np.ptp(np.concatenate(drawn), axis=0)))
    time_scales = [law.time_scale for law in mechanism.laws if law.time_scale is not None]
    return build(
        coordinates=tuple(
            Named(f"{part.name}.{c.name}", c.unit) for part in parts for c in part.coordinates
        ),
        q0=np.concatenate([part.initial_position for part in parts]),
        v0=np.concatenate([part.initial_velocity for part in parts]),
        length=extent if extent > 0.0 else 1.0,
        breakpoints=tuple(sorted({b for law in mechanism.laws for b in law.breakpoints})),
        time_scale=min(time_scales) if time_scales else None,
        forces=forces,
        constraints=constraints,
        observables=mechanism.observables,
        owners=owners,
    )


def positions(mechanism: Mechanism, places: Sequence[Attachment]) -> RowFunction:
    """All coordinates of a mechanism -> (x, y) of the places, one after the other."""
    owners = _owners(mechanism)
    q = ca.SX.sym("q", owners.n)
    own = {key: q[first : first + owners.sizes[key]] for key, first in owners.offsets.items()}
    found = [place.position(constant(place.operator) @ own[id(place.body)]) for place in places]
    return RowFunction(ca.Function("positions", [q], [ca.densify(ca.vertcat(*found))]))


def _owners(mechanism: Mechanism) -> Owners:
    owners: list[Part] = [mechanism.ground, *mechanism.parts.values()]
    return Owners({id(part): len(part.coordinates) for part in owners})


def build(
    *,
    coordinates: tuple[Named, ...],
    q0: Array,
    v0: Array,
    length: float,
    breakpoints: tuple[float, ...],
    time_scale: float | None,
    forces: list[ForceStatement],
    constraints: list[ConstraintStatement],
    observables: dict[str, Quantity],
    owners: Owners,
) -> EquationsOfMotion:
    """Resolve statements on bodies to terms in the global coordinates."""
    numbers = _Numbers()
    force_terms = [
        ForceTerm(
            alike[0].kernel,
            _stack([owners.globally(statement.pieces) for statement in alike]),
            numbers.store(np.concatenate([statement.data for statement in alike], axis=1)),
            sum(statement.count for statement in alike),
        )
        for alike in _by_kernel(forces)
    ]
    held = [Named(f"{s.part}.{x.name}", x.unit) for s in constraints for x in s.multipliers]
    ends = np.cumsum([0, *(len(statement.multipliers) for statement in constraints)]).tolist()
    constraint_terms = [
        ConstraintTerm(
            statement.kernel,
            owners.globally(statement.pieces),
            numbers.store(statement.data),
            slice(first, last),
        )
        for statement, (first, last) in zip(constraints, pairwise(ends), strict=True)
    ]
    rows: dict[str, slice] = {}
    for statement, term in zip(constraints, constraint_terms, strict=True):
        # A part may state several constraints, one after the other.
        rows[statement.part] = slice(rows.get(statement.part, term.rows).start, term.rows.stop)
    observed = [
        _observable(name, quantity, owners, numbers, rows) for name, quantity in observables.items()
    ]
    return EquationsOfMotion(
        coordinates=coordinates,
        multipliers=tuple(held),
        q0=q0,
        v0=v0,
        p=numbers.all,
        length=length,
        breakpoints=breakpoints,
        time_scale=time_scale,
        observables=tuple(observed),
        forces=tuple(force_terms),
        joints=tuple(constraint_terms),
    )


class _Numbers:
    """The numbers of the model, one after the other."""

    def __init__(self) -> None:
        self._stored: list[Array] = []

    @property
    def all(self) -> Array:
        return np.concatenate([np.zeros(0), *self._stored])

    def store(self, values: Array) -> slice:
        """Where the values are from now on, column after column."""
        begin = sum(len(stored) for stored in self._stored)
        self._stored.append(np.asarray(values, float).ravel(order="F"))
        return slice(begin, begin + len(self._stored[-1]))


def _by_kernel(statements: list[ForceStatement]) -> list[list[ForceStatement]]:
    """Statements that share a kernel, together: they are evaluated in one map."""
    groups: dict[int, list[ForceStatement]] = {}
    for statement in statements:
        groups.setdefault(id(statement.kernel), []).append(statement)
    return list(groups.values())


def _stack(operators: list[sp.csr_array]) -> sp.csr_array:
    return operators[0] if len(operators) == 1 else sp.csr_array(sp.vstack(operators))


def _observable(
    name: str, quantity: Quantity, owners: Owners, numbers: _Numbers, rows: dict[str, slice]
) -> Observable:
    if quantity.joint is not None and quantity.joint not in rows:
        raise BeamdaeError(f"{name}: {quantity.joint!r} holds nothing, it has no reaction.")
    lam_rows = slice(0, 0) if quantity.joint is None else rows[quantity.joint]
    operator = owners.globally(quantity.pieces)
    local = Local(operator.shape[0], len(quantity.data), lam_rows.stop - lam_rows.start)
    value = ca.densify(SX(quantity.expression(local)))
    if value.shape != (len(quantity.columns), 1):
        columns = ", ".join(column.name for column in quantity.columns)
        raise BeamdaeError(
            f"{name}: the quantity must give one value for each of {columns}, "
            f"got shape {value.shape}."
        )
    inputs = [local.time, local.q, local.v, local.data, local.lam]
    function = ca.Function("observed", inputs, [value])
    return Observable(
        name, quantity.columns, function, operator, numbers.store(quantity.data), lam_rows
    )
