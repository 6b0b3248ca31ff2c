"""Places of the coordinates of parts in q, and of the numbers of statements in p."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import BeamdaeError
from beamdae.parts.attachments import Attachment
from beamdae.parts.laws import Law
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.parts.signals import Activity, Input
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formula import Formula, compile_kind
from beamdae.symbolic.kernel_groups import Statement
from beamdae.symbolic.signals import SignalNumbers
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
        # Parts may use other formats.
        operators = [
            x.operator if isinstance(x.operator, sp.csr_array) else sp.csr_array(x.operator)
            for x in pieces
        ]
        # Not NumPy's sum, which takes longer for a few numbers.
        ends = list(accumulate((x.nnz for x in operators), initial=0))
        offsets = (self.offsets[id(x.owner)] for x in pieces)
        indices = [x.indices + first for x, first in zip(operators, offsets, strict=True)]
        starts = [x.indptr[:-1] + first for x, first in zip(operators, ends, strict=False)]
        indptr = np.concatenate([*starts, ends[-1:]])
        stacked = assemble_csr(
            np.concatenate([np.zeros(0), *(x.data for x in operators)]),
            np.concatenate([np.zeros(0, np.int32), *indices]),
            indptr,
            (len(indptr) - 1, self.n),
        )
        # Observables hold read-only operators without a copy.
        for array in (stacked.data, stacked.indices, stacked.indptr):
            array.setflags(write=False)
        return stacked


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
            positions[k] = _compile_position(formula, SX(0, 1), size)(local[None], np.zeros(0))
    for kind, members in kinds.items():
        rows, local_rows, numbers = zip(*members, strict=True)
        function = compile_kind(_compile_position, *kind)
        positions[list(rows)] = function(np.array(local_rows), np.array(numbers, float))
    return positions


def _compile_position(
    formula: Callable[[SX], tuple[SX, SX]], numbers: SX, size: int
) -> RowFunction:
    """Return the compiled function from rows of (local coordinates, numbers) to rows of (x, y)."""
    q = SX.sym("q", size)
    return RowFunction(ca.Function("position", [q, numbers], [ca.densify(formula(q)[0])]))


def select_input_laws(inputs: Mapping[str, Input]) -> dict[str, Law]:
    """Return the laws of the inputs that are not numbers, by name of the input."""
    return {name: x.law for name, x in inputs.items() if x.law is not None}


class NumberStore:
    """Collects the numbers p of a model.

    Attributes
    ----------
    switched_parts
        Names of the parts that are inactive at times.
    activities
        Indices of the numbers that are 0 while a part is inactive and otherwise 1, by part.
    """

    def __init__(
        self, initial_numbers: Array | None = None, switched_parts: Collection[str] = ()
    ) -> None:
        self.switched_parts = switched_parts
        self.activities: dict[str, tuple[int, ...]] = {}
        self._arrays: list[Array] = [] if initial_numbers is None else [initial_numbers]
        self._end = sum(map(len, self._arrays))
        self._inputs: dict[str, list[int]] = {}

    def all(self, inputs: Mapping[str, Input]) -> Array:
        """Return all numbers stored so far, with the values of `inputs`."""
        p = np.concatenate([np.zeros(0), *self._arrays])
        for name, indices in self._inputs.items():
            if name not in inputs:
                raise BeamdaeError(
                    f"{name}: the input is not part of this mechanism; add it with mech.input."
                )
            p[indices] = inputs[name].data[0]
        return p

    def store(self, values: Array) -> slice:
        """Append `values` column by column; return their slice of p."""
        begin = self._end
        self._arrays.append(np.asarray(values, float).ravel(order="F"))
        self._end += len(self._arrays[-1])
        return slice(begin, self._end)

    def store_copies(self, values: Array, statements: Sequence[Statement]) -> slice:
        """Append the data of the copies of statements, one column per copy; return their slice."""
        data = self.store(values)
        column = 0
        for statement in statements:
            for _ in range(statement.data.shape[1]):
                self.record_signals(statement.signals, data.start + column * len(values))
                column += 1
        return data

    def record_signals(self, signals: Sequence[SignalNumbers], begin: int) -> None:
        """Record the indices in p of the numbers of inputs and of activities.

        The data begin at index `begin`.
        """
        for signal, rows in signals:
            if isinstance(signal, Input) and rows.stop > rows.start:
                self._inputs.setdefault(signal.name, []).append(begin + rows.start)
            if isinstance(signal, Activity):
                self.record_activity(signal.name, begin + rows.start)

    def record_activity(self, part: str, index: int) -> None:
        """Record the index in p of a number that is 0 while `part` is inactive."""
        self.activities[part] = (*self.activities.get(part, ()), index)

    def input_indices(self, name: str) -> tuple[int, ...]:
        """Return the indices in p of the numbers of an input."""
        return tuple(self._inputs.get(name, ()))
