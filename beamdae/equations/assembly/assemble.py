"""From what the parts of a mechanism state to its equations of motion."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from beamdae.equations.assembly.building import build_equations
from beamdae.equations.assembly.configurations import build_configurations
from beamdae.equations.assembly.coordinate_map import (
    CoordinateMap,
    locate_attachments,
    map_coordinates,
)
from beamdae.equations.assembly.statement_checks import (
    collect_statements,
    require_body_fits,
    require_pieces_fit,
)
from beamdae.equations.equations_of_motion import (
    EquationsOfMotion,
    PartCoordinates,
)
from beamdae.equations.singular_laws import collect_varying_laws
from beamdae.equations.starts.initial_conditions import apply_initial_conditions
from beamdae.errors import BeamdaeError, short_repr
from beamdae.memory import require_memory
from beamdae.parts.attachments import largest_distance
from beamdae.parts.mechanism import MINIMUM_NORM, Mechanism
from beamdae.parts.part import Part
from beamdae.symbolic.statements import (
    ConstraintStatement,
    ForceStatement,
    Named,
    RangeStatement,
)

Array = np.ndarray

# What elements that interpolate their curve may miss it by, over the size of the mechanism.
_AS_DRAWN = 1e-2
# What a run takes at least for each coordinate [bytes]; measured: 14 kB where nothing is joined.
_MEMORY = 1e4


def equations_of_motion(mechanism: Mechanism, start: Any = None) -> EquationsOfMotion:
    """Equations of motion of a mechanism: the sum of what its parts state.

    `start` stands for that of the mechanism, see `Mechanism`.

    Raises
    ------
    BeamdaeError
        If nothing can move, a part has nothing to say, or states what does not fit its bodies.
    """
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(
            f"equations_of_motion: expected a Mechanism, got {short_repr(mechanism)}."
        )
    kept = _as_it_is(mechanism)
    configurations = build_configurations(kept, equations_of_motion)
    parts = list(mechanism.parts.values())
    for part in parts:
        require_body_fits(part)
    owners = map_coordinates(mechanism)
    if owners.n == 0:
        raise BeamdaeError("Mechanism: it needs at least one body that can move.")
    what = f"a run of its {owners.n} coordinates"
    require_memory("Mechanism", what, _MEMORY * owners.n, "take fewer bodies, or fewer elements")
    forces: list[ForceStatement] = []
    constraints: list[ConstraintStatement] = []
    ranges: list[RangeStatement] = []
    # Points that tell the size of the drawing: those of the bodies, and where they are joined.
    drawn = [np.asarray(part.outline, float) for part in parts]
    for part in parts:
        own_forces, held, reaching = collect_statements(part, mechanism.gravity, owners.sizes)
        if mechanism.gravity_laws is not None:
            own_forces = mechanism.gravity_laws.statements(part.forces)
        forces += own_forces
        constraints += held
        ranges += reaching
        if held:
            drawn += [np.reshape(attachment.point, (1, 2)) for attachment in part.attachments]
    for name, quantity in mechanism.observables.items():
        require_pieces_fit(name, quantity.pieces, owners.sizes)
    length = largest_distance(np.concatenate(drawn)) or 1.0
    q0 = np.concatenate([part.initial_position for part in parts])
    _require_drawn_where_they_are(mechanism, owners, q0, length)
    time_scales = [law.time_scale for law in mechanism.laws if law.time_scale is not None]
    drawn_equations = build_equations(
        coordinates=tuple(
            Named(f"{part.name}.{c.name}", c.unit) for part in parts for c in part.coordinates
        ),
        q0=q0,
        v0=np.concatenate([part.initial_velocity for part in parts]),
        length=length,
        parts=_part_coordinates(parts, owners, length),
        breakpoints=tuple(sorted({b for law in mechanism.laws for b in law.breakpoints})),
        time_scale=min(time_scales) if time_scales else None,
        forces=forces,
        constraints=constraints,
        ranges=ranges,
        observables=mechanism.observables,
        owners=owners,
        laws=collect_varying_laws([*parts, *filter(None, [mechanism.gravity_laws])]),
        events=[*mechanism.events, *(event for part in parts for event in part.events)],
        configurations=configurations,
    )
    drawn_equations = replace(drawn_equations, mechanism=kept)
    if mechanism.redundant == MINIMUM_NORM:
        if configurations is not None:
            raise BeamdaeError(
                f"Mechanism: redundant={MINIMUM_NORM!r} needs parts that are always active, events "
                "must not switch any; leave out the constraints that follow from others."
            )
        drawn_equations = replace(drawn_equations, redundant=True)
    return apply_initial_conditions(drawn_equations, mechanism.start if start is None else start)


def _as_it_is(mechanism: Mechanism) -> Mechanism:
    """The same parts and events, whatever is added to the mechanism later."""
    kept = copy(mechanism)
    kept.parts, kept.events = dict(mechanism.parts), list(mechanism.events)
    return kept


def _part_coordinates(
    parts: Sequence[Part], owners: CoordinateMap, length: float
) -> tuple[PartCoordinates, ...]:
    """Coordinates and size of each part that has some; `length` where it has no size."""
    found = []
    for part in parts:
        first, count = owners.offsets[id(part)], owners.sizes[id(part)]
        if count:
            size = largest_distance(np.asarray(part.outline, float)) or length
            found.append(PartCoordinates(part.name, slice(first, first + count), size))
    return tuple(found)


def _require_drawn_where_they_are(
    mechanism: Mechanism, owners: CoordinateMap, q0: Array, length: float
) -> None:
    """Refuse attachments whose motion does not start at the point of the drawing they are named by.

    Joints compare the points of the drawing: they would tear together what is drawn as meeting.
    """
    found = [a for part in mechanism.parts.values() for a in part.attachments]
    if not found:
        return
    started = locate_attachments(found, q0, owners)
    gaps = np.linalg.norm(started - [attachment.point for attachment in found], axis=1)
    worst = int(np.argmax(gaps))
    if not gaps[worst] <= _AS_DRAWN * length:
        raise BeamdaeError(
            f"{found[worst]}: its motion starts {gaps[worst]:.3g} m away from there, "
            "an attachment must start where it is drawn."
        )
