"""Base classes of all parts, and of parts whose forces are formulas of the motion of points.

Parts have coordinates, forces, constraints, events and an appearance. By the principle of virtual
work, the load on a point is the generalized force on a point that moves freely: its coordinates are
position and rotation. Forces and reactions of a `PointPart` follow from this one rule, also those
on the ground, which has no coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.deferred import module
from beamdae.errors import BeamdaeError, require_choice
from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.events import Event
from beamdae.parts.laws import Law
from beamdae.symbolic.formula import build_formula_kernel
from beamdae.symbolic.signals import find_signals
from beamdae.symbolic.statements import (
    LOAD_UNITS,
    SX,
    ConstraintStatement,
    ForceStatement,
    Local,
    Piece,
    Quantity,
    Variable,
    formula_quantity,
)

Array = np.ndarray
_PACKAGE = __name__.partition(".")[0]


class Drawing(NamedTuple):
    """Drawing of a body.

    Attributes
    ----------
    kind
        "beam", "rigid", "point" or "ground".
    places
        Attachments at the points of the drawing; for beams and rigid bodies, in order along the
        line to be drawn.
    """

    kind: str
    places: list[Attachment]


class AttachedPart(NamedTuple):
    """A part and one of its attachments."""

    part: Part
    attachment: Attachment


class SurfaceGap(NamedTuple):
    """Distance of a point from a surface, negative during penetration.

    Attributes
    ----------
    quantity
        Quantity with one column, the gap [m].
    point
        Name of what touches the surface.
    remedy
        Clause of a message that explains how to start without penetration.
    """

    quantity: Quantity
    point: str
    remedy: str


class RegularizedFriction(NamedTuple):
    """Friction of a part, regularized near zero velocity.

    Attributes
    ----------
    speed
        Regularization velocity [m/s].
    radius
        Radius of a bearing or guide [m]; None if the friction does not depend on it.
    """

    speed: float
    radius: float | None = None


class Part:
    """Base class of bodies, joints and forces.

    Subclasses override the properties and methods that apply to them; the defaults are empty.
    Assembly rejects a part that has neither coordinates nor forces nor constraints, and statements
    that do not fit the bodies to which they refer.

    Attributes
    ----------
    name
        Unique name in the mechanism, of at most 100 printable characters. A name must not start
        with =, +, - or @, contain [ or ], or start or end with a space.
    is_load
        True for loads. By default, the load factor of an equilibrium scales gravity and all active
        loads whose laws do not depend on states or sensors.
    symbol
        Name of the symbol of the part in drawings. Defaults to a diamond at each attachment.
    """

    name: str
    is_load: ClassVar[bool] = False
    # One of the keys of the table in `beamdae.report.scene.symbols`.
    symbol: ClassVar[str] = "marker"
    # How to write a point of a body, in messages about a body in place of its point.
    point_syntax: ClassVar[str] = ""

    # True for sampled controllers, which drive inputs of the mechanism.
    is_controller: ClassVar[bool] = False
    # True if the part loads its `beam` at an arc length that changes during a run.
    moves_along_beam: ClassVar[bool] = False

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """Attachments among the fields of the part and in nested lists and dictionaries."""
        return tuple(value for value in self._values if isinstance(value, Attachment))

    @property
    def bodies(self) -> tuple[Part, ...]:
        """Parts among the fields of the part, and the bodies of its attachments."""
        parts = tuple(value for value in self._values if isinstance(value, Part))
        return parts + tuple(attachment.body for attachment in self.attachments)

    @property
    def _values(self) -> list[Any]:
        # A dataclass with slots has no `vars` for its fields.
        kind: Any = type(self)
        names = _field_names(kind)
        return _flatten({name: getattr(self, name) for name in names} | vars(self))

    @property
    def coordinates(self) -> tuple[Variable, ...]:
        """Name and unit of each generalized coordinate; angles have the unit "rad"."""
        return ()

    @property
    def rigid_coordinate_count(self) -> int:
        """Number of leading coordinates that describe a rigid motion; by default all."""
        return len(self.coordinates)

    @property
    def frame_follows_section(self) -> bool:
        """True if the body has a floating frame that moves with one of its sections."""
        return False

    @property
    def initial_position(self) -> Array:
        """Values of the n coordinates in the reference configuration, shape (n,)."""
        return np.zeros(0)

    @property
    def initial_velocity(self) -> Array:
        """Initial rates of the n coordinates, shape (n,), not yet consistent with the joints."""
        return np.zeros(0)

    @property
    def given_velocities(self) -> tuple[bool, bool]:
        """True if the fields `velocity` and `angular_velocity` exist and are not None.

        Given velocities are kept if the joints allow it; so are those that are not zero.
        """
        linear, angular = (getattr(self, x, None) for x in ("velocity", "angular_velocity"))
        return linear is not None, angular is not None

    @property
    def is_state(self) -> bool:
        """True if the coordinates are first-order states x, whose rows of F are x' - f."""
        return False

    @property
    def scale(self) -> float | None:
        """Typical size of the coordinates; None (default) for bodies, whose outline defines it."""
        return None

    @property
    def outline(self) -> Array:
        """Points that span the extent of the part in the reference configuration, (k, 2) [m]."""
        return np.zeros((0, 2))

    @property
    def laws(self) -> tuple[Law, ...]:
        """Time laws on which the part depends; integrators restart at their breakpoints."""
        return ()

    @property
    def is_controlled(self) -> bool:
        """True if a law of the part depends on states or sensors."""
        return any(signal.rows for law in self.laws for signal in find_signals(law(SX.zeros(2))))

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Name and unit of each input of linearized models; empty if the part has no inputs.

        Otherwise, the field `law` of the part, a dataclass, is the law of its only input, or a pair
        of laws.
        """
        return ()

    def forces(self, gravity: Array) -> Sequence[ForceStatement]:
        """Return the forces of the part: inertia, elasticity, damping, weight, loads.

        Parameters
        ----------
        gravity
            Acceleration of gravity, shape (2,) [m/s^2].
        """
        return ()

    def constraints(self) -> Sequence[ConstraintStatement]:
        """Return the constraints of the part."""
        return ()

    def gap_size(self, gap: float, t: float) -> float:
        """Return the gap [m or rad] at a value of a constraint and a time [s], for messages."""
        return abs(gap)

    @property
    def load_distribution(self) -> str:
        """Distribution of the forces along a beam, used to recover section forces.

        "points": each force acts at its attachment, or on the axes of elements. "line": the forces
        act along the curve. "shares": the forces are shares of a single force that acts between
        their attachments. "none": the forces are internal forces of the beam.
        """
        return "points"

    @property
    def events(self) -> Sequence[Event]:
        """Events of the part, in addition to the events added by `Mechanism.when`."""
        return ()

    @property
    def regularized_friction(self) -> RegularizedFriction | None:
        """Friction of the part, with its speed in the field `friction_speed`; None without it."""
        return None

    @property
    def is_elastic(self) -> bool:
        """True for springs, dampers and bushings without formulas of the user."""
        return False

    @property
    def gaps(self) -> Sequence[SurfaceGap]:
        """Gaps of penalty forces, for contact onsets and warnings about initial penetrations."""
        return ()

    @property
    def acts_between_attachments(self) -> bool:
        """True if the forces do no work in a rigid motion of all attachments together.

        A part between two points of one rigid body then does nothing.
        """
        return False

    def _prolongation_to(self, fine: Part) -> sp.csc_array:
        """Return the matrix that maps changes of coordinates to those of a copy, (n', n).

        Copies may refer to beams with finer meshes. By default, coordinates stay the same.
        """
        return sp.eye_array(len(self.coordinates), format="csc")

    def _prepare(
        self, attached: Sequence[AttachedPart], has_fixed_coordinates: bool
    ) -> bool | None:
        """Adapt the coordinates to the parts attached to this part, before an assembly.

        Return False if the coordinates did not change; otherwise, quantities are rebuilt.

        Parameters
        ----------
        attached
            Attachments on this part, with the parts that refer to them.
        has_fixed_coordinates
            True if the coordinates must not change, because the start or a quantity that cannot be
            rebuilt refers to them.
        """
        return False

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing | None:
        """Return the drawing of a body, or None if the part is drawn by its `symbol`.

        Parameters
        ----------
        attached
            Attachments of the part that other parts refer to.
        points
            Number of points along a curve.
        """
        return None


@cache
def require_extension(kind: Any) -> None:
    """Raise an error if a class outside beamdae has an unknown symbol or replaces private names."""
    bases = [x for x in kind.__mro__ if x.__module__.partition(".")[0] == _PACKAGE]
    own = [x for x in kind.__mro__ if x not in (*bases, object)]
    if not own:
        return
    for x in own:
        for name in (*vars(x), *vars(x).get("__annotations__", ())):
            base = next((b for b in bases if name in vars(b)), None)
            is_private = name.startswith("_") and not name.startswith(("__", "_abc_"))
            if base is not None and is_private:
                raise BeamdaeError(
                    f"{kind.__name__}: the name {name} replaces a private name of "
                    f"{base.__name__}; choose another name."
                )
    if not isinstance(kind.symbol, property):
        module("report.scene.symbols").require_symbol(kind.__name__, kind.symbol)


@cache
def _field_names(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else ()


@cache
def _is_container(kind: type) -> bool:
    # Named tuples such as statements are values, not lists.
    return issubclass(kind, (list, set, frozenset, dict)) or kind is tuple


def _flatten(value: Any) -> list[Any]:
    """Return the entries of a list, tuple, set or dictionary, and of those inside it."""
    leaves: list[Any] = []
    for entry in value.values() if isinstance(value, dict) else value:
        kind: Any = type(entry)
        if _is_container(kind):
            leaves += _flatten(entry)
        else:
            leaves.append(entry)
    return leaves


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
