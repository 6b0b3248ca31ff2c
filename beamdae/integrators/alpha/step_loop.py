"""Step loops of the generalized-alpha family, with fixed and adaptive steps.

The functions are plain Python over arrays; `native.loops` compiles them if possible.
"""

from __future__ import annotations

import math

import numpy as np

from beamdae.equations.formulations.step_equations import (
    evaluate_step_matrix,
    evaluate_step_position,
    evaluate_step_residual,
)
from beamdae.integrators.alpha.family import JERK_INTERVAL
from beamdae.integrators.alpha.jerk import AdaptiveAlphaWorkspace, evaluate_normal_jerk
from beamdae.integrators.alpha.workspace import AlphaWorkspace, Motion
from beamdae.integrators.method import clip_step
from beamdae.integrators.multiplier_tolerances import lower_weights
from beamdae.native.loop_functions import combine, euclidean_norm, factorize, fill, max_norm, solve
from beamdae.native.return_codes import (
    DONE,
    ERROR_TOO_LARGE,
    FULL,
    NEW_PIVOTS,
    NOT_CONVERGED,
    NOT_FINITE,
    SINGULAR,
)

Array = np.ndarray

# Return code that requests the starting values of an interval; see `family.AlphaStart`.
FIRST_STEP = 10
# Return code in addition to `native.return_codes`: singular equations of the jerk.
STEP_NOT_CHANGED = -6

# Relative difference below which two steps are equal.
SAME_STEP = 1e-9

# The step grows by a factor from _MIN_GROWTH to _MAX_GROWTH if this many steps allow it: new
# factors cost more than a few steps, and the estimate vanishes briefly when the jerk of a vibration
# crosses zero.
_STEPS_BEFORE_GROWTH = 8
_MIN_GROWTH = 1.2
_MAX_GROWTH = 2.0
# Bounds on the factor that reduces a step whose error is too large.
_WEAKEST_SHRINKAGE = 0.9
_STRONGEST_SHRINKAGE = 0.2
# Factor that reduces a step after a failure of Newton's iteration, when the error is unknown.
_FAILURE_FACTOR = 0.5
_SAFETY = 0.8
# Coordinates whose vectors fit into the fastest processor cache together: several operations on
# them read each number from memory once.
_CHUNK = 512
# Newton's iteration keeps its factors while the rate of convergence, the ratio of successive
# corrections, is at most this value, ...
_KEEP_RATE = 0.05
# ... and computes new factors within a step if the rate exceeds this value.
_SLOW_RATE = 0.2
# The iteration has diverged if the correction grows by more than this factor.
_MAX_CORRECTION_GROWTH = 2.0
# Lower bounds on the estimated rate of convergence from the second iteration on, and in the first.
_MIN_RATE = 1e-4
_MIN_FIRST_RATE = 1e-2
_MAX_ITERATIONS = 12
# Corrections that decrease by less than this factor are rounding errors ...
_STAGNATION_RATE = 0.5
# ... of positions, if they are at most this many times `min_correction_limit`, ...
_ROUNDING_GROWTH = 10.0
# ... and of reactions, if they are smaller than this, relative to the largest reaction, or after
# this many iterations with new factors.
_REACTION_ROUNDING = 1e-6
_REACTION_ITERATIONS = 4
# Lower bound on the tolerance of reactions, relative to that of positions: squares of reactions
# would overflow at the start of a Gaussian pulse, where all are below 1e-150 N.
_MIN_REACTION_TOLERANCE = 1e-60
# Error of multipliers between the steps, relative to the difference from their extrapolation.
_MULTIPLIER_DIFFERENCE = 0.125
# Lower bound on the error, relative to the tolerance, from which the next step is computed.
_MIN_ERROR = 1e-9


def take_fixed_steps(run: AlphaWorkspace) -> int:
    """Take equal steps until the interval ends, the rows are full or a step fails.

    Return DONE, FULL, or the code of a failure or of a request for new pivots.
    """
    if run.has_jumped == 1:
        return apply_input_jump(run)
    while run.step_count < run.total_steps:
        if run.filled == run.most:
            return FULL
        last = run.step_count + 1 == run.total_steps
        t = run.end if last else (run.step_count + 1) * run.current.h + run.start_time
        code = _advance_step(run, t)
        if code != DONE:
            return code
        run.step_count += 1
        _store_row(run)
    return DONE


