"""Warnings about wrong reactions of mechanisms whose motion joints and drivers prescribe."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError, format_percent
from beamdae.results.columns import largest_of_kind
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Errors relative to half the range of a column from which on a run has a warning; with adaptive
# steps, errors of this many rtol are the accuracy asked for.
_MIN_ERROR = 0.01
_MIN_ERROR_PER_RTOL = 100.0
# Rows to compare: spread evenly, and where multipliers change most.
_SPREAD_ROWS = 50
_FAST_ROWS = 50
# Smaller ranges, relative to the largest value of a column of the same kind or to the largest
# multiplier, are rounding errors.
_MIN_RANGE = 1e-4
_MIN_RANGE_TO_MULTIPLIERS = 1e-6


def driven_reaction_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    columns: Mapping[str, Array],
    t: Array,
    observe: Callable[..., Array],
    integrator: Mapping[str, Any],
) -> tuple[str, ...]:
    """Return a warning if multipliers contradict the equations of motion at the output times.

    Without free motions, positions and velocities follow from the constraints, and accelerations
    and multipliers from the saddle-point system of `ConsistencySolver`, at any time. Runs with
    events, sampled controllers, or forces that depend on multipliers are not examined.

    Parameters
    ----------
    equations, trajectory
        Equations of motion and steps of the run.
    columns, t
        Observed columns (k,) by header, and their times (k,) [s].
    observe
        Function of times (j, 2) and of q, v, a and lam that returns rows of the columns.
    integrator
        Settings of the run.
    """
    has_configurations = any(x.configuration is not None for x in trajectory.intervals)
    has_implicit_forces = any(term.rows is not None for term in equations.forces)
    if not (equations.is_driven and columns) or has_configurations or has_implicit_forces:
        return ()
    if equations.controllers or len(t) < 2:
        return ()
    rtol = integrator.get("rtol")
    _, state = trajectory.at(t)
    rows = _select_rows(state.lam)
    times, state = trajectory.at(t[rows])
    solver = ConsistencySolver(equations)
    try:
        exact = [solver.acceleration(*x) for x in zip(times, state.q, state.v, strict=True)]
    except BeamdaeError:
        return ()  # singular positions have their own warning
    a, lam = (np.array(x) for x in zip(*exact, strict=True))
    difference = np.abs(observe(times, *state) - observe(times, state.q, state.v, a, lam))
    values = np.column_stack(list(columns.values()))
    largest = largest_of_kind(columns, np.max(np.abs(values), axis=0))
    half = 0.5 * np.ptp(values, axis=0)
    noise = np.maximum(_MIN_RANGE * largest, _MIN_RANGE_TO_MULTIPLIERS * np.max(np.abs(lam)))
    is_relevant = half > noise
    error = np.where(is_relevant, difference.max(axis=0) / np.where(is_relevant, half, 1.0), 0.0)
    worst = int(np.argmax(error))
    if not error[worst] > max(_MIN_ERROR, _MIN_ERROR_PER_RTOL * (rtol or 0.0)):
        return ()
    at = t[rows[np.argmax(difference[:, worst])]]
    remedy = "choose Radau(), or reduce the step" if rtol is None else "reduce rtol"
    return (
        f"{list(columns)[worst]}: wrong by {format_percent(error[worst])} of half its range at "
        f"t = {at:.4g} s, because steps resolve the motion, which joints and drivers prescribe, "
        f"but not this reaction; {remedy}.",
    )


def _select_rows(lam: Array) -> Array:
    """Return the indices of rows of the multipliers, spread evenly and where they change most."""
    spread = np.linspace(0, len(lam) - 1, min(_SPREAD_ROWS, len(lam))).astype(int)
    size = np.ptp(lam, axis=0)
    changes = np.abs(np.diff(lam, axis=0)) / np.where(size > 0.0, size, 1.0)
    fast = np.argsort(changes.max(axis=1))[-_FAST_ROWS:]
    return np.unique(np.concatenate([spread, fast, fast + 1]))
