"""First-order form of the equations of motion, and the unknowns that depend on others.

The equations F(t, q, v, a) + G^T lam = 0, g(t, q) = 0 become 0 = R(t, y, y') in these forms:

==================  =============  ==========================================================
form                y              equations
==================  =============  ==========================================================
index3              q, v, lam      q' = v; F + G^T lam = 0; g = 0
index2              q, v, lam      q' = v; F + G^T lam = 0; g_dot = 0
index1              q, v, lam      q' = v; F + G^T lam = 0; g_ddot = 0
ggl                 q, v, lam, mu  q' = v - P G^T mu; F + G^T lam = 0; g = 0; g_dot = 0
stabilized-index1   q, v, Lam, Mu  as ggl with lam = Lam', mu = Mu'
==================  =============  ==========================================================

ggl: Gear, Gupta & Leimkuhler, J. Comput. Appl. Math. 12-13 (1985) 77. stabilized-index1:
Anantharaman & Hiller, Int. J. Numer. Meth. Eng. 32 (1991) 1531. The diagonal matrix P assigns small
shares of the corrections to deformations (`Structure.correction_factors`); it does not change the
solution, for which mu = 0. Nonholonomic constraints A(t, q) v + b(t, q) = 0 replace g_dot = 0, with
A in place of G, and their derivative replaces g_ddot = 0. They also replace g = 0 in index3; in the
forms with mu, mu = 0 replaces g = 0.

For a correction of (y, y') by (x, c x), rows q' - v = 0 that hold already give x_v = c x_q. Without
these rows and velocities, the matrix R_y + c R_y' becomes K + c D + c^2 M, of about half the size.
Coordinates whose rows contain corrections by joints, q' = v - P G^T mu, keep both. In mixed
equations, resultants are defined by their laws; without them, the matrix is that of equations
without resultants.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.sums import (
    CORRECTION_STIFFNESS,
    FIRST_LEVEL,
    GRADIENT,
    REACTION_STIFFNESS,
    SCALED_GRADIENT,
    InputLayout,
    add_joint_matrices,
    add_tangents,
    assemble_residual,
    create_matrix_sum,
)
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.errors import require_choice
from beamdae.symbolic.constraint_kernel import NO_LEVEL
from beamdae.symbolic.force_kernel import DAMPING, MASS, STIFFNESS, Tangents
from beamdae.symbolic.local_symbols import C_A
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_matrix_factors, set_time
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator

Array = np.ndarray


@dataclass(frozen=True)
class Formulation:
    """First-order form of the equations of motion.

    Attributes
    ----------
    name, index
        Name of the form, and differentiation index of its equations.
    levels
        Levels of the constraints in the equations: g (0), g_dot (1) and g_ddot (2).
    stabilized
        True if multipliers mu of the velocity constraints correct q' = v.
    impulses
        True if the unknowns are time integrals of the multipliers: lam = Lam'.
    note
        Limitation that Ida reports for every run with this form; "" if there is none.
    """

    name: str
    index: int
    levels: tuple[int, ...]
    stabilized: bool = False
    impulses: bool = False
    note: str = ""


_DRIFT_NOTE = "positions drift off the joints and may change branch at singular positions"
# Measured on a rigid slider-crank: position errors of 20 to 170 rtol and velocity errors of 160 to
# 1400 rtol, against 0.5 and 4 to 19 with stabilized-index1; equal on the hub beam.
_TOLERANCE_NOTE = "rtol is not met: positions of rigid mechanisms were off by up to 170 rtol"
FORMULATIONS = {
    formulation.name: formulation
    for formulation in (
        Formulation("stabilized-index1", 1, (0, 1), stabilized=True, impulses=True),
        Formulation("ggl", 2, (0, 1), stabilized=True),
        Formulation("index2", 2, (1,), note=_DRIFT_NOTE),
        Formulation("index1", 1, (2,), note=_DRIFT_NOTE),
        Formulation("index3", 3, (0,), note=_TOLERANCE_NOTE),
    )
}
FIRST_ORDER = tuple(FORMULATIONS)


@dataclass(frozen=True)
class FirstOrderForm:
    """Residual R(t, y, y') of a first-order form with its exact Jacobian dR/dy + c dR/dy'.

    Attributes
    ----------
    equations, formulation
        Equations of motion, and the form to which they are converted.
    pattern
        CSC pattern of the Jacobian, (size, size); for a form built with `apart`, of each of its two
        parts.
    sums
        Plans of the sums of kernels that evaluate the residual and the Jacobian, with the inputs
        (y, y').
    apart
        True if dR/dy and dR/dy' are evaluated separately.
    """

    equations: EquationsOfMotion
    formulation: Formulation
    pattern: sp.csc_array
    sums: tuple[SumPlan, SumPlan]
    apart: bool = False

    @property
    def size(self) -> int:
        """Number of unknowns y."""
        return self.pattern.shape[0]

    @property
    def _slices(self) -> tuple[slice, slice, slice]:
        """Slices of q, v and lam in y."""
        n, m = self.equations.n, self.equations.m
        return slice(0, n), slice(n, 2 * n), slice(2 * n, 2 * n + m)

    def pack(self, state: State) -> tuple[Array, Array]:
        """Return consistent (y, y') of a consistent state, in which resultants are zero."""
        q, v, lam = self._slices
        y, yp = np.zeros(self.size), np.zeros(self.size)
        y[q], y[v], yp[q], yp[v] = state.q, state.v, state.v, state.a
        (yp if self.formulation.impulses else y)[lam] = state.lam
        return y, yp

    def unpack(self, y: Array, yp: Array) -> State:
        """Return the state of (y, y'), which may be vectors or rows of vectors."""
        q, v, lam = self._slices
        multipliers = yp if self.formulation.impulses else y
        return State(y[..., q], y[..., v], yp[..., v], multipliers[..., lam])

    @cached_property
    def _evaluators(self) -> list[SumEvaluator]:
        return [SumEvaluator(plan, self.equations.p) for plan in self.sums]

    def residual(self, time: Array, y: Array, yp: Array) -> Array:
        """Return R, (size,), at time = (t, branch); for loops, see `core.h`."""
        n, evaluate = self.equations.n, self._evaluators[0]
        set_time(evaluate, *time)
        result = evaluate(np.concatenate([y, yp]), self.size)
        result[:n] += yp[:n]
        result[:n] -= y[n : 2 * n]
        return result

    def jacobian(self, time: Array, y: Array, yp: Array, c: float = 1.0) -> Array:
        """Return the non-zeros of dR/dy + c dR/dy' on `pattern` at time = (t, branch).

        For a form built with `apart`, these are the non-zeros of dR/dy, then those of dR/dy', and
        `c` must be 1.
        """
        evaluate = self._evaluators[1]
        set_time(evaluate, *time)
        set_matrix_factors(evaluate, 1.0, 1.0, c, c, 1.0, 1.0)
        parts = 2 if self.apart else 1
        return evaluate(np.concatenate([y, yp]), parts * self.pattern.nnz)

    @property
    def names(self) -> list[str]:
        """Names of the unknowns y, in order."""
        q, lam = self.equations.q_names, self.equations.lam_names
        mu = lam if self.formulation.stabilized else ()
        return [*q, *(f"velocity of {x}" for x in q), *lam, *(f"correction of {x}" for x in mu)]

    def buffers(self) -> Workspace:
        """Return new buffers for evaluating R and its Jacobian in one run."""
        residual, jacobian = (total.sum(True, self.equations.p) for total in self.sums)
        return Workspace(
            "FirstOrderBuffers",
            n=self.equations.n,
            size=self.size,
            x=np.zeros(2 * self.size),
            residual=residual,
            jacobian=jacobian,
        )


@cache_on_owner
def formulate_first_order(
    equations: EquationsOfMotion, name: str, apart: bool = False
) -> FirstOrderForm:
    """Return a first-order form of equations of motion.

    Parameters
    ----------
    equations
        Equations of motion.
    name
        One of `FIRST_ORDER`.
    apart
        True to evaluate dR/dy and dR/dy' separately.

    Raises
    ------
    BeamdaeError
        If there is no form of this name.
    """
    form = FORMULATIONS[require_choice("formulation", "name", name, FIRST_ORDER)]
    pattern, jacobian = plan_jacobian(equations.structure, name, apart)
    return FirstOrderForm(
        equations, form, pattern, (plan_residual(equations.structure, name), jacobian), apart
    )


def _size(structure: Structure, form: Formulation) -> int:
    constraints = structure.m * (2 if form.stabilized else 1)
    return 2 * structure.n + constraints + structure.resultant_count


def _input_layout(structure: Structure, form: Formulation) -> InputLayout:
    """Return the offsets of the kernel inputs in (y, y')."""
    n, m, size = structure.n, structure.m, _size(structure, form)
    lam = 2 * n + (size if form.impulses else 0)
    resultants = lam - 2 * n + size - structure.resultant_count
    return InputLayout(q=0, v=n, a=size + n, lam=lam, mu=lam + m, resultants=resultants)


@cache_on_owner
def plan_residual(structure: Structure, name: str) -> SumPlan:
    """Return the plan of the residual of a form, without q' - v; inputs are (y, y')."""
    form, n = FORMULATIONS[name], structure.n
    layout = _input_layout(structure, form)
    return assemble_residual(structure, layout, form.levels, form.stabilized, dynamic=n).vector()


@cache_on_owner
def plan_jacobian(structure: Structure, name: str, apart: bool) -> tuple[sp.csc_array, SumPlan]:
    """Return pattern and plan of dR/dy + c dR/dy' or, if `apart`, of both derivatives.

    Those of mixed equations are planned apart only.
    """
    form = FORMULATIONS[name]
    n, m, size = structure.n, structure.m, _size(structure, form)
    total, layout = create_matrix_sum(), _input_layout(structure, form)
    # Terms with the factor c go to the same matrix, or to a second matrix below it.
    below = size if apart else 0
    total.add_diagonal(n, (below, 0), C_A, 1.0)
    total.add_diagonal(n, (0, n), None, -1.0)
    # Damping and mass enter the same block, unless they are evaluated apart.
    sums: Tangents = ((STIFFNESS,), (DAMPING, MASS))
    if apart:
        sums = ((STIFFNESS,), (DAMPING,), (MASS,))
    blocks = ((n, 0), (n, n), (below + n, n))[: len(sums)]
    factors = structure.correction_factors
    # c_l = c scales G^T if time integrals of the multipliers are the unknowns.
    reaction, by_c = (SCALED_GRADIENT, below) if form.impulses else (GRADIENT, 0)
    for term, copies in add_tangents(total, structure, layout, sums):
        add, on_q, on_s = partial(total.add_matrix, copies), term.operator, term.resultants
        for output, block in enumerate(blocks):
            add(output, on_q, on_q, block)
        if on_s is not None:
            first = size - structure.resultant_count
            add(0, on_q, on_s, (by_c + n, first))
            for output, column in ((0, 0), (1, n)):
                add(output, on_s, on_q, (first, column))
        if term.rows is not None:
            add(len(sums) + reaction, on_q, term.rows, (by_c + n, 2 * n))
    for joint, copies in add_joint_matrices(total, structure, layout, form.levels, form.stabilized):
        add, on_q, on_g = partial(total.add_matrix, copies), joint.operator, joint.rows
        levels, corrects = joint.kernel.effective_levels(form.levels, form.stabilized)
        add(reaction, on_g, on_q, (by_c + n, 2 * n), transposed=True)
        add(REACTION_STIFFNESS, on_q, on_q, (n, 0))
        if corrects:
            block = (by_c, 2 * n + m)
            add(reaction, on_g, on_q, block, transposed=True, factors=factors)
            add(CORRECTION_STIFFNESS, on_q, on_q, (0, 0), factors=factors)
        level_output = FIRST_LEVEL + corrects
        for k, level in enumerate(levels):
            row = 2 * n + k * m
            if level == NO_LEVEL:
                identity = level_output + 1 + reaction
                add(identity, on_g, on_g, (by_c + row, 2 * n + m))
            elif level == 0:
                add(GRADIENT, on_g, on_q, (row, 0))
            elif level == 1:
                add(level_output, on_g, on_q, (row, 0))
                add(GRADIENT, on_g, on_q, (row, n))
            else:
                for k_derivative, block in enumerate(((row, 0), (row, n), (below + row, n))):
                    add(level_output + k_derivative, on_g, on_q, block)
    return total.matrix((size, size), 2 if apart else 1)


# Entries of a row q' - v = 0.
_DEFINITION_ENTRIES = 2


class KinematicReduction(NamedTuple):
    """Equations and unknowns that remain.

    The unknowns are q, the velocities of corrected coordinates, and the multipliers; the equations
    are the equations of motion, the rows q' = v - P G^T mu of corrected coordinates, and the
    constraints.

    Attributes
    ----------
    corrected
        Indices of the coordinates whose rows contain corrections.
    defined
        Indices of the other coordinates.
    corrected_velocities, defined_velocities
        Indices of their velocities in y.
    remaining_velocities
        Indices of the velocities of corrected coordinates among the remaining unknowns.
    force_starts, force_rows
        Derivatives of forces by each resultant: starts of their entries, and their coordinates.
    law_starts, law_columns
        Derivatives of the law of each resultant: starts of their entries, and their unknowns in y.
    """

    corrected: Array
    defined: Array
    corrected_velocities: Array
    defined_velocities: Array
    remaining_velocities: Array
    force_starts: Array
    force_rows: Array
    law_starts: Array
    law_columns: Array

    def entry_count(self, pattern: sp.csc_array) -> int:
        """Number of entries of the sum that belongs to the reduced `pattern`."""
        return 3 * pattern.nnz + len(self.force_rows) + len(self.law_columns) + 1


def reduce_kinematics(
    form: FirstOrderForm,
) -> tuple[sp.csc_array, SumPlan, KinematicReduction]:
    """Return the pattern of the reduced matrix, the plan of its parts, and the reduction.

    The reduced matrix is A_0 + c A_1 + c^2 A_2. The sum of the plan has the non-zeros of A_0, A_1
    and A_2 on the pattern, followed by the derivatives of forces by resultants, those of the laws
    of resultants, and a number that is not used. `form` must have been built with `apart`.
    """
    return _plan_reduction(form.equations.structure, form.formulation.name)


# Shared by the pilot run, the main run and the other cases of a sweep.
@cache_on_owner
def _plan_reduction(
    structure: Structure, name: str
) -> tuple[sp.csc_array, SumPlan, KinematicReduction]:
    pattern, plan = plan_jacobian(structure, name, True)
    n, size = structure.n, pattern.shape[0]
    entries = np.bincount(pattern.indices, minlength=size)[:n]
    is_defined = entries <= _DEFINITION_ENTRIES
    corrected, defined = np.flatnonzero(~is_defined), np.flatnonzero(is_defined)
    last = size - structure.resultant_count
    reduced_size = last - len(defined)
    remaining_velocities = n + np.arange(len(corrected))
    # Reduced indices of the rows and columns of the full system, -1 for rows that are dropped.
    rows, columns = np.full(size, -1), np.zeros(size, int)
    rows[n : 2 * n] = columns[:n] = columns[n : 2 * n] = np.arange(n)
    rows[corrected] = columns[n + corrected] = remaining_velocities
    rows[2 * n : last] = columns[2 * n : last] = np.arange(n + len(corrected), reduced_size)
    column = np.repeat(np.arange(size), np.diff(pattern.indptr))
    is_force, is_law = column >= last, pattern.indices >= last
    is_kept = (rows[pattern.indices] >= 0) & ~is_force
    keys = columns[column] * reduced_size + rows[pattern.indices]
    reduced = sp.csc_array(
        sp.coo_array(
            (np.ones(int(is_kept.sum())), np.divmod(keys[is_kept], reduced_size)[::-1]),
            (reduced_size, reduced_size),
        )
    )
    reduced.sort_indices()
    reduced.data[:] = 1.0
    reduced_column = np.repeat(np.arange(reduced_size), np.diff(reduced.indptr))
    target = np.searchsorted(reduced_column * reduced_size + reduced.indices, keys)
    # Columns of defined velocities are multiplied by c.
    is_velocity = np.zeros(size, bool)
    is_velocity[n + defined] = True
    power = is_velocity[column].astype(int)
    # Forces of resultants are entries of their columns, and laws are entries of their rows.
    first_law = 3 * reduced.nnz + np.count_nonzero(is_force)
    laws = np.flatnonzero(is_law)[np.argsort(pattern.indices[is_law], kind="stable")]
    unused = first_law + len(laws)
    targets = [
        np.where(is_kept, (part + power) * reduced.nnz + target, unused) for part in range(2)
    ]
    targets[1][is_force] = np.arange(3 * reduced.nnz, first_law)
    targets[0][laws] = np.arange(first_law, unused)
    new_targets = _to_unsigned(np.concatenate(targets))
    plan = replace(
        plan,
        add_targets=new_targets[plan.add_targets],
        weighted_targets=new_targets[plan.weighted_targets],
    )
    resultants = np.arange(last, size + 1)
    indices = (
        corrected,
        defined,
        n + corrected,
        n + defined,
        remaining_velocities,
        np.searchsorted(column[is_force], resultants),
        pattern.indices[is_force] - n,
        np.searchsorted(pattern.indices[laws], resultants),
        column[laws],
    )
    return reduced, plan, KinematicReduction(*map(_to_unsigned, indices))


def _to_unsigned(indices: Array) -> Array:
    return indices.astype(np.uint32)
