"""Terms of the equations of motion, built from the statements of parts."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from beamdae.equations.assembly.coordinate_map import CoordinateMap, NumberStore, select_input_laws
from beamdae.equations.assembly.observables import (
    ObservableBuilder,
    locate_parts,
    require_unique_headers,
)
from beamdae.equations.assembly.statement_checks import select_multipliers
from beamdae.equations.equations_of_motion import (
    ControllerTerm,
    EquationsOfMotion,
    EventTerm,
    InputTerm,
    Observable,
    PartCoordinates,
    PartStatements,
)
from beamdae.equations.structure import (
    ConstraintTerm,
    ForceTerm,
    Structure,
    intern_structure,
)
from beamdae.errors import BeamdaeError, short_repr, suggest
from beamdae.parts.events import DIRECTIONS, Event
from beamdae.parts.signals import Input
from beamdae.read_only import read_only_copy
from beamdae.symbolic.kernel_groups import group_by_kernel
from beamdae.symbolic.sparse_operators import build_selection
from beamdae.symbolic.statements import (
    SX,
    ConstraintStatement,
    ForceStatement,
    Local,
    Quantity,
    Variable,
    apply_laws,
)
from beamdae.symbolic.sums.rotations import RotatedOperator, factor_operator

Array = np.ndarray

# Share of deformations relative to a floating frame in the correction q' - v by joints. With 1, the
# share of rigid motions, stiff deformations took over errors of the much faster rigid motion, and
# stresses in slow presses were wrong by 5 to 300 % between the steps. The force in a slow rod was
# wrong by 3.6 % with 1e-4 at rtol 1e-3, and is exact to 0.5 % with 1e-6. Results with 1e-9 are
# equally accurate.
_DEFORMATION_SHARE = 1e-6
_TIME = Variable("t", "s")  # name of the time in events


@dataclass(frozen=True)
class Statements:
    """What the parts of a mechanism, or the expressions of a constrained system, state.

    Attributes
    ----------
    forces, constraints
        Terms of F and of g.
    observables
        Observed quantities by name.
    events
        Events to be detected.
    controllers
        Sampled controllers.
    inputs
        Inputs of the mechanism by name.
    of_parts
        The same forces and constraints by part; empty for a constrained system.
    switched_parts
        Names of the parts that are inactive at times.
    """

    forces: Sequence[ForceStatement]
    constraints: Sequence[ConstraintStatement]
    observables: Mapping[str, Quantity] = field(default_factory=dict)
    events: Sequence[Event] = ()
    controllers: Sequence[Any] = ()
    inputs: Mapping[str, Input] = field(default_factory=dict)
    of_parts: tuple[PartStatements, ...] = ()
    switched_parts: Collection[str] = ()


@dataclass(frozen=True)
class Terms:
    """Terms of the equations of motion; for the attributes, see `EquationsOfMotion`."""

    multipliers: tuple[Variable, ...]
    structure: Structure
    p: Array
    observables: tuple[Observable, ...]
    events: tuple[EventTerm, ...]
    controllers: tuple[ControllerTerm, ...]
    inputs: tuple[InputTerm, ...]
    activities: Mapping[str, tuple[int, ...]]
    statements: tuple[PartStatements, ...]


def build_terms(
    statements: Statements,
    coordinates: tuple[Variable, ...],
    parts: Sequence[PartCoordinates],
    coordinate_map: CoordinateMap,
) -> Terms:
    """Return the terms of the equations of motion.

    Raises
    ------
    BeamdaeError
        If observables, events or multipliers do not fit the parts, or headers occur twice.
    """
    laws = select_input_laws(statements.inputs)
    numbers = NumberStore(switched_parts=statements.switched_parts)
    forces = [apply_laws(x, laws) for x in statements.forces]
    constraints = [apply_laws(x, laws) for x in statements.constraints]
    multipliers = tuple(
        Variable(f"{s.part}.{x.name}", x.unit) for s in constraints for x in s.multipliers
    )
    rows = locate_parts(s.part for s in constraints for _ in s.multipliers)
    structure = Structure(
        len(coordinates),
        len(multipliers),
        _build_force_terms(forces, rows, len(multipliers), coordinate_map, numbers),
        _build_constraint_terms(constraints, len(multipliers), coordinate_map, numbers),
        _correction_factors(coordinates, parts),
        tuple(k for part in parts if part.is_state for k in _indices(part.rows)),
    )
    builder = ObservableBuilder(coordinate_map, numbers, laws, rows, statements.of_parts)
    observables = tuple(builder.build(*x) for x in statements.observables.items())
    require_unique_headers(coordinates, multipliers, observables)
    events = _build_event_terms(statements.events, observables, builder)
    controllers = tuple(
        ControllerTerm(
            controller,
            coordinate_map.slice_of(controller),
            tuple(builder.build(controller.name, x) for x in controller.quantities),
        )
        for controller in statements.controllers
    )
    return Terms(
        multipliers,
        intern_structure(structure),
        read_only_copy(numbers.all(statements.inputs)),
        observables,
        events,
        controllers,
        tuple(
            InputTerm(name, x.unit, x.reference, numbers.input_indices(name), x.law)
            for name, x in statements.inputs.items()
        ),
        numbers.activities,
        statements.of_parts,
    )


def _build_force_terms(
    forces: Sequence[ForceStatement],
    rows: Mapping[str, slice],
    n_multipliers: int,
    coordinate_map: CoordinateMap,
    numbers: NumberStore,
) -> tuple[ForceTerm, ...]:
    """Return one term per kernel, whose copies differ in their numbers and coordinates.

    `rows` are the multipliers of each part.
    """
    terms = []
    for group in group_by_kernel(forces):
        members = [forces[k] for k in group.members]
        operator = coordinate_map.global_operator([piece for x in members for piece in x.pieces])
        count = group.data.shape[1]
        depends_on = select_multipliers(members, rows)
        rotated = RotatedOperator(operator, None, np.zeros((0, count)))
        if group.kernel.reused and depends_on is None:
            rotated = factor_operator(operator, count)
        data = numbers.store_copies(np.concatenate([group.data, rotated.data]), members)
        force_rows = None if depends_on is None else build_selection(depends_on, n_multipliers)
        terms.append(
            ForceTerm(group.kernel, rotated.selection, rotated.rotation, data, count, force_rows)
        )
    return tuple(terms)


def _build_constraint_terms(
    constraints: Sequence[ConstraintStatement],
    n_multipliers: int,
    coordinate_map: CoordinateMap,
    numbers: NumberStore,
) -> tuple[ConstraintTerm, ...]:
    """Return one term per kernel of constraints."""
    terms = []
    counts = [len(statement.multipliers) for statement in constraints]
    rows_of = np.split(np.arange(n_multipliers), np.cumsum(counts)[:-1]) if counts else []
    for group in group_by_kernel(constraints):
        members = [constraints[k] for k in group.members]
        rows = np.concatenate([rows_of[k] for k in group.members])
        terms.append(
            ConstraintTerm(
                group.kernel,
                coordinate_map.global_operator([piece for x in members for piece in x.pieces]),
                numbers.store_copies(group.data, members),
                build_selection(rows, n_multipliers),
                group.data.shape[1],
            )
        )
    return tuple(terms)


def _correction_factors(coordinates: Sequence[Variable], parts: Sequence[PartCoordinates]) -> Array:
    """Return the diagonal P of the corrections q' = v - P G^T mu by joints, (n,).

    The factors of angles are those of lengths divided by the square of the size of the connected
    parts, so that results do not depend on the unit of length. With equal factors, the angles of
    beams of 0.1 mm took over the corrections, and runs failed. The size is rounded to powers of
    1000, because models with equal factors share their plans. Deformations relative to a floating
    frame have factors that are smaller by 1e-6.
    """
    factors = np.ones(len(coordinates))
    for part in parts:
        size = 1000.0 ** round(math.log(part.group_size, 1000.0))
        for k in _indices(part.rows):
            if coordinates[k].unit == "rad":
                factors[k] = size**-2
        factors[part.deformations] *= _DEFORMATION_SHARE
    return factors


def _indices(coordinates: slice) -> range:
    return range(coordinates.start, coordinates.stop)


def remove_forces(e: EquationsOfMotion, parts: Collection[str]) -> EquationsOfMotion | None:
    """Return the equations of a mechanism without the forces and observables of some parts.

    The numbers remain. The result is None if a force of another part shares a kernel with them.
    """
    forces = []
    for term, members in zip(e.forces, list_force_statements(e), strict=True):
        is_removed = {x.part in parts for x in members}
        if len(is_removed) > 1:
            return None
        if is_removed == {False}:
            forces.append(term)
    return replace(
        e,
        structure=intern_structure(replace(e.structure, forces=tuple(forces))),
        statements=tuple(s for s in e.statements if s.part.name not in parts),
        observables=(),
        events=(),
    )


def list_force_statements(e: EquationsOfMotion) -> list[list[ForceStatement]]:
    """Return the statements of each force term of a mechanism."""
    laws = select_input_laws({} if e.mechanism is None else e.mechanism.inputs)
    forces = [apply_laws(x, laws) for part in e.statements for x in part.forces]
    return [[forces[k] for k in group.members] for group in group_by_kernel(forces)]


def _express_time(local: Local) -> SX:
    return local.time[0]


def _build_event_terms(
    events: Sequence[Event],
    observed: Sequence[Observable],
    builder: ObservableBuilder,
) -> tuple[EventTerm, ...]:
    """Return the terms of events; `builder` builds the observables of quantities."""
    terms: dict[str, EventTerm] = {}
    columns = {
        ".".join(filter(None, (o.name, column.name))): (o, k)
        for o in observed
        for k, column in enumerate(o.columns)
    }
    for event in events:
        name = str(event.name)
        if name in terms:
            raise BeamdaeError(
                f"event: the name {name!r} is in use; give every event a different name."
            )
        if event.what == _TIME.name:
            observable, column = builder.build(name, Quantity((_TIME,), (), _express_time)), 0
        elif isinstance(event.what, str):
            if event.what not in columns:
                near = suggest(event.what, columns)
                raise BeamdaeError(
                    f"{name}: the column {short_repr(event.what)} is not observed{near}; "
                    "observe the column or pass a quantity."
                )
            observable, column = columns[event.what]
        else:
            if len(event.what.columns) != 1:
                names = ", ".join(column.name for column in event.what.columns)
                raise BeamdaeError(
                    f"{name}: the quantity has several columns ({names}); observe the "
                    "quantity and name one column."
                )
            observable, column = builder.build(name, event.what.current), 0
        if observable.has_accelerations:
            raise BeamdaeError(
                f"{name}: an event cannot depend on accelerations, which follow from the forces; "
                "monitor a position, a velocity or a force."
            )
        direction = DIRECTIONS[event.direction]
        terms[name] = EventTerm(name, observable, column, event.crosses, direction, event.do)
    return tuple(terms.values())
