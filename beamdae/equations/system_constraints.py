"""Constraints of a system that is stated in expressions: of positions, and of velocities alone."""

from __future__ import annotations

from typing import Any

import casadi as ca

from beamdae.equations.expressions import KIND, Expressions, column
from beamdae.equations.statement_checks import require_unique
from beamdae.errors import BeamdaeError
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    Named,
    NonholonomicKernel,
    Piece,
)

# What multipliers are named after.
CONSTRAINT = "constraint"


def constraint_statements(
    given: Expressions, piece: Piece, constraints: Any, velocity_constraints: Any
) -> list[ConstraintStatement]:
    """The constraints there are, each an expression, a dict of them by name, or None.

    Raises
    ------
    BeamdaeError
        On two of a name, those of positions that depend on v, or those of velocities that are not
        linear in v.
    """
    found = []
    for stated, what, letter in ((constraints, "constraint", "g"), (velocity_constraints, _V, "h")):
        local, rows, held = _stated(given, stated, what, letter)
        if not held:
            continue
        kind = ConstraintKernel
        if what == _V:
            kind = NonholonomicKernel
            _require_linear(rows, local)
        elif ca.depends_on(rows, local.v):
            raise BeamdaeError(f"{KIND}: constraints must not depend on v.")
        kernel, data = kind(local, rows), given.numbers[:, None]
        found.append(ConstraintStatement(CONSTRAINT, kernel, (piece,), held, data))
    require_unique(KIND, "constraints", [x.name for s in found for x in s.multipliers])
    return found


_V = "velocity constraint"


def _stated(
    given: Expressions, stated: Any, what: str, letter: str
) -> tuple[Local, SX, tuple[Named, ...]]:
    """Rows of constraints in symbols with multipliers for them, and what these are called."""
    by_name = isinstance(stated, dict)
    if by_name:
        named = {column(header): expression for header, expression in stated.items()}
        told = [f"the {what} {x.name}" for x in named]
    else:
        named = {} if stated is None else {Named(letter, "-"): stated}
        told = [f"{what.replace(' ', '_')}s"]
    local = given.local()
    found = [given.stated(local, x, name) for x, name in zip(named.values(), told, strict=False)]
    rows = ca.vertcat(SX(0, 1), *(ca.vec(x) for x in found))
    held = tuple(
        Named(x.name if by_name and rows_of.numel() == 1 else f"{x.name}{i}", x.unit)
        for x, rows_of in zip(named, found, strict=True)
        for i in range(rows_of.numel())
    )
    own = given.local(len(held))
    symbols = [(x.time, x.q, x.v, x.data) for x in (local, own)]
    (moved,) = ca.substitute([ca.densify(rows)], *map(list, symbols))
    return own, moved, held


def _require_linear(rows: SX, local: Local) -> None:
    if not ca.is_linear(rows, local.v) or not ca.depends_on(rows, local.v):
        raise BeamdaeError(f"{KIND}: velocity_constraints must be linear in v.")
