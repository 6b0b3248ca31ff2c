"""Base class of all parts: coordinates, forces, constraints, events and appearance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.deferred import module
from beamdae.errors import BeamdaeError
from beamdae.parts.attachments import Attachment
from beamdae.parts.events import Event
from beamdae.parts.laws import Law
from beamdae.symbolic.signals import find_signals
from beamdae.symbolic.statements import (
    SX,
    ConstraintStatement,
    ForceStatement,
    Quantity,
    Variable,
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
