"""What a mechanism asks of every part, whatever it is: one protocol, empty by default."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from beamdae.parts.attachments import Attachment
from beamdae.parts.events import Event
from beamdae.parts.laws import Law
from beamdae.symbolic.statements import (
    ConstraintStatement,
    ForceStatement,
    Named,
    RangeStatement,
)

Array = np.ndarray


class Drawing(NamedTuple):
    """How a part is drawn: its kind, and the points it is drawn through."""

    kind: str
    places: list[Attachment]


class Part:
    """A body, joint, load or damper; a subclass overrides what it has something to say about.

    Its name has to be unique in the mechanism. A part that states neither coordinates, forces nor
    constraints is refused when the equations of motion are assembled, and so is a statement that
    does not fit the bodies it refers to.
    """

    name: str
    # Whether it is a load, which the load factor of an equilibrium scales unless others are named.
    is_load: ClassVar[bool] = False
    # Name of the symbol in drawings, one of `beamdae.report.scene.symbols`; a marker is a diamond at
    # each attachment.
    symbol: ClassVar[str] = "marker"

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """The points it refers to: all attachments among its fields, also in lists and the like."""
        return tuple(value for value in self._values if isinstance(value, Attachment))

    @property
    def bodies(self) -> tuple[Part, ...]:
        """The parts it refers to: those of its attachments, and parts among its fields."""
        own = tuple(value for value in self._values if isinstance(value, Part))
        return own + tuple(attachment.body for attachment in self.attachments)

    @property
    def _values(self) -> list[Any]:
        # Fields with slots are not among the variables of an instance.
        slots: tuple[Any, ...] = fields(self) if is_dataclass(self) else ()
        return _flatten({x.name: getattr(self, x.name) for x in slots} | vars(self))

    @property
    def coordinates(self) -> tuple[Named, ...]:
        """Name and unit of each coordinate it brings along; angles are in "rad"."""
        return ()

    @property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing, shape (number of coordinates,)."""
        return np.zeros(0)

    @property
    def initial_velocity(self) -> Array:
        """Their rates at the start; made consistent with the joints later."""
        return np.zeros(0)

    @property
    def outline(self) -> Array:
        """Points (k, 2) of the reference drawing that tell how large it is [m]."""
        return np.zeros((0, 2))

    @property
    def laws(self) -> tuple[Law, ...]:
        """Laws of time it follows: integrators stop at their breakpoints."""
        return ()

    @property
    def inputs(self) -> tuple[Named, ...]:
        """What each of its laws prescribes, as an input of linear models; empty if it is none."""
        return ()

    def with_constant_laws(self, values: Sequence[float]) -> Part:
        """The same part with numbers in place of its laws; asked of what has `inputs`."""
        raise NotImplementedError

    def forces(self, gravity: Array) -> Sequence[ForceStatement]:
        """Its forces: inertia, elasticity, damping, weight under `gravity` (2,), or loads."""
        return ()

    def constraints(self) -> Sequence[ConstraintStatement]:
        """What it holds."""
        return ()

    @property
    def load_distribution(self) -> str:
        """How its forces on sections of a beam are to be read along it, see `equations.load_distribution`.

        "points": each acts where it is stated; "line": they are a force per length, stated at the
        points at which inertia is integrated; "shares": they are those of one force in between.
        """
        return "points"

    def ranges(self) -> Sequence[RangeStatement]:
        """What tells, after a run, whether it stayed where its strains hold."""
        return ()

    @property
    def events(self) -> Sequence[Event]:
        """Events of its own, besides those of `Mechanism.when`."""
        return ()

    @property
    def facts(self) -> Mapping[str, float]:
        """Numbers worth knowing of it before a run, by name."""
        return {}

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing | None:
        """How it is drawn, `attached` being its points that other parts refer to.

        `points` is how many a curve is drawn through; None: not at all.
        """
        return None


def _flatten(value: Any) -> list[Any]:
    """What a value holds: its entries, if it is a listing or a dictionary, or itself."""
    if isinstance(value, dict):
        value = tuple(value.values())
    # Named tuples such as statements are values, not listings.
    if isinstance(value, (list, set, frozenset)) or type(value) is tuple:
        return [leaf for entry in value for leaf in _flatten(entry)]
    return [value]
