"""From equations of motion to the residuals of first-order forms, see `first_order_sums`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.sums import (
    InputLayout,
    add_joint_matrices,
    add_tangents,
    assemble_residual,
    create_matrix_sum,
)
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.errors import require_choice
from beamdae.native.loop_functions import combine
from beamdae.symbolic.constraint_kernel import NO_LEVEL
from beamdae.symbolic.force_kernel import Tangents
from beamdae.symbolic.kernel_sums import (
    Sum,
    SumPlan,
    evaluate_sum,
    set_matrix_factors,
    set_time,
)
from beamdae.symbolic.local_symbols import C_A


@dataclass(frozen=True)
class Formulation:
    """A first-order form.

    Attributes
    ----------
    name, index
        What it is called, and its differentiation index.
    levels
        Which of g (0), g_dot (1) and g_ddot (2) are among its equations.
    stabilized
        Whether multipliers mu of the velocity constraints correct q' = v.
    impulses
        Whether the multipliers among the unknowns are those of time integrals: lam = Lam'.
    note
        What every run of it has to be told, if anything.
    """

    name: str
    index: int
    levels: tuple[int, ...]
    stabilized: bool = False
    impulses: bool = False
    note: str = ""


_DRIFT_NOTE = "positions drift off the joints, in singular positions on to another branch"
# Measured on a rigid slider-crank: positions off by 20 to 170 rtol and velocities by 160 to 1400,
# where stabilized-index1 is off by 0.5 and 4 to 19; on the hub beam the two are alike.
_TOLERANCE_NOTE = "rtol is not kept, positions of rigid mechanisms were off by up to 170 rtol"
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


@cache_on_owner
def plan_residual(structure: Structure, name: str) -> SumPlan:
    """The residual."""
    form, n = FORMULATIONS[name], structure.n
    places = _input_layout(structure, form)
    return assemble_residual(structure, places, form.levels, form.stabilized, dynamic=n).vector()


def _size(structure: Structure, form: Formulation) -> int:
    return 2 * structure.n + structure.m * (2 if form.stabilized else 1)


def _input_layout(structure: Structure, form: Formulation) -> InputLayout:
    """Where (y, y') has what the kernels ask for."""
    n, m, size = structure.n, structure.m, _size(structure, form)
    held = 2 * n + (size if form.impulses else 0)
    return InputLayout(q=0, v=n, a=size + n, lam=held, mu=held + m)


@cache_on_owner
def plan_jacobian(structure: Structure, name: str, apart: bool) -> tuple[sp.csc_array, SumPlan]:
    """The pattern of dR/dy + c dR/dy' and its non-zeros, or the two one after the other."""
    form = FORMULATIONS[name]
    n, m, size = structure.n, structure.m, _size(structure, form)
    total, at = create_matrix_sum(), _input_layout(structure, form)
    # Where what is multiplied by c goes: among the rest, or into a matrix of its own below it.
    below = size if apart else 0
    total.add_diagonal(n, (below, 0), C_A, 1.0)
    total.add_diagonal(n, (0, n), None, -1.0)
    # Damping and mass add up at one place, unless they are wanted apart.
    sums: Tangents = ((0,), (1,), (2,)) if apart else ((0,), (1, 2))
    places = ((n, 0), (n, n), (below + n, n))[: len(sums)]
    # c_l is c; where the multipliers themselves are unknowns G^T stands without it.
    reaction, by_c = (1, below) if form.impulses else (0, 0)
    for term, copies in add_tangents(total, structure, at, sums):
        for output, place in enumerate(places):
            total.add_matrix(copies, output, term.operator, term.operator, place)
        if term.rows is not None:
            place = (by_c + n, 2 * n)
            total.add_matrix(copies, len(sums) + reaction, term.operator, term.rows, place)
    for joint, copies in add_joint_matrices(total, structure, at, form.levels, form.stabilized):
        on_q, on_g = joint.operator, joint.rows
        levels, corrects = joint.kernel.effective_levels(form.levels, form.stabilized)
        total.add_matrix(copies, reaction, on_g, on_q, (by_c + n, 2 * n), transposed=True)
        total.add_matrix(copies, 2, on_q, on_q, (n, 0))
        if corrects:
            total.add_matrix(copies, reaction, on_g, on_q, (by_c, 2 * n + m), transposed=True)
            total.add_matrix(copies, 3, on_q, on_q, (0, 0))
        more = 3 + corrects
        for k, level in enumerate(levels):
            row = 2 * n + k * m
            if level == NO_LEVEL:
                place = (by_c + row, 2 * n + m)
                total.add_matrix(copies, more + 1 + reaction, on_g, on_g, place)
            elif level == 0:
                total.add_matrix(copies, 0, on_g, on_q, (row, 0))
            elif level == 1:
                total.add_matrix(copies, more, on_g, on_q, (row, 0))
                total.add_matrix(copies, 0, on_g, on_q, (row, n))
            else:
                for own, place in enumerate(((row, 0), (row, n), (below + row, n))):
                    total.add_matrix(copies, more + own, on_g, on_q, place)
    return total.matrix((size, size), 2 if apart else 1)


Array = np.ndarray


@dataclass(frozen=True)
class FirstOrderForm:
    """Residual R(t, y, y') of a first-order form with its exact Jacobian.

    Attributes
    ----------
    pattern
        CSC pattern of the Jacobian.
    sums
        Of the residual and of the Jacobian, from (y, y').
    """

    equations: EquationsOfMotion
    formulation: Formulation
    pattern: sp.csc_array
    sums: tuple[SumPlan, SumPlan]

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.pattern.shape[0]

    @property
    def _parts(self) -> tuple[slice, slice, slice]:
        n, m = self.equations.n, self.equations.m
        return slice(0, n), slice(n, 2 * n), slice(2 * n, 2 * n + m)

    def pack(self, state: State) -> tuple[Array, Array]:
        """Consistent (y, y') of a consistent state."""
        q, v, lam = self._parts
        y, yp = np.zeros(self.size), np.zeros(self.size)
        y[q], y[v], yp[q], yp[v] = state.q, state.v, state.v, state.a
        (yp if self.formulation.impulses else y)[lam] = state.lam
        return y, yp

    def unpack(self, y: Array, yp: Array) -> State:
        """State of (y, y'), for one row or many."""
        q, v, lam = self._parts
        multipliers = yp if self.formulation.impulses else y
        return State(y[..., q], y[..., v], yp[..., v], multipliers[..., lam])

    @cached_property
    def _own(self) -> FirstOrderBuffers:
        return self.buffers()

    def residual(self, time: Array, y: Array, yp: Array) -> Array:
        """R at time = (t, branch), for whoever needs it once; runs have `buffers` of their own."""
        result = np.zeros(self.size)
        t, branch = time
        evaluate_residual(self._own, t, branch, y, yp, result)
        return result

    def jacobian(self, time: Array, y: Array, yp: Array, c: float) -> Array:
        """Non-zeros of dR/dy + c dR/dy' on `pattern`, likewise."""
        result = np.zeros(self.pattern.nnz)
        t, branch = time
        evaluate_jacobian(self._own, t, branch, c, y, yp, result)
        return result

    @property
    def names(self) -> list[str]:
        """What the unknowns are, in words where they are not coordinates or multipliers."""
        q, lam = self.equations.q_names, self.equations.lam_names
        mu = lam if self.formulation.stabilized else ()
        return [*q, *(f"velocity of {x}" for x in q), *lam, *(f"correction of {x}" for x in mu)]

    @property
    def is_native(self) -> bool:
        """Whether it can be evaluated in machine code."""
        return all(total.is_native for total in self.sums)

    def buffers(self, native: bool = False) -> FirstOrderBuffers:
        """What a run evaluates R and its Jacobian with, for itself alone."""
        residual, jacobian = (total.sum(native, self.equations.p) for total in self.sums)
        return FirstOrderBuffers(
            self.equations.n, self.size, np.zeros(2 * self.size), residual, jacobian
        )


@dataclass(slots=True)
class FirstOrderBuffers:
    """Buffers of a first-order form with `n` coordinates and `size` unknowns, x = (y, y')."""

    n: int
    size: int
    x: Array
    residual: Sum
    jacobian: Sum


def evaluate_residual(
    form: FirstOrderBuffers, t: float, branch: float, y: Array, yp: Array, result: Array
) -> None:
    """R(t, y, y'), into `result`."""
    _set_time(form, form.residual, t, branch, y, yp)
    evaluate_sum(form.residual, form.x, result)
    n = form.n
    kinematic = result[:n]
    combine(kinematic, (1.0, 1.0, -1.0), (kinematic, yp[:n], y[n : 2 * n]))


def evaluate_jacobian(
    form: FirstOrderBuffers, t: float, branch: float, c: float, y: Array, yp: Array, result: Array
) -> None:
    """The non-zeros of dR/dy + c dR/dy', into `result`."""
    _set_time(form, form.jacobian, t, branch, y, yp)
    set_matrix_factors(form.jacobian, 1.0, 1.0, c, c, 1.0, 1.0)
    evaluate_sum(form.jacobian, form.x, result)


def _set_time(
    form: FirstOrderBuffers, total: Sum, t: float, branch: float, y: Array, yp: Array
) -> None:
    combine(form.x[: form.size], (1.0,), (y,))
    combine(form.x[form.size :], (1.0,), (yp,))
    set_time(total, t, branch)


def evaluate_jacobian_parts(
    form: FirstOrderBuffers, t: float, branch: float, y: Array, yp: Array, result: Array
) -> None:
    """The non-zeros of dR/dy, then those of dR/dy', into `result`; `form` has them apart."""
    _set_time(form, form.jacobian, t, branch, y, yp)
    set_matrix_factors(form.jacobian, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    evaluate_sum(form.jacobian, form.x, result)


@cache_on_owner
def formulate_first_order(
    equations: EquationsOfMotion, name: str, apart: bool = False
) -> FirstOrderForm:
    """A first-order form.

    Parameters
    ----------
    name
        One of `FIRST_ORDER`.
    apart
        Whether dR/dy and dR/dy' are evaluated one by one, see `evaluate_jacobian_parts`.
    """
    form = FORMULATIONS[require_choice("formulation", "name", name, FIRST_ORDER)]
    pattern, jacobian = plan_jacobian(equations.structure, name, apart)
    return FirstOrderForm(
        equations, form, pattern, (plan_residual(equations.structure, name), jacobian)
    )