def take_adaptive_steps(run: AdaptiveAlphaWorkspace) -> int:
    """Take steps that pass the error test until the interval ends or the rows are full.

    Return DONE, FULL, a request (FIRST_STEP or NEW_PIVOTS), the code of a failure at the smallest
    step, or STEP_NOT_CHANGED.
    """
    if run.has_jumped == 1:
        code = apply_input_jump(run)
        _copy_motion(run.accepted_motion, run.current)
        return code
    while run.t < run.end:
        if run.filled == run.most:
            return FULL
        remaining = run.end - run.t
        h = clip_step(run.next_step, remaining)
        if h < run.next_step:
            run.unclipped_step = max(run.unclipped_step, run.next_step)
        last = h == remaining
        if abs(h - run.accepted_motion.h) <= SAME_STEP * h:
            h = run.accepted_motion.h
        if h != run.current.h:
            run.next_step = h
            if run.accepted_motion.h == 0.0:
                return FIRST_STEP
            code = _change_step(run, h)
            if code != DONE:
                return code
        t = run.t
        has_extrapolated = run.step_ratio > 0.0
        combine(run.lam_before, (1.0,), (run.lam_n,))
        code = _advance_step(run, run.end if last else t + h)
        if code == NEW_PIVOTS:
            return code
        run.error = math.inf
        if code == DONE:
            run.error = abs(run.defect) * h * h * _acceleration_change(run) / run.tolerance
            if has_extrapolated and h > run.shortest_tested_step:
                run.error = max(run.error, _multiplier_error(run))
            code = ERROR_TOO_LARGE
        if run.error <= 1.0:
            _copy_motion(run.accepted_motion, run.current)
            lower_weights(run.multiplier_weights, run.multiplier_tolerance, run.current.lam)
            _accept_step(run, h)
            _store_row(run)
            continue
        run.t = t
        run.rejections += 1
        _reject_step(run, h)
        _copy_motion(run.current, run.accepted_motion)
        if run.multiplier_weights.size > 0:
            combine(run.lam_n, (1.0,), (run.lam_before,))
        # Negated, so that NaN also stops the run.
        if not run.next_step >= run.min_step:
            return code
        run.current.h = 0.0
    return DONE


def set_step(run: AlphaWorkspace, h: float) -> None:
    """Set the length `h` [s] of the next steps, with the coefficients that depend on it."""
    c_f = h * h * run.beta
    c = run.prediction.coefficients
    c[0] = run.gamma / (h * run.beta)
    c[1] = (1.0 - run.alpha_m) / ((1.0 - run.alpha_f) * c_f)
    c[2] = c_f
    run.step_ratio = h / run.accepted_motion.h if run.accepted_motion.h > 0.0 else 0.0
    run.current.h, run.rate = h, math.inf


def _change_step(run: AdaptiveAlphaWorkspace, h: float) -> int:
    """Convert the motion to the step length `h` [s], preserving second order; return the code.

    a_n = q''_n + shift h_n q''' + O(h^2) depends on the last step h_n; for a step h it becomes
    q''_n + (h / h_n) (a_n - q''_n). In the index-3 form, the velocities contain the error
    h_n^2 defect P q''', which compensates the local error defect h^3 q''' so that positions
    satisfy the constraints (P as in `ConsistencySolver.evaluate_normal_jerk`). This velocity error
    is converted to h^2 defect P q'''. Without the first conversion, the method would be of first
    order if the step changed repeatedly; without the second, multipliers would be of first order
    after every change. Cf. Arnold, Hante & Koebis, PAMM 14 (2014) 27. Bruls & Arnold, J. Comput.
    Nonlinear Dyn. 3 (2008) 041007, instead make the parameters depend on the step ratio.
    """
    accepted_motion, current, h_n = run.accepted_motion, run.current, run.accepted_motion.h
    _copy_motion(current, accepted_motion)
    if run.corrects_velocities == 1 and h != h_n:
        interval = JERK_INTERVAL * h
        code = evaluate_normal_jerk(run.jerk, run.t, run.branch, accepted_motion, interval)
        if code != DONE:
            run.jerk.linear.singular = 0
            current.h = 0.0
            return NEW_PIVOTS if code == NEW_PIVOTS else STEP_NOT_CHANGED
        jerk = run.jerk.unknowns[: current.q.size]
        combine(current.v, (1.0, (h * h - h_n * h_n) * run.defect), (accepted_motion.v, jerk))
    ratio = h / h_n
    combine(current.a, (1.0 - ratio, ratio), (accepted_motion.ddq, accepted_motion.a))
    set_step(run, h)
    return DONE


