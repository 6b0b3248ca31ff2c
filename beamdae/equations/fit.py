"""Refusals: what a part states has to fit the bodies it refers to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from beamdae.errors import BeamdaeError
from beamdae.parts.part import Part
from beamdae.symbolic.statements import ConstraintStatement, ForceStatement, Named, Piece

Sizes = Mapping[int, int]


def require_body_fits(part: Part) -> None:
    """Refuse coordinates that are not named with a unit, differ in number, or share a name."""
    coordinates = part.coordinates
    if not all(isinstance(coordinate, Named) for coordinate in coordinates):
        raise BeamdaeError(
            f"{part.name}: coordinates must be Named(name, unit) each, got {coordinates!r}."
        )
    names = [coordinate.name for coordinate in coordinates]
    if len(set(names)) < len(names):
        raise BeamdaeError(f"{part.name}: its coordinates must differ, got {', '.join(names)}.")
    for what in ("initial_position", "initial_velocity"):
        shape = np.shape(getattr(part, what))
        if shape != (len(coordinates),):
            raise BeamdaeError(
                f"{part.name}: {what} must have shape {(len(coordinates),)}, one number a "
                f"coordinate, got {shape}."
            )


def require_statements_fit(
    part: Part,
    forces: Sequence[ForceStatement],
    constraints: Sequence[ConstraintStatement],
    sizes: Sizes,
) -> None:
    """Refuse a part with nothing to say, and statements of the wrong kind, name or shape.

    `sizes` has the number of coordinates of each body of the mechanism by its identity.
    """
    if not (forces or constraints or part.coordinates):
        raise BeamdaeError(
            f"{part.name}: the part has nothing to say, it states neither coordinates nor forces() "
            "nor constraints()."
        )
    for statements, kind in ((forces, ForceStatement), (constraints, ConstraintStatement)):
        for statement in statements:
            if not isinstance(statement, kind):
                raise BeamdaeError(
                    f"{part.name}: it must state {kind.__name__}s, got {statement!r:.80}."
                )
            if statement.part != part.name:
                raise BeamdaeError(
                    f"{part.name}: its statements must bear its name, got {statement.part!r}."
                )
    for force in forces:
        _require_kernel_fits(part.name, force, force.count, sizes)
    for held in constraints:
        _require_kernel_fits(part.name, held, 1, sizes)
        named, rows = len(held.multipliers), held.kernel.size
        if not named == rows == held.kernel.local.n_multipliers:
            raise BeamdaeError(
                f"{part.name}: it names {named} multipliers for {rows} constraints in "
                f"{held.kernel.local.n_multipliers} symbols, these must be as many."
            )


def _require_kernel_fits(
    part: str, statement: ForceStatement | ConstraintStatement, count: int, sizes: Sizes
) -> None:
    require_pieces_fit(part, statement.pieces, sizes)
    local = statement.kernel.local
    rows = sum(piece.operator.shape[0] for piece in statement.pieces)
    if rows != count * local.size:
        raise BeamdaeError(
            f"{part}: its operators have {rows} rows for {count} x {local.size} local coordinates, "
            "these must be as many."
        )
    if statement.data.shape != (local.n_data, count):
        raise BeamdaeError(
            f"{part}: its data must have shape {(local.n_data, count)}, got {statement.data.shape}."
        )


def require_pieces_fit(part: str, pieces: Sequence[Piece], sizes: Sizes) -> None:
    """Refuse operators on bodies of another mechanism, or of another width than the body has."""
    for piece in pieces:
        width = sizes.get(id(piece.owner))
        name = getattr(piece.owner, "name", repr(piece.owner))
        if width is None:
            raise BeamdaeError(
                f"{part}: it refers to {name!r}, which must be added to this mechanism first."
            )
        if piece.operator.shape[1] != width:
            raise BeamdaeError(
                f"{part}: its operator on {name!r} has {piece.operator.shape[1]} columns, "
                f"the body has {width} coordinates."
            )
