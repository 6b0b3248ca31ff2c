"""Source file model.c of an exported model: kernels, tables and numbers as constants."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable, State
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.formulations.kinematic_reduction import reduce_kinematics
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.equations.formulations.sums import TIME_SIZE
from beamdae.equations.starts.state_evaluator import (
    plan_motion,
    plan_smooth_motion,
    plan_state_sums,
)
from beamdae.equations.surface_gaps import SurfaceGapTerm, compile_surface_gaps
from beamdae.export.c_code import (
    Tables,
    format_number,
    format_string,
    write_kernel,
    write_point_kernel,
)
from beamdae.export.elimination_order import plan_elimination
from beamdae.export.radau_settings import RadauSettings
from beamdae.integrators.alpha.family import family_parameters
from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.radau import coefficients
from beamdae.integrators.radau.stepper import STABILIZED_FORM
from beamdae.linear.fixed_order import FixedOrder
from beamdae.native.lane_kernels import rewrite
from beamdae.symbolic.sparse_operators import build_selection
from beamdae.symbolic.sums.directional_sums import directional_plan
from beamdae.symbolic.sums.kernel_sums import Kernel, SumPlan
from beamdae.symbolic.sums.point_sums import PointSum
from beamdae.symbolic.sums.sum_builder import LocalInput, SumBuilder

Array = np.ndarray
SX = ca.SX


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
    weights, min_correction_limit
        Reciprocal scales of the coordinates, and lower bound on the Newton tolerance.
    step
        Internal step of generalized-alpha, and default communication step [s].
    method
        Method of the steps.
    duration
        Default end time [s].
    outputs, numbers
        Outputs, and inputs and parameters.
    fixed_iterations
        Number of Newton iterations of every step; 0 for as many as the tolerance requires.
    """

    equations: EquationsOfMotion
    state: State
    weights: Array
    min_correction_limit: float
    step: float
    method: GeneralizedAlpha | RadauSettings
    duration: float
    outputs: tuple[Output, ...]
    numbers: NumberMap
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
        variable = np.zeros(len(exported.equations.p), bool)
        variable[exported.numbers.targets] = True
        self._is_variable = variable

    def write(self) -> str:
        x, tables = self._exported, self._tables
        e, numbers = x.equations, x.numbers
        n, m, values = e.n, e.m, numbers.values
        sums = plan_state_sums(e.structure)
        if isinstance(x.method, RadauSettings):
            residual, size, inputs_size, method = self._radau(x.method)
        else:
            residual, size, inputs_size, method = self._generalized_alpha(x.method)
        outputs = plan_outputs(e, x.outputs)
        directions: list[SumPlan | None] = [None, None]
        if values:
            directions = [
                directional_plan(residual, inputs_size),
                directional_plan(outputs, 3 * n + m),
            ]
        velocity_rows = n + e.nonholonomic_rows
        has_friction = any(term.rows is not None for term in e.forces)
        breakpoints = [b for b in e.breakpoints if b > 0.0]
        fields: dict[str, Any] = {
            "n": n,
            "m": m,
            "n_p": len(e.p),
            "n_inputs": sum(value.is_input for value in values),
            "n_values": len(values),
            "n_outputs": len(x.outputs),
            "n_numbers": len(numbers.targets),
            "n_breakpoints": len(breakpoints),
            "n_velocity_rows": len(velocity_rows),
            "n_states": len(e.states),
            "forces_depend_on_reactions": int(has_friction),
            "tests_reactions": int(has_friction or e.is_driven),
            "fixed_iterations": x.fixed_iterations,
            "step": format_number(x.step),
            "duration": format_number(x.duration),
            "length": format_number(e.length),
            "p": tables.numbers(e.p),
            "q": tables.numbers(x.state.q),
            "v": tables.numbers(x.state.v),
            "values": tables.numbers([value.start for value in values]),
            "min_values": tables.numbers([value.low for value in values]),
            "max_values": tables.numbers([value.high for value in values]),
            "breakpoints": tables.numbers(breakpoints),
            "velocity_rows": tables.indices(velocity_rows),
            "states": tables.indices(e.states),
            "number_targets": tables.indices(numbers.targets),
            **self._number_functions(),
            "value_names": tables.rows(
                "char *const", [format_string(value.name) for value in values]
            ),
            "residual": self._plan(residual, size),
            "motion": self._plan(plan_motion(e.structure), n + 3 * m),
            "saddle": self._plan(sums.saddle, sums.saddle_pattern.nnz),
            "outputs": self._plan(outputs, len(x.outputs)),
            "residual_direction": self._plan(directions[0], size),
            "outputs_direction": self._plan(directions[1], len(x.outputs)),
            "saddle_pattern": self._pattern(
                sums.saddle_pattern, plan_elimination(sums.saddle_pattern, n)
            ),
            **method,
        }
        body = ",\n".join(f"    .{name} = {value}" for name, value in fields.items())
        return "\n".join(
            [
                "/* Kernels, tables and numbers of a model exported by beamdae. */\n",
                '#include "model.h"\n#include "points.h"\n\n#include <math.h>\n',
                *self._functions,
                tables.source,
                *self._programs,
                f"const Model model = {{\n{body}}};\n",
            ]
        )

    def _generalized_alpha(
        self, method: GeneralizedAlpha
    ) -> tuple[SumPlan, int, int, dict[str, str]]:
        """Return the residual, its size, the size of its inputs, and fields of the model."""
        x, tables, e = self._exported, self._tables, self._exported.equations
        member = family_parameters(method.family, method.rho_inf)
        form = formulate_step(e, False)
        residual, _, matrix = form.sums
        numbers = {
            "alpha_m": method.alpha_m,
            "alpha_f": method.alpha_f,
            "gamma": method.gamma,
            "beta": method.beta,
            "shift": member.shift,
            "defect": member.defect,
            "newton_tolerance": method.newton_tolerance,
            "min_correction_limit": x.min_correction_limit,
        }
        fields = {name: format_number(value) for name, value in numbers.items()}
        fields["weights"] = tables.numbers(x.weights)
        fields["matrix"] = self._plan(matrix, form.pattern.nnz)
        smooth_motion = plan_smooth_motion(e.structure)
        fields["smooth_motion"] = self._plan(smooth_motion, e.n + 3 * e.m)
        fields["step_pattern"] = self._pattern(form.pattern, plan_elimination(form.pattern, e.n))
        return residual, e.n + e.m, 3 * e.n + e.m, fields

    def _radau(self, settings: RadauSettings) -> tuple[SumPlan, int, int, dict[str, str]]:
        """Return the residual, its size, the size of its inputs, and fields of the model."""
        tables, e = self._tables, self._exported.equations
        form = formulate_first_order(e, STABILIZED_FORM, apart=True)
        pattern, matrix, reduction = reduce_kinematics(form)
        order = plan_elimination(pattern, e.n, first=len(reduction.corrected), last=e.m)
        gaps = compile_surface_gaps(e)
        numbers = {
            "longest_step": settings.longest_step,
            "start_rate": settings.start_rate,
            "stagnation_limit": settings.stagnation_limit,
            "rounding_ratio": settings.rounding_ratio,
            "multiplier_tolerance": settings.multipliers.tolerance,
            "shortest_tested_step": settings.multipliers.shortest_step,
        }
        arrays = {
            "test_weights": settings.test_weights,
            "iteration_weights": settings.iteration_weights,
            "rounding_weights": settings.rounding_weights,
            "multiplier_tolerances": 1.0 / settings.multipliers.weights,
        }
        tableau = {
            "nodes": coefficients.C,
            "to_stages": coefficients.T,
            "from_stages": coefficients.T_INVERSE,
            "rates": coefficients.RATES,
            "polynomial": coefficients.POLYNOMIAL,
            "embedded": coefficients.EMBEDDED,
            "start": coefficients.START,
            "uniform": coefficients.UNIFORM,
        }
        eigenvalues = {
            "real_eigenvalue": coefficients.REAL_EIGENVALUE,
            "eigenvalue_re": coefficients.COMPLEX_EIGENVALUE.real,
            "eigenvalue_im": coefficients.COMPLEX_EIGENVALUE.imag,
        }
        fields = {name: format_number(value) for name, value in numbers.items()}
        fields |= {name: tables.numbers(values) for name, values in arrays.items()}
        fields |= {
            "n_tested": str(len(settings.multipliers.weights)),
            "n_corrected": str(len(reduction.corrected)),
            "n_defined": str(len(reduction.defined)),
            "corrected": tables.indices(reduction.corrected),
            "defined": tables.indices(reduction.defined),
            "tableau": _initializer(
                {name: format_number(value) for name, value in eigenvalues.items()}
                | {name: tables.numbers(np.ravel(values)) for name, values in tableau.items()}
            ),
            "matrix": self._plan(matrix, 3 * pattern.nnz + 1),
            "step_pattern": self._pattern(pattern, order),
            "n_gaps": str(len(gaps)),
            "gaps": self._plan(plan_gaps(gaps) if gaps else None, len(gaps)),
        }
        return form.sums[0], form.size, 2 * form.size, fields

    def _number_functions(self) -> dict[str, str]:
        numbers = self._exported.numbers
        if not len(numbers.targets):
            return {"numbers": "NULL", "numbers_direction": "NULL"}
        direction = SX.sym("direction", numbers.symbols.shape)
        change = ca.densify(ca.jtimes(numbers.numbers, numbers.symbols, direction))
        symbols = [numbers.symbols, direction]
        functions = {
            "numbers": ca.Function("numbers", symbols, [ca.densify(numbers.numbers)]),
            "numbers_direction": ca.Function("numbers_direction", symbols, [change]),
        }
        self._functions += [write_kernel(name, f) for name, f in functions.items()]
        return {name: name for name in functions}

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
        self._functions.append(f"static void {name}(const double *, const double *, double *);\n")
        program, tables = points.program(kernel.outputs), self._tables
        constants = tables.indices(program.integers), tables.numbers(program.weights)
        self._programs.append(write_point_kernel(name, program, names, *constants))

    def _plan(self, plan: SumPlan | None, size: int) -> str:
        """Return the initializer of a `Plan`, with the numbers of each copy side by side."""
        if plan is None:
            return "{0}"
        tables = self._tables
        local, table = _LaneRemoval(plan), plan.batch_table
        starts, rows = local.starts, []
        picked, pick_ends = local.locate_copies(plan.pick_targets, table[:, 2])
        gathered, gather_ends = local.locate_copies(plan.gather_targets, table[:, 3])
        is_picked, is_gathered = picked >= 0, gathered >= 0
        add_sources = plan.add_sources.astype(np.intp)
        weighted_sources = plan.weighted_sources.astype(np.intp)
        add_begin = weighted_begin = 0
        for k, batch in enumerate(plan.batches):
            add_end, weighted_end = table[k, 4:].tolist()
            for sources, begin, end in (
                (add_sources, add_begin, add_end),
                (weighted_sources, weighted_begin, weighted_end),
            ):
                component, copy = np.divmod(sources[begin:end], batch.lanes)
                sources[begin:end] = copy * batch.kernel.n_out + component
            add_begin, weighted_begin = add_end, weighted_end
            ends = (pick_ends[k], gather_ends[k], add_end, weighted_end)
            shape = (batch.copies, batch.kernel.n_local, batch.kernel.n_out, starts[k])
            rows.append(f"{{{self._kernel(batch.kernel)}, {', '.join(map(str, shape + ends))}}}")
        data_targets, sources = local.locate(plan.data_targets), plan.data_sources.astype(int)
        is_copy = data_targets >= 0
        data_targets, sources = data_targets[is_copy], sources[is_copy]
        order = np.argsort(self._is_variable[sources], kind="stable")
        n_out = [batch.copies * batch.kernel.n_out for batch in plan.batches]
        fields = {
            "size": size,
            "n_shared": plan.n_shared,
            "n_local": starts[-1],
            "n_out": max([plan.n_shared + 1, *n_out]),
            "n_batches": len(plan.batches),
            "n_data": len(sources),
            "n_fixed_data": int(np.sum(~self._is_variable[sources])),
            "n_add": len(add_sources),
            "n_weighted": len(weighted_sources),
            "batches": tables.rows("Batch", rows),
            "data_targets": tables.indices(data_targets[order]),
            "data_sources": tables.indices(sources[order]),
            "pick_targets": tables.indices(picked[is_picked]),
            "pick_sources": tables.indices(plan.pick_sources[is_picked]),
            "gather_targets": tables.indices(gathered[is_gathered]),
            "gather_sources": tables.indices(plan.gather_sources[is_gathered]),
            "gather_weights": tables.numbers(plan.gather_weights[is_gathered]),
            "add_targets": tables.indices(plan.add_targets),
            "add_sources": tables.indices(add_sources),
            "weighted_targets": tables.indices(plan.weighted_targets),
            "weighted_sources": tables.indices(weighted_sources),
            "weights": tables.numbers(plan.weights),
        }
        return _initializer(fields)

    def _pattern(self, pattern: sp.csc_array, plan: FixedOrder) -> str:
        tables = self._tables
        fields: dict[str, Any] = {
            "size": pattern.shape[0],
            "nnz": pattern.nnz,
            "n_upper": len(plan.upper_rows),
            "n_lower": len(plan.lower_rows),
            "matrix_starts": tables.indices(pattern.indptr),
            "matrix_rows": tables.indices(pattern.indices),
        }
        for name, array in plan._asdict().items():
            fields[name] = tables.indices(array)
        return _initializer(fields)


class _LaneRemoval:
    """New positions of local numbers, copy by copy without padding.

    Plans store components of all lanes of a batch side by side, for vectors of the processor.
    """

    def __init__(self, plan: SumPlan) -> None:
        self._new = np.full(plan.n_local, -1)
        self.starts = [0]
        for batch in plan.batches:
            height = batch.kernel.n_local
            lanes, component = np.arange(batch.copies), np.arange(height)[:, None]
            old = batch.start + component * batch.lanes + lanes
            self._new[old] = self.starts[-1] + lanes * height + component
            self.starts.append(self.starts[-1] + height * batch.copies)

    def locate(self, positions: Array) -> Array:
        """Return the new positions; -1 for padding."""
        return self._new[positions.astype(int)]

    def locate_copies(self, positions: Array, ends: Array) -> tuple[Array, Array]:
        """Return the new positions, and the ends of the batches without padding."""
        located = self.locate(positions)
        return located, np.concatenate([[0], np.cumsum(located >= 0)])[ends]


def _initializer(fields: dict[str, Any]) -> str:
    body = ", ".join(f".{name} = {value}" for name, value in fields.items())
    return f"{{{body}}}"


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
