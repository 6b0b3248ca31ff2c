"""Source file model.c of an exported model: kernels, tables and numbers as constants.

`Image` has the initial words of the instances of a model: a table of the core, then its arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.core.linear_solver import LinearSolver
from beamdae.core.tables import Layout, Workspace, address_of
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable, State
from beamdae.equations.formulations.first_order import reduce_kinematics
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.equations.formulations.sums import TIME_SIZE
from beamdae.equations.starts.state_evaluator import (
    plan_motion,
    plan_smooth_motion,
    plan_state_sums,
)
from beamdae.equations.watched_terms import SurfaceGapTerm, compile_surface_gaps
from beamdae.export.c_code import (
    Tables,
    format_number,
    format_string,
    write_head,
    write_kernel,
    write_operations,
    write_point_kernel,
)
from beamdae.integrators.compiled_run import make_motion_buffers
from beamdae.integrators.radau.stepper import formulate_stages
from beamdae.linear.elimination import N_EXTRA_ENTRIES, EliminationPlan
from beamdae.linear.factorizations import has_many_couplings, order_along_band
from beamdae.linear.pivots import plan_in_order
from beamdae.native.lane_code import LANE_WIDTH
from beamdae.native.lane_kernels import rewrite
from beamdae.symbolic.local_symbols import MATRIX_SHARED
from beamdae.symbolic.sparse_operators import build_selection
from beamdae.symbolic.sums.kernel_code import PointSum
from beamdae.symbolic.sums.kernel_sums import Batch, Kernel, Sum, SumPlan
from beamdae.symbolic.sums.sum_builder import LocalInput, SumBuilder
from beamdae.symbolic.sums.sum_derivatives import directional_plan

_WORD = 8  # bytes


class Image:
    """Words of a layout, and of the arrays to which it refers.

    Arrays of indices are constants, which instances share.

    Parameters
    ----------
    layout
        Layout of the table.
    first
        Arrays that follow the table, in this order; the others follow in the order of the layout,
        those of sums last.
    """

    def __init__(self, layout: Layout, first: Sequence[Array] = ()) -> None:
        self._layout, self._first = layout, first
        self._constants = [(k, x) for k, x in layout.arrays if x.size and x.dtype == np.uint32]
        self._arrays = [(k, x) for k, x in layout.arrays if x.size and x.dtype != np.uint32]
        self._sums = {id(x): x for x, _, _ in layout.objects if isinstance(x, Sum)}
        owned = {id(getattr(x, name)) for x in self._sums.values() for name in Sum.__slots__}
        self._arrays.sort(key=lambda pair: id(pair[1]) in owned)
        self._n_state = sum(id(x) not in owned for _, x in self._arrays)
        self._blocks = self._place_blocks()

    def _place_blocks(self) -> list[tuple[int, int, int]]:
        """Return (address, size, index of the first word) of blocks of memory, by address."""
        arrays = [*self._first, *(x for _, x in self._arrays)]
        spans = sorted((address_of(x), x.nbytes) for x in arrays if x.size)
        blocks: list[list[int]] = []
        for start, size in spans:
            # Arrays may be views of the same memory.
            if blocks and start < sum(blocks[-1]):
                blocks[-1][1] = max(blocks[-1][1], start + size - blocks[-1][0])
            else:
                blocks.append([start, size])
        starts = np.array([start for start, _ in blocks])
        order = dict.fromkeys(
            int(np.searchsorted(starts, address_of(x), "right")) - 1 for x in arrays if x.size
        )
        placed, at = [], len(self._layout.words)
        for k in order:
            start, size = blocks[k]
            placed.append((start, size // _WORD, at))
            at += size // _WORD
        return sorted(placed)

    def locate(self, array: Array) -> int:
        """Return the index of the first word of an array."""
        address = address_of(array)
        start, _, at = next(x for x in reversed(self._blocks) if x[0] <= address)
        return at + (address - start) // _WORD

    def describe(self, tables: Tables) -> dict[str, Any]:
        """Return fields of `Model` by name, as C expressions."""
        words = np.array(self._layout.words, np.int64)
        words[[k for k, _ in self._layout.arrays]] = 0  # addresses
        for x in self._layout.numbers_in(words):
            x.words[x.word] = getattr(x.owner, x.name)
        segments = [f"{{0, {len(words)}, {tables.integers(words)}}}"]
        # Of views that begin at the same word, the longest.
        arrays = sorted((x for _, x in self._arrays if x.any()), key=lambda x: x.nbytes)
        for at, array in {self.locate(x): x for x in arrays}.items():
            flat = array.ravel()
            is_integer = flat.dtype.kind == "i"
            name = tables.integers(flat) if is_integer else tables.numbers(flat.view(np.float64))
            segments.append(f"{{{at}, {array.nbytes // _WORD}, {name}}}")
        constants = [f"{{{k}, {tables.indices(x.ravel())}}}" for k, x in self._constants]
        links = [f"{{{k}, {self.locate(x)}}}" for k, x in self._arrays]
        _, size, at = max(self._blocks, key=lambda x: x[2])
        further = [x for _, x in self._arrays[self._n_state :]]
        sizes = {
            "n_words": at + size,
            "n_state": self.locate(further[0]) if further else at + size,
        }
        return sizes | _count_rows(
            tables,
            segments=("Segment", segments),
            constants=("Constant", constants),
            links=("Link", links),
        )

    def describe_sums(
        self,
        tables: Tables,
        plans: dict[int, SumPlan],
        name_of: Callable[[Any], str],
        number_of: Array,
    ) -> dict[str, Any]:
        """Return fields of `Model` on kernels, and on numbers that depend on values.

        `plans` are those of the sums by identity, `name_of` returns the C function of a batch, and
        `number_of` contains the index of each number p, or -1 for constant numbers.
        """
        codes, numbers = [], []
        for key, total in self._sums.items():
            plan = plans[key]
            if plan.batches:
                first = self.locate(total.kernels)
                codes += [f"{{{first + k}, {name_of(x)}}}" for k, x in enumerate(plan.batches)]
            number = number_of[plan.data_sources.astype(int)]
            for target, k in zip(plan.data_targets[number >= 0], number[number >= 0], strict=True):
                numbers.append(f"{{{self.locate(total.local) + int(target)}, {k}}}")
        return _count_rows(tables, codes=("Code", codes), numbers=("Number", numbers))


def _count_rows(tables: Tables, **arrays: tuple[str, list[str]]) -> dict[str, Any]:
    """Return the names of arrays of structures by field, and the numbers of their rows."""
    fields: dict[str, Any] = {f"n_{name}": len(rows) for name, (_, rows) in arrays.items()}
    return fields | {name: tables.rows(kind, rows) for name, (kind, rows) in arrays.items()}


Array = np.ndarray
SX = ca.SX
_INCLUDES = '#include "model.h"\n#include "points.h"\n\n#include <stddef.h>\n'
TABLES = Path(__file__).parent / "c" / "tables.h"


@dataclass(frozen=True)
class Output:
    """Output of an exported model: a column of an observable."""

    name: str
    unit: str
    observable: Observable
    column: int


@dataclass(frozen=True)
class Value:
    """Input or parameter of an exported model.

    Attributes
    ----------
    name, unit, start
        Name, unit and start value.
    is_input
        True for an input, False for a tunable parameter.
    low, high
        Smallest and largest value.
    """

    name: str
    unit: str
    start: float
    is_input: bool
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True)
class NumberMap:
    """Numbers of the equations as functions of the values.

    Attributes
    ----------
    values
        Inputs, followed by parameters.
    symbols
        Symbols of the values, (len(values), 1).
    targets
        Indices of the numbers p that depend on the values.
    numbers
        These numbers, expressions in `symbols`.
    """

    values: tuple[Value, ...]
    symbols: SX
    targets: Array
    numbers: SX


@dataclass(frozen=True)
class ExportedModel:
    """Everything that the source of an exported model depends on.

    Attributes
    ----------
    equations
        Equations of motion.
    state
        Consistent state at t = 0.
    method
        Work arrays of the steps.
    outputs, numbers
        Outputs, and inputs and parameters.
    step
        Internal step of generalized-alpha, or default communication step [s].
    shift
        Parameter of generalized-alpha, see `family.AlphaParameters`.
    start_rate
        Lower bound on 2 / h^2 of the first step h of Radau [1/s^2].
    fixed_iterations
        Number of Newton iterations of every step; 0 for as many as the tolerance requires.
    """

    equations: EquationsOfMotion
    state: State
    method: Workspace
    outputs: tuple[Output, ...]
    numbers: NumberMap
    step: float
    shift: float = 0.0
    start_rate: float = 0.0
    fixed_iterations: int = 0


def write_model_source(exported: ExportedModel) -> str:
    """Return the text of model.c, except for the definition of `model_token`.

    Raises
    ------
    UnsupportedOperationError
        If a kernel contains an operation that has no C expression.
    """
    return _SourceWriter(exported).write()


class _SourceWriter:
    def __init__(self, exported: ExportedModel) -> None:
        self._exported = exported
        self._tables = Tables()
        self._kernels: dict[int, tuple[str, Kernel | ca.Function]] = {}
        self._functions: list[str] = []
        self._programs: list[str] = []
        self._batches: dict[str, str] = {}
        self._plans: dict[int, SumPlan] = {}

    def write(self) -> str:
        x, tables = self._exported, self._tables
        values, targets = x.numbers.values, x.numbers.targets
        table = SimpleNamespace(**self._describe_common())
        first: tuple[Array, ...] = ()
        if x.method.structure == "RadauWorkspace":
            structure, first = "RadauTable", self._add_radau(table, x.method)
            n_motion = len(Layout(structure, table, TABLES).words) + sum(y.size for y in first)
            table.before, table.begin = np.zeros(n_motion), np.zeros(2 * n_motion)
            first = (*first, table.before)
        else:
            structure = "AlphaTable"
            self._add_alpha(table, x.method)
        image = Image(Layout(structure, table, TABLES), first)
        number_of = np.full(len(x.equations.p), -1)
        number_of[targets] = np.arange(len(targets))
        fields: dict[str, Any] = {
            "n_inputs": sum(value.is_input for value in values),
            "n_values": len(values),
            "n_outputs": len(x.outputs),
            "step": format_number(x.step),
            "value_names": tables.rows(
                "char *const", [format_string(value.name) for value in values]
            ),
            **image.describe(tables),
            **image.describe_sums(tables, self._plans, self._batch, number_of),
            **self._number_functions(),
        }
        body = ",\n".join(f"    .{name} = {value}" for name, value in fields.items())
        return "\n".join(
            [
                "/* Kernels, tables and numbers of a model exported by beamdae. */\n",
                _INCLUDES,
                write_operations(),
                *self._functions,
                *self._batches,
                tables.source,
                *self._programs,
                f"const Model model = {{\n{body}}};\n",
            ]
        )

    def _describe_common(self) -> dict[str, Any]:
        """Return fields of `Table` by name."""
        x, e = self._exported, self._exported.equations
        n, m, values = e.n, e.m, x.numbers.values
        sums, outputs = plan_state_sums(e.structure), plan_outputs(e, x.outputs)
        starter, _ = make_motion_buffers(e)
        starter.motion, starter.saddle = self._sum(plan_motion(e.structure)), self._sum(sums.saddle)
        starter.linear = _make_solver(plan_elimination(sums.saddle_pattern, n), float)
        inputs = np.zeros(2 * (3 * n + m) + len(e.p))
        starter.q[:], starter.v[:], starter.inputs = x.state.q, x.state.v, inputs[: 3 * n + m]
        direction = directional_plan(outputs, 3 * n + m) if values else None
        return {
            "n": n,
            "m": m,
            "length": e.length,
            "values": np.array([value.start for value in values]),
            "breakpoints": np.array([b for b in e.breakpoints if b > 0.0]),
            "min_values": np.array([value.low for value in values]),
            "max_values": np.array([value.high for value in values]),
            "number_targets": x.numbers.targets.astype(np.uint32),
            "q": starter.q,
            "v": starter.v,
            "ddq": np.zeros(n),
            "lam": np.zeros(m),
            "starter": starter,
            "inputs": inputs,
            "rate": np.zeros(m),
            "outputs": np.zeros(len(x.outputs)),
            "direction": np.zeros(2 * len(values)),
            "numbers": np.zeros(LANE_WIDTH * len(x.numbers.targets)),
            "output": self._sum(outputs),
            "output_direction": self._sum(direction),
        }

    def _add_alpha(self, table: SimpleNamespace, run: Workspace) -> None:
        """Add the fields of `AlphaTable`."""
        e, current = self._exported.equations, run.current
        form = formulate_step(e, False)
        residual, _, matrix = form.sums
        run.form.residual, run.form.anchor = self._sum(residual), self._sum(None)
        run.form.matrix = self._sum(matrix)
        run.linear = _make_solver(plan_elimination(form.pattern, e.n), float)
        run.fixed_iterations = self._exported.fixed_iterations
        run.rows = run.rows[:1].copy()  # one step per call
        current.q[:], current.v[:] = table.q, table.v
        table.q, table.v, table.ddq, table.lam = current.q, current.v, current.ddq, current.lam
        table.starter.q, table.starter.v = current.q, current.v
        table.run = run
        table.residual_direction = self._direction(residual, 3 * e.n + e.m)
        table.smooth_motion = self._sum(plan_smooth_motion(e.structure))
        table.shift = self._exported.shift
        table.start, table.jump = np.zeros((2, 3 * e.n + e.m))
        table.jerk, table.velocity_error = np.zeros((2, e.n))

    def _add_radau(self, table: SimpleNamespace, run: Workspace) -> tuple[Array, ...]:
        """Add the fields of `RadauTable`; return the arrays that determine the motion."""
        e = self._exported.equations
        form = formulate_stages(e)
        pattern, matrix, reduction = reduce_kinematics(form)
        order = plan_elimination(pattern, e.n, first=len(reduction.corrected), last=e.m)
        gaps = compile_surface_gaps(e)
        run.form.residual, run.form.jacobian = self._sum(form.sums[0]), self._sum(matrix)
        run.rows = run.rows[:3].copy()  # one step per call
        run.real_solver, run.complex_solver = (_make_solver(order, x) for x in (float, complex))
        table.run = run
        table.zeros = np.zeros(form.size)
        table.start_rate = self._exported.start_rate
        table.residual_direction = self._direction(form.sums[0], 2 * form.size)
        table.gap_sum = self._sum(plan_gaps(gaps) if gaps else None)
        table.gaps = np.zeros(len(gaps))
        table.tangent, stages = np.zeros(form.size), np.zeros((3, 3, form.size))
        table.tangent_w, table.tangent_stages, table.tangent_rates = stages
        table.stage = np.zeros(4 * form.size + len(e.p))
        return table.values, run.y, run.yp, run.last_w, run.multiplier_weights

    def _direction(self, plan: SumPlan, n_inputs: int) -> Any:
        """Return the sum of derivatives along a direction, if there are values."""
        return self._sum(
            directional_plan(plan, n_inputs) if self._exported.numbers.values else None
        )

    def _sum(self, plan: SumPlan | None) -> Any:
        """Return a sum without addresses of kernels."""
        if plan is None:
            return SimpleNamespace(
                shared=np.zeros(len(MATRIX_SHARED)), out=np.zeros(len(MATRIX_SHARED) + 1)
            )
        # Without vectors of four numbers, tiles are slower than single entries.
        total = plan.allocate([0] * len(plan.batches), self._exported.equations.p, tiled=False)
        self._plans[id(total)] = plan
        return total

    def _number_functions(self) -> dict[str, str]:
        numbers = self._exported.numbers
        if not len(numbers.targets):
            return {"write_numbers": "NULL", "write_direction": "NULL"}
        direction = SX.sym("direction", numbers.symbols.shape)
        change = ca.densify(ca.jtimes(numbers.numbers, numbers.symbols, direction))
        inputs = [ca.vertcat(numbers.symbols, direction), SX(0, 1)]
        functions = {
            "write_numbers": ca.Function("numbers", inputs, [ca.densify(numbers.numbers)]),
            "write_direction": ca.Function("direction", inputs, [change]),
        }
        self._functions += [write_kernel(name, f) for name, f in functions.items()]
        return {name: name for name in functions}

    def _batch(self, batch: Batch) -> str:
        """Return the name of the function of a batch."""
        kernel = self._kernel(batch.kernel)
        name = f"{kernel}_{batch.copies}"
        self._batches[f"BATCH({name}, {kernel}, {batch.copies})\n"] = name
        return name

    def _kernel(self, kernel: Kernel) -> str:
        if id(kernel) not in self._kernels:
            name = f"kernel{len(self._kernels)}"
            self._kernels[id(kernel)] = (name, kernel)
            if kernel.loops is None:
                self._functions.append(write_kernel(name, kernel.function))
            else:
                self._write_points(name, kernel, kernel.loops)
        return self._kernels[id(kernel)][0]

    def _write_points(self, name: str, kernel: Kernel, points: PointSum) -> None:
        names = {}
        for symbol, term in zip(points.symbols, points.terms, strict=True):
            names[symbol] = f"{name}_{symbol}"
            function = rewrite(term.source, term.rewrites)
            self._functions.append(write_kernel(names[symbol], function))
        # Its constants are among the tables, which refer to the function.
        self._functions.append(f"{write_head(name)};\n")
        program, tables = points.program(kernel.outputs), self._tables
        constants = tables.indices(program.integers), tables.numbers(program.weights)
        self._programs.append(write_point_kernel(name, program, names, *constants))


def _make_solver(plan: EliminationPlan, dtype: type) -> LinearSolver:
    """Return a solver with these pivots."""
    solver = LinearSolver.empty(dtype)
    solver.set_plan(plan)
    return solver


def plan_outputs(e: EquationsOfMotion, outputs: Sequence[Output]) -> SumPlan:
    """Return the plan of the outputs, with the inputs (q, v, a, lam)."""
    total = SumBuilder(TIME_SIZE)
    multipliers = np.arange(e.m)
    for observable in {id(x.observable): x.observable for x in outputs}.values():
        selected = [(k, x.column) for k, x in enumerate(outputs) if x.observable is observable]
        rows = multipliers[observable.rows]
        inputs = [LocalInput(observable.operator, 0), LocalInput(observable.operator, e.n)]
        inputs.append(LocalInput(build_selection(rows, e.m), 3 * e.n))
        kernel = _output_kernel(observable, len(rows), [column for _, column in selected])
        copies = total.add(kernel, inputs, observable.data, 1)
        total.add_column(copies, 0, build_selection([k for k, _ in selected], len(outputs)), 0)
    return total.vector()


def plan_gaps(gaps: Sequence[SurfaceGapTerm]) -> SumPlan:
    """Return the plan of the gaps of contacts, with the coordinates q as inputs."""
    total = SumBuilder(TIME_SIZE)
    for k, gap in enumerate(gaps):
        operator = gap.distance.observable.operator
        time, q = SX.sym("time", TIME_SIZE), SX.sym("q", operator.shape[0])
        # Gaps depend on positions only. Their numbers are not those of the equations.
        numbers = SX(ca.DM(gap.distance.numbers[gap.distance.observable.data]))
        value = gap.distance.observable.function.express(time, q, q, numbers, SX(0, 1))
        kernel = Kernel.of("gap", time, q, [value[0]])
        copies = total.add(kernel, [LocalInput(operator, 0)], slice(0, 0), 1)
        total.add_column(copies, 0, build_selection([k], len(gaps)), 0)
    return total.vector()


def _output_kernel(observable: Observable, n_rows: int, columns: list[int]) -> Kernel:
    size = observable.operator.shape[0]
    time, q, v = SX.sym("time", TIME_SIZE), SX.sym("q", size), SX.sym("v", size)
    data = SX.sym("data", observable.data.stop - observable.data.start)
    lam = SX.sym("lam", n_rows)
    value = observable.function.express(time, q, v, data, lam)
    local = ca.vertcat(q, v, lam, data)
    return Kernel.of("output", time, local, [value[columns]])


def plan_elimination(
    pattern: sp.csc_array, n: int, first: int = 0, last: int = 0
) -> EliminationPlan:
    """Return the elimination of a matrix of n coordinates, followed by multipliers.

    The next `first` unknowns after the coordinates are eliminated before them, and the last `last`
    unknowns after all others.

    Coordinates are eliminated first: their block, dominated by inertia, has suitable diagonal
    pivots in all positions. The remaining block of the multipliers is then definite if the
    constraints are independent. Pivots chosen for one position would fail in others.
    """
    size = pattern.shape[0]
    ones = sp.csc_array((np.ones(pattern.nnz), pattern.indices, pattern.indptr), pattern.shape)
    symmetric = sp.csr_array(ones + ones.T)
    in_border = has_many_couplings(np.diff(symmetric.indptr)[:n])
    path = order_along_band(symmetric)
    is_coordinate = path < n
    band = np.flatnonzero(~in_border)
    wide = path[is_coordinate]
    is_first, is_last = ~is_coordinate & (path < n + first), path >= size - last
    order = np.concatenate(
        [
            path[is_first],
            band[order_along_band(symmetric[band][:, band])],
            wide[in_border[wide]],
            path[~is_coordinate & ~is_first & ~is_last],
            path[is_last],
        ]
    ).astype(int)
    # Only entries on the diagonal of the multipliers may be missing; a zero is their source.
    count = pattern.nnz + 1
    numbers = sp.csc_array((np.arange(1, count), pattern.indices, pattern.indptr), pattern.shape)
    whole = sp.csc_array(numbers + count * sp.eye_array(size, dtype=int, format="csc"))
    whole.sort_indices()
    plan = plan_in_order(whole, order)
    return plan._replace(
        scale=np.ones(size),
        matrix_starts=pattern.indptr.astype(np.uint32),
        matrix_rows=pattern.indices.astype(np.uint32),
        n_entries=pattern.nnz + N_EXTRA_ENTRIES,
        sources=((whole.data - 1) % count)[plan.sources].astype(np.uint32),
    )
