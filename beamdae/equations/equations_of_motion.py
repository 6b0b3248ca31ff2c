"""Equations of motion F(t, q, v, a, p) + G^T lam = 0, g(t, q, p) = 0, as immutable data.

They include a structure, which models that differ only in numbers share, and the numbers p.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae import deferred
from beamdae.equations.singular_laws import PartLaw
from beamdae.equations.structure import ConstraintTerm, ForceTerm, Structure
from beamdae.errors import BeamdaeError
from beamdae.parts.laws import Law
from beamdae.parts.mechanism import AS_DRAWN, Mechanism
from beamdae.parts.part import Part, RegularizedFriction
from beamdae.read_only import read_only_copy, read_only_data
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.statements import (
    ConstraintStatement,
    ForceStatement,
    Variable,
)

# Imported where they are created: most models have no controllers, and no events that switch parts.
if TYPE_CHECKING:
    from beamdae.parts.control.controller import Controller
    from beamdae.parts.joints.event_constraints import FrozenGaps

Array = np.ndarray
_BYTES_PER_NUMBER = 8
# Memory of the local coordinates of the times at which beams are checked together.
_MAX_BLOCK_BYTES = 1e7


class State(NamedTuple):
    """Coordinates, velocities, accelerations and multipliers: vectors, or one row per time."""

    q: Array
    v: Array
    a: Array
    lam: Array


@read_only_data
@dataclass(frozen=True)
class Observable:
    """Named columns with units and the function that evaluates them.

    Attributes
    ----------
    name
        Prefix of the columns, such as the name given to `observe`; "" for columns without prefix.
    columns
        Name and unit of each column.
    function
        Compiled function of time, local coordinates, local velocities, numbers and multipliers.
    operator
        Maps global to local coordinates.
    data
        Slice of p with the numbers of the observable.
    rows
        Slice of the multipliers on which the columns depend; empty if they depend on none.
    has_accelerations
        True if local accelerations are the last argument of `function`.
    is_magnitude, is_elastic
        See `Quantity`.
    """

    name: str
    columns: tuple[Variable, ...]
    function: RowFunction
    operator: sp.csr_array
    data: slice
    rows: slice
    has_accelerations: bool = False
    is_magnitude: bool = False
    is_elastic: bool = False

    @property
    def headers(self) -> list[str]:
        """CSV headers of the columns, such as 'tip.x [m]'."""
        return list(format_headers(self.name, self.columns))

    @cached_property
    def active_columns(self) -> tuple[Array, sp.csr_array]:
        """Indices of the coordinates with nonzero columns in `operator`, and these columns."""
        indices = np.unique(self.operator.indices)
        return indices, self.operator[:, indices]

    def evaluate(self, p: Array, times: Array, q: Array, v: Array, lam: Array) -> Array:
        """Return the columns, (rows, columns), for states in rows; not those with accelerations.

        The rows of `times` are (t, branch); `p` are the numbers to which `data` refers.
        """
        local = (np.asarray(self.operator @ x.T).T for x in (q, v))
        return np.asarray(self.function(times, *local, p[self.data], lam[:, self.rows]))


@lru_cache(maxsize=1024)  # each run formats the headers of its observables several times
def format_headers(name: str, columns: tuple[Variable, ...]) -> tuple[str, ...]:
    """Return the headers of columns, such as "tip.x [m]"."""
    return tuple(
        Variable(".".join(filter(None, (name, column.name))), column.unit).header
        for column in columns
    )


@dataclass(frozen=True)
class EventTerm:
    """Event of a run: a column of an observable crosses a value.

    Attributes
    ----------
    name
        Name of the event.
    observable, column
        Observable, and index of the monitored column in it.
    crosses
        Value to be crossed, in the unit of the column.
    direction
        1 for upward, -1 for downward crossings, 0 for both.
    do
        "stop", "record" or a tuple of actions; see `Event`.
    occurred_at_start
        True if the run resumes from a state at which this event occurred and its action was
        executed; the event is not triggered again at the start.
    due
        1 (upward crossing) or -1 (downward crossing) if the previous run ended at this event before
        executing its action; the resumed run then executes the action first. Otherwise 0.
    side
        1 if the column was above `crosses` at the end of the previous run, -1 if it was below. 0 if
        this is unknown or there is no previous run.
    """

    name: str
    observable: Observable
    column: int
    crosses: float
    direction: int
    do: Any
    occurred_at_start: bool = False
    due: int = 0
    side: int = 0

    def evaluate_difference(self, p: Array, times: Array, q: Array, v: Array, lam: Array) -> Array:
        """Return the monitored column minus `crosses`, (rows,), for states in rows.

        The rows of `times` are (t, branch); `p` are the numbers of the equations.
        """
        return self.observable.evaluate(p, times, q, v, lam)[:, self.column] - self.crosses


class InputTerm(NamedTuple):
    """Input of the equations of motion.

    Attributes
    ----------
    name, unit
        Name and unit.
    value
        Value at t = 0.
    indices
        Indices of the numbers `p` that are equal to the value; one for each formula that contains
        the input. If the input has a law, these numbers are added to the law.
    law
        Law of time; None if the value is a number.
    """

    name: str
    unit: str
    value: float
    indices: tuple[int, ...]
    law: Law | None


class ControllerTerm(NamedTuple):
    """Sampled controller.

    Attributes
    ----------
    controller
        The part, with the law.
    rows
        Slice of the coordinates with its held values.
    reads
        Observables that its law reads.
    """

    controller: Controller
    rows: slice
    reads: tuple[Observable, ...]


class PartCoordinates(NamedTuple):
    """Coordinates of one part of a mechanism or one body of a constrained system.

    Attributes
    ----------
    name
        Name of the part or body.
    rows
        Slice of the coordinates.
    size
        Largest distance between points of the outline of the part [m], which converts rotations to
        displacements. For a single point, and in a constrained system, the characteristic length.
    group_size
        Characteristic length [m] of the parts that bodies connect to this part.
    rigid_count
        Number of leading coordinates that describe a rigid motion: for a beam, those of its
        floating frame, or none in absolute coordinates; otherwise all, unless a part overrides
        `rigid_coordinate_count`.
    follows_section
        True if the floating frame moves with one section and follows the vibrations of the section.
    is_state
        True if the coordinates are first-order states, without inertia.
    given_velocities
        True for a velocity and an angular velocity that are given, also if they are zero.
    """

    name: str
    rows: slice
    size: float
    group_size: float
    rigid_count: int
    follows_section: bool = False
    is_state: bool = False
    given_velocities: tuple[bool, bool] = (False, False)

    @property
    def rigid(self) -> slice:
        """Slice of the coordinates that describe a rigid motion."""
        return slice(self.rows.start, self.rows.start + self.rigid_count)

    @property
    def deformations(self) -> slice:
        """Slice of the coordinates relative to a floating frame; empty without one."""
        return slice(self.rigid.stop if self.rigid_count else self.rows.stop, self.rows.stop)


class PartStatements(NamedTuple):
    """Constraints and forces of a part; see `Part`."""

    part: Part
    constraints: tuple[ConstraintStatement, ...]
    forces: tuple[ForceStatement, ...]


class Start(NamedTuple):
    """Requested initial conditions.

    Attributes
    ----------
    description
        Text that describes the request.
    q, v
        Requested coordinates and velocities, (n,) each, before they are made consistent. For an
        equilibrium or a steady rotation, the positions of the drawing and the final velocities.
    moves
        True if positions are requested by name.
    closed_q
        Positions (n,) of the drawing with closed joints, near which the equilibrium or the steady
        rotation was searched for; None for other starts.
    request
        The start as it was requested, which refined equations repeat; None if it names
        deformations, which differ in other meshes.
    """

    description: str
    q: Array
    v: Array
    moves: bool
    closed_q: Array | None = None
    request: Any = None


@read_only_data
@dataclass(frozen=True, eq=False)
class EquationsOfMotion:
    """Equations of motion of a mechanism or a constrained system.

    The equations are

        F(t, q, v, a, p) + G^T lam = 0,    0 = g(t, q, p),    G = dg/dq,

    where F contains inertia, elastic and damping forces minus applied loads. For nonholonomic
    constraints, A(t, q) v + b(t, q) = 0 replaces g_dot = 0, and A replaces G. With friction in
    joints, F also depends on lam. The object is immutable, so that formulations, integrators and
    analyses can share the data derived from it.

    Attributes
    ----------
    coordinates, multipliers
        Name and unit of each coordinate and multiplier. Names are 'part.coordinate' and
        'part.constraint'; coordinates of a constrained system keep their given names.
    q0, v0
        Initial coordinates and velocities, (n,) each: as drawn, or adjusted to the requested
        values. Integrators make them consistent.
    p
        Numbers of the model, such as quadrature data and section, mass and load values.
    length
        Characteristic length of the mechanism [m], the scale of positions: the largest distance
        between points of bodies and joints or, if there is only one point, the length of the
        shortest spring. For a constrained system, the largest absolute initial value of the
        coordinates that are not angles. 1 if this length is zero.
    parts
        Coordinates and size of each part that has coordinates.
    breakpoints
        Ascending times [s] at which laws have jumps or kinks; integrators stop and restart there.
    time_scale
        Shortest time [s] over which a law changes, or None.
    observables
        Columns evaluated along a run.
    structure
        Kernels of forces and joints with their operators, without numbers.
    scales
        Amplitude of each coordinate, in the unit of the coordinate, (n,). If None, adaptive
        integrators estimate the amplitudes.
    laws
        Time-dependent laws, with the names of their parts or, in a constrained system, of their
        symbols.
    start
        Requested initial conditions; None if "as drawn".
    redundant
        True if redundant constraints are removed and the reactions of all constraints are restored
        with minimum norm; False if redundant constraints are rejected.
    events
        Events to be detected in a run.
    configurations
        Equations with some parts inactive; None if no part is inactive at the start and no event
        switches parts or causes an impact.
    mechanism
        Mechanism from which the equations were assembled, for pictures and for observables added
        after a run; None for a constrained system.
    inputs
        Inputs of the mechanism and their places among the numbers `p`.
    controllers
        Sampled controllers.
    statements
        Statements of the parts of the mechanism. They contain the formulas of laws as they were
        when the equations were assembled. Empty for a constrained system.
    build_warnings
        Warnings issued while the model was built, which are part of all its results.
    activities
        Indices of the numbers `p` that are 1 while a part is active and 0 while it is inactive, by
        part. Observed and measured loads of the part have this factor.
    """

    coordinates: tuple[Variable, ...]
    multipliers: tuple[Variable, ...]
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
    laws: tuple[PartLaw, ...] = field(default=(), repr=False)
    start: Start | None = field(default=None, repr=False)
    redundant: bool = False
    events: tuple[EventTerm, ...] = field(default=(), repr=False)
    configurations: Any = field(default=None, repr=False)
    mechanism: Mechanism | None = field(default=None, repr=False)
    statements: tuple[PartStatements, ...] = field(default=(), repr=False)
    inputs: tuple[InputTerm, ...] = field(default=(), repr=False)
    controllers: tuple[ControllerTerm, ...] = field(default=(), repr=False)
    build_warnings: tuple[str, ...] = field(default=(), repr=False)
    activities: Mapping[str, tuple[int, ...]] = field(default_factory=dict, repr=False)
    _derived: dict[Any, Any] = field(default_factory=dict, init=False, repr=False)

    def __deepcopy__(self, memo: Any) -> EquationsOfMotion:
        # Immutable; machine code cannot be copied.
        return self

    def __reduce__(self) -> Any:
        if self.mechanism is None:
            raise BeamdaeError(
                "EquationsOfMotion: equations without a mechanism cannot be pickled; use a "
                "Mechanism, or pickle the arrays of the result."
            )
        # Imported here, because most runs are not pickled.
        from beamdae.symbolic.signal_pickling import pickle_with_signals

        numbers = {name: getattr(self, name) for name in _PICKLED_NUMBERS}
        return _reassemble, (pickle_with_signals(self.mechanism), numbers)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return self.structure.n

    @property
    def m(self) -> int:
        """Number of constraints."""
        return self.structure.m

    @property
    def observed_headers(self) -> list[str]:
        """Headers of the observed columns."""
        return [header for observable in self.observables for header in observable.headers]

    @property
    def forces(self) -> tuple[ForceTerm, ...]:
        """Terms of F, one per kernel."""
        return self.structure.forces

    @property
    def joints(self) -> tuple[ConstraintTerm, ...]:
        """Terms of g, one per kernel."""
        return self.structure.joints

    def with_loads_of(self, configuration: Configuration | None) -> EquationsOfMotion:
        """Return the equations whose observed loads are zero for inactive parts.

        Returns these equations if all parts whose loads are observed are active.
        """
        return self if configuration is None else self.without_loads_of(configuration.inactive)

    def without_loads_of(self, parts: frozenset[str]) -> EquationsOfMotion:
        """Return the equations with observed and measured loads of `parts` equal to zero."""
        inactive = parts.intersection(self.activities)
        if not inactive:
            return self
        key = (EquationsOfMotion.without_loads_of, inactive)
        if key not in self._derived:
            p = self.p.copy()
            p[[k for name in inactive for k in self.activities[name]]] = 0.0
            self._derived[key] = replace(self, p=read_only_copy(p))
        return self._derived[key]

    @cached_property
    def nonholonomic_rows(self) -> Array:
        """Indices of the nonholonomic constraints."""
        rows = [term.rows.indices for term in self.joints if not term.kernel.is_holonomic]
        return np.concatenate([np.zeros(0, np.intp), *rows])

    @cached_property
    def q_names(self) -> tuple[str, ...]:
        """Names of the coordinates, in order."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    @cached_property
    def lam_names(self) -> tuple[str, ...]:
        """Names of the multipliers, in order."""
        return tuple(multiplier.name for multiplier in self.multipliers)

    @property
    def states(self) -> Array:
        """Indices of the first-order states among the coordinates."""
        return np.array(self.structure.states, int)

    @property
    def is_driven(self) -> bool:
        """True if joints and drivers, if independent, prescribe all motions."""
        return self.m > 0 and self.m + len(self.states) == self.n

    @cached_property
    def has_friction(self) -> bool:
        """True if forces depend on the multipliers, as friction in joints does."""
        return any(term.rows is not None for term in self.forces)

    @property
    def multipliers_matter(self) -> bool:
        """True if forces depend on the multipliers, or joints and drivers prescribe all motions.

        Positions and velocities then do not reveal errors of the multipliers.
        """
        return self.is_driven or self.has_friction

    def without_states(self, x: Array) -> Array:
        """Return a copy of values (..., n) of the coordinates with zeros for first-order states."""
        moving = x.copy()
        moving[..., self.states] = 0.0
        return moving

    def coordinates_of_part(self, name: str) -> PartCoordinates:
        """Return the coordinates of the part with this name, which must have some."""
        return next(part for part in self.parts if part.name == name)

    @property
    def initially_active(self) -> EquationsOfMotion:
        """Equations of the parts that are active at the start of a run."""
        if self.configurations is None:
            return self
        active = self.configurations.initial_configuration(self).equations
        return active if active is self else replace(active, q0=self.q0, v0=self.v0)

    @cached_property
    def position_scales(self) -> Array:
        """Scale of each coordinate, (n,): the characteristic length [m], or 1 rad for an angle.

        The scale of a first-order state is that of its part.
        """
        scales = np.where(self.is_angle, 1.0, self.length)
        for part in self.parts:
            if part.is_state:
                scales[part.rows] = part.size
        return scales

    @cached_property
    def constraint_is_angle(self) -> Array:
        """Mask of the constraints of angles, (m,)."""
        return np.array([multiplier.unit == "N m" for multiplier in self.multipliers], bool)

    @cached_property
    def constraint_scales(self) -> Array:
        """Scale of each constraint, (m,): the characteristic length [m], or 1 rad for an angle."""
        return np.where(self.constraint_is_angle, 1.0, self.length)

    @property
    def frictions(self) -> dict[str, RegularizedFriction]:
        """Friction of all parts, by name; empty for a constrained system."""
        parts = {} if self.mechanism is None else self.mechanism.parts
        of_parts = {name: part.regularized_friction for name, part in parts.items()}
        return {name: friction for name, friction in of_parts.items() if friction is not None}

    @cached_property
    def part_indices(self) -> Array:
        """Index in `parts` of the part of each coordinate, (n,)."""
        indices = np.zeros(self.n, int)
        for k, part in enumerate(self.parts):
            indices[part.rows] = k
        return indices

    @cached_property
    def part_scales(self) -> Array:
        """Size of the part of each coordinate [m], or 1 rad for an angle, (n,).

        Unlike `position_scales`, it does not depend on other parts, which may be much larger.
        """
        return self._scale_lengths(lambda part: part.size)

    @cached_property
    def group_scales(self) -> Array:
        """Size of the connected parts of each coordinate [m], or 1 rad for an angle, (n,).

        It does not depend on parts that only the ground connects to the coordinate.
        """
        return self._scale_lengths(lambda part: part.group_size)

    def _scale_lengths(self, size: Callable[[PartCoordinates], float]) -> Array:
        scales = self.position_scales.copy()
        for part in self.parts:
            if not part.is_state:
                scales[part.rows] = np.where(self.is_angle[part.rows], 1.0, size(part))
        return scales

    @cached_property
    def is_angle(self) -> Array:
        """True for coordinates in rad, (n,)."""
        return np.array([coordinate.unit == "rad" for coordinate in self.coordinates], bool)


