"""Parts whose forces, constraints and observables are formulas of the motion of points.

By the principle of virtual work, the load on a point is the generalized force on a point that moves
freely: its coordinates are position and rotation. Forces and reactions follow from this one rule,
also those on the ground, which has no coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.errors import require_choice
from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.part import Part
from beamdae.symbolic.formula import build_formula_kernel
from beamdae.symbolic.statements import (
    LOAD_UNITS,
    SX,
    Local,
    Piece,
    Quantity,
    Variable,
    formula_quantity,
)

FORCE = (Variable("Fx", "N"), Variable("Fy", "N"))
MOMENT = Variable("M", "N m")
LOAD = (*FORCE, MOMENT)


class PlacedPoint(NamedTuple):
    """Attachment in the current configuration.

    Attributes
    ----------
    position
        Position (x, y) in the inertial frame [m], a column.
    rotation
        Rotation of the body or section from the reference configuration [rad]; 0 for a particle.
    """

    position: SX
    rotation: SX


@dataclass(frozen=True)
class PointFormula:
    """Formula of placed points, in their local coordinates.

    The arguments of a call are the kinematics of the points, then other functions. Equal instances
    build equal expressions.

    Attributes
    ----------
    sizes
        Number of local coordinates of each point.
    build
        Function (local, points, *other functions) that returns a kernel or an expression.
    """

    sizes: tuple[int, ...]
    build: Callable[..., Any]

    def __call__(self, local: Local, *functions: Any) -> Any:
        """Return the kernel or the expression."""
        ends = np.cumsum([0, *self.sizes]).tolist()
        points = []
        for place, (first, last) in zip(functions, pairwise(ends), strict=False):
            position, rotation = place(local.q[first:last])
            points.append(PlacedPoint(position, SX(rotation)))
        return self.build(local, points, *functions[len(points) :])


def observe_points(
    points: Sequence[Attachment],
    build: Callable[..., SX],
    columns: Sequence[Variable],
    functions: Sequence[Callable[..., Any]] = (),
    is_shared: bool = True,
    **source: Any,
) -> Quantity:
    """Return a quantity of points; see `PointFormula` for `build` and the other `functions`.

    Formulas that are not shared contain functions of the user, which are not cached for other
    models. `source` are further fields of the quantity.
    """
    formula = PointFormula(tuple(point.size for point in points), build)
    places = [point.checked_kinematics for point in points]
    pieces = [point.piece for point in points]
    quantity = formula_quantity(columns, pieces, formula, [*places, *functions], **source)
    if is_shared:
        return quantity
    return replace(quantity, expression=lambda local: quantity.expression(local))


@dataclass(frozen=True)
class _Loads:
    """Loads on some of the points.

    Attributes
    ----------
    force
        Function (local, points, *other functions) that returns the generalized forces on the
        left-hand side of the equations of motion.
    places
        Indices of the points.
    rows
        Indices of the observed components for each of them, of (Fx, Fy, M).
    axes
        "inertial" or "body".
    """

    force: Callable[..., SX]
    places: tuple[int, ...]
    rows: tuple[tuple[int, ...], ...]
    axes: str

    def __call__(self, local: Local, points: Sequence[PlacedPoint], *functions: Any) -> SX:
        free = Local(len(LOAD) * len(points), local.n_data, local.n_multipliers)
        vars(free).update(time=local.time, data=local.data, lam=local.lam)
        coordinates = ca.vertsplit(free.q, len(LOAD))
        free_points = [PlacedPoint(x[: len(FORCE)], x[len(FORCE)]) for x in coordinates]
        force = -ca.densify(self.force(free, free_points, *functions))
        motion = ca.vertcat(*(x for point in points for x in point))
        motion = ca.vertcat(motion, local.dot(motion))
        loads = ca.vertsplit(ca.substitute(force, ca.vertcat(free.q, free.v), motion), len(LOAD))
        values = []
        for place, rows in zip(self.places, self.rows, strict=True):
            load = loads[place]
            if self.axes == "body":
                load = ca.vertcat(rotate(-points[place].rotation, load), load[len(FORCE)])
            values.append(load[list(rows)])
        return ca.vertcat(*values)


class PointPart(Part):
    """Part whose forces, constraints and observables are formulas of the motion of its `points`."""

    @property
    def points(self) -> dict[str, Attachment]:
        """Points in the order of arguments, by their names in messages and observables."""
        raise NotImplementedError

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        """Functions that formulas receive after the points, such as laws."""
        return ()

    @property
    def _is_shared(self) -> bool:
        """False if formulas contain functions of the user, which are not cached for other models.

        By default True: equal formulas share one kernel.
        """
        return True

    @property
    def _generalized_force(self) -> Callable[..., SX]:
        """Function (local, points, *other functions) that returns all generalized forces."""
        raise NotImplementedError

    @property
    def _source(self) -> dict[str, Any]:
        """Fields of a `Quantity` that name the source of its values."""
        raise NotImplementedError

    @property
    def _sizes(self) -> tuple[int, ...]:
        return tuple(point.size for point in self.points.values())

    @property
    def _pieces(self) -> tuple[Piece, ...]:
        return tuple(point.piece for point in self.points.values())

    def _arguments(
        self, build: Callable[..., Any], functions: Sequence[Callable[..., Any]]
    ) -> tuple[PointFormula, tuple[Callable[..., Any], ...]]:
        """Return a formula and the functions to pass to it."""
        places = (point.checked_kinematics for point in self.points.values())
        return PointFormula(self._sizes, build), (*places, *functions)

    def _build_kernel(
        self,
        build: Callable[..., Any],
        functions: Sequence[Callable[..., Any]],
        n_multipliers: int = 0,
    ) -> tuple[Any, np.ndarray]:
        """Return the kernel of a formula and its data."""
        return build_formula_kernel(
            *self._arguments(build, functions), sum(self._sizes), n_multipliers, self._is_shared
        )

    def _observe(self, build: Callable[..., SX], columns: tuple[Variable, ...]) -> Quantity:
        """Return a quantity of the points; see `PointFormula` for `build`."""
        is_force = all(x.unit in LOAD_UNITS for x in columns)
        return observe_points(
            tuple(self.points.values()),
            build,
            columns,
            self._functions,
            self._is_shared,
            is_elastic=self.is_elastic and is_force,
            **self._source,
        )

    def _observe_load(self, place: str, axes: str) -> Quantity:
        """Return force Fx, Fy [N] and moment M [N m] on the body of a point, acting there."""
        require_choice(self.name, "place", place, tuple(self.points))
        require_choice(self.name, "axes", axes, ("inertial", "body"))
        columns = LOAD if self.points[place].has_angle else FORCE
        return self._observe_loads({place: tuple(range(len(columns)))}, columns, axes)

    def _observe_loads(
        self,
        rows: dict[str, tuple[int, ...]],
        columns: tuple[Variable, ...],
        axes: str = "inertial",
    ) -> Quantity:
        """Return components of the loads on points; `rows` are their indices by point."""
        places = tuple(list(self.points).index(place) for place in rows)
        loads = _Loads(self._generalized_force, places, tuple(rows.values()), axes)
        return self._observe(loads, columns)
