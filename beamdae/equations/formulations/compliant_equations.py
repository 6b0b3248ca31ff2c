"""Equations in which stiff forces are unknowns (mixed form).

Forces of thin beams and stiff bushings are determined by deformations that are lost in the rounding
of the positions. As unknowns, they are accurate whatever the stiffness: as reactions of constraints
g(q) + tau g'(q, v) - lam = 0, or for implicit steps, as further coordinates of the forces.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import (
    ConstraintTerm,
    ForceTerm,
    Structure,
    cache_on_owner,
)
from beamdae.symbolic.statements import Variable

Array = np.ndarray


class CompliantEquations(NamedTuple):
    """Equations F + G^T lam = 0, g = 0 of joints and g + tau g' - lam = 0 of compliant forms.

    Attributes
    ----------
    equations
        Equations whose last constraints are compliant.
    joint_count
        Number of constraints of joints.
    retardation, remainder
        Retardation times tau [s], and multiples of g that F adds to lam, (m,); 0 for joints.
    """

    equations: EquationsOfMotion
    joint_count: int
    retardation: Array
    remainder: Array


def introduce_resultants(e: EquationsOfMotion, idle: Array | None = None) -> CompliantEquations:
    """Return the equations with the stiff forces of all terms as unknowns.

    Those in the mask `idle` are not replaced, and the unknowns are zero: near a stiffness of zero,
    whose root has no derivative, the equations depend smoothly on the stiffness.
    """
    p, numbers, rotations, begin = e.p.copy(), [], [], 0
    diagonals = [np.zeros((2, e.m))]
    for term in e.forces:
        form = term.kernel.compliant
        if form is None:
            continue
        size = term.kernel.local.n_data
        columns = p[term.data].reshape((-1, term.count), order="F")
        shape = term.count, len(form.operators), form.kernel.size
        end = begin + math.prod(shape)
        mask = None if idle is None else idle[begin:end].reshape(shape)
        columns[:size], points, *parts = form.split(columns[:size].copy(), mask)
        p[term.data], begin = columns.ravel(order="F"), end
        rotations.append(columns[size:].tobytes())
        numbers.append(points.ravel())
        diagonals.append(np.reshape(parts, (2, -1)))
    structure = _add_constraints(e.structure, len(p), tuple(rotations))
    multipliers = _name_resultants(structure.m - e.m)
    equations = replace(
        e,
        structure=structure,
        p=np.concatenate([p, *numbers]),
        multipliers=(*e.multipliers, *multipliers),
    )
    return CompliantEquations(equations, e.m, *np.concatenate(diagonals, axis=1))


@lru_cache(maxsize=8)
def _name_resultants(count: int) -> tuple[Variable, ...]:
    return tuple(Variable(f"resultant {k}", "N") for k in range(count))


@cache_on_owner
def _add_constraints(structure: Structure, begin: int, rotations: tuple[bytes, ...]) -> Structure:
    """Return the structure with the constraints of all compliant forms.

    Their numbers follow the first `begin` ones. `rotations` are the numbers of the rotation of each
    term.
    """
    terms = [x for x in structure.forces if x.kernel.compliant is not None]
    new, m = [], structure.m
    for term, rotation in zip(terms, rotations, strict=True):
        form = term.kernel.compliant
        assert form is not None
        count = term.count * len(form.operators)
        data = slice(begin, begin + count * form.kernel.local.n_data)
        size = count * form.kernel.size
        rows = _select_rows(m, size)
        new.append(ConstraintTerm(form.kernel, _locate_points(term, rotation), data, rows, count))
        begin, m = data.stop, m + size
    joints = tuple(_widen(x, m) for x in (*structure.joints, *new))
    return replace(structure, m=m, joints=joints)


def _select_rows(begin: int, size: int) -> sp.csr_array:
    entries = (np.ones(size), np.arange(begin, begin + size), np.arange(size + 1))
    return sp.csr_array(entries, shape=(size, begin + size))


def _widen(term: ConstraintTerm, m: int) -> ConstraintTerm:
    """Return a term of constraints among `m` ones."""
    rows = term.rows
    wide = sp.csr_array((rows.data, rows.indices, rows.indptr), shape=(rows.shape[0], m))
    return replace(term, rows=wide)


def _locate_points(term: ForceTerm, rotation: bytes) -> sp.csr_array:
    """Return the operator from all coordinates to those of the points of a term."""
    assert term.kernel.compliant is not None
    operators, count = np.concatenate(term.kernel.compliant.operators), term.count
    blocks = np.broadcast_to(operators, (count, *operators.shape))
    if term.rotation is not None:
        numbers = np.frombuffer(rotation).reshape(-1, count)
        ones, others = term.rotation.arrays
        values = np.vstack([np.zeros(count), numbers])
        blocks = operators @ (ones + np.moveaxis(values[others], -1, 0))
    diagonal = sp.bsr_array((blocks, np.arange(count), np.arange(count + 1))).tocsr()
    diagonal.eliminate_zeros()
    return sp.csr_array(diagonal @ term.operator)


def mix_equations(e: EquationsOfMotion) -> EquationsOfMotion:
    """Return equations with the same numbers and the resultants of all forces as unknowns.

    Newton's iteration then converges as for rigid bodies with joints, whatever the stiffness, see
    `force_kernel.mix_law`. Cf. Magisano, Leonetti & Garcea, Comput. Methods Appl. Mech. Eng. 313
    (2017) 986, for statics.
    """
    return replace(e, structure=_mix_structure(e.structure))


@cache_on_owner
def _mix_structure(structure: Structure) -> Structure:
    total = sum(x.count * x.kernel.mixed.resultants for x in structure.forces)
    if not total:
        return structure
    begin, forces = 0, []
    for term in structure.forces:
        if term.kernel.mixed.resultants:
            term = _extend_term(term, begin, total)
            begin += term.count * term.kernel.resultants
        forces.append(term)
    return replace(structure, forces=tuple(forces))


def _extend_term(term: ForceTerm, begin: int, total: int) -> ForceTerm:
    """Return a term whose local coordinates include resultants, from index `begin` of `total`."""
    kernel = term.kernel.mixed
    old, count, added = term.operator, term.count, kernel.resultants
    size = old.shape[0] // count
    ends = np.pad(old.indptr[1:].reshape(count, size), ((0, 0), (0, added)), "edge")
    height = ends.size
    operator = sp.csr_array(
        (old.data, old.indices, np.append(0, ends.ravel())), shape=(height, old.shape[1])
    )
    rows = np.arange(height).reshape(count, -1)[:, size:].ravel()
    columns = begin + np.arange(len(rows))
    resultants = sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(height, total))
    rotation = term.rotation
    if rotation is not None:
        height, width = rotation.shape
        own = tuple((height + k, width + k) for k in range(added))
        shape = height + added, width + added
        rotation = replace(rotation, shape=shape, ones=(*rotation.ones, *own))
    changes = {"operator": operator, "rotation": rotation, "resultants": resultants}
    return replace(term, kernel=kernel, **changes)
