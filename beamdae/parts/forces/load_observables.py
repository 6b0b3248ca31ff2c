"""Observables of loads on whole beams, derived from their force statements.

By the principle of virtual work, a statement with generalized forces F on the left-hand side of the
equations of motion does the work -F . dq on a virtual displacement dq. With dq = v dt, this is the
power; with dq a rigid motion of the beam, the components of the resultant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.parts.part import FORCE, MOMENT, Part
from beamdae.symbolic.signals import SignalNumbers
from beamdae.symbolic.statements import (
    SX,
    ForceKernel,
    ForceStatement,
    Local,
    Piece,
    Quantity,
    Variable,
    rebuilt_for_mesh,
)

POWER = Variable("power", "W")


class _Copy(NamedTuple):
    """Generalized forces f = -F of one copy of a kernel, on its local coordinates.

    Attributes
    ----------
    force, v
        Generalized forces and velocities, (size,).
    rows
        Rows of the local coordinates among those of all copies.
    """

    force: SX
    v: SX
    rows: list[int]


@dataclass(frozen=True, eq=False)
class LoadValues:
    """Values computed from all copies of the kernels of a part.

    Attributes
    ----------
    forces
        Function (time, q, v, lam, data) -> generalized forces f = -F of one copy, for each
        statement. Unlike kernels, functions can be copied and pickled.
    sizes
        Number of local coordinates of one copy for each piece of each statement.
    counts
        Number of copies of each statement.
    combine
        Function from the list of all copies to the column of values.
    operator
        Maps the coordinates of the quantity to those of all copies; None if they are the same.
    signals
        Signals without coordinates in the data of each statement. The values contain their symbols,
        so that they follow changes of an input.
    """

    forces: tuple[ca.Function, ...]
    sizes: tuple[tuple[int, ...], ...]
    counts: tuple[int, ...]
    combine: Callable[[list[_Copy], Local], SX]
    operator: ca.DM | None
    signals: tuple[tuple[SignalNumbers, ...], ...]

    def __call__(self, local: Local) -> SX:
        """Return the column of values."""
        copies, first, first_data = [], 0, 0
        all_q, all_v = (
            x if self.operator is None else ca.mtimes(self.operator, x) for x in (local.q, local.v)
        )
        for function, sizes, count, signals in zip(
            self.forces, self.sizes, self.counts, self.signals, strict=True
        ):
            n_data = function.size1_in("data")
            # The operator of a piece stacks the rows of all copies.
            starts = first + count * np.cumsum([0, *sizes])
            for copy in range(count):
                rows = [
                    row
                    for start, size in zip(starts, sizes, strict=False)
                    for row in range(start + copy * size, start + (copy + 1) * size)
                ]
                data = SX(local.data[first_data : first_data + n_data])
                for signal, numbers in signals:
                    data[numbers] = signal.value_symbol
                first_data += n_data
                q, v = all_q[rows], all_v[rows]
                force = ca.densify(function(local.time, q, v, local.lam, data))
                copies.append(_Copy(force, v, rows))
            first = int(starts[-1])
        return self.combine(copies, local)

    def use_statements(self, quantity: Quantity, statements: Sequence[ForceStatement]) -> Quantity:
        """Return the quantity computed from the assembled forces of its part."""
        body = None if self.operator is None else quantity.pieces[0].owner
        part = str(quantity.load_of)
        built = _observe(part, statements, quantity.columns, self.combine, body=body)
        return replace(quantity, pieces=built.pieces, expression=built.expression, data=built.data)


def _observe(
    part: str,
    statements: Sequence[ForceStatement],
    columns: tuple[Variable, ...],
    combine: Callable[[list[_Copy], Local], SX],
    body: Part | None = None,
) -> Quantity:
    """Return a quantity computed by `combine` from the copies of all statements of `part`.

    If `body` is given, it owns all pieces, and its coordinates are those of the quantity.
    """
    statements = [copy for s in statements for copy in s.separate_copies]
    pieces = tuple(piece for s in statements for piece in s.pieces)
    operator = None
    if body is not None:
        operator = _stack_operators(statements)
        pieces = (Piece(body, sp.csr_array(sp.eye_array(operator.shape[1]))),)
    values = LoadValues(
        tuple(_force_function(s.kernel) for s in statements),
        tuple(tuple(p.operator.shape[0] // s.count for p in s.pieces) for s in statements),
        tuple(s.count for s in statements),
        combine,
        operator,
        tuple(tuple(x for x in s.signals if not x.signal.rows) for s in statements),
    )
    return Quantity(
        columns,
        pieces,
        values,
        np.concatenate([np.zeros(0), *(s.data.ravel(order="F") for s in statements)]),
        load_of=part,
    )


def _force_function(kernel: ForceKernel) -> ca.Function:
    x = kernel.local
    names = ["time", "q", "v", "lam", "data"]
    return ca.Function(
        "force", [x.time, x.q, x.v, x.lam, x.data], [-kernel.force], names, ["force"]
    )


def _stack_operators(statements: Sequence[ForceStatement]) -> ca.DM:
    operators = [piece.operator for s in statements for piece in s.pieces]
    return ca.DM(sp.csc_matrix(sp.vstack(operators)))


def _sum_powers(copies: list[_Copy], local: Local) -> SX:
    return sum((ca.dot(copy.force, copy.v) for copy in copies), start=SX(0))


class ObservablePower(Part):
    """Part with observable power, from its force statements by the principle of virtual work."""

    @property
    @rebuilt_for_mesh
    def power(self) -> Quantity:
        """Power [W] of all forces of the part, the rate of the work done on the mechanism.

        In the energy balance, its integral is the work of loads minus the dissipated energy and the
        increase of the strain energy of the part.
        """
        return _observe(self.name, self.forces(np.zeros(2)), (POWER,), _sum_powers)


class ObservableBeamLoad(ObservablePower):
    """Load distributed over a beam, whose resultant and power can be observed."""

    # A beam, whose kinematics have a method `rigid_motions`.
    beam: Any

    @property
    @rebuilt_for_mesh
    def force(self) -> Quantity:
        """Resultant force Fx, Fy [N] on the beam, in the inertial frame."""
        return self._observe_resultant(FORCE, slice(0, 2))

    @property
    @rebuilt_for_mesh
    def moment(self) -> Quantity:
        """Resultant moment M [N m] about the start of the beam, counter-clockwise."""
        return self._observe_resultant((MOMENT,), slice(2, 3))

    def _observe_resultant(self, columns: tuple[Variable, ...], rows: slice) -> Quantity:
        statements = self.forces(np.zeros(2))

        def combine(copies: list[_Copy], local: Local) -> SX:
            motions = self.beam.kinematics.rigid_motions(local.q)[:, rows]
            operator = _stack_operators(statements)
            forces = ca.vertcat(*(copy.force for copy in copies))
            order = [row for copy in copies for row in copy.rows]
            return ca.mtimes(ca.mtimes(operator, motions)[order, :].T, forces)

        return _observe(self.name, statements, columns, combine, body=self.beam)
