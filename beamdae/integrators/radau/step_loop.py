"""Step loop of three-stage Radau IIA: error test and step size control.

The functions are plain Python over arrays; `native.loops` compiles them if possible.
"""

from __future__ import annotations

from beamdae.integrators.method import clip_step
from beamdae.integrators.multiplier_tolerances import lower_weights
from beamdae.integrators.radau.coefficients import REAL_EIGENVALUE, C
from beamdae.integrators.radau.stages import (
    MAX_ITERATIONS,
    estimate_error,
    set_stages,
    solve_stages,
)
from beamdae.integrators.radau.workspace import TOO_SMALL, RadauWorkspace
from beamdae.native.loop_functions import combine, max_norm, minimum
from beamdae.native.return_codes import DONE, ERROR_TOO_LARGE, FULL, NEW_PIVOTS

# The local error of the embedded third-order method is of order 4.
_ERROR_EXPONENT = 1.0 / 4.0
_SAFETY = 0.9
# Bounds on the ratio of successive steps.
_MIN_FACTOR = 0.2
_MAX_FACTOR = 4.0
# Lower bound on the error, relative to the tolerance, from which the next step is computed.
_MIN_ERROR = 1e-2
# The step, and with it the factors, is kept if it would grow by less than this factor and Newton's
# iteration converges faster than _KEEP_RATE.
_KEPT_GROWTH = 1.2
_KEEP_RATE = 0.05
# Relative difference below which two steps are equal: steps between the samples of a controller
# differ by rounding.
_STEP_ROUNDING = 1e-9
# Factor that reduces the step, and limits the next ones, after a failure of Newton's iteration.
_FAILURE_FACTOR = 0.5
# Growth factor of this limit per step while the iteration converges faster than _SLOW_RATE.
_RECOVERY_FACTOR = 1.1
_SLOW_RATE = 0.2


def take_radau_steps(run: RadauWorkspace) -> int:
    """Take steps that pass the error test until the interval ends or the rows are full.

    Return DONE, FULL, NEW_PIVOTS, or the code of the last failure if steps become too small.
    """
    size = run.step_size
    while run.t < run.end:
        if run.filled == 3 * run.most:
            return FULL
        remaining = run.end - run.t
        h = clip_step(size.next_step, remaining)
        # The next step is NaN after an error estimate that is NaN.
        if size.next_step != size.next_step or h < min(size.smallest, remaining):
            return run.failure_code
        renew = not _can_reuse_factors(run, h)
        code = solve_stages(run, h, renew)
        if code == NEW_PIVOTS:
            return code
        if code != DONE:
            run.failures += 1
            run.factors_step = 0.0
            if renew:
                run.rejections += 1
                run.failure_code = code
                size.next_step = size.newton_limit = _FAILURE_FACTOR * h
                size.is_retry = 1
            continue
        estimate_error(run, h)
        # Rounding errors of positions divided by a short step are errors of velocities.
        velocities = run.test_weights[run.form.n :]
        minimum(velocities, run.tested_velocity_weights, h, run.velocity_rounding_weights)
        error = max_norm(run.error[: run.test_weights.size], run.test_weights)
        if h > run.shortest_tested_step:
            multipliers = _multiplier_error(run, h)
            if multipliers > error:
                error = multipliers
        if error < 1.0:
            _accept_step(run, h, error)
            _store_step(run, h, h == remaining)
            continue
        run.rejections += 1
        run.failure_code = ERROR_TOO_LARGE
        size.next_step = h * min(max(_step_factor(run, error), _MIN_FACTOR), _SAFETY)
        if error != error:
            size.next_step = error
        size.is_retry = 1
    return DONE


def _multiplier_error(run: RadauWorkspace, h: float) -> float:
    """Return the largest error of the tested multipliers relative to their tolerances.

    The estimate is that of their integrals over the step.
    """
    first, weights = 2 * run.form.n, run.multiplier_weights
    return max_norm(run.error[first : first + weights.size], weights) * (REAL_EIGENVALUE / h)


def _can_reuse_factors(run: RadauWorkspace, h: float) -> bool:
    same = abs(h - run.factors_step) <= _STEP_ROUNDING * h
    return same and run.rate <= _KEEP_RATE


def _step_factor(run: RadauWorkspace, error: float) -> float:
    """Return the step ratio that the error allows, reduced after many Newton iterations."""
    most = 2 * MAX_ITERATIONS
    return _SAFETY * (most + 1) / (most + run.iterations) / error**_ERROR_EXPONENT


def _accept_step(run: RadauWorkspace, h: float, error: float) -> None:
    """Set the next step after an accepted step `h` [s]; see `workspace.StepSizeState`."""
    size = run.step_size
    error = max(error, _MIN_ERROR)
    factor = _step_factor(run, error)
    if size.last_step > 0.0:
        factor *= min(1.0, h / size.last_step * (size.last_error / error) ** _ERROR_EXPONENT)
    factor = min(max(factor, _MIN_FACTOR), 1.0 if size.is_retry == 1 else _MAX_FACTOR)
    if run.rate < _SLOW_RATE:
        size.newton_limit = min(_RECOVERY_FACTOR * size.newton_limit, size.longest)
    candidate = min(factor * h, size.newton_limit)
    keep = h <= candidate and candidate <= _KEPT_GROWTH * h and _can_reuse_factors(run, h)
    size.next_step = h if keep else candidate
    # After a rejected attempt, its failure explains why the next step may be too small.
    if size.is_retry == 0:
        run.failure_code = TOO_SMALL
    size.last_step, size.last_error, size.is_retry = h, error, 0


def _store_step(run: RadauWorkspace, h: float, last: bool) -> None:
    """Store the stages of an accepted step as rows; the last stage starts the next step."""
    set_stages(run, h)
    n = run.form.n
    for i in range(3):
        row, y, yp = run.rows[run.filled + i], run.stages[i], run.rates[i]
        row[0] = run.t + C[i] * h
        combine(row[1 : 1 + 2 * n], (1.0,), (y[: 2 * n],))
        # The multipliers are derivatives of unknowns and follow the accelerations in y'.
        accelerations_and_multipliers = yp[n : n + row.size - 1 - 2 * n]
        combine(row[1 + 2 * n :], (1.0,), (accelerations_and_multipliers,))
        combine(run.last_w[i], (1.0,), (run.w[i],))
    lower_weights(run.multiplier_weights, run.multiplier_tolerance, run.rates[2][2 * n :])
    run.t = run.end if last else run.t + h
    run.rows[run.filled + 2][0] = run.t
    run.filled += 3
    combine(run.y, (1.0,), (run.stages[2],))
    combine(run.yp, (1.0,), (run.rates[2],))
