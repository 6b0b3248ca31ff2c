"""Equations of motion of a mechanism: F(t, q, v, a, p) + G^T lam = 0, g(t, q, p) = 0.

Immutable: a structure, which models that differ in numbers alone share, and the numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.equations.singular_laws import PartLaw
from beamdae.equations.structure import ConstraintTerm, ForceTerm, Structure
from beamdae.parts.mechanism import Mechanism
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.statements import Named, RangeStatement

if TYPE_CHECKING:
    from beamdae.equations.assembly.configurations import Configurations
    from beamdae.parts.mechanism import Mechanism

Array = np.ndarray


class State(NamedTuple):
    """Rows of a trajectory: coordinates, velocities, accelerations and multipliers."""

    q: Array
    v: Array
    a: Array
    lam: Array


@dataclass(frozen=True)
class RangeTerm:
    """What tells how far a part's strains are to be trusted, on the global coordinates."""

    statement: RangeStatement
    operator: sp.csr_array

    def largest(self, q: Array) -> Array:
        """Largest (deflection over length, rotation [rad], strain) over rows of coordinates."""
        kernel, data = self.statement.kernel, self.statement.data
        copies = data.shape[1]
        local = np.asarray(self.operator @ q.T).T.reshape(len(q) * copies, kernel.local.size)
        found = kernel.function(local, np.tile(data.T, (len(q), 1)))
        return found.max(axis=0)


@dataclass(frozen=True)
class Observable:
    """Named columns with units, and the function that gives them.

    `data` tells where its numbers are in p, `rows` which multipliers it asks for.
    """

    name: str
    columns: tuple[Named, ...]
    function: RowFunction
    operator: sp.csr_array
    data: slice
    rows: slice

    @property
    def headers(self) -> list[str]:
        """CSV headers 'name.suffix [unit]'."""
        return [
            Named(".".join(filter(None, (self.name, column.name))), column.unit).header
            for column in self.columns
        ]


@dataclass(frozen=True)
class EventTerm:
    """What a run watches: a column of an observable, the value it crosses, and what is done then.

    `direction` is 1 for up, -1 for down and 0 for both; where it `begins_there`, the run begins at
    the event, up to what a consistent start changes, and it does not happen there again. Where it
    is `due`, 1 up or -1 down, the run begins with it. `side` is that of the value on which a run
    before left the column, 1, -1, or 0 where that is not known.
    """

    name: str
    observable: Observable
    column: int
    crosses: float
    direction: int
    do: Any
    begins_there: bool = False
    due: int = 0
    side: int = 0

    def beyond(self, p: Array, times: Array, q: Array, v: Array, lam: Array) -> Array:
        """How far the column is beyond its value, at rows of states."""
        o = self.observable
        local = (np.asarray(o.operator @ x.T).T for x in (q, v))
        return o.function(times, *local, p[o.data], lam[:, o.rows])[:, self.column] - self.crosses


class PartCoordinates(NamedTuple):
    """Coordinates that move together.

    Attributes
    ----------
    name
        Of the part, or of the coordinate.
    rows
        Which coordinates.
    size
        How far from each other its points are [m]: an angle is worth the way it carries a point
        that far away.
    """

    name: str
    rows: slice
    size: float


class Start(NamedTuple):
    """A start other than the drawing.

    Attributes
    ----------
    told
        In words.
    q, v
        What was asked for, before joints made it consistent.
    moves
        Whether other positions than those drawn were asked for.
    """

    told: str
    q: Array
    v: Array
    moves: bool


@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """F(t, q, v, a, p) + G^T lam = 0, g(t, q, p) = 0 with everything integrators ask of them.

    Attributes
    ----------
    coordinates, multipliers
        'part.coordinate' and unit of each coordinate and multiplier.
    q0, v0
        Start, as drawn or of `start`; `consistent_start.Starter` makes it consistent.
    p
        Numbers of the model: quadrature data, section, mass and load values.
    length
        Characteristic length of the mechanism [m], the scale of positions.
    parts
        Coordinates that move together.
    breakpoints
        Ascending times [s] at which a law changes its formula; integrators stop and restart there.
    time_scale
        Shortest time [s] over which a law changes, or None.
    scales
        How far each coordinate moves [its unit], (n,), where that is given; None: integrators
        find out.
    structure
        The kernels of forces and joints, without numbers.
    laws
        Those that change with time, with the parts that follow them.
    start
        What was asked for instead of the drawing, if anything.
    redundant
        Whether constraints that follow from others are spared, see `reduced.reduced`; they are
        refused if not.
    events
        What a run watches for.
    configurations
        `Configurations` of a mechanism whose parts are switched; None: all are always active.
    mechanism
        What they are the equations of, for drawing and observing it after a run; None where they
        were stated otherwise.
    """

    coordinates: tuple[Named, ...]
    multipliers: tuple[Named, ...]
    q0: Array
    v0: Array
    p: Array
    length: float
    parts: tuple[PartCoordinates, ...]
    breakpoints: tuple[float, ...]
    time_scale: float | None
    observables: tuple[Observable, ...]
    structure: Structure = field(repr=False)
    scales: Array | None = None
    ranges: tuple[RangeTerm, ...] = field(default=(), repr=False)
    laws: tuple[PartLaw, ...] = field(default=(), repr=False)
    start: Start | None = field(default=None, repr=False)
    redundant: bool = False
    events: tuple[EventTerm, ...] = field(default=(), repr=False)
    configurations: Configurations | None = field(default=None, repr=False)
    mechanism: Mechanism | None = field(default=None, repr=False)
    _derived: dict[Any, Any] = field(default_factory=dict, init=False, repr=False)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return self.structure.n

    @property
    def m(self) -> int:
        """Number of constraints."""
        return self.structure.m

    @property
    def forces(self) -> tuple[ForceTerm, ...]:
        """Terms of F."""
        return self.structure.forces

    @property
    def joints(self) -> tuple[ConstraintTerm, ...]:
        """Terms of g."""
        return self.structure.joints

    @cached_property
    def nonholonomic_rows(self) -> Array:
        """Which constraints hold velocities alone."""
        rows = [term.rows.indices for term in self.joints if not term.kernel.is_holonomic]
        return np.concatenate([np.zeros(0, np.int64), *rows])

    @cached_property
    def q_names(self) -> tuple[str, ...]:
        """'part.coordinate' of each coordinate."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    @cached_property
    def lam_names(self) -> tuple[str, ...]:
        """'part.constraint' of each multiplier."""
        return tuple(multiplier.name for multiplier in self.multipliers)

    @cached_property
    def position_scales(self) -> Array:
        """Natural size of each coordinate: the characteristic length, or 1 for an angle."""
        angle = np.array([coordinate.unit == "rad" for coordinate in self.coordinates], bool)
        return np.where(angle, 1.0, self.length)
