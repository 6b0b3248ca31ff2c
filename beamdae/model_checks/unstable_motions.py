"""Warnings about runs that start in, or stay in, a state that the smallest disturbance leaves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from beamdae import deferred
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.equations.starts.rank import scaled_null_space
from beamdae.errors import BeamdaeError
from beamdae.parts.mechanism import EQUILIBRIUM
from beamdae.results.trajectory import Instant

if TYPE_CHECKING:
    from beamdae.results.run_data import RunData

Array = np.ndarray

_MAX_COORDINATES = 300  # of dense matrices
_GROWTH = np.log(1e3)  # exponent in a run, from an imperfection to a deflection
_LAST_PART = 0.05  # of a run, in which a mode grows at least by a factor of e
_MAX_TRAVEL = 0.1  # of slow motions in this part at their speed at the end, in natural sizes
_ASYMMETRY = 1e-9  # of the stiffness of forces without a potential
# Raised for singular positions, massless points, and values that are not finite
_NOT_LINEARIZED = (BeamdaeError, ValueError)


def unstable_motion_warnings(run: RunData) -> Iterator[str]:
    """Yield a warning if the start or the slow motion at the end of a run is unstable.

    The run contains no disturbance that would leave such a state. Models with sampled controllers,
    which may hold it, are exempt.
    """
    e, start, end = run.equations, run.trajectory.start, run.trajectory.end
    duration = end - start
    if e.mechanism is None or e.controllers or e.n > _MAX_COORDINATES or not duration > 0.0:
        return
    remedy = "add an imperfection (bd.imperfect) or a small load"
    if run.start.request == EQUILIBRIUM and (rate := _find_growth(run, start, _GROWTH / duration)):
        yield (
            "start: the equilibrium is unstable, and the smallest disturbance leaves it as "
            f"exp({rate:.3g} t); start from other positions, or {remedy}."
        )
        return
    speed = float(np.max(np.abs(run.trajectory.at(np.array([end]))[1].v[0]) / e.position_scales))
    if speed * _LAST_PART * duration > _MAX_TRAVEL:
        return
    if rate := _find_growth(run, end, 1.0 / (_LAST_PART * duration)):
        yield (
            f"run: at t = {end:.4g} s, the motion is slow but unstable, and the smallest "
            f"disturbance leaves it as exp({rate:.3g} t); {remedy}."
        )


def _find_growth(run: RunData, t: float, min_rate: float) -> float:
    """Return the largest growth rate [1/s] above `min_rate` about a state of the run, or 0."""
    e, trajectory, times = run.equations, run.trajectory, np.array([t])
    (time,), state = trajectory.at(times)
    interval = trajectory.intervals[int(trajectory.interval_index(times)[0])]
    active, lam = interval.active_equations(e), state.lam
    if interval.configuration is not None:
        lam = interval.configuration.select_multipliers(lam)
    state = type(state)(*(x[0] for x in state._replace(lam=lam)))
    with np.errstate(all="ignore"), suppress(*_NOT_LINEARIZED):
        tangent = compute_tangent(active, time, state)
        basis = scaled_null_space(tangent.acceleration_jacobian(active), active.position_scales)
        stiffness = basis.T @ (tangent.stiffness @ basis)
        total = tangent.stiffness + min_rate * tangent.damping + min_rate**2 * tangent.mass
        asymmetry = np.max(np.abs(stiffness - stiffness.T), initial=0.0)
        has_potential = asymmetry <= _ASYMMETRY * np.max(np.abs(stiffness), initial=0.0)
        projected = basis.T @ (total @ basis)
        if has_potential and np.all(np.linalg.eigvalsh(projected + projected.T) > 0.0):
            return 0.0
        analysis = deferred.module("analysis.linear_dynamics.natural_modes")
        about = Instant(time, state, interval.configuration)
        rates = analysis.compute_modes(e, about, None, assessed=0).growth_rates
        return float(np.max(rates[rates > min_rate], initial=0.0))
    return 0.0
