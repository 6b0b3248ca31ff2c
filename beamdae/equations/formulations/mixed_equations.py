"""Equations in which axial and shear forces of beams and forces of springs are unknowns.

In this mixed form, Newton's iteration converges as for rigid bodies with joints, whatever the
stiffness, see `force_kernel.mix_law`. Cf. Magisano, Leonetti & Garcea, Comput. Methods Appl. Mech.
Eng. 313 (2017) 986, for statics.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import ForceTerm, Structure, cache_on_owner


def mix_equations(e: EquationsOfMotion) -> EquationsOfMotion:
    """Return equations with the same numbers and the resultants of all forces as unknowns."""
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
