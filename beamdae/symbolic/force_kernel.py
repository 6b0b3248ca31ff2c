"""Generalized forces of one statement and the kernels derived from them."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.native.instructions import (
    evaluate_instructions,
    operation_codes,
    read_instructions,
    read_operations,
    repeat_operation,
    trace_dependence,
)
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.constraint_kernel import ConstraintKernel
from beamdae.symbolic.local_symbols import SX, Local, describe_column_error
from beamdae.symbolic.signals import SignalBinding, bind_signals, find_signals
from beamdae.symbolic.sums.kernel_code import PointSum, PointTerm
from beamdae.symbolic.sums.kernel_sums import Kernel
from beamdae.symbolic.table_lookups import TableCall

Array = np.ndarray

# Indices of dF/dq, dF/dv and dF/da in `Tangents`.
STIFFNESS = 0
DAMPING = 1
MASS = 2

# One item per matrix: the indices of the derivatives in its sum.
Tangents = tuple[tuple[int, ...], ...]

# Sums and products of powers, sines and cosines are broad; values of other operations may be zero
# except for a short time.
_BROAD_OPERATIONS = set(operation_codes("ASSIGN ADD SUB MUL NEG SQ TWICE SIN COS"))

# Operations with jumps or kinks, and calls of tables.
_ABRUPT_OPERATIONS = set(
    operation_codes(
        "LT LE EQ NE NOT AND OR IF_ELSE_ZERO SIGN FABS FLOOR CEIL FMOD REMAINDER COPYSIGN FMIN "
        "FMAX CALL"
    )
)

# Functions of points may contain the symbols of signals, which statements replace.
_FREE_SIGNALS = {"allow_free": True}
_N_ENERGIES = 3
_N_POWERS = 2


@dataclass(frozen=True)
class ForceKernel:
    """Generalized forces of one statement, F = M a - f, with energies and powers.

    Attributes
    ----------
    local
        Symbols of the coordinates, multipliers and data.
    force
        F(time, q, v, a, lam, data), shape (size,): inertial, elastic, damping and gravity forces
        and loads on the left-hand side of F + G^T lam = 0. lam are the multipliers of a joint, for
        example for friction.
    energies
        (kinetic energy, strain energy, potential of gravity) [J].
    powers
        (power of the loads, dissipated power) [W].
    reused
        True if statements share the kernel unchanged; see `kernel_groups` for other kernels.
    table_calls
        Tables in the expressions.
    points
        Points whose forces are the whole force; empty if the force has another form.
    compliant
        Form of the force whose stiff parts are constraints with compliance, or None.
    mix
        Function that returns the kernel of the same force with resultants as unknowns, or None; see
        `mixed`.
    resultants
        Number of resultants r, which are the last coordinates. The last forces are g(q, v) - r, by
        the laws r = g of the resultants; the derivatives of the other forces with respect to the
        other coordinates include those through the laws.
    """

    local: Local
    force: SX
    energies: SX = field(default_factory=lambda: SX.zeros(_N_ENERGIES))
    powers: SX = field(default_factory=lambda: SX.zeros(_N_POWERS))
    reused: bool = False
    table_calls: tuple[TableCall, ...] = ()
    points: tuple[ForceAtPoint, ...] = field(default=(), repr=False)
    compliant: CompliantForm | None = field(default=None, repr=False)
    mix: Callable[[], ForceKernel] | None = field(default=None, repr=False)
    resultants: int = 0
    _tangents: dict[Tangents, Kernel] = field(default_factory=dict, init=False, repr=False)
    _tangent_functions: dict[tuple[int, ...], ca.Function] = field(
        default_factory=dict, init=False, repr=False
    )

    @cached_property
    def mixed(self) -> ForceKernel:
        """Kernel of the same force with resultants as unknowns; this kernel if it has none."""
        if self.mix is not None:
            return self.mix()
        counts = [point.kernel.mixed.resultants for point in self.points]
        total, old = sum(counts), self.local
        if not total:
            return self
        local, eye = Local(old.size + total, old.n_data), ca.DM.eye(total)
        own = ca.vertsplit(eye, [0, *np.cumsum(counts).tolist()])
        points = [
            ForceAtPoint(
                ca.diagcat(point.differences, eye),
                ca.diagcat(point.weights, rows),
                point.kernel.mixed,
                ca.substitute(point.data, old.data, local.data),
            )
            for point, rows in zip(self.points, own, strict=True)
        ]
        return replace(ForceKernel.of_points(local, points), resultants=total)

    @property
    def inputs(self) -> list[SX]:
        """Symbols (time, q, v, a, lam, data) of the expressions; only the force may depend on a."""
        x = self.local
        return [x.time, x.q, x.v, x.a, x.lam, x.data]

    @property
    def outputs(self) -> list[SX]:
        """Expressions (force, energies, powers)."""
        return [self.force, self.energies, self.powers]

    @classmethod
    def of_points(
        cls, local: Local, points: Sequence[ForceAtPoint], compliant: CompliantForm | None = None
    ) -> ForceKernel:
        """Return the reused kernel of the sum of the forces, energies and powers of points."""
        force, energies, powers = SX.zeros(local.size), SX.zeros(_N_ENERGIES), SX.zeros(_N_POWERS)
        calls: list[TableCall] = []
        for point in points:
            inputs = point.inputs(local)
            of_point = point.kernel.point_function(*inputs)
            force += point.operator.T @ of_point[0]
            energies += of_point[1]
            powers += of_point[2]
            calls += point.kernel.table_calls_at(*inputs)
        return cls(local, force, energies, powers, True, tuple(calls), tuple(points), compliant)

    def table_calls_at(self, *inputs: SX) -> list[TableCall]:
        """Return the calls of tables at other (time, q, v, a, data), for kernels of points."""
        x, calls = self.local, []
        for table, arguments, value in self.table_calls:
            symbols = [x.time, x.q, x.v, x.a, x.data]
            expressions = [*arguments, value]
            function = ca.Function("calls", symbols, expressions, _FREE_SIGNALS)
            *others, value_at = function.call(inputs)
            calls.append(TableCall(table, tuple(others), value_at))
        return calls

    @cached_property
    def point_function(self) -> ca.Function:
        """Function of (time, q, v, a, data) that returns the `outputs`, for kernels of points."""
        x = self.local
        inputs = [x.time, x.q, x.v, x.a, x.data]
        return ca.Function("point", inputs, self.outputs, _FREE_SIGNALS)

    @cached_property
    def expression_error(self) -> str:
        """Error message about the expressions; '' if they are valid."""
        x = self.local
        motion = (x.time, x.q, x.v, x.lam, x.data)
        return (
            describe_column_error("force", self.force, x.size, *motion, x.a)
            or describe_column_error("energies", self.energies, _N_ENERGIES, *motion)
            or describe_column_error("powers", self.powers, _N_POWERS, *motion)
        )

    @cached_property
    def signal_binding(self) -> tuple[SignalBinding, ForceKernel] | None:
        """Outputs without symbols of signals, and the kernel of them; None without signals."""
        signals = find_signals(*self.outputs)
        if not signals:
            return None
        binding = bind_signals(self.local, self.outputs, signals)
        force, energies, powers = binding.outputs
        # Measured coordinates are not loaded.
        force = ca.vertcat(force, SX.zeros(binding.local.size - self.local.size))
        return binding, ForceKernel(binding.local, force, energies, powers, self.reused)

    @cached_property
    def has_branches(self) -> bool:
        """True if the force depends on the branch of a law."""
        return ca.depends_on(self.force, self.local.time[1])

    @cached_property
    def is_one_sided(self) -> bool:
        """True if the force contains a maximum or minimum, such as the penetration of a contact."""
        f = ca.Function("force", self.inputs, [self.force])
        return not {ca.OP_FMAX, ca.OP_FMIN}.isdisjoint(read_operations(f))

    def applies(
        self, is_operation: Callable[[int], bool], arguments: Container[tuple[int, int]]
    ) -> bool:
        """Return True if an operation of CasADi acts on values that depend on `arguments`.

        `is_operation` selects the operations by their codes. `arguments` are pairs (index in
        `inputs`, entry).
        """
        function = ca.Function("force", self.inputs, [self.force])
        return any(
            # Of a conditional value, the condition decides.
            is_operation(code) and any(flags[:1] if code == ca.OP_IF_ELSE_ZERO else flags)
            for code, flags in trace_dependence(function, arguments)
        )

    @cached_property
    def has_kinks_over_motion(self) -> bool:
        """True if the force has kinks or tables over positions, velocities or reactions.

        Kinks over time or inputs do not count, and neither do smooth formulas with short peaks.
        """
        x = self.local
        sizes = {1: x.size, 2: x.size, 4: x.n_multipliers}  # q, v and lam in `inputs`
        motion = {(argument, entry) for argument, size in sizes.items() for entry in range(size)}
        return self.applies(_ABRUPT_OPERATIONS.__contains__, motion)

    @cached_property
    def may_have_peaks(self) -> bool:
        """True for a formula that may have narrow peaks over time or over the motion."""
        if not self.has_load_function:
            return False
        entries = {(0, 0), *((k, i) for k in (1, 2) for i in range(self.local.size))}
        return self.applies(lambda code: code not in _BROAD_OPERATIONS, entries)

    @cached_property
    def has_load_function(self) -> bool:
        """True if time, q, v and data determine the force; then `load_function` is exact."""
        x = self.local
        return not (self.reused or x.n_multipliers or self.has_accelerations)

    @cached_property
    def load_function(self) -> RowFunction:
        """F in (time, q, v, data), without accelerations and multipliers."""
        return RowFunction(self._load)

    @cached_property
    def _load(self) -> ca.Function:
        x = self.local
        zeros = [SX.zeros(x.a.shape), SX.zeros(x.lam.shape)]
        force = ca.substitute(self.force, ca.vertcat(x.a, x.lam), ca.vertcat(*zeros))
        return ca.Function("load", [x.time, x.q, x.v, x.data], [ca.densify(force)])

    @cached_property
    def peak_arguments(self) -> RowFunction:
        """Arguments in `load_function` of the operations by which a formula may have peaks.

        Functions in (time, q, v, data). Of operations on two moving arguments, they include the
        difference.
        """
        inputs, arguments = self._load.sx_in(), [SX(0, 1)]

        # Values are expressions, and whether they depend on time, q or v.
        def read(code: int, operands: tuple[Any, ...]) -> tuple[SX, bool]:
            if code == ca.OP_CONST:
                return SX(*operands), False
            is_moving = operands == (0, 0) or operands[0] in (1, 2)
            return inputs[operands[0]].nz[operands[1]], is_moving

        def operate(
            operation: Any, operands: list[tuple[SX, bool]], count: int
        ) -> list[tuple[SX, bool]]:
            moving = [x for x, is_moving in operands if is_moving]
            if operation not in _BROAD_OPERATIONS:
                arguments.extend([*moving, moving[0] - moving[1]] if moving[1:] else moving)
            results = repeat_operation(operation, [x for x, _ in operands], count)
            return [(x, bool(moving)) for x in results]

        evaluate_instructions(read_instructions(self._load), read, operate, lambda *x: None)
        return RowFunction(ca.Function("arguments", inputs, [ca.vertcat(*arguments)]))

    @cached_property
    def has_accelerations(self) -> bool:
        """True if the force depends on accelerations, as inertia does."""
        return bool(ca.depends_on(self.force, self.local.a))

    @cached_property
    def _stacked(self) -> SX:
        x = self.local
        return ca.vertcat(x.q, x.v, x.a, x.lam, x.data)

    @cached_property
    def force_kernel(self) -> Kernel:
        """Kernel of F in (t, branch) and (q, v, a, lam, data)."""
        outputs, points = (
            [ca.densify(self.force)],
            self._sum_points(lambda kernel: kernel.force_kernel),
        )
        return Kernel.of("force", self.local.time, self._stacked, outputs, points)

    def tangent_kernel(self, sums: Tangents) -> Kernel:
        """Return the kernel of sums of c_q dF/dq, c_v dF/dv and c_a dF/da, one matrix per sum.

        `sums` lists the derivatives in each sum. The inputs are `MATRIX_SHARED` and
        (q, v, a, lam, data). If `local` has multipliers, the last outputs are dF/dlam and
        c_l dF/dlam, and all outputs are evaluated at the multipliers c_r lam.
        """
        if sums not in self._tangents:
            self._tangents[sums] = self._build_tangent_kernel(sums)
        return self._tangents[sums]

    def _build_tangent_kernel(self, sums: Tangents) -> Kernel:
        x, (shared, c) = self.local, self.local.matrix_inputs()
        factors = {STIFFNESS: c.c_q, DAMPING: c.c_v, MASS: c.c_a}
        outputs = [self._sum_derivatives({k: factors[k] for k in terms}) for terms in sums]
        if x.n_multipliers:
            by_lam = ca.jacobian(self.force, x.lam)
            outputs += [by_lam, c.c_l * by_lam]
            outputs = ca.substitute(outputs, [x.lam], [c.c_r * x.lam])
        points = self._sum_points(lambda kernel: kernel.tangent_kernel(sums))
        return Kernel.of("tangent", shared, self._stacked, outputs, points)

    def _sum_derivatives(self, factors: dict[int, SX]) -> SX:
        """Return the sum of derivatives of F, times factors by derivative, (size, size)."""
        x, total = self.local, SX(self.local.size, self.local.size)
        for point in self.points:
            # B^T C B has half as many operations as the derivatives of the sum of all points.
            tangent = point.kernel._tangent_function(tuple(factors))
            matrix, operator = tangent(*factors.values(), *point.inputs(x)), point.operator
            total += operator.T @ (matrix @ operator)
        if self.points:
            return total
        symbols = {STIFFNESS: x.q, DAMPING: x.v, MASS: x.a}
        total = sum((c * ca.jacobian(self.force, symbols[k]) for k, c in factors.items()), total)
        size = x.size - self.resultants
        by_resultants = ca.jacobian(self.force[:size], x.q[size:])
        total[:size, :size] += by_resultants @ total[size:, :size]
        return total

    def _tangent_function(self, terms: tuple[int, ...]) -> ca.Function:
        """Return the function of (factors of `terms`, time, q, v, a, data) for their sum."""
        if terms not in self._tangent_functions:
            x, factors = self.local, {k: SX.sym(f"c{k}") for k in terms}
            inputs = [*factors.values(), x.time, x.q, x.v, x.a, x.data]
            outputs = [self._sum_derivatives(factors)]
            function = ca.Function("tangent", inputs, outputs, _FREE_SIGNALS)
            self._tangent_functions[terms] = function
        return self._tangent_functions[terms]

    @cached_property
    def balance_kernel(self) -> Kernel:
        """Kernel of F, F at a = 0, and (energies, powers); inputs as in `force_kernel`."""
        x = self.local
        at_zero_acceleration = ca.substitute(self.force, x.a, SX.zeros(x.a.shape))
        outputs = [self.force, at_zero_acceleration, ca.vertcat(self.energies, self.powers)]
        dense = [ca.densify(o) for o in outputs]
        points = self._sum_points(lambda kernel: kernel.balance_kernel)
        return Kernel.of("balance", x.time, self._stacked, dense, points)

    def _sum_points(self, get_kernel: Callable[[ForceKernel], Kernel]) -> PointSum | None:
        """Return the sum of a kernel of all points; None if the force has another form."""
        if not self.points:
            return None
        terms = []
        for kernel in {id(x.kernel): x.kernel for x in self.points}.values():
            points = [x for x in self.points if x.kernel is kernel]
            of_point = get_kernel(kernel)
            terms.append(
                PointTerm(
                    of_point.source,
                    of_point.rewrites,
                    of_point.outputs,
                    points[0].differences.full(),
                    np.array([x.weights.full() for x in points]),
                    np.array([x.rows_of_data(self.local) for x in points]),
                )
            )
        return PointSum(tuple(terms), 3, self.local.n_data)


def mix_law(
    local: Local, deformation: SX, law: SX, count: int, rest: SX | None = None
) -> ForceKernel:
    """Return the kernel of a law of deformations whose first `count` forces are unknowns.

    The force is J^T law + `rest`, with the Jacobian J of the deformation. Computed from
    deformations, stiff forces would be wrong after every correction of Newton's method that turns
    them; as unknowns, they are as accurate as the reactions of joints.
    """
    mixed, resultants = Local(local.size + count, local.n_data), SX.sym("resultants", count)
    stiff, others = ca.vertsplit(law, [0, count, law.numel()])
    forces = ca.vertcat(resultants, others)
    force = ca.jtimes(deformation, local.q, forces, True) + (0 if rest is None else rest)
    old = local.time, ca.vertcat(local.q, resultants), local.v, local.data
    new = mixed.time, mixed.q, mixed.v[: local.size], mixed.data
    (force,) = ca.substitute(
        [ca.vertcat(force, stiff - resultants)], [ca.vertcat(*old)], [ca.vertcat(*new)]
    )
    return ForceKernel(mixed, force, resultants=count)


class CompliantForm(NamedTuple):
    """Force whose elastic parts are the reactions lam of constraints g(z) - lam = 0 of points.

    A stiffness k of a deformation x is g = sqrt(k) x. If it exceeds others by many digits, it does
    not enter the rounding errors of the forces.

    Attributes
    ----------
    kernel
        Constraints g of a point.
    operators
        Matrices (points, coordinates of a point, local coordinates): z = B x.
    split
        Function of the numbers of copies (n_data, count) that returns those of the rest of the
        force (n_data, count), those of the points (count, points, data), the retardation times tau
        of g + tau g' - lam = 0, and the multiple of g which that rest adds to lam (count, points,
        constraints of a point). A second argument, a mask of constraints, names those whose
        stiffnesses stay in the rest.
    """

    kernel: ConstraintKernel
    operators: Array
    split: Callable[..., tuple[Array, ...]]


class ForceAtPoint(NamedTuple):
    """Force B^T f(t, B q, B v, B a, data) of a point on local coordinates, for example of elements.

    Attributes
    ----------
    differences
        Constant matrix D (size, size). Its rows are evaluated first: differences of coordinates
        have smaller rounding errors than sums of coordinates times weights that cancel.
    weights
        Constant matrix W (n, size): the coordinates of the point are W (D q), B = W D.
    kernel
        Kernel of f, in the coordinates of the point.
    data
        Numbers of the kernel.
    """

    differences: ca.DM
    weights: ca.DM
    kernel: ForceKernel
    data: SX

    @property
    def operator(self) -> SX:
        """The matrix B (n, size)."""
        return SX(ca.sparsify(self.weights @ self.differences))

    def inputs(self, local: Local) -> list[SX]:
        """Return (time, q, v, a, data) of the point."""
        differences, weights = SX(self.differences), SX(self.weights)
        motion = (weights @ (differences @ x) for x in (local.q, local.v, local.a))
        return [local.time, *motion, self.data]

    def rows_of_data(self, local: Local) -> Array:
        """Return the rows of the local data of which the numbers of the kernel consist."""
        rows = ca.Function("rows", [local.data], [ca.densify(self.data)])
        return rows(np.arange(local.data.numel())).full().ravel().astype(int)
