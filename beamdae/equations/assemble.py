"""From what the parts of a mechanism state to its equations of motion."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import (
    ConstraintTerm,
    EquationsOfMotion,
    ForceTerm,
    Observable,
)
from beamdae.errors import BeamdaeError
from beamdae.parts.mechanism import Mechanism
from beamdae.symbolic.statements import (
    SX,
    ConstraintStatement,
    ForceStatement,
    Local,
    Piece,
    Quantity,
)

Array = np.ndarray


def equations_of_motion(mechanism: Mechanism) -> EquationsOfMotion:
    """Equations of motion of a mechanism: the sum of what its parts state."""
    bodies = [p for p in mechanism.parts.values() if hasattr(p, "coordinate_names")]
    start = np.cumsum([0, *(len(b.coordinate_names) for b in bodies)])
    if start[-1] == 0:
        raise BeamdaeError("Mechanism: it needs at least one body that can move.")
    offsets = {id(b): int(s) for b, s in zip(bodies, start[:-1], strict=True)}
    forces = [
        statement
        for part in mechanism.parts.values()
        if hasattr(part, "force_statements")
        for statement in part.force_statements(mechanism.gravity)
    ]
    constraints = [joint.constraint_statement() for joint in mechanism.joints]
    time_scales = [law.time_scale for law in mechanism.laws if law.time_scale is not None]
    return build(
        q_names=tuple(f"{b.name}.{c}" for b in bodies for c in b.coordinate_names),
        q0=np.concatenate([b.initial_position for b in bodies]),
        v0=np.concatenate([b.initial_velocity for b in bodies]),
        length=_size(mechanism),
        breakpoints=tuple(sorted({b for law in mechanism.laws for b in law.breakpoints})),
        time_scale=min(time_scales) if time_scales else None,
        forces=forces,
        constraints=constraints,
        observables=mechanism.observables,
        offsets=offsets,
    )


def _size(mechanism: Mechanism) -> float:
    """Largest extent of the drawing: bodies and the points they are joined at."""
    outlines = [p.outline for p in mechanism.parts.values() if hasattr(p, "outline")]
    points = [[a.point for a in (j.a, j.b)] for j in mechanism.joints]
    everything = np.concatenate([*outlines, *(np.reshape(p, (-1, 2)) for p in points)])
    extent = float(np.max(np.ptp(everything, axis=0)))
    return extent if extent > 0.0 else 1.0


def build(
    *,
    q_names: tuple[str, ...],
    q0: Array,
    v0: Array,
    length: float,
    breakpoints: tuple[float, ...],
    time_scale: float | None,
    forces: list[ForceStatement],
    constraints: list[ConstraintStatement],
    observables: dict[str, Quantity],
    offsets: dict[int, int],
) -> EquationsOfMotion:
    """Resolve statements on bodies to terms in the global coordinates."""
    n = len(q_names)
    data: list[Array] = []

    def store(values: Array) -> slice:
        begin = sum(len(d) for d in data)
        data.append(np.asarray(values, float).ravel(order="F"))
        return slice(begin, begin + len(data[-1]))

    force_terms = [
        ForceTerm(
            s[0].kernel,
            _stack([_globally(x, n, offsets) for x in s]),
            store(_joined(s)),
            sum(x.count for x in s),
        )
        for s in _by_kernel(forces)
    ]
    constraint_terms: list[ConstraintTerm] = []
    lam_names: list[str] = []
    rows: dict[str, slice] = {}
    for statement in constraints:
        begin = len(lam_names)
        lam_names += [f"{statement.part}.{name}" for name in statement.names]
        rows[statement.part] = slice(begin, len(lam_names))
        operator = _globally(statement, n, offsets)
        constraint_terms.append(
            ConstraintTerm(statement.kernel, operator, store(statement.data), rows[statement.part])
        )
    resolved = []
    for name, quantity in observables.items():
        operator = _globally(quantity, n, offsets)
        lam_rows = rows[quantity.joint] if quantity.joint else slice(0, 0)
        function = _quantity_function(quantity, operator.shape[0], lam_rows.stop - lam_rows.start)
        resolved.append(
            Observable(name, quantity.columns, function, operator, store(quantity.data), lam_rows)
        )
    return EquationsOfMotion(
        q_names=q_names,
        lam_names=tuple(lam_names),
        q0=q0,
        v0=v0,
        p=np.concatenate(data) if data else np.zeros(0),
        length=length,
        breakpoints=breakpoints,
        time_scale=time_scale,
        observables=tuple(resolved),
        forces=tuple(force_terms),
        joints=tuple(constraint_terms),
    )


def _by_kernel(statements: list[ForceStatement]) -> list[list[ForceStatement]]:
    """Statements that share a kernel, together: they are evaluated in one map."""
    groups: dict[int, list[ForceStatement]] = {}
    for statement in statements:
        groups.setdefault(id(statement.kernel), []).append(statement)
    return list(groups.values())


def _joined(statements: list[ForceStatement]) -> Array:
    return np.concatenate([s.data for s in statements], axis=1)


def _stack(operators: list[sp.csr_array]) -> sp.csr_array:
    return operators[0] if len(operators) == 1 else sp.csr_array(sp.vstack(operators))


def _globally(statement: Any, n: int, offsets: dict[int, int]) -> sp.csr_array:
    """The pieces' operators on the global coordinates, one above the other."""
    return _stack(
        [_shifted(piece, n, offsets) for piece in statement.pieces] or [sp.csr_array((0, n))]
    )


def _shifted(piece: Piece, n: int, offsets: dict[int, int]) -> sp.csr_array:
    operator = sp.csr_array(piece.operator)
    offset = offsets.get(id(piece.owner), 0)
    parts = (operator.data, operator.indices + offset, operator.indptr)
    return sp.csr_array(parts, shape=(operator.shape[0], n))


def _quantity_function(quantity: Quantity, size: int, n_multipliers: int) -> ca.Function:
    local = Local(size, len(quantity.data), n_multipliers)
    value = ca.densify(SX(quantity.expression(local)))
    if value.shape != (len(quantity.columns), 1):
        raise BeamdaeError(
            f"a quantity must give one value for each of {quantity.columns}, "
            f"got shape {value.shape}."
        )
    return ca.Function("observed", [local.time, local.q, local.v, local.data, local.lam], [value])
