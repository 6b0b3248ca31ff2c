"""Sums over points as programs: constant sparse products around calls of the points' kernels.

The kernel of an element is a sum over its quadrature points. Written out, its code grows with the
cube of the number of points, so that compilers need seconds for elements of higher degree. Programs
are short for any number of points, and the kernel of a point is compiled once for all of them.

A program evaluates one copy. In its LLVM IR, every number is a vector of several copies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np

from beamdae.native.lane_code import LANE_WIDTH, LANES, format_constant, write_lane_function

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


_VECTOR = LANES.number
_KINDS = {"integers": "i64", "weights": "double"}
# Processors with vectors of all lanes use them.
_ATTRIBUTES = 'attributes #0 = { "min-legal-vector-width"="512" "prefer-vector-width"="512" }'


def write_point_module(name: str, program: Program) -> str:
    """Return the module of the function of (shared, local, out, padded), see `LaneKernel`."""
    writer = _CodeWriter()
    for step in program.steps:
        writer.write(step)
    buffers = [
        f"%{x} = alloca {_VECTOR}, i64 {count}, align 64" for x, count in program.buffers.items()
    ]
    numbers = ", ".join(f"i64 {x}" for x in program.integers.tolist())
    weights = ", ".join(f"double {format_constant(x)}" for x in program.weights.tolist())
    return "\n".join(
        [
            f"@integers = private constant [{len(program.integers)} x i64] [{numbers}]",
            f"@weights = private constant [{len(program.weights)} x double] [{weights}]",
            *(f"declare void @{x}(ptr, ptr, ptr, i64) nounwind" for x in program.symbols),
            _write_move("load"),
            _write_move("store"),
            *(writer.functions[x] for x in sorted(writer.functions)),
            *write_lane_function(name, buffers, writer.lines),
            _ATTRIBUTES,
            "",
        ]
    )


@dataclass
class _CodeWriter:
    """Collects the instructions of the function, and the functions that they call by name."""

    lines: list[str] = field(default_factory=list)
    functions: dict[str, str] = field(default_factory=dict)
    _point: str = ""
    _count: int = 0

    def write(self, step: Step) -> None:
        """Write the instructions of a step."""
        if isinstance(step, Loop):
            self._write_loop(step)
        elif isinstance(step, Call):
            local, values = self._address(step.local), self._address(step.values)
            arguments = f"ptr %shared, ptr {local}, ptr {values}, i64 {LANE_WIDTH}"
            self.lines.append(f"call void @{step.symbol}({arguments})")
        elif isinstance(step, Mix):
            kind = step.entries, step.tile, step.numbers is not None
            name = f"mix{'x'.join(map(str, kind[:2]))}{'.numbers' if kind[2] else ''}"
            if name not in self.functions:
                self.functions[name] = _write_mixture(name, *kind)
            places = step.target, step.source, step.columns, step.weights
            numbers = "null" if step.numbers is None else self._address(step.numbers)
            sizes = step.tiles, step.length, *step.strides
            self._call(name, places, sizes, f", i1 {int(step.adds)}, ptr {numbers}")
        elif isinstance(step, Spread):
            name = f"spread{step.entries}"
            if name not in self.functions:
                self.functions[name] = _write_spread(name, step.entries)
            places = step.target, step.source, step.places, step.weights
            self._call(name, places, (step.runs, step.size))
        elif isinstance(step, Set):
            value = format_constant(step.value)
            self.functions.setdefault("set", _SET)
            self._call("set", (step.target,), (step.size,), f", double {value}")
        elif isinstance(step, Load):
            rest = ", ptr %local, i64 %padded, i64 %first"
            self._call("load", (step.target, step.rows), (step.size,), rest)
        else:
            rest = ", ptr %out, i64 %padded, i64 %first"
            self._call("store", (step.source, step.rows), (step.size,), rest)

    def _call(
        self, name: str, places: Sequence[Place], sizes: Sequence[int], rest: str = ""
    ) -> None:
        arguments = [f"ptr {self._address(x)}" for x in places] + [f"i64 {x}" for x in sizes]
        self.lines.append(f"call void @{name}({', '.join(arguments)}{rest})")

    def _write_loop(self, loop: Loop) -> None:
        label = self._name("loop")
        self._point = f"%{label}.point"
        self.lines += [
            f"br label %{label}.before",
            f"{label}.before:",
            f"br label %{label}",
            f"{label}:",
            f"{self._point} = phi i64 [0, %{label}.before], [{self._point}.next, %{label}]",
        ]
        for step in loop.steps:
            self.write(step)
        self.lines += [
            f"{self._point}.next = add i64 {self._point}, 1",
            f"{self._point}.more = icmp slt i64 {self._point}.next, {loop.points}",
            f"br i1 {self._point}.more, label %{label}, label %{label}.end",
            f"{label}.end:",
        ]

    def _name(self, prefix: str) -> str:
        self._count += 1
        return f"{prefix}{self._count}"

    def _address(self, place: Place) -> str:
        """Return the address of a place."""
        kind = _KINDS.get(place.array, _VECTOR)
        base = f"{'@' if place.array in _KINDS else '%'}{place.array}"
        index = f"{place.offset}"
        if place.per_point:
            moved, index = f"%{self._name('x')}", f"%{self._name('x')}"
            self.lines += [
                f"{moved} = mul i64 {self._point}, {place.per_point}",
                f"{index} = add i64 {moved}, {place.offset}",
            ]
        name = f"%{self._name('x')}"
        self.lines.append(f"{name} = getelementptr {kind}, ptr {base}, i64 {index}")
        return name


def _write_mixture(name: str, entries: int, tile: int, has_numbers: bool) -> str:
    """Return the function of a `Mix`."""
    each = [(r, e) for r in range(tile) for e in range(entries)]
    text = [
        f"define internal void @{name}(ptr noalias %target, ptr noalias readonly %sources, "
        "ptr readonly %columns, ptr readonly %weights, i64 %tiles, i64 %length, i64 %stride, "
        "i64 %step, i1 %adds, ptr readonly %numbers) noinline nounwind #0 {",
        *_begin_loop("row", "i"),
        f"%column = mul i64 %i, {entries}",
        f"%weight = mul i64 %i, {entries * tile}",
        f"%tile = mul i64 %i, {tile}",
    ]
    for e in range(entries):
        text += [
            f"%column{e} = add i64 %column, {e}",
            *_load("i64", f"%offset{e}", "%columns", f"%column{e}"),
            f"%source{e} = getelementptr {_VECTOR}, ptr %sources, i64 %offset{e}",
        ]
    for r in range(tile):
        text += [
            f"%row{r} = add i64 %tile, {r}",
            f"%start{r} = mul i64 %row{r}, %stride",
            f"%target{r} = getelementptr {_VECTOR}, ptr %target, i64 %start{r}",
        ]
    for r, e in each:
        x = f"{r}.{e}"
        text.append(f"%entry{x} = add i64 %weight, {r * entries + e}")
        if has_numbers:
            text += _load("i64", f"%number{x}", "%weights", f"%entry{x}")
            text += _load(_VECTOR, f"%w{x}", "%numbers", f"%number{x}")
        else:
            text += _broadcast(f"%w{x}", "%weights", f"%entry{x}")
    text += [*_begin_loop("item", "k", "row"), "%to = mul i64 %k, %step"]
    for e in range(entries):
        text += _load(_VECTOR, f"%x{e}", f"%source{e}", "%k")
    for r in range(tile):
        text += [
            *_sum_products([(f"%w{r}.{e}", f"%x{e}") for e in range(entries)], f"%sum{r}"),
            *_load(_VECTOR, f"%old{r}", f"%target{r}", "%to"),
            f"%more{r} = fadd contract {_VECTOR} %old{r}, %sum{r}",
            f"%new{r} = select i1 %adds, {_VECTOR} %more{r}, {_VECTOR} %sum{r}",
            f"store {_VECTOR} %new{r}, ptr %old{r}.p, align 8",
        ]
    text += [*_end_loop("item", "k", "%length"), *_end_loop("row", "i", "%tiles")]
    return "\n".join([*text, "ret void", "}"])


def _write_spread(name: str, entries: int) -> str:
    """Return the function of a `Spread`."""
    text = [
        f"define internal void @{name}(ptr noalias %targets, ptr noalias readonly %sources, "
        "ptr readonly %places, ptr readonly %weights, i64 %runs, i64 %count) noinline nounwind "
        "#0 {",
        *_begin_loop("run", "i"),
        f"%place = mul i64 %i, {entries + 1}",
        *_load("i64", "%offset", "%places", "%place"),
        f"%target = getelementptr {_VECTOR}, ptr %targets, i64 %offset",
        "%weight = mul i64 %i, %count",
    ]
    for e in range(entries):
        text += [
            f"%place{e} = add i64 %place, {e + 1}",
            *_load("i64", f"%offset{e}", "%places", f"%place{e}"),
            *_load(_VECTOR, f"%x{e}", "%sources", f"%offset{e}"),
        ]
    text += [*_begin_loop("item", "k", "run"), "%at = add i64 %weight, %k"]
    text.append(f"%entry = mul i64 %at, {entries}")
    for e in range(entries):
        text += [f"%entry{e} = add i64 %entry, {e}"]
        text += _broadcast(f"%w{e}", "%weights", f"%entry{e}")
    text += [
        *_sum_products([(f"%w{e}", f"%x{e}") for e in range(entries)], "%sum"),
        f"%to = getelementptr {_VECTOR}, ptr %target, i64 %k",
        f"store {_VECTOR} %sum, ptr %to, align 8",
        *_end_loop("item", "k", "%count"),
        *_end_loop("run", "i", "%runs"),
    ]
    return "\n".join([*text, "ret void", "}"])


def _write_move(name: str) -> str:
    """Return the function of a `Load` or `Store`."""
    number, source, target = "%i", "%entry", "%place"
    if name == "store":
        number, source, target = "%number", "%place", "%entry"
    text = [
        f"define internal void @{name}(ptr noalias %buffer, ptr readonly %rows, i64 %count, "
        "ptr noalias %array, i64 %padded, i64 %first) noinline nounwind #0 {",
        *_begin_loop("item", "i"),
        *_load("i64", "%row", "%rows", "%i"),
        "%base = mul i64 %row, %padded",
        "%index = add i64 %base, %first",
        "%entry = getelementptr double, ptr %array, i64 %index",
        # The indices of stored numbers follow the rows.
        "%second = add i64 %count, %i",
        *(_load("i64", "%number", "%rows", "%second") if name == "store" else ()),
        f"%place = getelementptr {_VECTOR}, ptr %buffer, i64 {number}",
        f"%x = load {_VECTOR}, ptr {source}, align 8",
        f"store {_VECTOR} %x, ptr {target}, align 8",
        *_end_loop("item", "i", "%count"),
    ]
    return "\n".join([*text, "ret void", "}"])


def _begin_loop(label: str, index: str, before: str = "start") -> list[str]:
    """Begin a loop in the block `before`, that of the function or of an outer loop."""
    first = ["start:"] if before == "start" else []
    return [
        *first,
        f"br label %{label}",
        f"{label}:",
        f"%{index} = phi i64 [0, %{before}], [%{index}.next, %{label}.last]",
    ]


def _end_loop(label: str, index: str, count: str) -> list[str]:
    """End a loop; the next instructions are those of the block around it."""
    return [
        f"br label %{label}.last",
        f"{label}.last:",
        f"%{index}.next = add i64 %{index}, 1",
        f"%{index}.more = icmp slt i64 %{index}.next, {count}",
        f"br i1 %{index}.more, label %{label}, label %{label}.end",
        f"{label}.end:",
    ]


def _load(kind: str, result: str, array: str, index: str) -> list[str]:
    return [
        f"{result}.p = getelementptr {kind}, ptr {array}, i64 {index}",
        f"{result} = load {kind}, ptr {result}.p, align 8",
    ]


def _broadcast(result: str, array: str, index: str) -> list[str]:
    """Load a number of an array into all lanes."""
    return [
        *_load("double", f"{result}.s", array, index),
        f"{result}.i = insertelement {_VECTOR} poison, double {result}.s, i32 0",
        f"{result} = shufflevector {_VECTOR} {result}.i, {_VECTOR} poison, "
        f"<{LANE_WIDTH} x i32> zeroinitializer",
    ]


def _sum_products(factors: Sequence[tuple[str, str]], result: str) -> list[str]:
    text, last = [], len(factors) - 1
    for e, (x, y) in enumerate(factors):
        product = f"{result}.{e}" if last else result
        text.append(f"{product} = fmul contract {_VECTOR} {x}, {y}")
        if e:
            total = f"{result}.t{e}" if e < last else result
            before = f"{result}.t{e - 1}" if e > 1 else f"{result}.0"
            text.append(f"{total} = fadd contract {_VECTOR} {before}, {product}")
    return text


_SET = "\n".join(
    [
        "define internal void @set(ptr noalias %buffer, i64 %count, double %value) noinline "
        "nounwind #0 {",
        "start:",
        f"%one = insertelement {_VECTOR} poison, double %value, i32 0",
        f"%all = shufflevector {_VECTOR} %one, {_VECTOR} poison, "
        f"<{LANE_WIDTH} x i32> zeroinitializer",
        *_begin_loop("item", "i")[1:],
        f"%place = getelementptr {_VECTOR}, ptr %buffer, i64 %i",
        f"store {_VECTOR} %all, ptr %place, align 8",
        *_end_loop("item", "i", "%count"),
        "ret void",
        "}",
    ]
)
