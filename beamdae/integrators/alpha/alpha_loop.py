"""Steps of the generalized-alpha family, as loops that are compiled.

Plain Python over arrays: `native.loops` compiles it, and where that cannot be had it runs as it is.
"""

from __future__ import annotations

import math

import numpy as np

from beamdae.equations.step_equations import (
    step_matrix,
    step_position,
    step_residual,
)
from beamdae.integrators.alpha.alpha_workspace import AlphaRun, Motion
from beamdae.integrators.alpha.jerk import AdaptiveRun, normal_jerk
from beamdae.integrators.method import fitted
from beamdae.linear.return_codes import DONE, FULL, NEW_PIVOTS, SINGULAR
from beamdae.native.vectors import combine, factorize, fill, largest, norm, solve

Array = np.ndarray

# How else a loop comes back: for the first step of an interval, or because it cannot go on.
FIRST_STEP = 10
NOT_CONVERGED, NOT_FINITE, ERROR_TOO_LARGE, NOT_RESUMED = -1, -2, -4, -6

_MAX_ITERATIONS = 12
# The factors are kept while every iteration gains this much.
_KEEP_RATE = 0.05
# Slower than this, and new factors are found within the iteration.
_SLOW_RATE = 0.2

# A step grows if all of so many steps say that it may, by _LEAST_GROWTH to _MOST_GROWTH: new
# factors cost more than a few steps, and the jerk of a vibration passes zero.
_PATIENCE = 8
_LEAST_GROWTH, _MOST_GROWTH = 1.2, 2.0
_LEAST_SHRINKAGE, _MOST_SHRINKAGE = 0.9, 0.2
# Where Newton's iteration fails nothing is known of the error.
_FAILED_SHRINKAGE = 0.5
_SAFETY = 0.8


def fixed_steps(run: AlphaRun) -> int:
    """Equal steps, as many as are asked for and there are."""
    while run.taken < run.total:
        if run.filled == run.most:
            return FULL
        last = run.taken + 1 == run.total
        t = run.end if last else (run.taken + 1) * run.now.h + run.start_time
        code = _advance(run, t)
        if code != DONE:
            return code
        run.taken += 1
        _store(run)
    return DONE


def adaptive_steps(run: AdaptiveRun) -> int:
    """Steps that pass the error test, as many as are asked for and there are."""
    while run.t < run.end:
        if run.filled == run.most:
            return FULL
        left = run.end - run.t
        h = fitted(run.next, left)
        last = h == left
        if abs(h - run.kept.h) <= 1e-9 * h:
            h = run.kept.h
        if h != run.now.h:
            run.next = h
            if run.kept.h == 0.0:
                return FIRST_STEP
            code = _resume(run, h)
            if code != DONE:
                return code
        t = run.t
        code = _advance(run, run.end if last else t + h)
        if code == NEW_PIVOTS:
            return code
        run.error = math.inf
        if code == DONE:
            run.error = abs(run.defect) * h * h * _jump(run) / run.tolerance
            code = ERROR_TOO_LARGE
        if run.error <= 1.0:
            _keep(run.kept, run.now)
            _accept(run, h)
            _store(run)
            continue
        run.t = t
        run.rejected += 1
        _reject(run, h)
        _keep(run.now, run.kept)
        # Of states beyond all numbers the step is none either.
        if not run.next >= run.smallest:
            return code
        run.now.h = 0.0
    return DONE


def take_step(run: AlphaRun, h: float) -> None:
    """Go on with steps h."""
    c_f = h * h * run.beta
    c = run.at.coefficients
    c[0] = run.gamma / (h * run.beta)
    c[1] = (1.0 - run.alpha_m) / ((1.0 - run.alpha_f) * c_f)
    c[2] = c_f
    run.trend = h / run.kept.h if run.kept.h > 0.0 else 0.0
    run.now.h, run.rate = h, math.inf


