"""LLVM IR of the programs of `point_programs`, with one copy per vector lane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from beamdae.native.lane_code import LANE_WIDTH, LANES, format_constant, write_lane_function
from beamdae.native.point_programs import Call, Load, Loop, Mix, Place, Program, Set, Spread, Step

Array = np.ndarray

_VECTOR = LANES.number
_KINDS = {"integers": "i64", "weights": "double"}
# Processors with vectors of all lanes use them.
_ATTRIBUTES = 'attributes #0 = { "min-legal-vector-width"="512" "prefer-vector-width"="512" }'


def write_point_module(name: str, program: Program) -> str:
    """Return the module of the function of (shared, local, out, padded), see `LaneKernel`."""
    writer = _Writer()
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
class _Writer:
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
