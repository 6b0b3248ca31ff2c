"""Assembly of the equations of motion from the statements of the parts of a mechanism."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from beamdae.equations.assembly.building import Statements, Terms, build_terms
from beamdae.equations.assembly.coordinate_map import (
    CoordinateMap,
    locate_attachments,
    map_coordinates,
)
from beamdae.equations.assembly.statement_checks import (
    collect_statements,
    require_body_fits,
    require_coordinates_fit,
)
from beamdae.equations.equations_of_motion import (
    EquationsOfMotion,
    PartCoordinates,
    PartStatements,
)
from beamdae.equations.singular_laws import collect_unbounded_laws
from beamdae.errors import (
    BeamdaeError,
    hold_messages,
    merge_alike,
    record_messages,
    short_repr,
    warn_user,
)
from beamdae.memory import require_memory
from beamdae.parts.attachments import measure_extent
from beamdae.parts.events import select_impacts
from beamdae.parts.mechanism import AS_DRAWN, MINIMUM_NORM, Mechanism, require_start
from beamdae.parts.part import AttachedPart, Part
from beamdae.read_only import ReadOnlyDict, read_only_copy
from beamdae.symbolic.statements import (
    LOAD_UNITS,
    Quantity,
    Variable,
    forget_meshes,
)

Array = np.ndarray

_MAX_DRAWING_ERROR = 1e-2  # due to interpolated curves; relative to the mechanism
_PLACEMENT_COORDINATES = 3  # position and angle
_MAX_CACHED_NAMES = 256  # parts with different names or coordinates
_BYTES_PER_COORDINATE = 1e4  # lower bound of the memory of a run; measured without joints: 14 kB


def equations_of_motion(mechanism: Mechanism, start: Any = None) -> EquationsOfMotion:
    """Assemble the equations of motion of a mechanism from the statements of its parts.

    Parameters
    ----------
    mechanism
        The mechanism, with at least one part that has coordinates. Parts, observables and events
        that are added later do not affect the result.
    start
        Initial conditions, see `Mechanism`. Defaults to those of the mechanism.

    Returns
    -------
    EquationsOfMotion
        F(t, q, v, a, p) + G^T lam = 0, g(t, q, p) = 0.

    Raises
    ------
    BeamdaeError
        If `mechanism` is not a Mechanism, no part has coordinates, a part, an observable or an
        event does not fit the mechanism, redundant="minimum norm" is combined with inactive parts,
        impacts or events that switch parts, memory does not suffice for a run, or the initial
        conditions are invalid or cannot be satisfied.
    """
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(
            f"equations_of_motion: expected a Mechanism, got {short_repr(mechanism)}."
        )
    start = mechanism.start if start is None else require_start("start", start)
    snapshot = _prepare(mechanism, start)
    coordinate_map = map_coordinates(mechanism)
    snapshot.require_switched_members()
    configurations = None
    if snapshot.events or snapshot.inactive:
        # Imported where they are needed: most models have no events.
        from beamdae.equations.assembly.configurations import build_configurations

        configurations = build_configurations(snapshot, coordinate_map, equations_of_motion)
    if coordinate_map.n == 0:
        raise BeamdaeError("Mechanism: there is no body that can move; add at least one.")
    require_memory(
        "Mechanism",
        f"a run with {coordinate_map.n} coordinates",
        _BYTES_PER_COORDINATE * coordinate_map.n,
        "use fewer bodies or fewer elements",
    )
    statements = _collect_statements(mechanism, snapshot, coordinate_map)
    if configurations is not None:
        statements = replace(statements, switched_parts=configurations.switched_parts)
    placed = _place(mechanism, statements, coordinate_map)
    terms = build_terms(statements, placed["coordinates"], placed["parts"], coordinate_map)
    is_redundant = mechanism.redundant == MINIMUM_NORM
    if is_redundant and configurations is not None:
        raise BeamdaeError(
            f"Mechanism: redundant={MINIMUM_NORM!r} is not supported with inactive "
            "parts, impacts or events that switch parts; omit these or remove the "
            "redundant constraints."
        )
    time_scales = [law.time_scale for law in mechanism.laws if law.time_scale is not None]
    gravity = filter(None, [mechanism.gravity_laws])
    equations = EquationsOfMotion(
        **placed,
        breakpoints=tuple(sorted({b for law in mechanism.laws for b in law.breakpoints})),
        time_scale=min(time_scales, default=None),
        laws=collect_unbounded_laws([*mechanism.parts.values(), *gravity]),
        **vars(terms),
        configurations=configurations,
        mechanism=snapshot,
        redundant=is_redundant,
        build_warnings=_warn_of_unused_commands(mechanism, terms),
    ).without_loads_of(mechanism.removed)
    if start == AS_DRAWN:
        return equations
    from beamdae.equations.starts.initial_conditions import apply_initial_conditions

    return apply_initial_conditions(equations, start)


def _prepare(mechanism: Mechanism, start: Any) -> Mechanism:
    """Let the parts adapt to each other and return a snapshot of the mechanism."""
    snapshot = mechanism.snapshot()
    with record_messages() as messages:
        try:
            with hold_messages() as of_parts:
                _prepare_parts(mechanism, start)
        finally:
            for message in merge_alike(of_parts):
                warn_user(message)
    _add_warnings(mechanism, messages)
    snapshot.observables = ReadOnlyDict(
        {name: quantity.current for name, quantity in mechanism.observables.items()}
    )
    for part in mechanism.parts.values():
        require_body_fits(part)
    return snapshot


def _add_warnings(mechanism: Mechanism, messages: Iterable[str]) -> None:
    # Parts are prepared once, but the mechanism may be assembled again.
    mechanism.build_warnings = tuple(dict.fromkeys([*mechanism.build_warnings, *messages]))


def _collect_statements(
    mechanism: Mechanism, snapshot: Mechanism, coordinate_map: CoordinateMap
) -> Statements:
    """Return what the parts of the mechanism state; observables are those of the snapshot."""
    of_parts = []
    for part in mechanism.parts.values():
        forces, constraints = collect_statements(part, mechanism.gravity, coordinate_map.sizes)
        if mechanism.gravity_laws is not None:
            forces = mechanism.gravity_laws.statements(part.forces)
        of_parts.append(PartStatements(part, tuple(constraints), tuple(forces)))
    for name, quantity in snapshot.observables.items():
        _require_load_exists(name, quantity, mechanism)
    return Statements(
        forces=[x for part in of_parts for x in part.forces],
        constraints=[x for part in of_parts for x in part.constraints],
        observables=snapshot.observables,
        events=[
            *mechanism.events,
            *(event for part in mechanism.parts.values() for event in part.events),
        ],
        controllers=[x for x in mechanism.parts.values() if x.is_controller],
        inputs=mechanism.inputs,
        of_parts=tuple(of_parts),
    )


def _place(
    mechanism: Mechanism, statements: Statements, coordinate_map: CoordinateMap
) -> dict[str, Any]:
    """Return the coordinates as drawn and the sizes: the fields of `EquationsOfMotion` on these.

    The outlines of the bodies and the attachments of joints determine the size of the mechanism; a
    single point mass without joints has that of its springs.
    """
    parts = list(mechanism.parts.values())
    joints = {id(x.part) for x in statements.of_parts if x.constraints}

    def measure(members: Sequence[Part]) -> float:
        extent = measure_extent(members, [x for x in members if id(x) in joints])
        # Otherwise, the shortest distance between the attachments of a spring, or of a similar
        # part. A long spring may only approximate a force in one direction.
        distances = (measure_extent((), [x]) for x in members if x.acts_between_attachments)
        return extent or min((x for x in distances if x > 0.0), default=0.0)

    length = measure(parts) or 1.0
    groups = _connected_parts(parts, coordinate_map)
    group_sizes = {id(part): measure(group) or length for group in groups for part in group}
    q0 = np.concatenate([part.initial_position for part in parts])
    _require_drawn_attachments(mechanism, coordinate_map, q0, length)
    return {
        "coordinates": tuple(
            variable
            for part in parts
            for variable in _name_coordinates(part.name, tuple(part.coordinates))
        ),
        "q0": read_only_copy(q0),
        "v0": read_only_copy(np.concatenate([part.initial_velocity for part in parts])),
        "length": length,
        # If the outline of a part is empty or a single point, its size is `length`.
        "parts": tuple(
            PartCoordinates(
                part.name,
                coordinate_map.slice_of(part),
                part.scale or measure_extent([part]) or length,
                group_sizes[id(part)],
                part.rigid_coordinate_count,
                part.frame_follows_section,
                part.is_state,
                part.given_velocities,
            )
            for part in parts
            if coordinate_map.sizes[id(part)]
        ),
    }


def _warn_of_unused_commands(mechanism: Mechanism, terms: Terms) -> tuple[str, ...]:
    """Warn of controllers without effect; return all warnings issued while the model was built."""
    if mechanism.outputs or terms.controllers:
        from beamdae.equations.commands import unused_command_warnings

        with record_messages() as messages:
            for sentence in unused_command_warnings(mechanism, terms.statements):
                warn_user(sentence)
        _add_warnings(mechanism, messages)
    return mechanism.build_warnings


@lru_cache(maxsize=_MAX_CACHED_NAMES)
def _name_coordinates(part: str, coordinates: tuple[Variable, ...]) -> tuple[Variable, ...]:
    return tuple(Variable(f"{part}.{x.name}", x.unit) for x in coordinates)


def _prepare_parts(mechanism: Mechanism, start: Any) -> None:
    """Let each part adapt its coordinates to the attachments of all parts.

    A part keeps its coordinates if a quantity that cannot be rebuilt refers to the part, or `start`
    names one of its coordinates after the first three.
    """
    attached: dict[int, list[AttachedPart]] = {}
    for part in mechanism.parts.values():
        for attachment in part.attachments:
            attached.setdefault(id(attachment.body), []).append(AttachedPart(part, attachment))
    sources = [*mechanism.observables.values()]
    for event in mechanism.events:
        sources += [event.what, *(impact.on for impact in select_impacts(event.do))]
    quantities = [x for x in sources if isinstance(x, Quantity)]
    fixed = {id(piece.owner) for x in quantities if not x.can_be_rebuilt for piece in x.pieces}
    requested = set(start) if isinstance(start, Mapping) else set()
    has_changed = False
    for part in mechanism.parts.values():
        # The first coordinates of a beam are those of its frame or of its first node.
        coordinates = require_coordinates_fit(part)[_PLACEMENT_COORDINATES:]
        names = [f"{part.name}.{x.name}" for x in coordinates]
        is_requested = any(name in requested or f"{name}_dot" in requested for name in names)
        is_fixed = id(part) in fixed or is_requested
        # Functions of users may return None.
        has_changed |= part._prepare(attached.get(id(part), []), is_fixed) is not False
    if has_changed:
        forget_meshes()


def _require_load_exists(name: str, quantity: Quantity, mechanism: Mechanism) -> None:
    part = quantity.load_of
    is_load = any(x.unit in LOAD_UNITS for x in quantity.columns)
    if part is not None and is_load and part not in mechanism.parts:
        raise BeamdaeError(
            f"{name}: {part!r} is not part of the mechanism, so it exerts no force that can be "
            "observed; add it with mech.add."
        )


def _connected_parts(parts: Sequence[Part], coordinate_map: CoordinateMap) -> list[list[Part]]:
    """Return the groups of parts that bodies connect; the ground connects none."""
    groups = {id(part): [part] for part in parts}
    for part in parts:
        for body in part.bodies:
            if coordinate_map.sizes.get(id(body), 0) and groups[id(body)] is not groups[id(part)]:
                merged = groups[id(part)] + groups[id(body)]
                groups.update((id(member), merged) for member in merged)
    return list({id(group): group for group in groups.values()}.values())


def _require_drawn_attachments(
    mechanism: Mechanism, coordinate_map: CoordinateMap, q0: Array, length: float
) -> None:
    """Reject attachments whose position at q0 is over 1 % of `length` from `Attachment.point`.

    Joints are defined by these points. If the positions differed, a joint would connect points that
    are drawn apart.
    """
    attachments = [a for part in mechanism.parts.values() for a in part.attachments]
    if not attachments:
        return
    positions = locate_attachments(attachments, q0, coordinate_map)
    gaps = np.linalg.norm(positions - [attachment.point for attachment in attachments], axis=1)
    worst = int(np.argmax(gaps))
    if not gaps[worst] <= _MAX_DRAWING_ERROR * length:
        raise BeamdaeError(
            f"{attachments[worst]}: the kinematics place this attachment "
            f"{gaps[worst]:.3g} m from its point in the reference configuration; correct the "
            "kinematics or the point."
        )
