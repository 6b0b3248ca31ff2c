"""Fastest natural modes of a mechanism, estimated for integrators."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

_POWER_ITERATIONS = 12


class Mode(NamedTuple):
    """Natural frequency [rad/s] and damping ratio of a mode."""

    frequency: float
    damping_ratio: float


def estimate_fastest_modes(
    solver: ConsistencySolver, time: Array, state: State
) -> tuple[Mode, ...]:
    """Estimate the fastest natural mode of each elastic body of the constrained mechanism.

    The method is power iteration with M^-1 K under the constraints, where K = dF/dq and M = dF/da.
    First-order states are constant. A body is a set of parts that M and K couple. The coordinates
    of one part are coupled even if their entries of M and K are zero, which depends on the
    orientation of a straight beam. The iterate is normalized separately for each body, so that the
    fastest body does not mask slower ones. Bodies without stiffness or inertia are omitted.
    """
    stiffness, damping, mass = solver.linearize_forces(time, state)
    count, body = _find_bodies(solver.equations, stiffness, mass)
    x = np.cos(np.arange(solver.equations.n) ** 2.0)
    for _ in range(_POWER_ITERATIONS):
        x = solver.solve_saddle(time, state.q, state.v, stiffness @ x, 0.0)[0]
        size = np.zeros(count)
        np.maximum.at(size, body, np.abs(x))
        x /= np.where(size > 0.0, size, 1.0)[body]

    inertia, elastic, dissipated = (
        np.bincount(body, x * (matrix @ x), count) for matrix in (mass, stiffness, damping)
    )
    is_elastic = (inertia > 0.0) & (elastic != 0.0)
    frequency = np.sqrt(np.abs(elastic[is_elastic]) / inertia[is_elastic])
    ratio = dissipated[is_elastic] / (2.0 * frequency * inertia[is_elastic])
    return tuple(Mode(float(w), float(z)) for w, z in zip(frequency, ratio, strict=True))


def _find_bodies(equations: EquationsOfMotion, *matrices: sp.csc_array) -> tuple[int, Array]:
    """Return the number of bodies that the matrices couple, and the body of each coordinate."""
    n = equations.n
    # The first coordinate of each part is coupled to the others.
    first = np.zeros(n, np.intp)
    for part in equations.parts:
        first[part.rows] = part.rows.start
    entries = [(x.indices, column_indices(x), np.abs(x.data) > 0.0) for x in matrices]
    rows = np.concatenate([first, *(i[is_coupled] for i, _, is_coupled in entries)])
    columns = np.concatenate([np.arange(n), *(j[is_coupled] for _, j, is_coupled in entries)])
    graph = sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    count, body = connected_components(graph, directed=False)
    return int(count), body
