"""Sums over points as programs: constant sparse products around calls of the points' kernels.

The kernel of an element is a sum over its quadrature points. Written out, its code grows with the
cube of the number of points, so that compilers need seconds for elements of higher degree. Programs
are short for any number of points, and the kernel of a point is compiled once for all of them.

A program evaluates one copy. In machine code, every number is a vector of several copies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

Array = np.ndarray

# Entries and rows that are mixed at once; their weights stay in registers.
_MAX_ENTRIES = 8
_MAX_ROWS = 3


class Place(NamedTuple):
    """Place in an array, which may move with the index of the present point.

    Attributes
    ----------
    array
        Name of a buffer, or "integers" or "weights".
    offset, per_point
        The index is offset + per_point * point.
    """

    array: str
    offset: int = 0
    per_point: int = 0

    def __add__(self, offset: int) -> Place:  # type: ignore[override]
        return self._replace(offset=self.offset + offset)


class Load(NamedTuple):
    """Copy local inputs, whose rows are integers, to a buffer."""

    target: Place
    rows: Place
    size: int


class Store(NamedTuple):
    """Copy numbers to outputs; `rows` are their rows, followed by the indices of the numbers."""

    source: Place
    rows: Place
    size: int


class Set(NamedTuple):
    """Set `size` numbers to `value`."""

    target: Place
    size: int
    value: float


class Mix(NamedTuple):
    """Mix rows of `length` numbers: target[i] (+)= sum over e of weight[i, e] source[column[e]].

    Each `tile` of the `tiles` * `tile` rows have the same columns, which are offsets of rows of the
    source. `strides` are the distances of rows and of numbers of the target. With `numbers`,
    weights are integers, indices of numbers there.
    """

    target: Place
    source: Place
    columns: Place
    weights: Place
    tiles: int
    tile: int
    entries: int
    length: int
    strides: tuple[int, int]
    adds: bool
    numbers: Place | None


class Spread(NamedTuple):
    """Multiply single numbers by several weights: target[k] = sum over e of weight[k, e] source[e].

    For each run, `places` are the offsets of the target and of the `entries` numbers.
    """

    target: Place
    source: Place
    places: Place
    weights: Place
    runs: int
    entries: int
    size: int


class Call(NamedTuple):
    """Call the kernel of a point."""

    symbol: str
    local: Place
    values: Place


class Loop(NamedTuple):
    """Repeat steps for each point."""

    points: int
    steps: tuple[Step, ...]


Step: TypeAlias = Load | Store | Set | Mix | Spread | Call | Loop


@dataclass(frozen=True)
class Program:
    """Steps, the sizes of buffers by name, and the constants."""

    steps: tuple[Step, ...]
    buffers: dict[str, int]
    integers: Array
    weights: Array

    @property
    def symbols(self) -> tuple[str, ...]:
        """Names of the kernels of points."""
        loops = (x for x in self.steps if isinstance(x, Loop))
        return tuple(
            dict.fromkeys(x.symbol for loop in loops for x in loop.steps if isinstance(x, Call))
        )


@dataclass(frozen=True)
class PointLoop:
    """Points with one kernel.

    Attributes
    ----------
    symbol
        Name of the kernel.
    n_local, n_out
        Sizes of its inputs and outputs.
    vectors
        Indices of the local vectors on which it depends.
    differences
        Matrix that is applied to local vectors first.
    weights
        Matrices (points, rows, local coordinates) that are applied to the differences; the kernel
        takes the rows of all vectors, then its data.
    data
        Rows of the local inputs with the data of each point (points, data).
    patterns
        Rows and columns of the non-zeros of each output of the kernel.
    """

    symbol: str
    n_local: int
    n_out: int
    vectors: tuple[int, ...]
    differences: Array
    weights: Array
    data: Array
    patterns: tuple[tuple[Array, Array], ...]

    @property
    def operators(self) -> Array:
        """Matrices B that map local coordinates to those of each point."""
        return self.weights @ self.differences

    def reorder(self, order: Array) -> PointLoop:
        """Return the loop in local coordinates in another order."""
        differences, weights = self.differences[np.ix_(order, order)], self.weights[..., order]
        return replace(self, differences=differences, weights=weights)


class Output(NamedTuple):
    """Output of a sum: the rows and columns of its non-zeros, and its kind.

    Columns and matrices refer to local coordinates; other "numbers" are added.
    """

    rows: Array
    columns: Array
    kind: str


class _Mixture(NamedTuple):
    """Sparse matrices of one pattern, with equally many entries in all rows.

    `columns` (rows, entries) contains the columns, `weights` (matrices, rows, entries) the entries;
    those that are not needed are 0.
    """

    columns: Array
    weights: Array

    @classmethod
    def of(cls, matrices: Array) -> _Mixture:
        """Return the mixture of dense matrices (count, rows, columns)."""
        is_used = (matrices != 0.0).any(axis=0)
        entries = max(int(is_used.sum(axis=1).max(initial=0)), 1)
        # Used columns first, in ascending order.
        columns = np.argsort(~is_used, axis=1, kind="stable")[:, :entries]
        return cls(columns, np.take_along_axis(matrices, columns[None], axis=2))


@dataclass
class _Writer:
    """Collects the steps of a program."""

    steps: list[Step] = field(default_factory=list)
    buffers: dict[str, int] = field(default_factory=dict)
    integers: list[Array] = field(default_factory=list)
    weights: list[Array] = field(default_factory=list)

    def buffer(self, size: int) -> Place:
        name = f"buffer{len(self.buffers)}"
        self.buffers[name] = max(size, 1)
        return Place(name)

    def constants(self, values: Array, is_moving: bool = False) -> Place:
        """Store constants; those of a point are rows of `values` if the place is moving."""
        values = np.asarray(values)
        name = "weights" if values.dtype.kind == "f" else "integers"
        arrays = self.weights if name == "weights" else self.integers
        offset = sum(x.size for x in arrays)
        arrays.append(values.ravel())
        return Place(name, offset, values[0].size if is_moving else 0)

    def load(self, target: Place, rows: Array, is_moving: bool = False) -> None:
        if rows.shape[-1]:
            self.steps.append(Load(target, self.constants(rows, is_moving), rows.shape[-1]))

    def mix(
        self,
        target: Place,
        source: Place,
        mixture: _Mixture,
        length: int = 1,
        *,
        row: int | None = None,
        strides: tuple[int, int] | None = None,
        adds: bool = False,
        numbers: Place | None = None,
    ) -> None:
        """Mix rows of `length` numbers, `row` apart in the source; rows are contiguous by default.

        Several matrices are those of the points.
        """
        rows, entries = mixture.columns.shape
        row, strides = length if row is None else row, strides or (length, 1)
        for first in range(0, entries, _MAX_ENTRIES):
            part = slice(first, first + _MAX_ENTRIES)
            columns, weights = mixture.columns[:, part], mixture.weights[:, :, part]
            is_shared = length > 1 and bool(np.all(columns == columns[:1]))
            begin = 0
            # Rows with the same columns share their loads.
            for tile in range(min(_MAX_ROWS if is_shared else 1, rows), 0, -1):
                tiles = (rows - begin) // tile
                if not tiles:
                    continue
                part = slice(begin, begin + tiles * tile)
                self.steps.append(
                    Mix(
                        target + begin * strides[0],
                        source,
                        self.constants(columns[part][::tile] * row),
                        self.constants(weights[:, part], len(weights) > 1),
                        tiles,
                        tile,
                        columns.shape[1],
                        length,
                        strides,
                        adds or first > 0,
                        numbers,
                    )
                )
                begin += tiles * tile


def write_point_program(
    sizes: tuple[int, int, int],
    rotation: tuple[Array, Array] | None,
    loops: Sequence[PointLoop],
    outputs: Sequence[Output],
) -> Program:
    """Return the program of a sum over points.

    Parameters
    ----------
    sizes
        Numbers of local vectors, of their coordinates, and of the data. Local inputs are vectors,
        data, and the numbers of the rotation.
    rotation
        Matrix T of ones and zeros, and matrix of the indices + 1 of those entries that are numbers
        of the rotation instead. Local vectors are T times the inputs; columns and matrices of the
        outputs are T^T f and T^T K T. None without a rotation.
    loops
        The points, whose sum is the function.
    outputs
        The outputs of all kernels of points, and of the sum.
    """
    writer, (n_vectors, size, n_data) = _Writer(), sizes
    ones, numbers = (np.eye(size), np.zeros((size, size), int)) if rotation is None else rotation
    n_inputs, n_numbers = ones.shape[1], int(numbers.max(initial=0))
    order = _group_coordinates(loops)
    loops = [loop.reorder(order) for loop in loops]
    # Weights of the rotation: 0, 1, and numbers.
    weights = writer.buffer(2 + n_numbers)
    writer.steps += [Set(weights, 1, 0.0), Set(weights + 1, 1, 1.0)]
    writer.load(weights + 2, n_vectors * n_inputs + n_data + np.arange(n_numbers))
    indices = np.where(numbers > 0, numbers + 1, ones).astype(int)[order]
    to_local, from_local = _Mixture.of(indices[None]), _Mixture.of(indices.T[None])

    vectors, inputs = writer.buffer(n_vectors * size), writer.buffer(n_inputs)
    for k in range(n_vectors):
        writer.load(inputs, k * n_inputs + np.arange(n_inputs))
        writer.mix(vectors + k * size, inputs, to_local, numbers=weights)

    totals = []
    for output in outputs:
        heights = {"column": size, "matrix": size * size}
        height = heights.get(output.kind, len(output.rows))
        totals.append(writer.buffer(height))
        writer.steps.append(Set(totals[-1], height, 0.0))
    for loop in loops:
        _write_loop(writer, loop, vectors, totals, outputs)

    first, position = 0, np.argsort(order)
    for total, output in zip(totals, outputs, strict=True):
        count, places, result = len(output.rows), np.arange(len(output.rows)), total
        if rotation is None and output.kind != "numbers":
            places = position[output.rows]
            if output.kind == "matrix":
                places = places * size + position[output.columns]
        elif output.kind == "column":
            result = writer.buffer(n_inputs)
            writer.mix(result, total, from_local, numbers=weights)
        elif output.kind == "matrix":
            # Rows, then columns of the transpose.
            left, result = writer.buffer(size * n_inputs), writer.buffer(n_inputs * n_inputs)
            strides = (1, n_inputs)
            writer.mix(left, total, from_local, size, strides=strides, numbers=weights)
            writer.mix(result, left, from_local, n_inputs, numbers=weights)
            places = output.columns * n_inputs + output.rows
        rows = writer.constants(np.concatenate([first + np.arange(count), places]))
        if count:
            writer.steps.append(Store(result, rows, count))
        first += count
    constants = [np.concatenate(x) for x in (writer.integers, writer.weights)]
    return Program(tuple(writer.steps), writer.buffers, *constants)


def _group_coordinates(loops: Sequence[PointLoop]) -> Array:
    """Return an order in which coordinates with the same rows at points are neighbors."""
    used = np.concatenate([(x.operators != 0.0).any(axis=0) for x in loops])
    kinds: dict[bytes, int] = {}
    return np.argsort([kinds.setdefault(x.tobytes(), len(kinds)) for x in used.T], kind="stable")


def _write_loop(
    writer: _Writer,
    loop: PointLoop,
    vectors: Place,
    totals: Sequence[Place],
    outputs: Sequence[Output],
) -> None:
    """Write the evaluation of all points, then the sums of their outputs."""
    operators = loop.operators
    points, height, size = operators.shape
    local, values = writer.buffer(loop.n_local), writer.buffer(points * loop.n_out)
    changes = writer.buffer(size * len(loop.vectors))
    for i, k in enumerate(loop.vectors):
        differences = _Mixture.of(loop.differences[None])
        writer.mix(changes + i * size, vectors + k * size, differences)
    at_points = _Writer([], writer.buffers, writer.integers, writer.weights)
    for i, k in enumerate(loop.vectors):
        at_points.mix(local + k * height, changes + i * size, _Mixture.of(loop.weights))
    at_points.load(local + (loop.n_local - loop.data.shape[1]), loop.data, is_moving=True)
    of_point = values._replace(per_point=loop.n_out)
    at_points.steps.append(Call(loop.symbol, local, of_point))
    ends = np.cumsum([0, *(len(rows) for rows, _ in loop.patterns)]).tolist()
    products = {}
    for k, (output, pattern) in enumerate(zip(outputs, loop.patterns, strict=True)):
        if output.kind == "matrix":
            products[k] = writer.buffer(points * height * size)
            product = products[k]._replace(per_point=height * size)
            _write_product(at_points, product, of_point + ends[k], operators, pattern)
    writer.steps.append(Loop(points, tuple(at_points.steps)))
    for k, (total, output, pattern) in enumerate(zip(totals, outputs, loop.patterns, strict=True)):
        count = len(pattern[0])
        if output.kind == "matrix":
            _add_product(writer, total, products[k], operators, pattern)
        elif count:
            matrices = operators.transpose(0, 2, 1)
            if output.kind == "numbers":
                matrices = np.tile(np.eye(count), (points, 1, 1))
            mixture = _join_points(matrices, loop.n_out, ends[k])
            writer.mix(total, values, mixture, row=1, adds=True)


def _join_points(matrices: Array, stride: int, first: int = 0) -> _Mixture:
    """Return the mixture of the rows of all points, `stride` apart and from the `first` on."""
    each = _Mixture.of(matrices)
    rows, points = len(each.columns), len(matrices)
    columns = first + stride * np.arange(points) + each.columns[:, :, None]
    weights = each.weights.transpose(1, 2, 0)
    return _Mixture(columns.reshape(rows, -1), weights.reshape(1, rows, -1))


def _write_product(
    writer: _Writer,
    product: Place,
    source: Place,
    operators: Array,
    pattern: tuple[Array, Array],
) -> None:
    """Write C B of a point, with the non-zeros of C at `source` and the rows of B in `operators`.

    Coordinates with the same rows of B are neighbors, and have the same entries of C in each row.
    """
    rows, columns = pattern
    size, is_read = operators.shape[2], _find_products(operators, pattern)
    runs: dict[tuple[int, int], list[tuple[list[int], Array]]] = {}
    for begin, end in _neighbors(operators):
        used = np.flatnonzero((operators[:, :, begin] != 0.0).any(axis=0))
        for row in range(len(is_read)):
            entries = [k for k in np.flatnonzero(rows == row) if columns[k] in used]
            place = row * size + begin
            if entries:
                weights = operators[:, columns[entries], begin:end].transpose(0, 2, 1)
                run = ([place, *map(int, entries)], weights)
                runs.setdefault((end - begin, len(entries)), []).append(run)
            elif is_read[row, begin]:
                writer.steps.append(Set(product + place, end - begin, 0.0))
    for (count, entries_of_run), items in runs.items():
        places = writer.constants(np.array([x for x, _ in items]))
        of_runs = writer.constants(np.stack([x for _, x in items], axis=1), is_moving=True)
        sizes = len(items), entries_of_run, count
        writer.steps.append(Spread(product, source, places, of_runs, *sizes))


def _find_products(operators: Array, pattern: tuple[Array, Array]) -> Array:
    """Return a mask of the entries of C B that rows of B^T C B contain."""
    used = (operators != 0.0).any(axis=0)
    is_filled = np.zeros(used.shape, bool)
    for row, column in zip(*pattern, strict=True):
        is_filled[row] |= used[column]
    is_read = np.zeros_like(is_filled)
    for begin, _ in _neighbors(operators):
        together = used[:, begin]
        is_read[together] |= is_filled[together].any(axis=0)
    return is_read


def _neighbors(operators: Array) -> list[tuple[int, int]]:
    """Return the ranges of coordinates with the same rows at points."""
    used = (operators != 0.0).any(axis=0)
    changes = np.flatnonzero((used[:, 1:] != used[:, :-1]).any(axis=0)) + 1
    bounds = [0, *changes.tolist(), used.shape[1]]
    return [(begin, end) for begin, end in pairwise(bounds) if used[:, begin].any()]


def _add_product(
    writer: _Writer,
    total: Place,
    product: Place,
    operators: Array,
    pattern: tuple[Array, Array],
) -> None:
    """Add the sum of B^T (C B) over all points."""
    _, height, size = operators.shape
    is_read = _find_products(operators, pattern)
    for begin, end in _neighbors(operators):
        mixture = _join_points(operators[:, :, begin:end].transpose(0, 2, 1), height)
        row = int(np.argmax((operators[:, :, begin] != 0.0).any(axis=0)))
        read = np.flatnonzero(is_read[row])
        for part in np.split(read, np.flatnonzero(np.diff(read) > 1) + 1):
            if len(part):
                first, strides = int(part[0]), (size, 1)
                target, source = total + (begin * size + first), product + first
                writer.mix(target, source, mixture, len(part), row=size, strides=strides, adds=True)
