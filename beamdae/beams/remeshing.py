"""Copies of mechanisms in which beams have other meshes and formulations, and maps to them."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from copy import deepcopy
from functools import cached_property
from inspect import getattr_static
from typing import Any

import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import CUSTOM_FORMULATION, Beam, beams_of
from beamdae.beams.mesh import Mesh, mesh_of_modes
from beamdae.errors import BeamdaeError, format_exception, set_fields
from beamdae.parts.events import select_impacts
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.symbolic.statements import Quantity

Array = np.ndarray


def replace_beams(
    mechanism: Mechanism,
    beams: Mapping[str, Beam],
    caller: str,
    alter: Callable[[Part], object] | None = None,
) -> Mechanism:
    """Return a copy of a mechanism with other beams on the same curves.

    The original mechanism is not changed. Attachments, joints, loads, observables and events of the
    copy refer to the new beams. Other beams are copied, too.

    Parameters
    ----------
    mechanism
        The mechanism.
    beams
        The new beams by name, see `Beam._with_mesh`.
    caller
        Beginning of the message of an error.
    alter
        Function that may change values of the copied parts.

    Raises
    ------
    BeamdaeError
        If a part cannot be copied.
    """
    memo: dict[int, Any] = {id(mechanism.parts[name]): beam for name, beam in beams.items()}
    try:
        if mechanism.has_coordinate_signals:
            # Imported here, because few models have such signals.
            from beamdae.symbolic.signal_pickling import copy_with_signals

            other = copy_with_signals(mechanism, memo)
        else:
            other = deepcopy(mechanism, memo)
    except Exception as problem:
        raise BeamdaeError(
            f"{caller}: a part of the mechanism cannot be copied "
            f"({format_exception(problem)}); keep objects that Python cannot copy, such as files "
            "and locks, in global variables."
        ) from problem
    for part in other.parts.values():
        if not isinstance(part, Beam):
            # Cached values may refer to the coordinates of the original mesh; the symbols of
            # states are parts of expressions.
            for name in set(vars(part)) - {"value_symbol"}:
                if isinstance(getattr_static(type(part), name, None), cached_property):
                    del vars(part)[name]
            if alter is not None:
                alter(part)
    # Warnings about the replaced beams concern their meshes and lengths.
    other.build_warnings = tuple(
        x
        for x in other.build_warnings
        if not x.startswith(tuple(f"{name}{end}" for name in beams for end in (": ", " (also ")))
    )
    other.observables = {name: x.current for name, x in other.observables.items()}
    for event in other.events:
        if isinstance(event.what, Quantity):
            set_fields(event, what=event.what.current)
        for impact in select_impacts(event.do):
            if isinstance(impact.on, Quantity):
                set_fields(impact, on=impact.on.current)
    return other


def resolve_modes(mechanism: Mechanism, start: Any = None) -> Mechanism:
    """Return a copy in which meshes that the program chose resolve ten modes of each beam.

    The mechanism itself is returned if there are none, or a part cannot be copied. `start` replaces
    the start of the mechanism.
    """
    beams = {
        beam.name: beam._with_mesh(mesh_of_modes(mesh), mesh)
        for beam, mesh in divide_meshes(mechanism, list_fixed_beams(mechanism, start))
        if beam._has_chosen_mesh
    }
    if not beams:
        return mechanism
    try:
        return replace_beams(mechanism, beams, "modes")
    except BeamdaeError:
        return mechanism


def divide_meshes(mechanism: Mechanism, fixed: Container[str]) -> Iterator[tuple[Beam, Mesh]]:
    """Yield the beams that are not `fixed`, with their meshes after the first assembly."""
    sections = _attached_sections(mechanism)
    for beam in beams_of(mechanism):
        if beam.name not in fixed:
            yield beam, beam._divide_mesh(sections[id(beam)])


def _attached_sections(mechanism: Mechanism) -> dict[int, set[float]]:
    """Return the arc lengths [m] of the attachments of each beam, by its `id`."""
    sections: dict[int, set[float]] = {id(beam): set() for beam in beams_of(mechanism)}
    for part in mechanism.parts.values():
        for attachment in part.attachments:
            if attachment.s is not None and id(attachment.body) in sections:
                sections[id(attachment.body)].add(float(attachment.s))
    return sections


def list_fixed_beams(mechanism: Mechanism, start: Any = None) -> dict[str, str]:
    """Return the reasons why the mesh and strains of beams must not change, by name.

    `start` replaces the start of the mechanism.
    """
    beams, start = beams_of(mechanism), mechanism.start if start is None else start
    fixed = {
        piece.owner.name: f"the quantity {name!r} refers to its coordinates"
        for name, quantity in _named_quantities(mechanism)
        if not quantity.can_be_rebuilt
        for piece in quantity.pieces
        if isinstance(piece.owner, Beam)
    }
    for name in (beam.name for beam in beams):
        if isinstance(start, Mapping) and any(x.startswith(f"{name}.") for x in start):
            fixed[name] = "the start names its coordinates"
    custom = (beam.name for beam in beams if beam.formulation == CUSTOM_FORMULATION)
    return dict.fromkeys(custom, "its kinematics are custom ones") | fixed


def _named_quantities(mechanism: Mechanism) -> Iterator[tuple[str, Quantity]]:
    yield from mechanism.observables.items()
    for event in mechanism.events:
        for quantity in (event.what, *(impact.on for impact in select_impacts(event.do))):
            if isinstance(quantity, Quantity):
                yield str(event.name), quantity


def prolong_coordinates(
    names: Sequence[str],
    fine_names: Sequence[str],
    parts: Mapping[str, Part],
    fine_parts: Mapping[str, Part],
) -> tuple[sp.csc_array, Array]:
    """Return the map from coordinates q of a mechanism to those of a copy with other meshes.

    Parameters
    ----------
    names, fine_names
        Names of the coordinates of the mechanism and of the copy.
    parts, fine_parts
        Their parts by name.

    Returns
    -------
    prolongation, start
        Matrix (n', n) and vector (n',): the coordinates are start + prolongation @ q.
    """
    old = {name: k for k, name in enumerate(names)}
    new = {name: k for k, name in enumerate(fine_names)}
    prolongation = sp.lil_array((len(new), len(old)))
    start = np.zeros(len(new))
    for name, coarse in parts.items():
        fine = fine_parts[name]
        rows = [new[f"{name}.{c.name}"] for c in fine.coordinates]
        columns = [old[f"{name}.{c.name}"] for c in coarse.coordinates]
        if rows:
            block = coarse._prolongation_to(fine)
            prolongation[np.ix_(rows, columns)] = block.toarray()
            start[rows] = fine.initial_position - block @ coarse.initial_position
    return sp.csc_array(prolongation), start
