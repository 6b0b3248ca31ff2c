"""Checks of the coordinates, start values, laws and statements of a part before assembly."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    format_exception,
    require_sequence,
    require_unit,
    short_repr,
)
from beamdae.parts.laws import Law
from beamdae.parts.part import Part
from beamdae.symbolic.statements import (
    ConstraintStatement,
    ForceStatement,
    Piece,
    Variable,
)

T = TypeVar("T")
Sizes = Mapping[int, int]
Statement = ForceStatement | ConstraintStatement

_MAX_CACHED_CHECKS = 256  # parts with different names or coordinates


def require_coordinates_fit(part: Part) -> list[Variable]:
    """Return the coordinates of the part; reject those that do not conform to `Part`."""
    coordinates = part.coordinates
    if type(coordinates) is tuple and set(map(type, coordinates)) <= {Variable}:
        # Models are often built again with the same coordinates.
        with suppress(TypeError):
            return list(_require_coordinates(part.name, coordinates))
    return list(_require_coordinates.__wrapped__(part.name, coordinates))


@lru_cache(maxsize=_MAX_CACHED_CHECKS)
def _require_coordinates(part: str, value: Any) -> list[Variable]:
    coordinates = _require_list(part, "coordinates", value, Variable)
    for coordinate in coordinates:
        require_unit(part, coordinate.unit)
    require_unique(part, "coordinates", [coordinate.name for coordinate in coordinates])
    return coordinates


def require_body_fits(part: Part) -> None:
    """Reject coordinates, start values, laws or an outline that do not conform to `Part`."""
    coordinates = require_coordinates_fit(part)
    starts = {
        "initial_position": part.initial_position,
        "initial_velocity": part.initial_velocity,
    }
    for name, start in starts.items():
        try:
            shape = np.asarray(start, dtype=float).shape
        except Exception:  # Foreign array types may raise anything.
            shape = None
        if shape != (len(coordinates),):
            raise BeamdaeError(
                f"{part.name}: {name} must have shape {(len(coordinates),)}, one "
                "number per coordinate, got "
                f"{(short_repr(start) if shape is None else shape)}."
            )
    try:
        outline = np.asarray(part.outline, dtype=float)
    except Exception:  # Foreign array types may raise anything.
        outline = np.empty(0)
    if outline.ndim != 2 or outline.shape[1] != 2 or not np.isfinite(outline).all():
        raise BeamdaeError(
            f"{part.name}: outline must be a finite array of shape (k, 2), got "
            f"{short_repr(part.outline)}."
        )
    for law in _require_list(part.name, "laws", part.laws, Law):
        if not np.isfinite(law.breakpoints).all():
            raise BeamdaeError(
                f"{part.name}: breakpoints of laws must be finite, got {law.breakpoints}."
            )


def require_unique(part: str, what: str, names: Iterable[str]) -> None:
    """Reject duplicate names; `what` describes them in the message."""
    duplicates = [name for name, count in Counter(names).items() if count > 1]
    if duplicates:
        raise BeamdaeError(
            f"{part}: {what} must be unique, but some are repeated: {', '.join(duplicates)}."
        )


def require_columns_fit(part: str, columns: Any) -> None:
    """Reject columns of a quantity that are not `Variable`s with valid units."""
    for column in _require_list(part, "columns", columns, Variable):
        require_unit(part, column.unit)


def collect_statements(part: Part, gravity: np.ndarray, sizes: Sizes) -> tuple[list, list]:
    """Return the force and constraint statements of a part.

    `sizes` maps `id(body)` to the number of coordinates of the body.

    Raises
    ------
    BeamdaeError
        If the part has neither coordinates nor forces nor constraints, one of its methods fails, or
        a statement does not fit the part or the bodies to which it refers.
    """
    forces = _require_list(
        part.name,
        "forces()",
        call_part(part.name, "forces()", part.forces, gravity),
        ForceStatement,
    )
    constraints = _require_list(
        part.name,
        "constraints()",
        call_part(part.name, "constraints()", part.constraints),
        ConstraintStatement,
    )
    if not (forces or constraints or part.coordinates):
        raise BeamdaeError(
            f"{part.name}: the part has no effect; define coordinates, forces() or constraints()."
        )
    for statement in forces:
        _require_statement_fits(part, statement, np.shape(statement.data)[-1:], sizes)
    for constraint in constraints:
        _require_statement_fits(part, constraint, (1,), sizes)
        multipliers = _require_list(part.name, "multipliers", constraint.multipliers, Variable)
        if len(multipliers) != constraint.kernel.local.n_multipliers:
            raise BeamdaeError(
                f"{part.name}: multipliers must have length "
                f"{constraint.kernel.local.n_multipliers}, one entry per constraint, got "
                f"length {len(multipliers)}."
            )
    return forces, constraints


def call_part(part: str, what: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return the result of `function`; convert unexpected exceptions to errors naming the part."""
    try:
        return function(*arguments)
    except BeamdaeError:
        raise
    except Exception as problem:
        raise BeamdaeError(f"{part}: {what} failed: {format_exception(problem)}.") from problem


