"""Equations of motion as sums of kernels, which integrators evaluate in every step."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp

from beamdae.equations.structure import ConstraintTerm, ForceTerm, Structure
from beamdae.symbolic.constraint_kernel import NO_LEVEL
from beamdae.symbolic.force_kernel import Tangents
from beamdae.symbolic.local_symbols import MATRIX_SHARED
from beamdae.symbolic.sums.kernel_sums import Kernel
from beamdae.symbolic.sums.rotations import rotate_kernel
from beamdae.symbolic.sums.sum_builder import KernelCopies, LocalInput, SumBuilder

Array = np.ndarray

TIME_SIZE = 2  # (t, branch)
# Energies (kinetic, strain, gravity) [J] and powers (loads, drivers, dissipated) [W].
N_BALANCE_SCALARS = 6
_FORCE_SCALARS = (0, 1, 2, 3, 5)  # scalars to which forces contribute
_DRIVER_POWER = 4  # scalar to which joints contribute

# Outputs of `ConstraintKernel.matrices_kernel`.
GRADIENT = 0  # G
SCALED_GRADIENT = 1  # c_l G
REACTION_STIFFNESS = 2  # d(G^T lam)/dq
FIRST_LEVEL = 3  # first of the derivatives of g_dot and g_ddot, if there is no mu
CORRECTION_STIFFNESS = 3  # d(G^T mu)/dq, if there is mu; the derivatives of the levels follow


@dataclass(frozen=True)
class InputLayout:
    """Offsets of q, v, a, lam, mu and resultants in the input vector of a sum."""

    q: int
    v: int = 0
    a: int = 0
    lam: int = 0
    mu: int = 0
    resultants: int = 0


def _local_inputs(operator: sp.csr_array, *offsets: int) -> list[LocalInput]:
    return [LocalInput(operator, offset) for offset in offsets]


def _joint_inputs(
    term: ConstraintTerm, layout: InputLayout, levels: tuple[int, ...], stabilized: bool
) -> list[LocalInput]:
    """Return the inputs of the kernels of a joint; v, a and mu are included only if needed."""
    highest = max(levels, default=0)
    motion = [layout.q]
    if highest > 0:
        motion.append(layout.v)
    if highest > 1:
        motion.append(layout.a)
    multipliers = [layout.lam]
    if stabilized or NO_LEVEL in levels:
        multipliers.append(layout.mu)
    return _local_inputs(term.operator, *motion) + _local_inputs(term.rows, *multipliers)


def _add_forces(
    total: SumBuilder, forces: Iterable[ForceTerm], layout: InputLayout, row: int
) -> list[tuple[ForceTerm, KernelCopies]]:
    """Add F, starting at row `row`; return each term with its kernels in the sum."""
    force_copies = []
    for term in forces:
        copies = _add_force(total, layout, term, term.kernel.force_kernel)
        total.add_column(copies, 0, term.operator, row)
        force_copies.append((term, copies))
    return force_copies


def _add_force(
    total: SumBuilder, layout: InputLayout, term: ForceTerm, kernel: Kernel, scalars: int = 0
) -> KernelCopies:
    """Add a kernel of a force term.

    The last `scalars` outputs of the kernel do not refer to local coordinates.
    """
    inputs = _local_inputs(term.operator, layout.q, layout.v, layout.a)
    if term.resultants is not None:
        height, n = term.operator.shape
        between = sp.csr_array((height, layout.resultants - layout.q - n))
        columns = sp.hstack([term.operator, between, term.resultants], format="csr")
        inputs[0] = LocalInput(columns, layout.q)
    if term.rows is not None:
        inputs += _local_inputs(term.rows, layout.lam)
    if term.rotation is not None:
        kernel = rotate_kernel(kernel, term.rotation, len(inputs), scalars)
    return total.add(kernel, inputs, term.data, term.count)


def assemble_residual(
    structure: Structure,
    layout: InputLayout,
    levels: tuple[int, ...],
    stabilized: bool,
    dynamic: int = 0,
) -> SumBuilder:
    """Return the sum that evaluates F + G^T lam and the constraints on `levels`, stacked.

    F + G^T lam starts at row `dynamic` and is followed by the constraints. If `stabilized`, the
    first n rows are P G^T mu, so that `dynamic` must be n. See `ConstraintKernel.residual_kernel`.
    """
    n, m, total = structure.n, structure.m, SumBuilder(TIME_SIZE)
    for term, copies in _add_forces(total, structure.forces, layout, dynamic):
        if term.resultants is not None:
            row = dynamic + n + len(levels) * m
            total.add_column(copies, 0, term.resultants, row)
    for joint in structure.joints:
        own_levels, corrects = joint.kernel.effective_levels(levels, stabilized)
        copies = _add_joint(total, joint, layout, own_levels, corrects)
        total.add_column(copies, 0, joint.operator, dynamic)
        if corrects:
            total.add_column(copies, 1, joint.operator, 0, structure.correction_factors)
        for k in range(len(levels)):
            total.add_column(copies, 1 + corrects + k, joint.rows, dynamic + n + k * m)
    return total


def _add_joint(
    total: SumBuilder,
    joint: ConstraintTerm,
    layout: InputLayout,
    levels: tuple[int, ...],
    stabilized: bool,
) -> KernelCopies:
    """Add the kernels of a joint, see `ConstraintKernel.residual_kernel`."""
    kernel = joint.kernel.residual_kernel(levels, stabilized)
    inputs = _joint_inputs(joint, layout, levels, stabilized)
    return total.add(kernel, inputs, joint.data, joint.count)


def assemble_motion(
    structure: Structure,
    layout: InputLayout,
    forces: Iterable[ForceTerm] | None = None,
    with_reactions: bool = False,
) -> SumBuilder:
    """Return the sum that evaluates the stacked vector (F, g, g_dot, g_ddot[, G^T lam]).

    Rows of g are zero for nonholonomic constraints. F does not contain G^T lam, so that F and g
    stay finite at positions where G is not finite; it is the sum of `forces`, by default of all.
    G^T lam follows if `with_reactions`.
    """
    total = SumBuilder(TIME_SIZE)
    _add_forces(total, structure.forces if forces is None else forces, layout, 0)
    for joint in structure.joints:
        levels = (0, 1, 2) if joint.kernel.is_holonomic else (1, 2)
        copies = _add_joint(total, joint, layout, levels, False)
        for output, k in enumerate(levels, 1):
            total.add_column(copies, output, joint.rows, structure.n + k * structure.m)
        if with_reactions:
            total.add_column(copies, 0, joint.operator, structure.n + 3 * structure.m)
    return total


def assemble_reactions(
    structure: Structure, layout: InputLayout, holonomic_only: bool = False
) -> SumBuilder:
    """Return the sum that evaluates G^T lam of all, or only of holonomic, constraints."""
    total = SumBuilder(TIME_SIZE)
    for joint in select_holonomic(structure) if holonomic_only else structure.joints:
        copies = _add_joint(total, joint, layout, (), False)
        total.add_column(copies, 0, joint.operator, 0)
    return total


def select_holonomic(structure: Structure) -> tuple[ConstraintTerm, ...]:
    """Return the terms of the holonomic constraints."""
    return tuple(joint for joint in structure.joints if joint.kernel.is_holonomic)


def assemble_balance(structure: Structure, layout: InputLayout) -> SumBuilder:
    """Return the sum that evaluates energies, powers, forces and constraints, stacked.

    The first rows are the energies (kinetic, strain, gravity) [J] and the powers (loads, drivers,
    dissipated) [W], followed by F + G^T lam, G^T lam, F at a = 0, g and g_dot.
    """
    n, m, total = structure.n, structure.m, SumBuilder(TIME_SIZE)
    residual = N_BALANCE_SCALARS
    reaction, static, level = residual + n, residual + 2 * n, residual + 3 * n
    for term in structure.forces:
        copies = _add_force(total, layout, term, term.kernel.balance_kernel, scalars=1)
        add = partial(total.add_column, copies)
        add(0, term.operator, residual)
        add(1, term.operator, static)
        add(2, _summation(term.count, *_FORCE_SCALARS), 0)
    for joint in structure.joints:
        inputs = _joint_inputs(joint, layout, (1,), False)
        copies = total.add(joint.kernel.balance_kernel, inputs, joint.data, joint.count)
        add = partial(total.add_column, copies)
        add(0, joint.operator, residual)
        add(0, joint.operator, reaction)
        add(1, joint.rows, level)
        add(2, joint.rows, level + m)
        add(3, _summation(joint.count, _DRIVER_POWER), 0)
    return total


def _summation(count: int, *rows: int) -> sp.csr_array:
    """Return the operator that adds the outputs of `count` copies to rows of the scalars."""
    column = np.tile(rows, count)
    entries = (np.ones(len(column)), (np.arange(len(column)), column))
    return sp.csr_array(entries, shape=(len(column), N_BALANCE_SCALARS))


def add_tangents(
    total: SumBuilder, structure: Structure, layout: InputLayout, sums: Tangents
) -> list[tuple[ForceTerm, KernelCopies]]:
    """Add the tangent kernels of all force terms; return each term with its kernels in the sum.

    See `ForceKernel.tangent_kernel` for `sums`.
    """
    return [
        (term, _add_force(total, layout, term, term.kernel.tangent_kernel(sums)))
        for term in structure.forces
    ]


def add_joint_matrices(
    total: SumBuilder,
    structure: Structure,
    layout: InputLayout,
    levels: tuple[int, ...],
    stabilized: bool,
) -> list[tuple[ConstraintTerm, KernelCopies]]:
    """Add the matrix kernels of all joints; return each term with its kernels in the sum.

    See `ConstraintKernel.matrices_kernel` for `levels` and `stabilized`.
    """
    joint_copies = []
    for joint in structure.joints:
        effective = joint.kernel.effective_levels(levels, stabilized)
        kernel = joint.kernel.matrices_kernel(*effective)
        inputs = _joint_inputs(joint, layout, *effective)
        joint_copies.append((joint, total.add(kernel, inputs, joint.data, joint.count)))
    return joint_copies


def add_saddle_point(
    total: SumBuilder,
    structure: Structure,
    layout: InputLayout,
    sums: Tangents,
    *,
    with_reaction_stiffness: bool,
) -> None:
    """Add the matrix [[K, G^T + dF/dlam], [G, 0]].

    K is the sum of the derivatives of F listed in `sums`, times their factors (see
    `ForceKernel.tangent_kernel`), and, if `with_reaction_stiffness`, of d(G^T lam)/dq.
    """
    n = structure.n
    for term, copies in add_tangents(total, structure, layout, sums):
        for output in range(len(sums)):
            total.add_matrix(copies, output, term.operator, term.operator, (0, 0))
        if term.rows is not None:
            total.add_matrix(copies, len(sums), term.operator, term.rows, (0, n))
    levels = (0,) if with_reaction_stiffness else ()
    for joint, copies in add_joint_matrices(total, structure, layout, levels, False):
        add, on_q = partial(total.add_matrix, copies), joint.operator
        add(GRADIENT, joint.rows, on_q, (n, 0))
        add(GRADIENT, joint.rows, on_q, (0, n), transposed=True)
        if with_reaction_stiffness:
            add(REACTION_STIFFNESS, on_q, on_q, (0, 0))


def create_matrix_sum() -> SumBuilder:
    """Return an empty sum of matrices with the shared inputs `MATRIX_SHARED`."""
    return SumBuilder(len(MATRIX_SHARED))
