"""Positions moved to fit the joints, without the strain a straight way there would leave.

Nodes of a beam that is turned by linear steps move along tangents: it would be stretched by half
the square of the angle.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.measures import balance_rows

if TYPE_CHECKING:
    from beamdae.equations.starts.consistent_start import ConsistencySolver

Array = np.ndarray
# What is missed, and its derivative.
ConstraintFunction = Callable[[Array], tuple[Array, Any]]

# Beside the largest entry: what lets rows that depend on each other be solved with.
_DEPENDENT = 1e-13
# Largest change of an iteration, and the one at which it ends, in natural sizes of coordinates.
_FARTHEST, _STEADY, _ITERATIONS = 0.5, 1e-10, 30


def solve_least_change(weight: Any, rows: Any, wanted: Array, force: Array | None = None) -> Array:
    """The change x with rows @ x = wanted that is least as `weight` has it.

    Under a `force` it is the one that makes weight @ x - force vanish but for what the rows bear.
    """
    n, count = weight.shape[0], rows.shape[0]
    size = float(abs(weight).max()) or 1.0
    inverse = sp.eye_array(count) * (_DEPENDENT / size)
    matrix = sp.block_array([[weight, rows.T], [rows, -inverse]], format="csc")
    given = np.concatenate([np.zeros(n) if force is None else force, wanted])
    try:
        return splu(matrix).solve(given)[:n]
    except RuntimeError:
        return np.full(n, np.nan)


def minimize_strain(
    starter: ConsistencySolver,
    time: Array,
    begun: Array,
    q: Array,
    free: Array,
    held: ConstraintFunction,
    square: float,
) -> Array:
    """Positions near `q` that satisfy what is held, with the least of motion and elastic energy.

    M (q - begun) + T^2 (F(q) - F(free)) + R^T mu = 0, by Newton's method: elastic forces are those
    beyond the ones at the positions `free`, such as the drawing. Loads on coordinates that turn
    with a beam are among them where they change: what comes of it is taken if it strains less.

    Parameters
    ----------
    starter
        Of the equations.
    time
        (t, branch).
    begun
        Where the motion began.
    q
        Positions that satisfy what is held.
    free
        Positions whose elastic forces, weights and loads are none of this.
    held
        Positions -> what is missed (k,) and its derivative R (k, n).
    square
        T^2 [s^2].

    Returns
    -------
    Array
        `q` itself where the iteration does not end, or ends at more strain energy.
    """
    still, scale = np.zeros(len(q)), starter.equations.position_scales
    at_free = starter.forces(time, starter.rest_state(free), still)
    found = q
    for _ in range(_ITERATIONS):
        state = starter.rest_state(found)
        stiffness, _, mass = starter.linearize_forces(time, state)
        beyond = starter.forces(time, state, still) - at_free
        missed, rows = held(found)
        force = -(mass @ (found - begun) + square * beyond)
        change = solve_least_change(mass + square * stiffness, rows, -missed, force)
        far = float(np.max(np.abs(change) / scale))
        if not np.isfinite(far):
            break
        found = found + change * min(1.0, _FARTHEST / max(far, _FARTHEST))
        if far < _STEADY:
            return min(q, found, key=lambda at: _strain_energy(starter.equations, time, at))
    return q


def _strain_energy(equations: EquationsOfMotion, time: Array, q: Array) -> float:
    still, loose = np.zeros((1, equations.n)), np.zeros((1, equations.m))
    return float(balance_rows(equations)(time[None], q[None], still, still, loose)[0, 1])
