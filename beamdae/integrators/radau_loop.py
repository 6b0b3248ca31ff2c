"""Steps of three-stage Radau IIA, as a loop that is compiled.

A step h from (t, y) seeks Y_i with R(t + c_i h, Y_i, Y'_i) = 0, Y_i = y + h sum_j a_ij Y'_j, and
ends at Y_3, see `radau_coefficients`. Plain Python over arrays: `native.loops` compiles it, and
where that cannot be had it runs as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.formulations import (
    FirstOrderSums,
    first_order_jacobian,
    first_order_residual,
)
from beamdae.integrators.radau_coefficients import (
    EMBEDDED,
    GAMMA,
    PAIR,
    POLYNOMIAL,
    RATES,
    T_INVERSE,
    TO_PAIR,
    UNIFORM,
    C,
    T,
)
from beamdae.native.codes import DONE, FULL, NEW_PIVOTS, SINGULAR
from beamdae.native.vectors import combine, factorize, largest, minimum, parts, scatter, solve

Array = np.ndarray

# Why a step is none.
NOT_CONVERGED, NOT_FINITE, ERROR_TOO_LARGE, TOO_SMALL = -1, -2, -4, -5

MAX_ITERATIONS = 10
# Of the first change; the next one tells.
UNKNOWN_RATE = 0.99
# The second change may be as large as the first: a linear step stretches a beam that rotates, and
# the next one takes that back.
_MOST_GROWTH = 2.0

# One over the order of what is estimated: the embedded method is of order 3.
_POWER = 1.0 / 4.0
_MARGIN = 0.9
_SHRINK, _GROW = 0.2, 4.0
# An error below this says no more about the next step.
_LEAST_ERROR = 1e-2
# A step that would grow by less keeps its size, and with it the factors, if they shrink the
# changes of Newton's iteration to _KEEP_RATE.
_HYSTERESIS = 1.2
_KEEP_RATE = 0.05
# Steps too long for Newton's iteration: how far to go back, and how to return from there while it
# converges as fast as this.
_RETREAT = 0.5
_RETURN = 1.1
_SLOW_RATE = 0.2
# The last step of an interval ends on its end if it comes this near.
_NEARLY = 1.0 - 1e-9


@dataclass(slots=True)
class StepSize:
    """The next step: predicted from the last two errors, and within what Newton's iteration can do.

    h_{n+1} = 0.9 h_n e_n^(-1/4) min(1, (h_n / h_{n-1}) (e_{n-1} / e_n)^(1/4)); Gustafsson, ACM
    Trans. Math. Softw. 20 (1994) 496. Slender beams bend with little and stretch with much force:
    Newton's iteration fails where a step rotates an element by more than its slenderness, often
    long before the error test does. Such a step is halved, and approached again by small steps.

    Attributes
    ----------
    next
        Step to try [s].
    longest, smallest
        Bounds of a step [s].
    manageable
        The longest one for Newton's iteration, as far as is known [s].
    before, error_before
        Last step [s], 0 if there is none, and its error over the tolerance.
    repeated
        Whether the step under way was refused before.
    """

    longest: float
    smallest: float = 0.0
    next: float = 0.0
    manageable: float = 0.0
    before: float = 0.0
    error_before: float = 0.0
    repeated: int = 0


@dataclass(slots=True)
class RadauRun:
    """A run under way.

    Attributes
    ----------
    form, real, pair
        The equations, and the factors of the real and of the complex matrix.
    size
        The next step.
    y, yp
        The state the step under way starts from.
    before, w
        W of the last step and of the one under way.
    stages, rates, residuals_at
        Y, Y' and the residual of the stages.
    change, pair_change, pair_real, pair_imaginary
        Right-hand sides and solutions of Newton's equations.
    ahead
        By which W is predicted from that of the last step.
    stiffness, inertia, real_nonzeros, pair_nonzeros
        R_y and R_y' at the factors, and the matrices that are factorized.
    of_row, of_column
        Where these have their entries.
    error, right
        The estimate of the error.
    tested
        One over the tolerances of those of (q, v) the error test sees.
    bounds
        One over what the iteration may leave of (q, v); of v in the step under way.
    velocity_bounds, velocity_rounding
        Of v in long steps, and over the step what rounding leaves of it in short ones.
    rows, filled, most
        (t, q, v, a, lam) of the stages of the steps taken, how many of the rows are, and of how
        many steps they are to be at most.
    t, branch, end
        Where the run is in its interval.
    factorized, iterations, rate
        The step of the factors, 0 without; iterations of the last step, and by how much the last
        one of them shrank the change.
    reason
        Why the step under way was refused.
    """

    form: FirstOrderSums
    real: Any
    pair: Any
    size: StepSize
    y: Array
    yp: Array
    before: Array
    w: Array
    stages: Array
    rates: Array
    residuals_at: Array
    change: Array
    pair_change: Array
    pair_real: Array
    pair_imaginary: Array
    ahead: Array
    stiffness: Array
    inertia: Array
    real_nonzeros: Array
    pair_nonzeros: Array
    of_row: Array
    of_column: Array
    error: Array
    right: Array
    tested: Array
    bounds: Array
    velocity_bounds: Array
    velocity_rounding: Array
    rows: Array
    filled: int = 0
    most: int = 0
    t: float = 0.0
    branch: float = 0.0
    end: float = 0.0
    factorized: float = 0.0
    iterations: int = 0
    rate: float = 1.0
    residuals: int = 0
    jacobians: int = 0
    failures: int = 0
    rejected: int = 0
    reason: int = TOO_SMALL


def radau_steps(run: RadauRun) -> int:
    """Steps that pass the error test, as many as are asked for and there are."""
    size = run.size
    while run.t < run.end:
        if run.filled == 3 * run.most:
            return FULL
        left = run.end - run.t
        h = left if size.next >= _NEARLY * left else min(size.next, 0.5 * left)
        # Of states beyond all numbers the step is none either.
        if size.next != size.next or h < min(size.smallest, left):
            return run.reason
        renew = not _serves(run, h)
        code = solve_stages(run, h, renew)
        if code == NEW_PIVOTS:
            return code
        if code != DONE:
            run.failures += 1
            run.factorized = 0.0
            if renew:
                run.rejected += 1
                run.reason = code
                size.next = size.manageable = _RETREAT * h
                size.repeated = 1
            continue
        estimate_error(run, h)
        error = largest(run.error[: run.tested.size], run.tested)
        if error < 1.0:
            _accept(run, h, error)
            _store(run, h, h == left)
            continue
        run.rejected += 1
        run.reason = ERROR_TOO_LARGE
        size.next = h * min(max(_factor(run, error), _SHRINK), _MARGIN)
        if error != error:
            size.next = error
        size.repeated = 1
    return DONE


def _serves(run: RadauRun, h: float) -> bool:
    """Whether there are factors for this step that shrank the last change by much."""
    return h == run.factorized and run.rate <= _KEEP_RATE


def _factor(run: RadauRun, error: float) -> float:
    """By how much the error lets a step grow, less where the iteration was slow."""
    most = 2 * MAX_ITERATIONS
    return _MARGIN * (most + 1) / (most + run.iterations) / error**_POWER


def _accept(run: RadauRun, h: float, error: float) -> None:
    """Find the step after a step h."""
    size = run.size
    error = max(error, _LEAST_ERROR)
    factor = _factor(run, error)
    if size.before > 0.0:
        factor *= min(1.0, h / size.before * (size.error_before / error) ** _POWER)
    factor = min(max(factor, _SHRINK), 1.0 if size.repeated == 1 else _GROW)
    if run.rate < _SLOW_RATE:
        size.manageable = min(_RETURN * size.manageable, size.longest)
    wanted = min(factor * h, size.manageable)
    keep = h <= wanted and wanted <= _HYSTERESIS * h and _serves(run, h)
    size.next = h if keep else wanted
    size.before, size.error_before, size.repeated = h, error, 0
    run.reason = TOO_SMALL


def _store(run: RadauRun, h: float, last: bool) -> None:
    """Take the step: the stages are rows, and the last one is where the next step starts."""
    _set_stages(run, h)
    n = run.form.n
    for i in range(3):
        row, y, yp = run.rows[run.filled + i], run.stages[i], run.rates[i]
        row[0] = run.t + C[i] * h
        combine(row[1 : 1 + 2 * n], (1.0,), (y[: 2 * n],))
        # Multipliers are derivatives of unknowns and follow the accelerations.
        held = yp[n : n + row.size - 1 - 2 * n]
        combine(row[1 + 2 * n :], (1.0,), (held,))
        combine(run.before[i], (1.0,), (run.w[i],))
    run.t = run.end if last else run.t + h
    run.rows[run.filled + 2][0] = run.t
    run.filled += 3
    combine(run.y, (1.0,), (run.stages[2],))
    combine(run.yp, (1.0,), (run.rates[2],))


def solve_stages(run: RadauRun, h: float, renew: bool) -> int:
    """Seek the stages of a step, with new factors or with those there are."""
    _predict(run, h)
    _set_stages(run, h)
    velocities = run.bounds[run.form.n :]
    minimum(velocities, run.velocity_bounds, h, run.velocity_rounding)
    if renew:
        code = _factorize(run, h)
        if code != DONE:
            return code
    return _iterate(run, h)


def _predict(run: RadauRun, h: float) -> None:
    """Extrapolate the collocation polynomial of the step before, or y'."""
    w, before, ahead = run.w, run.before, run.ahead
    if run.size.before == 0.0:
        for i in range(3):
            combine(w[i], (h * UNIFORM[i],), (run.yp,))
        return
    for i in range(3):
        for j in range(3):
            ahead[i, j] = 0.0
    for k in range(3):
        x = 1.0 + C[k] * (h / run.size.before)
        for j in range(3):
            there = (x - 1.0) * POLYNOMIAL[0, j] + (x * x - 1.0) * POLYNOMIAL[1, j]
            there += (x * x * x - 1.0) * POLYNOMIAL[2, j]
            for i in range(3):
                ahead[i, j] += T_INVERSE[i, k] * there
    for i in range(3):
        factors = (ahead[i, 0], ahead[i, 1], ahead[i, 2])
        combine(w[i], factors, (before[0], before[1], before[2]))


