"""Observables of loads and force elements, derived from their force statements.

One rule, the principle of virtual work, serves all parts: a statement with generalized forces F on
the left-hand side of the equations of motion does the work -F . dq on a virtual displacement dq.
With dq = v dt, this is the power; with dq a rigid motion of the loaded body, the components of the
resultant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import BeamdaeError, require_choice
from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.part import Part
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

FORCE = (Variable("Fx", "N"), Variable("Fy", "N"))
_MOMENT = Variable("M", "N m")
_POWER = Variable("power", "W")


class _Copy(NamedTuple):
    """Generalized forces f = -F of one copy of a kernel, on its local coordinates.

    Attributes
    ----------
    force, q, v
        Generalized forces, coordinates and velocities, (size,).
    rows
        Rows of the local coordinates among those of all copies.
    sizes
        Number of local coordinates of each piece.
    """

    force: SX
    q: SX
    v: SX
    rows: list[int]
    sizes: tuple[int, ...]

    def of_piece(self, k: int) -> tuple[SX, SX]:
        """Return the generalized forces and the coordinates of piece number `k`."""
        first, last = list(pairwise(np.cumsum([0, *self.sizes]).tolist()))[k]
        return self.force[first:last], self.q[first:last]


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
                copies.append(_Copy(force, q, v, rows, sizes))
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
    joint_part: Part | None = None,
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
        statements[0].joint,
        joint_part,
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


def resultant_at(kinematics: Callable[[SX], Any], force: SX, q: SX, has_angle: bool) -> SX:
    """Return (Fx, Fy) or (Fx, Fy, M) at a point, given the generalized forces J^T (Fx, Fy, M).

    J is the Jacobian of position and rotation. The rotation is the first column of the QR
    factorization of J^T: then a long arm from a body's center to the point causes no cancellation.
    """
    position, rotation = kinematics(q)
    placement = ca.vertcat(rotation, position) if has_angle else position
    orthogonal, triangular = ca.qr(ca.densify(ca.jacobian(placement, q)).T)
    components = ca.solve(triangular, ca.mtimes(orthogonal.T, force))
    return ca.vertcat(components[1:], components[0]) if has_angle else components


class LoadedPoint(NamedTuple):
    """Point at which a part exerts a load.

    Attributes
    ----------
    at
        The point.
    piece
        Index of the piece of the statement with the local coordinates of the point.
    """

    at: Attachment
    piece: int


class ObservablePower(Part):
    """Part with observable power, from its force statements by the principle of virtual work."""

    @property
    def _joint(self) -> Part | None:
        """Joint on whose reactions the forces depend."""
        return None

    def _observe_forces(
        self, columns: tuple[Variable, ...], combine: Callable[[list[_Copy], Local], SX]
    ) -> Quantity:
        """Return a quantity computed by `combine` from the copies of all statements."""
        return _observe(self.name, self.forces(np.zeros(2)), columns, combine, self._joint)

    @property
    @rebuilt_for_mesh
    def power(self) -> Quantity:
        """Power [W] of all forces of the part, the rate of the work done on the mechanism.

        In the energy balance, its integral is the work of loads minus the dissipated energy and the
        increase of the strain energy of the part.
        """
        return self._observe_forces((_POWER,), _sum_powers)


class ObservableBeamLoad(ObservablePower):
    """Load distributed over a beam, whose resultant and power can be observed."""

    # Beam with a method `rigid_motions`, see `beamdae.beams.kinematics.Kinematics`.
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
        return self._observe_resultant((_MOMENT,), slice(2, 3))

    def _observe_resultant(self, columns: tuple[Variable, ...], rows: slice) -> Quantity:
        statements = self.forces(np.zeros(2))

        def combine(copies: list[_Copy], local: Local) -> SX:
            motions = self.beam.rigid_motions(local.q)[:, rows]
            operator = _stack_operators(statements)
            forces = ca.vertcat(*(copy.force for copy in copies))
            order = [row for copy in copies for row in copy.rows]
            return ca.mtimes(ca.mtimes(operator, motions)[order, :].T, forces)

        return _observe(self.name, statements, columns, combine, body=self.beam)


class ObservableLoad(ObservablePower):
    """Part with loads at points, which can be observed together with their power."""

    @property
    def loaded_points(self) -> dict[str, LoadedPoint]:
        """Points at which the part exerts loads, by their names in `load_on`."""
        raise NotImplementedError

    @property
    def observed_points(self) -> tuple[str, ...]:
        """Names of the points to which `force` and `moment` refer; by default the last one."""
        return tuple(self.loaded_points)[-1:]

    @rebuilt_for_mesh
    def load_on(self, place: str, axes: str = "inertial") -> Quantity:
        """Return force Fx, Fy [N] and moment M [N m] on the body of a point, acting at this point.

        The load on a particle has no moment.

        Parameters
        ----------
        place
            Name of the point: "a" or "b" for elements between two points and friction, "point" or
            "surface" for a contact, "on" for a load at one point, "reaction_on" for the second body
            of a moment, "1", "2", ... for a force law with several attachments.
        axes
            "inertial", or "body" for axes that rotate with the body (or with the section of a
            beam); in the reference configuration, these are the inertial axes.

        Raises
        ------
        BeamdaeError
            If `place` is not the name of a point, the point belongs to the ground, or `axes` is
            invalid.
        """
        points = self.loaded_points
        require_choice(self.name, "place", place, tuple(points))
        require_choice(self.name, "axes", axes, ("inertial", "body"))
        at = self._require_coordinates(place)
        columns = (*FORCE, *([_MOMENT] if at.has_angle else []))
        return self._observe_points([place], columns, slice(None), axes, is_numbered=False)

    @property
    @rebuilt_for_mesh
    def force(self) -> Quantity:
        """Force Fx, Fy [N] on the loaded body, in the inertial frame.

        With several loaded points, the columns are Fx1, Fy1, Fx2, ...
        """
        places = self._places(needs_angle=False)
        return self._observe_points(places, FORCE, slice(0, 2))

    @property
    @rebuilt_for_mesh
    def moment(self) -> Quantity:
        """Moment M [N m] on the loaded body about the loaded point, counter-clockwise.

        With several loaded points that have an angle, the columns are M1, M2, ...

        Raises
        ------
        BeamdaeError
            If the part acts on particles only, which have no angle.
        """
        places = self._places(needs_angle=True)
        return self._observe_points(places, (_MOMENT,), slice(2, 3))

    def _places(self, needs_angle: bool) -> list[str]:
        places = list(self.observed_points)
        if len(places) == 1:
            self._require_coordinates(places[0])
        points = {place: self.loaded_points[place].at for place in places}
        places = [place for place, at in points.items() if at.size]
        if not needs_angle:
            return places
        places = [place for place in places if points[place].has_angle]
        if not places:
            first = next(iter(points.values()))
            raise BeamdaeError(
                f"{self.name}: {first} is a particle without an angle, so there is no moment on "
                "it; observe the force."
            )
        return places

    def _require_coordinates(self, place: str) -> Attachment:
        at = self.loaded_points[place].at
        if not at.size:
            others = [name for name, x in self.loaded_points.items() if x.at.size]
            raise BeamdaeError(
                f"{self.name}: the point {place!r} belongs to the ground, whose load is not "
                f"computed; observe load_on({others[0]!r})."
            )
        return at

    def _observe_points(
        self,
        places: Sequence[str],
        columns: tuple[Variable, ...],
        rows: slice,
        axes: str = "inertial",
        is_numbered: bool = True,
    ) -> Quantity:
        points = [self.loaded_points[place] for place in places]

        def combine(copies: list[_Copy], local: Local) -> SX:
            (copy,) = copies
            values = []
            for at, piece in points:
                force, q = copy.of_piece(piece)
                load = resultant_at(at.checked_kinematics, force, q, at.has_angle)
                if axes == "body":
                    _, rotation = at.checked_kinematics(q)
                    load = ca.vertcat(rotate(-SX(rotation), load), load[2:])
                values.append(load[rows])
            return ca.vertcat(*values)

        numbered = is_numbered and len(self.observed_points) > 1
        all_columns = tuple(
            Variable(f"{x.name}{place}" if numbered else x.name, x.unit)
            for place in places
            for x in columns
        )
        return self._observe_forces(all_columns, combine)