def _acceleration_change(run: AlphaWorkspace) -> float:
    """Return the largest change of the scaled algorithmic acceleration in the step [1/s^2]."""
    combine(run.a_predicted, (1.0, -1.0), (run.current.a, run.a_n))
    return max_norm(run.a_predicted, run.weights)


def _multiplier_error(run: AdaptiveAlphaWorkspace) -> float:
    """Return the largest error of the tested multipliers relative to their tolerances.

    The difference from the extrapolated multipliers is of order h^2; the power 3/2 makes its
    ratio to the tolerance grow with h^3, as the error of the positions.
    """
    weights, first = run.multiplier_weights, run.current.q.size
    largest, c_f = 0.0, run.prediction.coefficients[2]
    for k in range(weights.size):
        change = abs(run.x[first + k] - run.first_multipliers[k]) * weights[k]
        largest = max(largest, change)
    return (_MULTIPLIER_DIFFERENCE * largest / c_f) ** 1.5


def _accept_step(run: AlphaWorkspace, h: float) -> None:
    """Count an accepted step; increase the step if the last eight accepted steps allow it."""
    run.steps_checked += 1
    run.max_error = max(run.max_error, run.error)
    if run.steps_checked < _STEPS_BEFORE_GROWTH:
        return
    growth = min(_step_factor(run.max_error), _MAX_GROWTH)
    if growth >= _MIN_GROWTH:
        run.next_step = min(h * growth, run.max_step)
    run.steps_checked, run.max_error = 0, 0.0


def _reject_step(run: AlphaWorkspace, h: float) -> None:
    """Reduce the step after an error that is too large or unknown."""
    shrinkage = _FAILURE_FACTOR
    if math.isfinite(run.error):
        shrinkage = max(min(_step_factor(run.error), _WEAKEST_SHRINKAGE), _STRONGEST_SHRINKAGE)
    run.next_step, run.unclipped_step = h * shrinkage, 0.0
    run.steps_checked, run.max_error = 0, 0.0


def _step_factor(error: float) -> float:
    """Return the factor for the next step; `error` (relative to the tolerance) grows with h^3."""
    return _SAFETY * max(error, _MIN_ERROR) ** (-1.0 / 3.0)


def _copy_motion(target: Motion, source: Motion) -> None:
    combine(target.q, (1.0,), (source.q,))
    combine(target.v, (1.0,), (source.v,))
    combine(target.ddq, (1.0,), (source.ddq,))
    combine(target.a, (1.0,), (source.a,))
    combine(target.lam, (1.0,), (source.lam,))
    target.h = source.h


def _store_row(run: AlphaWorkspace) -> None:
    current, row, n = run.current, run.rows[run.filled], run.current.q.size
    row[0] = run.t
    combine(row[1 : 1 + n], (1.0,), (current.q,))
    combine(row[1 + n : 1 + 2 * n], (1.0,), (current.v,))
    combine(row[1 + 2 * n : 1 + 3 * n], (1.0,), (current.ddq,))
    combine(row[1 + 3 * n :], (1.0,), (current.lam,))
    run.filled += 1


def _advance_step(run: AlphaWorkspace, t: float) -> int:
    """Advance the current motion to time `t` [s]; a failure leaves it unchanged."""
    current, at, x, c = run.current, run.prediction, run.x, run.prediction.coefficients
    n, end = current.q.size, current.q.size + current.lam.size
    # Predictor: q'' and the multipliers are extrapolated; x[:n] is the correction of the predicted
    # positions.
    extrapolation = (1.0 + run.step_ratio, -run.step_ratio)
    for begin in range(0, n, _CHUNK):
        _predict_coordinates(run, extrapolation, begin, min(begin + _CHUNK, n))
    factors = (c[2] * extrapolation[0], c[2] * extrapolation[1])
    combine(x[n:end], factors, (current.lam, run.lam_n))
    combine(run.lam_n, (1.0,), (current.lam,))
    fill(x[end:], 0.0)
    _set_correction_limit(run)
    code = _solve_step(run, t)
    if code != DONE:
        return code
    q = evaluate_step_position(run.form, at, x)
    for begin in range(0, n, _CHUNK):
        stop = min(begin + _CHUNK, n)
        d = x[begin:stop]
        combine(current.q[begin:stop], (1.0,), (q[begin:stop],))
        combine(current.v[begin:stop], (1.0, c[0]), (at.v[begin:stop], d))
        combine(current.ddq[begin:stop], (1.0, c[1]), (at.a[begin:stop], d))
        combine(current.a[begin:stop], (1.0, 1.0 / c[2]), (run.a_predicted[begin:stop], d))
    combine(current.lam, (1.0 / c[2],), (x[n:end],))
    run.t = t
    run.step_ratio = 1.0
    return DONE


