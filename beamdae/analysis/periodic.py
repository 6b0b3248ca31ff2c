"""Steady states under periodic loads, and whether they are stable."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from beamdae.analysis.monodromy import Linearized
from beamdae.analysis.shooting import Flow, Shot
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, BeamdaeWarning, count, finite, positive
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import PeriodicMotion, largest, sorted_multipliers
from beamdae.simulation import as_equations

Array = np.ndarray

# Newton's method: where it has converged, over how far coordinates move, and how often it goes.
TOLERANCE, _MOST_ITERATIONS = 1e-6, 25
RTOL = 1e-8
MOST_SETTLING = 10_000
# Steps of the disturbances are halved until the largest multipliers change by less.
_MULTIPLIERS, _MOST_HALVINGS = 1e-5, 3
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
        Also where Newton's method did not converge: `status` says so, and a warning.

    Raises
    ------
    BeamdaeError
        If loads or drivers do not repeat, parts are switched, or a run over a period fails.

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
    period, begin = positive("periodic", "period", period), finite("periodic", "begin", begin)
    tolerance = positive("periodic", "tolerance", tolerance)
    settle = count("periodic", "settle", settle, 0, MOST_SETTLING)
    method = Radau(RTOL) if integrator is None else integrator
    require_integrator("periodic", method)
    flow = Flow.of(equations_of(model, start), method, begin, period)
    q, v, scales = settled(flow, settle)
    shot, iterations = converged(flow, q, v, scales, tolerance)
    status = Status("ok", "repeats after its period")
    if shot.off > tolerance:
        told = f"misses its start by {shot.off:.3g} of its motion after {iterations} iterations"
        status = Status("failed", told)
        warnings.warn(f"periodic: the motion {told}.", BeamdaeWarning, stacklevel=2)
    multipliers, error = _multipliers(flow, shot)
    return PeriodicMotion(shot.solution, period, multipliers, error, shot.off, iterations, status)


def equations_of(model: Any, start: Any = None) -> EquationsOfMotion:
    """Equations of a model whose parts are always active."""
    equations = as_equations(model, start)
    if equations.configurations is not None or any(x.do != "record" for x in equations.events):
        raise BeamdaeError(
            "periodic: events must not stop a run or switch parts; make contacts and the like "
            "smooth forces."
        )
    return equations


def settled(flow: Flow, periods: int) -> tuple[Array, Array, Array | None]:
    """The state after some periods, and how far things moved in the last."""
    e = flow.equations
    q, v = flow.consistent(e.q0, e.v0)
    if not periods:
        return q, v, None
    solution = flow.run(q, v, periods=periods)
    if not solution.status.success:
        raise BeamdaeError(
            f"periodic: the run to settle was not finished, {solution.status.sentence}."
        )
    last = solution.trajectory.intervals[-1].state
    q = last.q[-1].copy()
    angles = np.array([c.unit == "rad" for c in e.coordinates])
    turns = np.where(angles, 2.0 * np.pi * np.round((q - e.q0) / (2.0 * np.pi)), 0.0)
    return *flow.consistent(q - turns, last.v[-1]), None


def converged(
    flow: Flow, q: Array, v: Array, scales: Array | None, tolerance: float
) -> tuple[Shot, int]:
    """The last shot of Newton's method, and how many there were before it."""
    shot = Shot.of(flow, q, v, scales)
    flow.require_repeating(shot.solution)
    best = shot
    for iteration in range(1, _MOST_ITERATIONS + 1):
        if shot.off <= tolerance:
            return shot, iteration - 1
        matrix = shot.carried - np.eye(len(shot.missed))
        change = -np.linalg.lstsq(matrix, shot.missed, rcond=_NEUTRAL)[0]
        # No more than what the motion is as a whole.
        change /= max(1.0, float(np.max(np.abs(change))) / 3.0)
        q, v = flow.consistent(*shot.moved(change))
        shot = Shot.of(flow, q, v, None)
        best = min(best, shot, key=lambda x: x.off)
    return best, _MOST_ITERATIONS


def _multipliers(flow: Flow, shot: Shot) -> tuple[Array, float]:
    """Floquet multipliers, with the steps of disturbances halved until the largest stay."""
    linear = Linearized(flow.equations)
    into = (shot.free / shot.scales[:, None] ** 2).T
    found, error = sorted_multipliers(shot.carried), np.inf
    for halving in range(1, _MOST_HALVINGS + 1):
        carried = into @ linear.carried(shot.solution.trajectory, shot.free, halving)
        finer = sorted_multipliers(carried)
        error = abs(largest(finer) - largest(found))
        found = finer
        if error <= _MULTIPLIERS:
            break
    return found, float(error)
