"""Runs at rest, in which positions and forces are rounding errors."""

from __future__ import annotations

import numpy as np

from beamdae.equations import measures
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.results.trajectory import Trajectory

# Largest change of coordinates by rounding errors, relative to the length of the mechanism or 1 rad
# and to their values.
_ROUNDING = 1e-12
_RESIDUAL = 6  # column of the energy balance, after three energies and three powers


def is_at_rest(equations: EquationsOfMotion, trajectory: Trajectory, largest_force: float) -> bool:
    """Return True if coordinates change by rounding errors only, and so do all forces.

    The terms of a formula may cancel, for example those of a spring at its natural length, so that
    the largest force of a run is a rounding error.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    largest_force
        Largest entry of the forces and the reactions in the run.
    """
    return is_motionless(equations, trajectory) and has_rounding_forces(
        equations, trajectory, largest_force
    )


def has_rounding_forces(
    equations: EquationsOfMotion, trajectory: Trajectory, largest_force: float
) -> bool:
    """Return True if bodies move by rounding errors only, and all forces are rounding errors.

    States of signals, such as the integral of a controller without an actuator, may change. See
    `is_at_rest` for the parameters.
    """
    is_body = np.ones(equations.n, bool)
    is_body[equations.states] = False
    if not _moves_by_rounding(equations, trajectory, is_body):
        return False
    first = trajectory.intervals[0]
    start = first.rows.q[:1]
    rounding = _measure_rounding(equations, start[0])
    zero = np.zeros_like(start)
    times, lam = np.array([[first.t[0], first.branch]]), np.zeros((1, equations.m))
    states = ((start + sign * rounding, zero, zero, lam) for sign in (-1.0, 1.0))
    evaluate = measures.BalanceRows(equations)
    # Without accelerations and multipliers, the residual consists of forces.
    residuals = (evaluate(times, *state)[0, _RESIDUAL] for state in states)
    return bool(largest_force <= max(residuals))


def is_motionless(equations: EquationsOfMotion, trajectory: Trajectory) -> bool:
    """Return True if coordinates change by rounding errors only, whatever the forces are."""
    return _moves_by_rounding(equations, trajectory, np.ones(equations.n, bool))


def _moves_by_rounding(
    equations: EquationsOfMotion, trajectory: Trajectory, is_selected: np.ndarray
) -> bool:
    start = trajectory.intervals[0].rows.q[:1]
    rounding = np.where(is_selected, _measure_rounding(equations, start[0]), np.inf)
    # The last row first, which shows most motions.
    rows = (x.rows.q for x in trajectory.intervals)
    changes = (np.abs(q - start) for x in rows for q in (x[-1:], x))
    return all(bool((x <= rounding).all()) for x in changes)


def _measure_rounding(equations: EquationsOfMotion, q: np.ndarray) -> np.ndarray:
    size = np.maximum(np.where(equations.is_angle, 1.0, equations.length), np.abs(q))
    return np.asarray(_ROUNDING * size)
