"""Impacts: velocity jumps by Newton's law of restitution, subject to all active joints."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.equations_of_motion import ImpactEquations, State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.dependent_constraints import require_independent_constraints

Array = np.ndarray


def solve_impulses(
    names: tuple[str, ...], mass: sp.csc_array, gradient: sp.csc_array, rate_changes: Array
) -> tuple[Array, Mapping[str, float]]:
    """Return the velocity jump for given changes of constraint rates, and impulses by name.

    With M = `mass` and G = `gradient`, M (v+ - v-) = -G^T P and G (v+ - v-) = `rate_changes` are
    solved for the jump v+ - v-, (n,), and the impulses P [N s or N m s], (m,), of the constraints
    `names`.
    """
    n, m = mass.shape[0], len(rate_changes)
    if not m or not np.any(rate_changes):
        return np.zeros(n), dict.fromkeys(names, 0.0)
    saddle = sp.block_array([[mass, gradient.T], [gradient, None]], format="csc")
    unknowns = splu(saddle).solve(np.concatenate([np.zeros(n), rate_changes]))
    return unknowns[:n], dict(zip(names, unknowns[n:].tolist(), strict=True))


def apply_impact(
    impact: ImpactEquations, time: Array, state: State
) -> tuple[Array, Mapping[str, float]]:
    """Return the velocities after an impact at `time` = (t, branch), and impulses by constraint.

    Closed gaps that are already opening are excluded, because contacts can only push.

    Raises
    ------
    BeamdaeError
        If the active joints depend on each other at the impact.
    """
    solver, names = ConsistencySolver(impact.equations), impact.equations.lam_names
    rates = solver.constraint_levels(time, state.q, state.v)[1]
    active = select_active_constraints(impact, rates)
    if not len(active):
        return state.v, {}
    restitution = impact.coefficients
    require_independent_constraints(solver, time, state.q)
    gradient = sp.csc_array(solver.constraint_matrix(time, state.q)[active])
    change, impulses = solve_impulses(
        tuple(names[k] for k in active),
        solver.mass_matrix(time, state.q),
        gradient,
        -(1.0 + restitution[active]) * rates[active],
    )
    return state.v + change, impulses


def select_active_constraints(impact: ImpactEquations, rates: Array) -> Array:
    """Return the indices of the constraints that act in an impact, empty if no body is stopped.

    `rates` are the rates of the constraints before the impact, (m,).
    """
    names = impact.equations.lam_names
    opening = np.array([name in impact.gaps for name in names], bool) & (rates <= 0.0)
    (active,) = np.nonzero(~opening)
    if not any(names[k] in impact.restitution for k in active):
        return active[:0]
    return active
