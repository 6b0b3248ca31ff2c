"""Whose coordinates stand where among those of all, and where points of the owners are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formulas import MAX_SHARED_KERNELS, Formula
from beamdae.symbolic.sparse_operators import to_casadi_constant
from beamdae.symbolic.statements import SX, Piece

Array = np.ndarray


@dataclass(frozen=True)
class CoordinateMap:
    """Whose coordinates stand where among those of all; the ground has none."""

    sizes: dict[int, int]

    @cached_property
    def offsets(self) -> dict[int, int]:
        """First coordinate of each owner."""
        starts = np.cumsum([0, *self.sizes.values()])[:-1]
        return dict(zip(self.sizes, starts.tolist(), strict=True))

    @cached_property
    def n(self) -> int:
        """Number of coordinates."""
        return sum(self.sizes.values())

    def slice(self, owner: Any) -> slice:
        """Where the coordinates of an owner stand."""
        first = self.offsets[id(owner)]
        return slice(first, first + self.sizes[id(owner)])

    def globally(self, pieces: Sequence[Piece]) -> sp.csr_array:
        """The operators of the pieces on all coordinates, one above the other."""
        found = [(sp.csr_array(x.operator), self.offsets[id(x.owner)]) for x in pieces]
        ends = np.cumsum([0, *(operator.nnz for operator, _ in found)])
        data = [operator.data for operator, _ in found]
        indices = [operator.indices + offset for operator, offset in found]
        starts = [op.indptr[:-1] + first for (op, _), first in zip(found, ends, strict=False)]
        parts = (
            np.concatenate([np.zeros(0), *data]),
            np.concatenate([np.zeros(0, np.int32), *indices]),
            np.concatenate([*starts, ends[-1:]]),
        )
        return sp.csr_array(parts, shape=(len(parts[2]) - 1, self.n))


def map_coordinates(mechanism: Mechanism) -> CoordinateMap:
    """The ground and the parts of a mechanism."""
    owners: list[Part] = [mechanism.ground, *mechanism.parts.values()]
    return CoordinateMap({id(part): len(part.coordinates) for part in owners})


def locate_attachments(places: Sequence[Attachment], q0: Array, owners: CoordinateMap) -> Array:
    """Where the places are at q0, (number of places, 2)."""
    found = np.empty((len(places), 2))
    kinds: dict[tuple[Callable[..., Any], int, int], list[tuple[int, Array, Any]]] = {}
    for k, place in enumerate(places):
        moved, local = place.checked_kinematics, place.operator @ q0[owners.slice(place.body)]
        if isinstance(moved, Formula):
            kind = (moved.kind, len(moved.numbers), place.size)
            kinds.setdefault(kind, []).append((k, local, moved.numbers))
        else:
            found[k] = _compile_place(moved, place.size, SX(0, 1))(local[None], np.zeros(0))
    for kind, members in kinds.items():
        which, own, numbers = zip(*members, strict=True)
        found[list(which)] = _compile_kind(*kind)(np.array(own), np.array(numbers, dtype=float))
    return found


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def _compile_kind(kind: Callable[..., Any], count: int, size: int) -> RowFunction:
    numbers = SX.sym("numbers", count)
    return _compile_place(Formula(kind, numbers), size, numbers)


def _compile_place(moved: Callable[[SX], tuple[SX, SX]], size: int, numbers: SX) -> RowFunction:
    """Rows of (local coordinates, numbers) -> rows of (x, y)."""
    q = SX.sym("q", size)
    return RowFunction(ca.Function("place", [q, numbers], [ca.densify(moved(q)[0])]))


def compile_positions(mechanism: Mechanism, places: Sequence[Attachment]) -> RowFunction:
    """All coordinates of a mechanism -> (x, y) of the places, one after the other."""
    owners = map_coordinates(mechanism)
    q = ca.SX.sym("q", owners.n)
    own = {key: q[first : first + owners.sizes[key]] for key, first in owners.offsets.items()}
    found = [
        place.position(to_casadi_constant(place.operator) @ own[id(place.body)]) for place in places
    ]
    return RowFunction(ca.Function("positions", [q], [ca.densify(ca.vertcat(*found))]))