def _set_stages(run: RadauRun, h: float) -> None:
    w = run.w
    for i in range(3):
        combine(run.stages[i], (1.0, T[i, 0], T[i, 1], T[i, 2]), (run.y, w[0], w[1], w[2]))
        factors = (RATES[i, 0] / h, RATES[i, 1] / h, RATES[i, 2] / h)
        combine(run.rates[i], factors, (w[0], w[1], w[2]))


def _factorize(run: RadauRun, h: float) -> int:
    """Factorize at the second stage: no other is as near to all three."""
    form, t, y, yp = run.form, run.t + C[1] * h, run.stages[1], run.rates[1]
    stiffness, inertia, whole = run.stiffness, run.inertia, run.real_nonzeros
    run.factorized = 0.0
    first_order_jacobian(form, t, run.branch, 0.0, y, yp, stiffness)
    first_order_jacobian(form, t, run.branch, GAMMA / h, y, yp, whole)
    combine(inertia, (h / GAMMA, -h / GAMMA), (whole, stiffness))
    combine(run.pair_nonzeros, (1.0, PAIR / h), (stiffness, inertia))
    real = factorize(run.real, whole)
    pair = factorize(run.pair, run.pair_nonzeros)
    if real == NEW_PIVOTS or pair == NEW_PIVOTS:
        return NEW_PIVOTS
    run.jacobians += 2
    run.real.singular = 0
    run.pair.singular = 0
    if real == SINGULAR or pair == SINGULAR:
        return SINGULAR
    run.factorized = h
    return DONE


