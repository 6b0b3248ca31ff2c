"""What is observed of a run after it: columns that its equations of motion did not have."""

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
    """The equations of motion of a mechanism, which observe one quantity more.

    Raises
    ------
    BeamdaeError
        If they are of no mechanism, or the quantity is not of a part it had when it ran.
    """
    mechanism = e.mechanism
    if mechanism is None:
        raise BeamdaeError(f"{require_name('observe', name)}: the run is not one of a mechanism.")
    require_name("observe", name)
    quantity, owners = as_quantity(name, what), map_coordinates(mechanism)
    for piece in quantity.pieces:
        if id(piece.owner) not in owners.sizes:
            raise BeamdaeError(
                f"{name}: {piece.owner.name!r} is no part of the mechanism that ran."
            )
    require_pieces_fit(name, quantity.pieces, owners.sizes)
    numbers = NumberStore(e.p)
    rows: dict[str, slice] = {}
    for row, multiplier in enumerate(e.lam_names):
        part = multiplier.rpartition(".")[0]
        rows[part] = slice(rows.get(part, slice(row, row)).start, row + 1)
    every = (*e.observables, build_observable(name, quantity, owners, numbers, rows))
    require_unique_headers(e.coordinates, e.multipliers, every)
    seen = copy(mechanism)
    seen.observables = {**mechanism.observables, name: quantity}
    return replace(e, observables=every, p=read_only_copy(numbers.all), mechanism=seen)
