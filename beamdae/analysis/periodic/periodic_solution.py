"""Periodic motion under periodic loads, with its Floquet multipliers: `bd.periodic`."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from beamdae.analysis.periodic.monodromy import LinearizationError
from beamdae.analysis.periodic.shooting import (
    DEFAULT_RTOL,
    MAX_SETTLING_PERIODS,
    IncompleteRunError,
    PeriodMap,
    PeriodRun,
    Tolerance,
    build_periodic_equations,
    solve_shooting,
)
from beamdae.errors import BeamdaeWarning, require_count, require_finite, require_positive
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.interrupts import interruptible
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import PeriodicMotion, floquet_multipliers, largest_modulus

Array = np.ndarray

_NAME = "periodic"
# Steps of the variational equations are halved until the largest modulus of a multiplier changes by
# at most this amount.
_MULTIPLIER_TOLERANCE = 1e-5
_MAX_REFINEMENTS = 6
# Steps of the coarsest variational equations, relative to those of Newton's method.
_COARSEST_STEPS = 4.0
# Below this relative deviation, the accuracy of the integrator may limit the convergence.
_INTEGRATOR_LIMITED_DEVIATION = 1e-4


@interruptible
def periodic(
    model: Any,
    period: float,
    integrator: Integrator | None = None,
    start: Any = None,
    begin: float = 0.0,
    settle: int = 5,
    tolerance: float | None = None,
) -> PeriodicMotion:
    """Find a periodic motion under periodic loads and drivers, and its stability.

    Single shooting (Nayfeh & Balachandran, Applied Nonlinear Dynamics, 1995, chapter 6): Newton's
    method solves (q, v)(t + T) = (q, v)(t), for one period T, within the motions that the joints
    allow. The monodromy matrix comes from the variational equations along the run. Both stable and
    unstable motions are found; if there are several, the result depends on the start. Angles may
    advance by full revolutions. The method usually fails if disturbances grow by more than a factor
    of 1e5 per period.

    Parameters
    ----------
    model
        As in `simulate`.
    period
        Period of the motion [s]: the period of loads and drivers, or a multiple for subharmonics.
    integrator
        Integrator. Defaults to Radau(1e-8).
    start
        "as drawn", "equilibrium", or positions and velocities by name. Defaults to the start of the
        model.
    begin
        Time [s] at which the period begins; loads must be periodic from this time on.
    settle
        Number of periods to run before the first iteration, 0 to 10 000, to approach a stable
        motion.
    tolerance
        Largest permitted difference between the states at the end and at the start of the period,
        relative to the amplitudes; positive. Defaults to 100 times the relative tolerance of the
        integrator, but 1e-8 to 1e-3, or to 1e-6 for fixed steps. With the default, an iteration
        that stagnates at the errors of adaptive steps succeeds up to ten times this value.

    Returns
    -------
    PeriodicMotion
        One period with its Floquet multipliers, or the incomplete run if a run ends early. If the
        search fails, `status` gives the reason.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, loads or drivers are not periodic, parts are inactive, or events
        stop the run, switch parts or cause impacts.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        If no periodic motion was found.

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
    period = require_positive(_NAME, "period", period)
    begin = require_finite(_NAME, "begin", begin)
    settle = require_count(_NAME, "settle", settle, 0, MAX_SETTLING_PERIODS)
    method = Radau(DEFAULT_RTOL) if integrator is None else integrator
    require_integrator(_NAME, method)
    limits = Tolerance.for_integrator(_NAME, tolerance, method)
    equations = build_periodic_equations(_NAME, model, start)
    period_map = PeriodMap.from_equations(equations, method, begin, period)
    try:
        q, v = period_map.settle(settle)
        result, iterations = solve_shooting(period_map, q, v, limits)
    except IncompleteRunError as error:
        sentence = str(error).removeprefix("periodic: ").rstrip(".")
        motion = PeriodicMotion(error.solution, period, status=Status("failed", sentence))
    else:
        deviation = result.relative_deviation
        status = Status("ok", "repeats after one period")
        if deviation > limits.accepted:
            sentence = (
                f"after {iterations} iterations the end of the period differs from the "
                f"start by {deviation:.3g} times the amplitude; change start= or increase settle="
            )
            if deviation < _INTEGRATOR_LIMITED_DEVIATION:
                sentence += ", or use a more accurate integrator"
            status = Status("failed", sentence)
        multipliers, error_estimate = _refine_multipliers(result)
        motion = PeriodicMotion(
            result.solution, period, multipliers, error_estimate, deviation, iterations, status
        )
    if not motion.status.success:
        warnings.warn(f"periodic: {motion.status.sentence}.", BeamdaeWarning, stacklevel=3)
    return motion


def _refine_multipliers(run: PeriodRun) -> tuple[Array, float]:
    """Return the Floquet multipliers and an error estimate.

    The estimate is the change of the largest modulus in the last refinement of the steps.
    """
    multipliers, error = np.zeros(0, complex), np.inf
    coarsest = _COARSEST_STEPS * run.steps_per_node
    for refinement in range(_MAX_REFINEMENTS + 1):
        try:
            monodromy = run.monodromy(steps_per_node=coarsest / 2**refinement)
        except LinearizationError:
            continue
        refined = floquet_multipliers(monodromy)
        if multipliers.size:
            error = abs(largest_modulus(refined) - largest_modulus(multipliers))
        multipliers = refined
        if error <= _MULTIPLIER_TOLERANCE:
            break
    return multipliers, float(error)
