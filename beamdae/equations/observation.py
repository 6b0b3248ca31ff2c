"""What is observed of a run after it: columns that its equations of motion did not have."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

from beamdae.equations.building import Numbers, frozen, observable, require_headers
from beamdae.equations.coordinate_map import owners_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.statement_checks import require_pieces_fit
from beamdae.errors import BeamdaeError
from beamdae.parts.attachments import Attachment
from beamdae.parts.observables import observed
from beamdae.parts.part import require_name
from beamdae.symbolic.statements import Quantity


def observing(e: EquationsOfMotion, name: str, what: Attachment | Quantity) -> EquationsOfMotion:
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
    quantity, owners = observed(name, what), owners_of(mechanism)
    for piece in quantity.pieces:
        if id(piece.owner) not in owners.sizes:
            raise BeamdaeError(
                f"{name}: {piece.owner.name!r} is no part of the mechanism that ran."
            )
    require_pieces_fit(name, quantity.pieces, owners.sizes)
    numbers = Numbers(e.p)
    rows: dict[str, slice] = {}
    for row, multiplier in enumerate(e.lam_names):
        part = multiplier.rpartition(".")[0]
        rows[part] = slice(rows.get(part, slice(row, row)).start, row + 1)
    every = (*e.observables, observable(name, quantity, owners, numbers, rows))
    require_headers(e.coordinates, e.multipliers, every)
    seen = copy(mechanism)
    seen.observables = {**mechanism.observables, name: quantity}
    return replace(e, observables=every, p=frozen(numbers.all), mechanism=seen)