def _set_correction_limit(run: AlphaWorkspace) -> None:
    """Set the limit of corrections, and the factor that compares those of reactions with it."""
    current, c_f = run.current, run.prediction.coefficients[2]
    limit = run.newton_tolerance * c_f * max_norm(current.ddq, run.weights)
    run.correction_limit = max(limit, run.min_correction_limit)
    reaction = run.newton_tolerance * c_f * max_norm(current.lam, run.reaction_weights)
    tolerance = max(reaction / run.correction_limit, _MIN_REACTION_TOLERANCE)
    run.reaction_factor = 1.0 / tolerance if reaction > 0.0 else 0.0


def apply_input_jump(run: AlphaWorkspace) -> int:
    """Change accelerations and multipliers after a jump of held inputs; return the code.

    Positions and velocities are continuous. The changes solve the equations of a step of length
    zero: these are the equations of motion with M + c_v/c_a C + K/c_a in place of M, which reduces
    the accelerations of modes too fast for the step, as at the start of an interval
    (`family.AlphaStart`). The algorithmic acceleration changes by the same amount.
    """
    current, at, x, c = run.current, run.prediction, run.x, run.prediction.coefficients
    n, end = current.q.size, current.q.size + current.lam.size
    change = run.change[:n]
    combine(at.q, (1.0,), (current.q,))
    combine(at.before, (1.0,), (current.q,))
    combine(at.a, (1.0,), (current.ddq,))
    fill(x[:n], 0.0)
    combine(x[n:end], (c[2],), (current.lam,))
    fill(x[end:], 0.0)
    if run.states.size > 0:
        # The rows of first-order states are c_f (x' - f).
        combine(at.v, (1.0,), (current.v,))
        evaluate_step_residual(run.form, run.t, run.branch, at, x, run.change)
        for k in run.states:
            current.v[k] -= change[k] / c[2]
    combine(at.v, (1.0,), (current.v,))
    _set_correction_limit(run)
    code = _solve_step(run, run.t)
    if code != DONE:
        return code
    combine(change, (c[1],), (x[:n],))
    for k in run.states:
        change[k] = 0.0
    combine(current.ddq, (1.0, 1.0), (current.ddq, change))
    combine(current.a, (1.0, 1.0), (current.a, change))
    combine(run.ddq_n, (1.0, 1.0), (run.ddq_n, change))
    # The differences from which the predictor extrapolates do not change.
    combine(run.lam_n, (1.0, -1.0, 1.0 / c[2]), (run.lam_n, current.lam, x[n:end]))
    combine(current.lam, (1.0 / c[2],), (x[n:end],))
    run.has_jumped = 0
    return DONE


def _predict_coordinates(
    run: AlphaWorkspace, extrapolation: tuple[float, float], begin: int, end: int
) -> None:
    """Predict the coordinates begin:end with their derivatives, and store their last values."""
    current, at, h, beta = run.current, run.prediction, run.current.h, run.beta
    factor = 1.0 / (1.0 - run.alpha_m)
    q, v, a, ddq = (
        current.q[begin:end],
        current.v[begin:end],
        current.a[begin:end],
        current.ddq[begin:end],
    )
    predicted, a_predicted = at.a[begin:end], run.a_predicted[begin:end]
    combine(predicted, extrapolation, (ddq, run.ddq_n[begin:end]))
    averages = (factor * (1.0 - run.alpha_f), factor * run.alpha_f, -factor * run.alpha_m)
    combine(a_predicted, averages, (predicted, ddq, a))
    positions = (1.0, h, h * h * (0.5 - beta), h * h * beta)
    combine(at.q[begin:end], positions, (q, v, a, a_predicted))
    velocities = (1.0, h * (1.0 - run.gamma), h * run.gamma)
    combine(at.v[begin:end], velocities, (v, a, a_predicted))
    combine(run.ddq_n[begin:end], (1.0,), (ddq,))
    combine(run.a_n[begin:end], (1.0,), (a,))
    if run.form.stabilized == 1:
        combine(at.before[begin:end], (1.0,), (q,))
    fill(run.x[begin:end], 0.0)


