"""Positions that satisfy constraints with the least motion and strain energy.

Newton's method moves nodes of a rotating beam along tangents, which stretches the beam by half the
square of the angle; minimizing the strain energy removes that strain.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.measures import balance_rows
from beamdae.equations.starts.state_evaluator import StateEvaluator

Array = np.ndarray
# Function from positions to gaps (k,) and their derivative (k, n).
ConstraintFunction = Callable[[Array], tuple[Array, Any]]

_REGULARIZATION = 1e-13  # relative to 1 / largest weight; makes dependent rows solvable
_MAX_CHANGE = 0.5  # per iteration, in units of `position_scales`
_CONVERGED_CHANGE = 1e-10  # in units of `position_scales`
_MAX_ITERATIONS = 30
_STRAIN_COLUMN = 1  # of the rows of the energy balance


def solve_least_change(weight: Any, rows: Any, values: Array, force: Array | None = None) -> Array:
    """Return the x with rows @ x = values that minimizes x . weight x / 2 - x . force.

    Parameters
    ----------
    weight, rows
        Sparse matrices (n, n) and (k, n); dependent rows are allowed.
    values, force
        Right-hand sides (k,) and (n,); the force defaults to zero.

    Returns
    -------
    numpy.ndarray
        x, (n,); nan if `weight` is singular on the null space of `rows`.
    """
    n, count = weight.shape[0], rows.shape[0]
    size = float(abs(weight).max()) or 1.0
    regularization = sp.eye_array(count) * (_REGULARIZATION / size)
    matrix = sp.block_array([[weight, rows.T], [rows, -regularization]], format="csc")
    right = np.concatenate([np.zeros(n) if force is None else force, values])
    try:
        return splu(matrix).solve(right)[:n]
    except RuntimeError:
        return np.full(n, np.nan)


def minimize_strain(
    evaluator: StateEvaluator,
    time: Array,
    begin: Array,
    q: Array,
    unstrained: Array,
    constraints: ConstraintFunction,
    square: float,
) -> Array:
    """Return positions near `q` that meet the constraints with least motion and strain energy.

    Newton's method solves M (q - begin) + T^2 (F(q) - F(unstrained)) + R^T mu = 0: elastic forces
    are measured relative to the positions `unstrained`, for example as drawn. Loads contribute only
    insofar as they differ from those at `unstrained`. The result is used only if it reduces the
    strain energy.

    Parameters
    ----------
    evaluator
        Evaluator of the equations of motion.
    time
        (t, branch).
    begin
        Positions (n,) from which the motion is measured.
    q
        Positions (n,) that satisfy the constraints.
    unstrained
        Positions (n,) whose forces F (elastic forces, weight and loads) are subtracted.
    constraints
        Function from positions to gaps (k,) and their Jacobian R (k, n).
    square
        T^2 [s^2], the weight of forces relative to inertia.

    Returns
    -------
    numpy.ndarray
        Positions (n,); `q` itself if the iteration fails or increases the strain energy.
    """
    zeros, scale = np.zeros(len(q)), evaluator.equations.position_scales
    reference = evaluator.force(time, unstrained, zeros, zeros)
    best = q
    for _ in range(_MAX_ITERATIONS):
        stiffness, _, mass = evaluator.linearize_forces(time, evaluator.rest_state(best))
        elastic = evaluator.force(time, best, zeros, zeros) - reference
        gaps, rows = constraints(best)
        force = -(mass @ (best - begin) + square * elastic)
        force[evaluator.equations.states] = 0.0
        change = solve_least_change(mass + square * stiffness, rows, -gaps, force)
        size = float(np.max(np.abs(change) / scale))
        if not np.isfinite(size):
            break
        best = best + change * min(1.0, _MAX_CHANGE / max(size, _MAX_CHANGE))
        if size < _CONVERGED_CHANGE:
            return min(q, best, key=lambda at: _strain_energy(evaluator, time, at))
    return q


def _strain_energy(evaluator: StateEvaluator, time: Array, q: Array) -> float:
    equations = evaluator.equations
    zeros, no_reactions = np.zeros((1, equations.n)), np.zeros((1, equations.m))
    rows = balance_rows(equations)(time[None], q[None], zeros, zeros, no_reactions)
    return float(rows[0, _STRAIN_COLUMN])
