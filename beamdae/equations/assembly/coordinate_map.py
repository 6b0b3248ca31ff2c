"""Map of each part to its slice of the global coordinates, and positions of attachments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formula import MAX_SHARED_KERNELS, Formula
from beamdae.symbolic.sparse_operators import assemble_csr
from beamdae.symbolic.statements import SX, Piece

Array = np.ndarray


@dataclass(frozen=True)
class CoordinateMap:
    """Maps the ground and each part to its slice of the global coordinates, which may be empty.

    For a constrained system, the only part is the system.

    Attributes
    ----------
    sizes
        Number of coordinates of each part, by `id(part)`, in the order of the coordinates.
    """

    sizes: dict[int, int]

    @cached_property
    def offsets(self) -> dict[int, int]:
        """Index of the first coordinate of each part, by `id(part)`."""
        starts = np.cumsum([0, *self.sizes.values()])[:-1]
        return dict(zip(self.sizes, starts.tolist(), strict=True))

    @cached_property
    def n(self) -> int:
        """Number of coordinates of all parts."""
        return sum(self.sizes.values())

    def slice_of(self, body: Any) -> slice:
        """Return the slice of the global coordinates that belongs to a body or another part."""
        first = self.offsets[id(body)]
        return slice(first, first + self.sizes[id(body)])

    def global_operator(self, pieces: Sequence[Piece]) -> sp.csr_array:
        """Return the stacked operators of the pieces, extended to all coordinates, (rows, n)."""
        operators = [_as_csr(x.operator) for x in pieces]
        return _stack(operators, [self.offsets[id(x.owner)] for x in pieces], self.n)


def _stack(operators: Sequence[sp.csr_array], columns: Sequence[int], n: int) -> sp.csr_array:
    """Return the stacked operators, whose columns begin at the given column of `n`."""
    # Not NumPy's sum, which takes longer for a few numbers.
    ends = list(accumulate((x.nnz for x in operators), initial=0))
    data = [x.data for x in operators]
    indices = [x.indices + first for x, first in zip(operators, columns, strict=True)]
    starts = [x.indptr[:-1] + first for x, first in zip(operators, ends, strict=False)]
    indptr = np.concatenate([*starts, ends[-1:]])
    stacked = assemble_csr(
        np.concatenate([np.zeros(0), *data]),
        np.concatenate([np.zeros(0, np.int32), *indices]),
        indptr,
        (len(indptr) - 1, n),
    )
    # Observables hold read-only operators without a copy.
    for array in (stacked.data, stacked.indices, stacked.indptr):
        array.setflags(write=False)
    return stacked


def _as_csr(operator: Any) -> sp.csr_array:
    # Parts may use other formats.
    return operator if isinstance(operator, sp.csr_array) else sp.csr_array(operator)


def map_coordinates(mechanism: Mechanism) -> CoordinateMap:
    """Return the coordinate map of the ground and the parts of a mechanism."""
    bodies: list[Part] = [mechanism.ground, *mechanism.parts.values()]
    return CoordinateMap({id(body): len(body.coordinates) for body in bodies})


def locate_attachments(
    attachments: Sequence[Attachment], q: Array, coordinates: CoordinateMap
) -> Array:
    """Return the positions (count, 2) [m] of attachments at the global coordinates `q`, (n,)."""
    positions = np.empty((len(attachments), 2))
    # Points with the same formula are evaluated together by one compiled function.
    kinds: dict[Any, list[tuple[int, Array, Any]]] = {}
    for k, attachment in enumerate(attachments):
        operator, formula = attachment.operator, attachment.checked_kinematics
        first, (size, width) = coordinates.offsets[id(attachment.body)], operator.shape
        local = operator @ q[first : first + width]
        if isinstance(formula, Formula):
            kind = (formula.kind, len(formula.numbers), size)
            kinds.setdefault(kind, []).append((k, local, formula.numbers))
        else:
            positions[k] = _compile_position(formula, size, SX(0, 1))(local[None], np.zeros(0))
    for kind, members in kinds.items():
        rows, local_rows, numbers = zip(*members, strict=True)
        function = _compile_position_kind(*kind)
        positions[list(rows)] = function(np.array(local_rows), np.array(numbers, float))
    return positions


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def _compile_position_kind(kind: Callable[..., Any], count: int, size: int) -> RowFunction:
    numbers = SX.sym("numbers", count)
    return _compile_position(Formula(kind, numbers), size, numbers)


def _compile_position(
    formula: Callable[[SX], tuple[SX, SX]], size: int, numbers: SX
) -> RowFunction:
    """Return the compiled function from rows of (local coordinates, numbers) to rows of (x, y)."""
    q = SX.sym("q", size)
    return RowFunction(ca.Function("position", [q, numbers], [ca.densify(formula(q)[0])]))