def _resume(run: AdaptiveRun, h: float) -> int:
    """Set the motion as steps h would have brought it about; keeps second order.

    a_n = q''_n + shift h_n q''' + O(h^2) belongs to the step h_n that led to it: for h it is
    q''_n + (h / h_n) (a_n - q''_n). On index 3 positions are on the constraints after every
    step, although each lacks defect h^3 q''', because velocities are off by h_n^2 defect P q'''
    (P as in `Starter.normal_jerk`): that is made h^2 defect P q'''. Without the first, steps
    that change all the time are of first order; without the second, multipliers are after
    every change. Cf. Arnold, Hante & Koebis, PAMM 14 (2014) 27; Bruls & Arnold, J. Comput.
    Nonlinear Dyn. 3 (2008) 041007, let the parameters depend on the ratio of the steps instead.
    """
    kept, now, before = run.kept, run.now, run.kept.h
    _keep(now, kept)
    if run.corrects == 1 and h != before:
        code = normal_jerk(run.jerk, run.t, run.branch, kept, 1e-2 * h)
        if code != DONE:
            run.jerk.linear.singular = 0
            now.h = 0.0
            return NEW_PIVOTS if code == NEW_PIVOTS else NOT_RESUMED
        jerk = run.jerk.found[: now.q.size]
        combine(now.v, (1.0, (h * h - before * before) * run.defect), (kept.v, jerk))
    ratio = h / before
    combine(now.a, (1.0 - ratio, ratio), (kept.ddq, kept.a))
    take_step(run, h)
    return DONE


def _jump(run: AlphaRun) -> float:
    """Largest change of the algorithmic acceleration over the scales."""
    combine(run.a_p, (1.0, -1.0), (run.now.a, run.a_n))
    return largest(run.a_p, run.weights)


def _accept(run: AlphaRun, h: float) -> None:
    """Hear of the error of a step over its tolerance; grows the step now and then."""
    run.seen += 1
    run.worst = max(run.worst, run.error)
    if run.seen < _PATIENCE:
        return
    growth = min(_possible(run.worst), _MOST_GROWTH)
    if growth >= _LEAST_GROWTH:
        run.next = min(h * growth, run.largest)
    run.seen, run.worst = 0, 0.0


def _reject(run: AlphaRun, h: float) -> None:
    """Shrink the step after one with too large an error, or with none."""
    shrinkage = _FAILED_SHRINKAGE
    if math.isfinite(run.error):
        shrinkage = max(min(_possible(run.error), _LEAST_SHRINKAGE), _MOST_SHRINKAGE)
    run.next = h * shrinkage
    run.seen, run.worst = 0, 0.0


def _possible(error: float) -> float:
    """The factor by which a step may change that makes an error of h^3."""
    return _SAFETY * max(error, 1e-9) ** (-1.0 / 3.0)


def _keep(kept: Motion, now: Motion) -> None:
    combine(kept.q, (1.0,), (now.q,))
    combine(kept.v, (1.0,), (now.v,))
    combine(kept.ddq, (1.0,), (now.ddq,))
    combine(kept.a, (1.0,), (now.a,))
    combine(kept.lam, (1.0,), (now.lam,))
    kept.h = now.h


def _store(run: AlphaRun) -> None:
    now, row, n = run.now, run.rows[run.filled], run.now.q.size
    row[0] = run.t
    combine(row[1 : 1 + n], (1.0,), (now.q,))
    combine(row[1 + n : 1 + 2 * n], (1.0,), (now.v,))
    combine(row[1 + 2 * n : 1 + 3 * n], (1.0,), (now.ddq,))
    combine(row[1 + 3 * n :], (1.0,), (now.lam,))
    run.filled += 1


