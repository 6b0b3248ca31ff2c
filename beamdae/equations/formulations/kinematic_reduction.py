"""Newton's equations of first-order forms without the unknowns that other equations define.

For a correction of (y, y') by (x, c x), rows q' - v = 0 that hold already give x_v = c x_q. Without
these rows and velocities, the matrix R_y + c R_y' becomes K + c D + c^2 M, of about half the size.
Coordinates whose rows contain corrections by joints, q' = v - P G^T mu, keep both. In mixed
equations, resultants are defined by their laws; without them, the matrix is that of equations
without resultants.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.equations.formulations.first_order import FirstOrderForm, plan_jacobian
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.symbolic.sums.kernel_sums import SumPlan

Array = np.ndarray

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
