"""Transpose of the reactions of redundant constraints, see `redundant_derivatives`."""

from __future__ import annotations

import numpy as np

from beamdae.analysis.gradients.start_adjoint import StartAdjoint
from beamdae.analysis.sensitivities.redundant_derivatives import ScaledRows
from beamdae.equations.equations_of_motion import State

Array = np.ndarray


def transpose_reactions(
    adjoint: StartAdjoint, independent: Array, time: Array, at: State, by_lam: Array
) -> tuple[Array, Array, Array]:
    """Transpose the derivatives of the minimum-norm multipliers at one state.

    Parameters
    ----------
    adjoint
        Equations with all constraints. The derivatives with respect to p are added to its
        `numbers`.
    independent
        Indices of the independent constraints.
    time, at
        (t, branch), and the state with the multipliers of the independent constraints.
    by_lam
        Derivatives of an objective with respect to all multipliers, (m,).

    Returns
    -------
    tuple of numpy.ndarray
        Derivatives with respect to the positions and to the scales of the coordinates, (n,) each,
        and to the multipliers of the independent constraints.
    """
    full = adjoint.equations
    gradient = adjoint.solver.constraint_matrix(time, at.q).toarray()
    rows = ScaledRows.of(gradient, full.position_scales)
    start = np.zeros(full.m)
    start[independent] = at.lam
    scaled_start = rows.length * start
    rest = scaled_start - rows.project(scaled_start)
    by_result = by_lam / rows.length
    by_length = -by_result * (scaled_start - rest) / rows.length
    by_start = rows.project(by_result)
    by_scaled = np.outer(by_result - by_start, rows.inverse @ scaled_start)
    by_scaled += np.outer(rest, rows.inverse @ by_result)
    by_length += by_start * start - np.sum(by_scaled * rows.scaled, axis=1) / rows.length
    by_rate = by_scaled / rows.length[:, None] + by_length[:, None] * rows.scaled
    by_q = adjoint.weigh_constraint_matrix(time, at.q, by_rate * full.position_scales)
    by_scales = np.sum(by_rate * gradient, axis=0)
    return by_q, by_scales, (rows.length * by_start)[independent]