def select_multipliers(
    forces: Sequence[ForceStatement], rows: Mapping[str, slice]
) -> np.ndarray | None:
    """Return indices of the multipliers on which forces of one kernel depend; None if none.

    `rows` maps the name of each part with constraints to the slice of its multipliers.

    Raises
    ------
    BeamdaeError
        If a force depends on multipliers without naming a joint, or not on as many multipliers as
        the joint that it names has constraints.
    """
    indices: list[int] = []
    for force in forces:
        count = force.kernel.local.n_multipliers
        if (force.joint is None) != (count == 0):
            raise BeamdaeError(
                f"{force.part}: the force has n_multipliers={count} but "
                f"joint={short_repr(force.joint)}; name the joint if the force depends on "
                "its multipliers, otherwise omit both."
            )
        if force.joint is None:
            continue
        available = rows.get(force.joint, slice(0, 0))
        if available.stop - available.start != count:
            raise BeamdaeError(
                f"{force.part}: n_multipliers of the force must be "
                f"{available.stop - available.start}, the number of constraints of "
                f"{force.joint!r}, got {count}."
            )
        indices += range(available.start, available.stop)
    return np.array(indices) if indices else None


def _require_list(part: str, what: str, value: Any, kind: type[T]) -> list[T]:
    """Return `value` as a list; reject anything but a list or tuple of `kind`."""
    # `Piece` and `Variable` are tuples themselves.
    if not isinstance(value, (tuple, list)) or isinstance(value, (Piece, Variable)):
        raise BeamdaeError(
            f"{part}: {what} must be a list of {kind.__name__}, got {short_repr(value)}."
        )
    # The methods of subclasses may fail.
    is_plain = type(value) is tuple or type(value) is list
    entries = (
        list(value)
        if is_plain
        else require_sequence(part, what, value, f"a list of {kind.__name__}")
    )
    for entry in entries:
        if not isinstance(entry, kind):
            raise BeamdaeError(
                f"{part}: {what} must contain only {kind.__name__}, got {short_repr(entry)}."
            )
    return entries


def _require_statement_fits(
    part: Part, statement: Statement, copies: tuple[int, ...], sizes: Sizes
) -> None:
    """Reject a statement whose name, kernel, data or pieces do not fit each other or the part."""
    name, kernel = part.name, statement.kernel
    if statement.part != name:
        raise BeamdaeError(
            f"{name}: 'part' of a statement must be {name!r}, got {short_repr(statement.part)}."
        )
    if kernel.expression_error:
        raise BeamdaeError(f"{name}: {kernel.expression_error}.")
    if kernel.has_branches and not part.laws:
        raise BeamdaeError(
            f"{name}: the part uses a piecewise law that the property 'laws' does not "
            "list; add the law to 'laws', so that integrators stop at the "
            "breakpoints."
        )
    data, local = statement.data, kernel.local
    count = copies[0] if len(copies) == 1 else 0
    if not isinstance(data, np.ndarray) or data.shape != (local.n_data, count):
        raise BeamdaeError(
            f"{name}: data must be an array of shape ({local.n_data}, number of "
            f"copies), got {short_repr(data)}."
        )
    pieces = _require_list(name, "pieces", statement.pieces, Piece)
    require_pieces_fit(name, pieces, sizes)
    rows = sum(piece.operator.shape[0] for piece in pieces)
    if rows != count * local.size:
        raise BeamdaeError(
            f"{name}: the operators must have {count} x {local.size} rows, one per "
            f"copy and local coordinate, got {rows}."
        )


def require_pieces_fit(part: str, pieces: Sequence[Piece], sizes: Sizes) -> None:
    """Reject pieces that refer to another mechanism or whose operator has the wrong width."""
    for piece in pieces:
        width = sizes.get(id(piece.owner))
        name = piece.owner.name if isinstance(piece.owner, Part) else short_repr(piece.owner)
        if width is None:
            raise BeamdaeError(
                f"{part}: {name!r} is not part of this mechanism; add {name!r} first."
            )
        if piece.operator.shape[1] != width:
            raise BeamdaeError(
                f"{part}: the operator on {name!r} must have {width} columns, one per "
                f"coordinate of the body, got {piece.operator.shape[1]}."
            )
