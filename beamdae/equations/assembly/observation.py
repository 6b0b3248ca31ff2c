"""Observables added after a run."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

from beamdae.equations.assembly.building import (
    NumberStore,
    build_observable,
    read_only_copy,
    require_unique_headers,
)
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.assembly.statement_checks import require_pieces_fit
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, require_name
from beamdae.parts.attachments import Attachment
from beamdae.parts.observables import as_quantity
from beamdae.symbolic.statements import Quantity


def add_observable(
    e: EquationsOfMotion, name: str, what: Attachment | Quantity
) -> EquationsOfMotion:
    """Return the equations of motion of a mechanism with one more observable.

    Raises
    ------
    BeamdaeError
        If they are not those of a mechanism, or the quantity is that of another mechanism.
    """
    name, mechanism = require_name("observe", name), e.mechanism
    if mechanism is None:
        raise BeamdaeError(
            f"{name}: the run is not one of a mechanism; observe columns of a ConstrainedSystem "
            "by its parameter observe."
        )
    quantity, coordinate_map = as_quantity(name, what), map_coordinates(mechanism)
    for piece in quantity.pieces:
        if id(piece.owner) not in coordinate_map.sizes:
            raise BeamdaeError(
                f"{name}: {piece.owner.name!r} is no part of the mechanism that ran; observe one "
                "of its parts."
            )
    require_pieces_fit(name, quantity.pieces, coordinate_map.sizes)
    numbers = NumberStore(e.p)
    rows: dict[str, slice] = {}
    for row, multiplier in enumerate(e.lam_names):
        part = multiplier.rpartition(".")[0]
        rows[part] = slice(rows.get(part, slice(row, row)).start, row + 1)
    added = build_observable(name, quantity, coordinate_map, numbers, rows)
    observables = (*e.observables, added)
    require_unique_headers(e.coordinates, e.multipliers, observables)
    observed = copy(mechanism)
    observed.observables = {**mechanism.observables, name: quantity}
    return replace(e, observables=observables, p=read_only_copy(numbers.all), mechanism=observed)
