"""Base class of parts: coordinates, forces, constraints, events and drawing of each."""

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
    RangeStatement,
    Variable,
)

Array = np.ndarray


class Drawing(NamedTuple):
    """Line style of a body in drawings, and the points its line passes through."""

    kind: str
    places: list[Attachment]


class Part:
    """Base class of bodies, joints, loads and dampers.

    A subclass overrides the properties and methods that apply to it; all others are empty. Assembly
    rejects a part that has neither coordinates, forces nor constraints, and a statement that does
    not fit the bodies it refers to.

    Attributes
    ----------
    name
        Unique name in the mechanism.
    is_load
        True for loads: the load factor of an equilibrium scales them unless others are named.
    symbol
        Name of its symbol in drawings. The default is a diamond at each attachment.
    """

    name: str
    is_load: ClassVar[bool] = False
    # One of the keys of the table in `beamdae.report.scene.symbols`.
    symbol: ClassVar[str] = "marker"

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """Attachments it refers to: those among its fields, also inside lists and dictionaries."""
        return tuple(value for value in self._values if isinstance(value, Attachment))

    @property
    def bodies(self) -> tuple[Part, ...]:
        """Parts it refers to: parts among its fields, and bodies of its attachments."""
        parts = tuple(value for value in self._values if isinstance(value, Part))
        return parts + tuple(attachment.body for attachment in self.attachments)

    @property
    def _values(self) -> list[Any]:
        # A dataclass with slots has no `vars` for its fields.
        dataclass_fields: tuple[Any, ...] = fields(self) if is_dataclass(self) else ()
        return _flatten({x.name: getattr(self, x.name) for x in dataclass_fields} | vars(self))

    @property
    def coordinates(self) -> tuple[Variable, ...]:
        """Name and unit of each generalized coordinate of a body; angles are in "rad"."""
        return ()

    @property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing, shape (number of coordinates,)."""
        return np.zeros(0)

    @property
    def initial_velocity(self) -> Array:
        """Rates of the coordinates at the start, before they are made consistent with joints."""
        return np.zeros(0)

    @property
    def outline(self) -> Array:
        """Points (k, 2) of the reference drawing that span its extent [m]."""
        return np.zeros((0, 2))

    @property
    def laws(self) -> tuple[Law, ...]:
        """Laws of time it depends on; integrators stop at their breakpoints."""
        return ()

    @property
    def inputs(self) -> tuple[Variable, ...]:
        """Name and unit of each law as an input of linear models; empty if it has no inputs."""
        return ()

    def with_constant_laws(self, values: Sequence[float]) -> Part:
        """Return the same part with constant laws, one value for each of `inputs`."""
        raise NotImplementedError

    def forces(self, gravity: Array) -> Sequence[ForceStatement]:
        """Return its forces: inertia, elasticity, damping, weight, loads.

        Parameters
        ----------
        gravity
            Acceleration of gravity, shape (2,) [m/s^2].
        """
        return ()

    def constraints(self) -> Sequence[ConstraintStatement]:
        """Return its constraints."""
        return ()

    @property
    def load_distribution(self) -> str:
        """Distribution of its forces along a beam, from which section forces are recovered.

        "points": each force acts at its attachment. "line": the forces are a force per length,
        integrated at the points at which inertia is. "shares": the forces are shares of a single
        force that acts between their attachments.
        """
        return "points"

    def ranges(self) -> Sequence[RangeStatement]:
        """Return the measures that check after a run whether its strains stayed valid."""
        return ()

    @property
    def events(self) -> Sequence[Event]:
        """Events of the part, in addition to those of `Mechanism.when`."""
        return ()

    @property
    def facts(self) -> Mapping[str, float]:
        """Values that `beamdae check` reports of it before a run, by name."""
        return {}

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing | None:
        """Return the line of a body in drawings, or None if the part is drawn by its `symbol`.

        Parameters
        ----------
        attached
            Its attachments that other parts refer to.
        points
            Number of points of a curve.
        """
        return None


def _flatten(value: Any) -> list[Any]:
    """Return the entries of nested lists, tuples, sets and dictionaries."""
    if isinstance(value, dict):
        value = tuple(value.values())
    # Named tuples such as statements are values, not lists.
    if isinstance(value, (list, set, frozenset)) or type(value) is tuple:
        return [leaf for entry in value for leaf in _flatten(entry)]
    return [value]