def _solve_step(run: AlphaWorkspace, t: float) -> int:
    """Solve the step equations for x by Newton's iteration.

    Up to three attempts are made: with the existing factors, with new factors, and with new factors
    starting from uniform motion. Uniform motion is the better first iterate under a violent load,
    when the accelerations of light, stiff coordinates are huge for an instant.
    """
    x, n, current = run.x, run.current.q.size, run.current
    combine(run.first_multipliers, (1.0,), (x[n:],))
    if run.rate <= _KEEP_RATE:
        code = _iterate_newton(run, t, False)
        if code in (DONE, NOT_FINITE):
            return code
        run.failures += 1
    code = SINGULAR
    for attempt in range(2):
        fill(x[:n], 0.0)
        combine(x[n:], (1.0,), (run.first_multipliers,))
        if attempt == 1:
            uniform = (current.q, current.v, run.prediction.q)
            combine(x[:n], (1.0, current.h, -1.0), uniform)
        code = _factorize_step_matrix(run, t)
        if code == DONE:
            code = _iterate_newton(run, t, True)
        if code in (DONE, NOT_FINITE, NEW_PIVOTS):
            return code
        run.failures += 1
    run.linear.singular = 0
    return code


def _factorize_step_matrix(run: AlphaWorkspace, t: float) -> int:
    evaluate_step_matrix(run.form, t, run.branch, run.prediction, run.x, run.nonzeros)
    code = factorize(run.linear, run.nonzeros)
    # With new pivots, the matrix is evaluated again.
    if code != NEW_PIVOTS:
        run.jacobians += 1
    run.rate = 0.0 if code == DONE else math.inf
    return code


def _iterate_newton(run: AlphaWorkspace, t: float, may_renew: bool) -> int:
    """Iterate until the corrections of positions and of tested reactions are small.

    Without a test of the reactions, those of driven mechanisms, whose positions the constraints
    determine, would not converge with forces that depend on reactions or velocities. Rounding
    errors may exceed the limit: small corrections that no longer decrease end the iteration.
    """
    rounding = _ROUNDING_GROWTH * run.min_correction_limit
    x, change, n = run.x, run.change, run.current.q.size
    x_change = change[: x.size]
    q_change, lam_change = change[:n], change[n : n + run.current.lam.size]
    previous = math.inf
    for k in range(_MAX_ITERATIONS):
        evaluate_step_residual(run.form, t, run.branch, run.prediction, x, change)
        run.residuals += 1
        solve(run.linear, change)
        combine(x, (1.0, -1.0), (x, x_change))
        q_size = size = euclidean_norm(q_change, run.weights)
        if run.reaction_factor > 0.0:
            reaction = run.reaction_factor * euclidean_norm(lam_change, run.reaction_weights)
            size = math.sqrt(q_size * q_size + reaction * reaction)
        if k == 0 and not math.isfinite(size):
            return NOT_FINITE
        # Corrections of reactions that remain after those of positions may grow.
        of_reactions = q_size < size < math.inf and q_size <= max(run.correction_limit, rounding)
        if not (size <= rounding or of_reactions or size <= _MAX_CORRECTION_GROWTH * previous):
            return NOT_CONVERGED
        if k > 0:
            run.rate = max(size / previous, _MIN_RATE) if previous > 0.0 else 0.0
        rate = run.rate if k > 0 else max(run.rate, _MIN_FIRST_RATE)
        if rate < 1.0 and size * rate <= run.correction_limit * (1.0 - rate):
            return DONE
        if k > 0 and rate > _STAGNATION_RATE:
            if size <= rounding:
                return DONE
            is_small = size * run.newton_tolerance <= _REACTION_ROUNDING * run.correction_limit
            if of_reactions and (is_small or (may_renew and k + 1 >= _REACTION_ITERATIONS)):
                return DONE
            if of_reactions and not may_renew:
                return NOT_CONVERGED
        if may_renew and rate > _SLOW_RATE:
            code = _factorize_step_matrix(run, t)
            if code != DONE:
                return code
        previous = size
    return NOT_CONVERGED
