"""Five first-order forms of equations of motion, as sums of kernels.

First-order forms of F(t, q, v, a) + G^T lam = 0, g(t, q) = 0 for an integrator of
0 = R(t, y, y'):

==================  =============  ==========================================================
form                y              equations
==================  =============  ==========================================================
index3              q, v, lam      q' = v; F + G^T lam = 0; g = 0
index2              q, v, lam      q' = v; F + G^T lam = 0; g_dot = 0
index1              q, v, lam      q' = v; F + G^T lam = 0; g_ddot = 0
ggl                 q, v, lam, mu  q' = v - G^T mu; F + G^T lam = 0; g = 0; g_dot = 0
stabilized-index1   q, v, Lam, Mu  as ggl with lam = Lam', mu = Mu'
==================  =============  ==========================================================

ggl: Gear, Gupta & Leimkuhler, J. Comput. Appl. Math. 12-13 (1985) 77. stabilized-index1:
Anantharaman & Hiller, Int. J. Numer. Meth. Eng. 32 (1991) 1531. What holds velocities alone,
A(t, q) v + b(t, q) = 0, has this row in place of g_dot = 0, with A for G; in place of g = 0 it has
the same row with index3, and mu = 0 where there is mu.
"""

from __future__ import annotations

from dataclasses import dataclass

import scipy.sparse as sp

from beamdae.equations.structure import Structure, once
from beamdae.equations.sums import (
    C_A,
    Places,
    add_joint_matrices,
    add_tangents,
    matrix_builder,
    residual_sum,
)
from beamdae.symbolic.constraint_kernel import UNHELD
from beamdae.symbolic.force_kernel import Tangents
from beamdae.symbolic.kernel_sums import SumPlan


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


_DRIFTS = "positions drift off the joints, in singular positions on to another branch"
# Measured on a rigid slider-crank: positions off by 20 to 170 rtol and velocities by 160 to 1400,
# where stabilized-index1 is off by 0.5 and 4 to 19; on the hub beam the two are alike.
_LOOSE = "rtol is not kept, positions of rigid mechanisms were off by up to 170 rtol"
FORMULATIONS = {
    formulation.name: formulation
    for formulation in (
        Formulation("stabilized-index1", 1, (0, 1), stabilized=True, impulses=True),
        Formulation("ggl", 2, (0, 1), stabilized=True),
        Formulation("index2", 2, (1,), note=_DRIFTS),
        Formulation("index1", 1, (2,), note=_DRIFTS),
        Formulation("index3", 3, (0,), note=_LOOSE),
    )
}
FIRST_ORDER = tuple(FORMULATIONS)


@once
def residual_plan(structure: Structure, name: str) -> SumPlan:
    """The residual."""
    form, n = FORMULATIONS[name], structure.n
    places = _places(structure, form)
    return residual_sum(structure, places, form.levels, form.stabilized, dynamic=n).vector()


def _size(structure: Structure, form: Formulation) -> int:
    return 2 * structure.n + structure.m * (2 if form.stabilized else 1)


def _places(structure: Structure, form: Formulation) -> Places:
    """Where (y, y') has what the kernels ask for."""
    n, m, size = structure.n, structure.m, _size(structure, form)
    held = 2 * n + (size if form.impulses else 0)
    return Places(q=0, v=n, a=size + n, lam=held, mu=held + m)


@once
def jacobian_sum(structure: Structure, name: str, apart: bool) -> tuple[sp.csc_array, SumPlan]:
    """The pattern of dR/dy + c dR/dy' and its non-zeros, or the two one after the other."""
    form = FORMULATIONS[name]
    n, m, size = structure.n, structure.m, _size(structure, form)
    total, at = matrix_builder(), _places(structure, form)
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
        levels, corrects = joint.kernel.asked(form.levels, form.stabilized)
        total.add_matrix(copies, reaction, on_g, on_q, (by_c + n, 2 * n), transposed=True)
        total.add_matrix(copies, 2, on_q, on_q, (n, 0))
        if corrects:
            total.add_matrix(copies, reaction, on_g, on_q, (by_c, 2 * n + m), transposed=True)
            total.add_matrix(copies, 3, on_q, on_q, (0, 0))
        more = 3 + corrects
        for k, level in enumerate(levels):
            row = 2 * n + k * m
            if level == UNHELD:
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
