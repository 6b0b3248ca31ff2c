"""States in which elastic parts follow a motion without vibrations.

Elastic forces are K dq near positions q. Without vibrations, velocities and accelerations satisfy
the constraints with the least strain, and the deformation is that in equilibrium with the loads and
the forces of inertia:

    [[K, G^T], [G, 0]] (v, .) = (0, G v),
    [[K, G^T], [G, 0]] (a, .) = (-F''[v, v], gamma),
    [[K, G^T], [G, 0]] (dq, lam) = (-F(q, v) - M a, 0)

A small multiple of M is added to K for the motions that do not strain parts.
"""

from __future__ import annotations

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.linear.saddle_point import factorize_saddle_point

Array = np.ndarray

# Multiple of M that is added to K, relative to the largest ratio of their diagonals.
_REGULARIZATION = 1e-14
# Motion for the second difference F''[v, v], relative to `position_scales`.
_DIFFERENCE = 1e-3
_SLOWNESS = 1e-6  # of velocities at which these forces are evaluated


def find_smooth_state(
    solver: ConsistencySolver, time: Array, q: Array, v: Array, is_at_rest: bool = False
) -> State | None:
    """Return the state without vibrations near consistent positions and velocities, or None.

    Parameters
    ----------
    solver
        Solver of the equations of motion.
    time
        (t, branch).
    q, v
        Coordinates and velocities (n,) that satisfy the constraints.
    is_at_rest
        True to return the equilibrium with the loads at `time`, without velocities and
        accelerations of drivers.

    Returns
    -------
    State or None
        None if the matrix is singular or the result is not finite.
    """
    e, rest = solver.equations, solver.rest_state(q)
    stiffness, _, mass = solver.linearize_forces(time, rest)
    rows = solver.constraint_matrix(time, q)
    inertia = mass.diagonal()
    has_inertia = inertia > 0.0
    ratios = np.abs(stiffness.diagonal()[has_inertia]) / inertia[has_inertia]
    shift = _REGULARIZATION * float(np.max(ratios, initial=0.0)) or 1.0
    solve = factorize_saddle_point(stiffness + shift * mass, rows.T, rows)
    if solve is None:
        return None

    def balance(force: Array, values: Array) -> tuple[Array, Array]:
        solution = solve(np.concatenate([e.without_states(force), values]))
        return solution[: e.n], solution[e.n :]

    a = rest.a
    if is_at_rest:
        v = rest.v
    else:
        v, _ = balance(shift * (mass @ v), rows @ v)
        bend = np.zeros(e.n)
        speed = float(np.max(np.abs(v) / e.position_scales, initial=0.0))
        if speed > 0.0:
            interval = _DIFFERENCE / speed
            # At tiny velocities: straight extrapolations strain parts, whose damping would count.
            slow = _SLOWNESS * v
            bend = solver.evaluate_force_change(time, q, slow, interval / _SLOWNESS) / interval**2
        gamma = -solver.constraint_levels(time, q, v)[2]
        a, _ = balance(-shift * solver.force(time, q, v) - bend, gamma)
    still = np.zeros(e.m)
    change, lam = balance(-solver.force(time, q, v) - mass @ a, still)
    # Motions without strain, along which rounding errors of forces are amplified.
    drift, _ = balance(shift * (mass @ change), still)
    state = State(q + change - drift, v, a, lam)
    return state if all(np.isfinite(x).all() for x in state) else None