def _iterate(run: RadauRun, h: float) -> int:
    w, at, bounded = run.w, run.residuals_at, run.bounds.size
    change, pair = run.change, run.pair_change
    previous, rate = math.inf, UNKNOWN_RATE
    for k in range(MAX_ITERATIONS):
        run.iterations = k + 1
        if k > 0:
            _set_stages(run, h)
        for i in range(3):
            t = run.t + C[i] * h
            first_order_residual(run.form, t, run.branch, run.stages[i], run.rates[i], at[i])
        run.residuals += 3
        factors = (T_INVERSE[0, 0], T_INVERSE[0, 1], T_INVERSE[0, 2])
        combine(change, factors, (at[0], at[1], at[2]))
        combine(pair, (TO_PAIR[0], TO_PAIR[1], TO_PAIR[2]), (at[0], at[1], at[2]))
        solve(run.real, change)
        solve(run.pair, pair)
        parts(run.pair_real, run.pair_imaginary, pair)
        combine(w[0], (1.0, -1.0), (w[0], change))
        combine(w[1], (1.0, -1.0), (w[1], run.pair_real))
        combine(w[2], (1.0, -1.0), (w[2], run.pair_imaginary))
        own, others = largest(change[:bounded], run.bounds), largest(pair[:bounded], run.bounds)
        if not (math.isfinite(own) and math.isfinite(others)):
            return NOT_FINITE
        moved = max(own, others)
        if k > 0:
            rate = moved / previous if previous > 0.0 else 0.0
            if rate > (_MOST_GROWTH if k == 1 else 1.0):
                break
        if rate < 1.0 and moved * rate <= 1.0 - rate:
            run.rate = rate if k > 0 else 0.0
            return DONE
        previous = moved
    return NOT_CONVERGED


def estimate_error(run: RadauRun, h: float) -> None:
    """Error of an embedded method of order 3, without what is stiff in it.

    y^ = y_n + h (y'_n / gamma + sum_i b^_i Y'_i), and of e = y^ - y_{n+1} the filter
    (R_y + (gamma/h) R_y') x = (gamma/h) R_y' e passes what is slow and damps what is fast. For
    R = M y' - f(y) this is the estimate of RADAU5. In constraints, without y', it would leave
    nothing: there the right-hand side is R_y e, the error of what the joints prescribe, which
    is all there is of a motion that drivers force. Multipliers enter R by their derivatives,
    in the same columns of both matrices: their errors stay in their own components.
    """
    w, error, right, n = run.w, run.error, run.right, run.form.n
    factors = (h / GAMMA, EMBEDDED[0], EMBEDDED[1], EMBEDDED[2])
    combine(right, factors, (run.yp, w[0], w[1], w[2]))
    scatter(error, run.of_row, run.inertia, right, run.of_column)
    combine(error, (GAMMA / h,), (error,))
    scatter(run.change, run.of_row, run.stiffness, right, run.of_column)
    combine(error[2 * n :], (1.0,), (run.change[2 * n :],))
    solve(run.real, error)
