"""Periodic motion, forced or self-excited, with its Floquet multipliers: `bd.periodic`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg as la

from beamdae import deferred
from beamdae.analysis.periodic.load_periods import Loads
from beamdae.analysis.periodic.monodromy import dominant_range
from beamdae.analysis.periodic.period_map import (
    IncompleteRunError,
    PeriodMap,
    PeriodRun,
    adopt_radau,
    build_periodic_equations,
)
from beamdae.analysis.periodic.shooting import (
    DAMPING_REMEDY,
    DEFAULT_RTOL,
    MAX_SETTLING_PERIODS,
    PeriodLinearization,
    Tolerance,
    estimate_period,
    settle_and_solve,
    solve_shooting,
)
from beamdae.errors import (
    BeamdaeError,
    require_count,
    require_finite,
    require_positive,
    warn_of_incomplete_result,
    warn_of_result,
    warnings_are_ignored,
)
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.integrator import require_integrator
from beamdae.interrupts import Interrupted, interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_functions import HasOrigin, Model
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import (
    PeriodicMotion,
    floquet_multipliers,
    largest_modulus,
)

Array = np.ndarray

_NAME = "periodic"
# Steps of the variational equations are halved up to this number of times, until the largest
# multiplier changes by at most this amount and by this fraction.
_MAX_REFINEMENTS, _MULTIPLIER_TOLERANCE, _MAX_RELATIVE_CHANGE = 4, 1e-5, 0.1
# Parts of the monodromy matrix below this fraction of its norm are neglected.
_MULTIPLIER_RANK_TOLERANCE = 1e-6
# A motion is a state of rest if its rates, relative to amplitudes and period, are below this value.
# A search that fails leads to a state of rest if it reduces all velocities below this fraction.
_REST_TOLERANCE, _REST_RATIO = 1e-6, 1e-2


@single_threaded
@interruptible
def periodic(
    model: Any,
    period: float | None = None,
    integrator: Integrator | None = None,
    start: Any = None,
    t_start: float = 0.0,
    settle: int = 5,
    tolerance: float | None = None,
    period_guess: float | None = None,
    *,
    accuracy: float | None = None,
    accuracy_columns: Sequence[str] | str | None = None,
) -> PeriodicMotion:
    """Find a periodic motion, forced or self-excited, and its stability.

    Single shooting (Nayfeh & Balachandran, Applied Nonlinear Dynamics, 1995, chapter 6): Newton's
    method solves (q, v)(t + T) = (q, v)(t), for one period T, within the motions that the joints
    allow. The monodromy matrix comes from the variational equations along the run. Both stable and
    unstable motions are found; if there are several, the result depends on the start. Angles may
    advance by full revolutions. The method usually fails if disturbances grow by more than a factor
    of 1e5 per period.

    Without `period`, the period of a self-excited or free motion is an unknown. The corrections of
    the state are then orthogonal to its time derivative (Seydel, Practical Bifurcation and
    Stability Analysis, 2010, section 7.1). One of the multipliers is 1: disturbances along the
    motion persist.

    Parameters
    ----------
    model
        As in `simulate`.
    period
        Period of the motion [s]: the period of loads and drivers, or a multiple for subharmonics.
        None to find the period of a motion under loads that do not depend on time.
    integrator
        Integrator with fixed steps, or `Radau`. Defaults to Radau(1e-8). Other integrators with
        adaptive steps are replaced by `Radau` with the same rtol, because they resolve vibrations
        that are not part of the motion.
    start
        "as drawn", "equilibrium", `rotation`, or positions and velocities by name. Defaults to the
        start of the model.
    t_start
        Time [s] at which the period begins; loads must be periodic from this time on.
    settle
        Number of periods to run before the first iteration, 0 to 10 000, to approach a stable
        motion. Without `period` and `period_guess`, the model runs to its end time instead.
    tolerance
        Largest permitted difference between the states at the end and at the start of the period,
        relative to the amplitudes; positive. Defaults to 100 times the relative tolerance of the
        integrator, but 1e-8 to 1e-3, or to 1e-6 for fixed steps. With the default, an iteration
        that stagnates at the errors of adaptive steps succeeds up to ten times this value.
    period_guess
        Approximate period [s] if `period` is None. A run of twice this duration shows the time
        after which the motion recurs first. Defaults to the end time of the model, at which the
        motion is settled.
    accuracy
        Largest error of the required columns [-], from 1e-6 to 0.1, see `Errors`.
    accuracy_columns
        Columns of `errors` that must be accurate. Defaults to a free period, the largest
        multiplier and, of the observed columns, positions, angles and deflections [m, rad] or, if
        there are none, all.

    Returns
    -------
    PeriodicMotion
        One period with its Floquet multipliers, or the incomplete run if a run ends early. If the
        search fails, `status` gives the reason.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, loads or drivers are not periodic or, without `period`, depend
        on time, parts are inactive, or events stop the run, switch parts or cause impacts.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        If no periodic motion was found, if `PeriodicMotion.errors` exceed 4 %, and for each warning
        of the run over the period.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0)))
    >>> rail = mech.add(bd.PointOnLine("rail", mech.ground.at(1.0, 0.0), mass.point, (1.0, 0.0)))
    >>> wall = mech.ground.at(0.0, 0.0)
    >>> spring = mech.add(bd.Spring("spring", wall, mass.point, 9.0, 0.5))
    >>> load = mech.add(bd.Force("load", mass.point, (bd.sine(1.0, frequency=0.3), 0.0)))
    >>> mech.observe("mass", mass.point)
    >>> motion = bd.periodic(mech, period=1.0 / 0.3)
    >>> motion.stability
    'stable'
    """
    t_start = require_finite(_NAME, "t_start", t_start)
    settle = require_count(_NAME, "settle", settle, 0, MAX_SETTLING_PERIODS)
    method = Radau(DEFAULT_RTOL) if integrator is None else integrator
    require_integrator(_NAME, method)
    method = adopt_radau(method)
    is_free = period is None
    guess, settle = _first_period(model, period, period_guess, settle)

    def find(model: Any, method: Integrator) -> PeriodicMotion:
        limits = Tolerance.for_integrator(_NAME, tolerance, method)
        equations = build_periodic_equations(_NAME, model, start)
        loads = Loads(equations, t_start, guess)
        if is_free:
            loads.require_constant()
        else:
            loads.require_repeating()
        period_map = PeriodMap.from_equations(equations, method, t_start, guess)
        try:
            if is_free:
                period_map, q, v = _settle_freely(period_map, settle, period_guess is not None)
                linear = solve_shooting(period_map, q, v, limits, is_free)
            else:
                linear = settle_and_solve(period_map, settle, limits)
        except IncompleteRunError as error:
            sentence = str(error).removeprefix("periodic: ").rstrip(".")
            return PeriodicMotion(
                error.solution,
                guess,
                status=Status("failed", sentence),
            )
        run = linear.run
        multipliers, change = _find_multipliers(run, is_free)
        status = _describe_outcome(linear, limits, is_free)
        return PeriodicMotion(
            run.solution,
            run.period_map.period,
            multipliers,
            change,
            run.relative_deviation,
            linear.iterations,
            status,
            is_free=is_free,
        )

    until = deferred.module("accuracy.until")
    analysis = until.Analysis(
        _NAME,
        find,
        method,
        start,
        lambda motion: motion.solution.columns,
    )
    motion = until.reach_accuracy(analysis, model, accuracy, accuracy_columns)
    if motion.status.kind == "interrupted":
        raise Interrupted(motion.status.sentence, motion, _NAME)
    if not motion.status.success:
        warn_of_incomplete_result(f"periodic: {motion.status.sentence}.")
    if not warnings_are_ignored():
        about_outcome = () if motion.status.success else motion.warnings[-1:]
        warn_of_result(motion.warnings, (*motion.solution.equations.build_warnings, *about_outcome))
    return motion


def _first_period(
    model: Any, period: float | None, guess: float | None, settle: int
) -> tuple[float, int]:
    """Return the period of the first run [s], and the number of periods to run before.

    Without a period and a guess, the first run is a single run to the end time of the model.
    """
    if period is not None:
        if guess is not None:
            raise BeamdaeError(
                "periodic: period and period_guess are mutually exclusive; omit one."
            )
        return require_positive(_NAME, "period", period), settle
    if guess is not None:
        return require_positive(_NAME, "period_guess", guess), settle
    origin = model.origin if isinstance(model, (Model, HasOrigin)) else None
    if origin is None or origin.t_end is None:
        raise BeamdaeError(
            "periodic: the model has no end time from which to estimate the period; pass period= "
            "or period_guess=."
        )
    return float(origin.t_end), 0


def _settle_freely(
    period_map: PeriodMap, settle: int, is_guess: bool
) -> tuple[PeriodMap, Array, Array]:
    """Return the map with the period that a run shows, and the state (q, v) from which it repeats.

    A run of two guessed periods from the state after `settle` periods shows the period, unless it
    ends early or does not recur. Without a guess, a run to the end time shows it.

    Raises
    ------
    IncompleteRunError
        If the run to settle or to the end time ends early.
    BeamdaeError
        If the period is no guess and the motion of the run does not recur.
    """
    q, v, _ = period_map.settle(settle)
    if is_guess:
        with suppress(IncompleteRunError):
            estimate = estimate_period(period_map.run(q, v, periods=2), is_settled=False)
            period_map = replace(period_map, period=estimate or period_map.period)
        return period_map, q, v
    run = period_map.run(q, v)
    estimate = estimate_period(run, is_settled=True)
    if estimate is None:
        raise BeamdaeError(
            f"periodic: the motion does not recur within {period_map.period:g} s; pass "
            "period_guess=, a longer end time of the model or a start closer to the motion."
        )
    period_map = replace(period_map, period=estimate)
    return period_map, *PeriodRun(period_map, run).end_state()


def _describe_outcome(linear: PeriodLinearization, limits: Tolerance, is_free: bool) -> Status:
    run, iterates = linear.run, linear.problem.iterates
    deviation, n = run.relative_deviation, len(run.state) // 2
    is_at_rest = not np.any(np.abs(run.rate) > _REST_TOLERANCE)
    if deviation > limits.accepted:
        # Deviations relative to the amplitude hardly change while the motions decay.
        velocities = iterates[-1].run.scales[n:] / iterates[0].run.scales[n:]
        is_at_rest |= bool(np.max(velocities) < _REST_RATIO)
    if is_free and is_at_rest:
        return Status(
            "failed", "the search leads to a state of rest; change start= or increase settle="
        )
    if deviation <= limits.accepted:
        return Status("ok", "repeats after one period")
    name = run.solution.equations.q_names[int(np.argmax(np.abs(run.difference / run.scales))) % n]
    sentence = (
        f"after {linear.iterations} iterations the end of the period differs from the start by "
        f"{deviation:.3g} times the amplitude, most in {name!r}; change start=, increase settle=, "
        "use a more accurate integrator"
    )
    at = run.period_map
    if not is_free and not Loads(at.equations, at.begin, at.period).varying:
        sentence += ", or omit period= to find the period of the free motion"
    elif not is_free:
        sentence += f", pass a multiple of the period of the loads as period=, or {DAMPING_REMEDY}"
    return Status("failed", sentence)


def _find_multipliers(run: PeriodRun, is_free: bool) -> tuple[Array, float]:
    """Return the Floquet multipliers, and the change of the largest one by halved steps.

    Disturbances along a free motion have the multiplier 1. The others are those of disturbances
    modulo these: rounding would split a double multiplier of a conservative motion by its root.
    """
    along = run.rate[None] if is_free else np.zeros((0, len(run.rate)))
    across = la.null_space(along)
    previous, expected = np.array([np.inf]), across[:, :0]
    for refinement in range(-1, _MAX_REFINEMENTS + 1):
        monodromy = run.monodromy(
            expected, tolerance=_MULTIPLIER_RANK_TOLERANCE, refinement=refinement
        )
        expected = dominant_range(monodromy, _MULTIPLIER_RANK_TOLERANCE)
        others = floquet_multipliers(across.T @ monodromy @ across)
        values = np.concatenate([np.ones(len(monodromy) - len(others)), others])
        values = values[np.argsort(-np.abs(values), kind="stable")]
        error, previous = _change_of_largest(values, previous), values
        if error <= min(_MULTIPLIER_TOLERANCE, _MAX_RELATIVE_CHANGE * largest_modulus(values)):
            break
    return values, error


def _change_of_largest(values: Array, previous: Array) -> float:
    """Return the change of the largest multiplier from those of steps of twice the length.

    Steps that are too long damp multipliers: if the largest grew by a factor, its change is
    multiplied by it. Multipliers that are not known are zero.
    """
    largest = values[0] if len(values) else 0.0
    nearest = min(previous, key=lambda x: abs(largest - x), default=0.0)
    if largest == nearest:
        return 0.0
    growth = abs(largest) / abs(nearest) if nearest else np.inf
    return float(abs(largest - nearest) * max(growth, 1.0))
