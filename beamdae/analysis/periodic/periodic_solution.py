"""Steady states under periodic loads, and whether they are stable."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from beamdae.analysis.periodic.monodromy import VariationalEquations
from beamdae.analysis.periodic.shooting import IncompleteRunError, PeriodMap, ShootingResult
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    require_count,
    require_finite,
    require_positive,
)
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import PeriodicMotion, floquet_multipliers, largest_modulus
from beamdae.simulation import as_equations

Array = np.ndarray

# Newton's method: where it has converged, over how far coordinates move, and how often it goes.
TOLERANCE, _MOST_ITERATIONS = 1e-6, 25
RTOL = 1e-8
MOST_SETTLING = 10_000
# Nearer than this iterations that do not halve what is missed are in vain, several in a row.
_NEAR, _IN_VAIN = 1e-4, 4
# How often a step of Newton's method is halved from where no run reaches the end of the period.
_HALVINGS = 5
# Steps of the disturbances are halved until the largest multipliers change by less.
_MULTIPLIERS, _MOST_HALVINGS = 1e-5, 6
# Singular values smaller than this, over the largest, belong to motions that any state repeats in.
_NEUTRAL = 1e-9


def periodic(
    model: Any,
    period: float,
    integrator: Integrator | None = None,
    start: Any = None,
    begin: float = 0.0,
    settle: int = 5,
    tolerance: float = TOLERANCE,
) -> PeriodicMotion:
    """Find the steady state under loads and drivers that repeat after a period.

    By single shooting: Newton's method on the state that a period carries to itself, in the motions
    that the joints allow, with the monodromy matrix from the equations linearized along the run
    (Nayfeh & Balachandran, Applied Nonlinear Dynamics, 1995, chapter 6). Stable and unstable
    motions are found alike; where there are several, the one near the start. Angles repeat up to
    whole turns. Motions whose disturbances grow by more than 1e5 in a period are out of its reach.

    Parameters
    ----------
    model
        As in `simulate`.
    period
        Of the motion [s]: that of loads and drivers, or a multiple of it for subharmonics.
    integrator
        Default Radau(1e-8).
    start
        "as drawn", "equilibrium", or positions and velocities by name, see `simulate`.
    begin
        Time [s] at which periods begin, where loads repeat from there on.
    settle
        Periods that are run before, towards a motion that is stable.
    tolerance
        By how much a period may miss its start, over how far coordinates move.

    Returns
    -------
    PeriodicMotion
        Also where Newton's method did not converge, or a run did not reach its end: `status` says
        so, and a warning.

    Raises
    ------
    BeamdaeError
        If loads or drivers do not repeat, or parts are switched.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0)))
    >>> rail = mech.add(bd.PointOnLine("rail", mech.ground.at(1.0, 0.0), mass.point, (1.0, 0.0)))
    >>> wall = mech.ground.at(0.0, 0.0)
    >>> spring = mech.add(bd.SpringDamper("spring", wall, mass.point, 9.0, 0.5))
    >>> load = mech.add(bd.Force("load", mass.point, (bd.sine(1.0, frequency=0.3), 0.0)))
    >>> mech.observe("mass", mass.point)
    >>> motion = bd.periodic(mech, period=1.0 / 0.3)
    >>> motion.stability
    'stable'
    """
    period, begin = (
        require_positive("periodic", "period", period),
        require_finite("periodic", "begin", begin),
    )
    tolerance = require_positive("periodic", "tolerance", tolerance)
    settle = require_count("periodic", "settle", settle, 0, MOST_SETTLING)
    method = Radau(RTOL) if integrator is None else integrator
    require_integrator("periodic", method)
    flow = PeriodMap.of(build_periodic_equations("periodic", model, start), method, begin, period)
    try:
        shot, iterations = solve_shooting(flow, *settle_motion(flow, settle), tolerance)
    except IncompleteRunError as problem:
        told = str(problem).removeprefix("periodic: ").rstrip(".")
        found = PeriodicMotion(problem.solution, period, status=Status("failed", told))
    else:
        status = _shooting_status(shot, iterations, tolerance)
        multipliers, error = _converge_multipliers(flow, shot)
        found = PeriodicMotion(
            shot.solution, period, multipliers, error, shot.off, iterations, status
        )
    if not found.status.success:
        warnings.warn(f"periodic: {found.status.sentence}.", BeamdaeWarning, stacklevel=2)
    return found


def _shooting_status(shot: ShootingResult, iterations: int, tolerance: float) -> Status:
    if shot.off <= tolerance:
        return Status("ok", "repeats after its period")
    told = f"after {iterations} iterations the motion misses its start by {shot.off:.3g} of itself"
    if shot.off < _NEAR:
        told += ", which may be what the integrator is off by"
    return Status("failed", told)


def build_periodic_equations(name: str, model: Any, start: Any = None) -> EquationsOfMotion:
    """Equations of a model whose parts are always active; `name` is that of what was given it."""
    equations = as_equations(name, model, start)
    if equations.configurations is not None or any(x.do != "record" for x in equations.events):
        raise BeamdaeError(
            f"{name}: events must not stop a run or switch parts; make contacts and the like "
            "smooth forces."
        )
    return equations


def settle_motion(flow: PeriodMap, periods: int) -> tuple[Array, Array]:
    """The state (q, v) after some periods."""
    e = flow.equations
    q, v = flow.consistent(e.q0, e.v0)
    if not periods:
        return q, v
    solution = flow.run(q, v, periods=periods)
    last = solution.trajectory.intervals[-1].state
    q = last.q[-1].copy()
    angles = np.array([c.unit == "rad" for c in e.coordinates])
    turns = np.where(angles, 2.0 * np.pi * np.round((q - e.q0) / (2.0 * np.pi)), 0.0)
    return flow.consistent(q - turns, last.v[-1])


def solve_shooting(
    flow: PeriodMap, q: Array, v: Array, tolerance: float
) -> tuple[ShootingResult, int]:
    """The last shot of Newton's method, and how many there were before it."""
    shot = ShootingResult.of(flow, q, v)
    flow.require_repeating(shot.solution)
    best, last = shot, 0
    for iteration in range(1, _MOST_ITERATIONS + 1):
        if shot.off <= tolerance:
            return shot, iteration - 1
        matrix = shot.carried - np.eye(len(shot.missed))
        change = -np.linalg.lstsq(matrix, shot.missed, rcond=_NEUTRAL)[0]
        # No more than what the motion is as a whole.
        change /= max(1.0, float(np.max(np.abs(change))) / 3.0)
        shot = _shoot_from(flow, shot, change)
        if shot.off < 0.5 * best.off:
            last = iteration
        best = min(best, shot, key=lambda x: x.off)
        if best.off < _NEAR and iteration - last >= _IN_VAIN:
            return best, iteration
    return best, _MOST_ITERATIONS


def _shoot_from(
    flow: PeriodMap, shot: ShootingResult, change: Array, halvings: int = _HALVINGS
) -> ShootingResult:
    """The period from a changed start on; from one changed by less where no run gets through."""
    try:
        return ShootingResult.of(flow, *flow.consistent(*shot.moved(change)))
    except IncompleteRunError:
        if not halvings:
            raise
        return _shoot_from(flow, shot, 0.5 * change, halvings - 1)


def _converge_multipliers(flow: PeriodMap, shot: ShootingResult) -> tuple[Array, float]:
    """Floquet multipliers, with the steps of disturbances halved until the largest stay."""
    linear = VariationalEquations(flow.equations)
    into = (shot.free / shot.scales[:, None] ** 2).T
    found, error = floquet_multipliers(shot.carried), np.inf
    for halving in range(1, _MOST_HALVINGS + 1):
        carried = into @ linear.carried(shot.solution.trajectory, shot.free, halving)
        finer = floquet_multipliers(carried)
        error = abs(largest_modulus(finer) - largest_modulus(found))
        found = finer
        if error <= _MULTIPLIERS:
            break
    return found, float(error)