# Fields that may differ from those of newly assembled equations of the same mechanism.
_PICKLED_NUMBERS = ("q0", "v0", "p", "length", "breakpoints", "scales", "start", "build_warnings")


def _reassemble(source: bytes, numbers: dict[str, Any]) -> EquationsOfMotion:
    """Return pickled equations; CasADi expressions cannot be pickled."""
    assemble: Any = deferred.module("equations.assembly.assemble").equations_of_motion
    equations: EquationsOfMotion = assemble(pickle.loads(source), AS_DRAWN)
    if len(numbers["p"]) != len(equations.p):
        raise BeamdaeError(
            "EquationsOfMotion: the pickled equations do not contain the same parts as their "
            "mechanism; pickle the arrays of the result."
        )
    return replace(equations, **numbers)


@read_only_data
@dataclass(frozen=True, eq=False)
class Configuration:
    """Equations of the active parts of a mechanism, between two events.

    Attributes
    ----------
    equations
        Equations of the active parts, on the coordinates of all parts.
    multiplier_rows
        Indices of the active multipliers among the multipliers of all parts.
    inactive
        Names of the inactive parts.
    frozen_gaps
        Gaps of joints that events activated with `as_is=True`, by name of the joint.
    """

    equations: EquationsOfMotion
    multiplier_rows: Array
    inactive: frozenset[str]
    frozen_gaps: FrozenGaps = field(default_factory=dict)

    def select_multipliers(self, lam: Array) -> Array:
        """Return the active multipliers, (rows, active), from all multipliers `lam`, (rows, m)."""
        return lam[:, self.multiplier_rows]

    def expand_multipliers(self, lam: Array, m: int) -> Array:
        """Return all multipliers, (rows, m), from active ones `lam`; zero for inactive parts."""
        multipliers = np.zeros((len(lam), m))
        multipliers[:, self.multiplier_rows] = lam
        return multipliers


@read_only_data
@dataclass(frozen=True)
class ImpactEquations:
    """Equations of the active parts, extended by the constraints of the impacts of an event.

    Attributes
    ----------
    equations
        Equations with the constraints of the active parts and of the impacts.
    restitution
        Coefficient of restitution of each impact constraint, by name of its multiplier.
    gaps
        Names of the multipliers of contact gaps, which may open without an impulse.
    """

    equations: EquationsOfMotion
    restitution: Mapping[str, float]
    gaps: frozenset[str]

    @property
    def coefficients(self) -> Array:
        """Coefficient of restitution of each constraint, (m,); 0 for active joints."""
        return np.array([self.restitution.get(x, 0.0) for x in self.equations.lam_names])
