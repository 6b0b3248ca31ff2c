"""Equations of motion as sums of kernels: what integrators evaluate in every step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import ConstraintTerm, ForceTerm, Structure
from beamdae.symbolic.constraint_kernel import NO_LEVEL
from beamdae.symbolic.force_kernel import Tangents
from beamdae.symbolic.kernel_sums import Kernel
from beamdae.symbolic.local_symbols import MATRIX_SHARED
from beamdae.symbolic.rotations import rotate_kernel
from beamdae.symbolic.sum_builder import KernelCopies, LocalInput, SumBuilder

Array = np.ndarray
TIME_SIZE = 2
# Energies and powers, the first rows of a balance.
N_BALANCE_SCALARS = 6


@dataclass(frozen=True)
class InputLayout:
    """Where q, v, a, lam and mu begin in the vector that goes into a sum."""

    q: int
    v: int = 0
    a: int = 0
    lam: int = 0
    mu: int = 0


def term_data(equations: EquationsOfMotion, term: ForceTerm | ConstraintTerm) -> Array:
    """Data of the copies of a term, a column each."""
    return _term_numbers(equations, term)[: term.kernel.local.n_data]


def _term_numbers(equations: EquationsOfMotion, term: ForceTerm | ConstraintTerm) -> Array:
    return equations.p[term.data].reshape((-1, term.count), order="F")


def build_local_operator(equations: EquationsOfMotion, term: ForceTerm) -> sp.csr_array:
    """From the global to the local coordinates of all copies."""
    if term.rotation is None:
        return term.operator
    return term.rotation.operator(
        term.operator, _term_numbers(equations, term)[term.kernel.local.n_data :]
    )


def _gather_motion(operator: sp.csr_array, *firsts: int) -> list[LocalInput]:
    return [LocalInput(operator, first) for first in firsts]


def _gather_joint_inputs(
    term: ConstraintTerm, at: InputLayout, levels: tuple[int, ...], stabilized: bool
) -> list[LocalInput]:
    highest = max(levels, default=0)
    motion = (at.q, *((at.v,) if highest > 0 else ()), *((at.a,) if highest > 1 else ()))
    held = (at.lam, *((at.mu,) if stabilized or NO_LEVEL in levels else ()))
    return _gather_motion(term.operator, *motion) + _gather_motion(term.rows, *held)


def _add_forces(total: SumBuilder, structure: Structure, at: InputLayout, row: int) -> None:
    """Add F, from a row on."""
    for term in structure.forces:
        copies = _add_force(total, at, term, term.kernel.force_kernel)
        total.add_column(copies, 0, term.operator, row)


def _add_force(
    total: SumBuilder, at: InputLayout, term: ForceTerm, kernel: Kernel, scalars: int = 0
) -> KernelCopies:
    """Add a kernel of a term, whose last outputs, so many, are not in its coordinates."""
    inputs = _gather_motion(term.operator, at.q, at.v, at.a)
    if term.rows is not None:
        inputs += _gather_motion(term.rows, at.lam)
    if term.rotation is not None:
        kernel = rotate_kernel(kernel, term.rotation, len(inputs), scalars)
    return total.add(kernel, inputs, term.data, term.count)


def assemble_residual(
    structure: Structure,
    at: InputLayout,
    levels: tuple[int, ...],
    stabilized: bool,
    dynamic: int = 0,
) -> SumBuilder:
    """Rows: from `dynamic` on F + G^T lam, then the `levels`; if `stabilized` the first G^T mu.

    See `ConstraintKernel.residual_kernel`.
    """
    n, m, total = structure.n, structure.m, SumBuilder(TIME_SIZE)
    _add_forces(total, structure, at, dynamic)
    for joint in structure.joints:
        asked = joint.kernel.effective_levels(levels, stabilized)
        copies = _add_joint(total, joint, at, *asked)
        corrects = asked[1]
        total.add_column(copies, 0, joint.operator, dynamic)
        if corrects:
            total.add_column(copies, 1, joint.operator, 0)
        for k in range(len(levels)):
            total.add_column(copies, 1 + corrects + k, joint.rows, dynamic + n + k * m)
    return total


def _add_joint(
    total: SumBuilder,
    joint: ConstraintTerm,
    at: InputLayout,
    levels: tuple[int, ...],
    stabilized: bool,
) -> KernelCopies:
    """Add the kernel of `ConstraintKernel.residual_kernel`."""
    kernel = joint.kernel.residual_kernel(levels, stabilized)
    inputs = _gather_joint_inputs(joint, at, levels, stabilized)
    return total.add(kernel, inputs, joint.data, joint.count)


def assemble_motion(structure: Structure, at: InputLayout) -> SumBuilder:
    """Rows: F, g, g_dot and g_ddot; what is not finite in G leaves them as they are."""
    total = SumBuilder(TIME_SIZE)
    _add_forces(total, structure, at, 0)
    for joint in structure.joints:
        levels = (0, 1, 2) if joint.kernel.is_holonomic else (1, 2)
        copies = _add_joint(total, joint, at, levels, False)
        for output, k in enumerate(levels, 1):
            total.add_column(copies, output, joint.rows, structure.n + k * structure.m)
    return total


def assemble_accelerations(structure: Structure, at: InputLayout) -> SumBuilder:
    """Rows: g_ddot of what holds positions."""
    total = SumBuilder(TIME_SIZE)
    for joint in select_holonomic(structure):
        copies = _add_joint(total, joint, at, (2,), False)
        total.add_column(copies, 1, joint.rows, 0)
    return total


def assemble_reactions(
    structure: Structure, at: InputLayout, of_positions: bool = False
) -> SumBuilder:
    """Rows: G^T lam, if `of_positions` without what holds velocities alone."""
    total = SumBuilder(TIME_SIZE)
    for joint in select_holonomic(structure) if of_positions else structure.joints:
        copies = _add_joint(total, joint, at, (), False)
        total.add_column(copies, 0, joint.operator, 0)
    return total


def select_holonomic(structure: Structure) -> tuple[ConstraintTerm, ...]:
    """The constraints that hold positions."""
    return tuple(joint for joint in structure.joints if joint.kernel.is_holonomic)


def assemble_balance(structure: Structure, at: InputLayout) -> SumBuilder:
    """Rows: energies and powers, F + G^T lam, G^T lam, F at a = 0, g and g_dot.

    The first are (kinetic, strain, gravity) [J] and the power of the loads, that of the drivers and
    the dissipated one [W].
    """
    n, m, total = structure.n, structure.m, SumBuilder(TIME_SIZE)
    residual = N_BALANCE_SCALARS
    reaction, still, level = residual + n, residual + 2 * n, residual + 3 * n
    for term in structure.forces:
        copies = _add_force(total, at, term, term.kernel.balance_kernel, scalars=1)
        total.add_column(copies, 0, term.operator, residual)
        total.add_column(copies, 1, term.operator, still)
        total.add_column(copies, 2, _summation(term.count, 0, 1, 2, 3, 5), 0)
    for joint in structure.joints:
        inputs = _gather_joint_inputs(joint, at, (1,), False)
        copies = total.add(joint.kernel.balance_kernel, inputs, joint.data, joint.count)
        total.add_column(copies, 0, joint.operator, residual)
        total.add_column(copies, 0, joint.operator, reaction)
        total.add_column(copies, 1, joint.rows, level)
        total.add_column(copies, 2, joint.rows, level + m)
        total.add_column(copies, 3, _summation(joint.count, 4), 0)
    return total


def _summation(count: int, *rows: int) -> sp.csr_array:
    """What adds up columns of all copies into these rows."""
    at = np.tile(rows, count)
    return sp.csr_array(
        (np.ones(len(at)), (np.arange(len(at)), at)), shape=(len(at), N_BALANCE_SCALARS)
    )


def add_tangents(
    total: SumBuilder, structure: Structure, at: InputLayout, sums: Tangents
) -> list[tuple[ForceTerm, KernelCopies]]:
    """Add the kernels of `ForceKernel.tangent_kernel`."""
    return [
        (term, _add_force(total, at, term, term.kernel.tangent_kernel(sums)))
        for term in structure.forces
    ]


def add_joint_matrices(
    total: SumBuilder,
    structure: Structure,
    at: InputLayout,
    levels: tuple[int, ...],
    stabilized: bool,
) -> list[tuple[ConstraintTerm, KernelCopies]]:
    """Add the kernels of `ConstraintKernel.matrices_kernel`, of the levels each of them has."""
    found = []
    for joint in structure.joints:
        asked = joint.kernel.effective_levels(levels, stabilized)
        kernel, inputs = (
            joint.kernel.matrices_kernel(*asked),
            _gather_joint_inputs(joint, at, *asked),
        )
        found.append((joint, total.add(kernel, inputs, joint.data, joint.count)))
    return found


def create_matrix_sum() -> SumBuilder:
    """A sum of matrices, without any."""
    return SumBuilder(len(MATRIX_SHARED))