def _advance(run: AlphaRun, t: float) -> int:
    """The motion one step later, at t; as it was unless that succeeds."""
    now, at, x, c = run.now, run.at, run.x, run.at.coefficients
    n, end, h, beta = now.q.size, now.q.size + now.lam.size, now.h, run.beta
    # Prediction: q'' and the multipliers go on as in the step before; d is measured from there.
    share = 1.0 / (1.0 - run.alpha_m)
    trend = (1.0 + run.trend, -run.trend)
    combine(at.a, trend, (now.ddq, run.ddq_n))
    shares = (share * (1.0 - run.alpha_f), share * run.alpha_f, -share * run.alpha_m)
    combine(run.a_p, shares, (at.a, now.ddq, now.a))
    positions = (now.q, now.v, now.a, run.a_p)
    combine(at.q, (1.0, h, h * h * (0.5 - beta), h * h * beta), positions)
    combine(at.v, (1.0, h * (1.0 - run.gamma), h * run.gamma), (now.v, now.a, run.a_p))
    combine(run.ddq_n, (1.0,), (now.ddq,))
    combine(at.before, (1.0,), (now.q,))
    combine(run.a_n, (1.0,), (now.a,))
    fill(x[:n], 0.0)
    combine(x[n:end], (c[2] * trend[0], c[2] * trend[1]), (now.lam, run.lam_n))
    combine(run.lam_n, (1.0,), (now.lam,))
    fill(x[end:], 0.0)
    run.bound = max(run.newton_tolerance * c[2] * largest(now.ddq, run.weights), run.least)
    code = _solve(run, t)
    if code != DONE:
        return code
    combine(now.q, (1.0,), (step_position(run.form, at, x),))
    combine(now.v, (1.0, c[0]), (at.v, x[:n]))
    combine(now.ddq, (1.0, c[1]), (at.a, x[:n]))
    combine(now.a, (1.0, 1.0 / c[2]), (run.a_p, x[:n]))
    combine(now.lam, (1.0 / c[2],), (x[n:end],))
    run.t = t
    run.trend = 1.0
    return DONE


def _solve(run: AlphaRun, t: float) -> int:
    """Improve x until the step equations hold.

    From x with the factors there are, with new ones, and from uniform motion: under a violent load
    the accelerations of light, stiff coordinates are huge for an instant, and it is the better
    guess.
    """
    x, n = run.x, run.now.q.size
    combine(run.start, (1.0,), (x,))
    if run.rate <= _KEEP_RATE:
        code = _iterate(run, t, False)
        if code in (DONE, NOT_FINITE):
            return code
        run.failures += 1
    code = SINGULAR
    for attempt in range(2):
        combine(x, (1.0,), (run.start,))
        if attempt == 1:
            combine(x[:n], (1.0, run.now.h, -1.0), (run.now.q, run.now.v, run.at.q))
        code = _factorize(run, t)
        if code == DONE:
            code = _iterate(run, t, True)
        if code in (DONE, NOT_FINITE, NEW_PIVOTS):
            return code
        run.failures += 1
    run.linear.singular = 0
    return code


def _factorize(run: AlphaRun, t: float) -> int:
    step_matrix(run.form, t, run.branch, run.at, run.x, run.nonzeros)
    code = factorize(run.linear, run.nonzeros)
    # With other pivots it will be done again.
    if code != NEW_PIVOTS:
        run.jacobians += 1
    run.rate = 0.0 if code == DONE else math.inf
    return code


def _iterate(run: AlphaRun, t: float, renew: bool) -> int:
    x, change = run.x, run.change
    own = change[: x.size]
    moved = change[: run.now.q.size]
    previous = math.inf
    for k in range(_MAX_ITERATIONS):
        step_residual(run.form, t, run.branch, run.at, x, change)
        run.residuals += 1
        solve(run.linear, change)
        combine(x, (1.0, -1.0), (x, own))
        size = norm(moved, run.weights)
        if k == 0 and not math.isfinite(size):
            return NOT_FINITE
        if not size <= 2.0 * previous:
            return NOT_CONVERGED
        if k > 0:
            run.rate = max(size / previous, 1e-4) if previous > 0.0 else 0.0
        rate = run.rate if k > 0 else max(run.rate, 1e-2)
        if rate < 1.0 and size * rate <= run.bound * (1.0 - rate):
            return DONE
        if renew and rate > _SLOW_RATE:
            code = _factorize(run, t)
            if code != DONE:
                return code
        previous = size
    return NOT_CONVERGED
