"""Steps of the generalized-alpha family, as loops that are compiled.

Plain Python over arrays: `native.loops` compiles it, and where that cannot be had it runs as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.step_equations import (
    Predicted,
    StepSums,
    step_matrix,
    step_position,
    step_residual,
)
from beamdae.native.vectors import combine, factorize, fill, largest, norm, solve

Array = np.ndarray

# How a loop comes back.
DONE, FULL, ANOTHER_STEP = 0, 1, 2
NOT_CONVERGED, NOT_FINITE, SINGULAR, TOO_SMALL = -1, -2, -3, -4

_MAX_ITERATIONS = 12
# The factors are kept while every iteration gains this much.
_KEEP_RATE = 0.05
# Slower than this, and new factors are found within the iteration.
_SLOW_RATE = 0.2

@dataclass(slots=True)
class AlphaNumbers:
    """The member of the family, the tolerance of the iteration, the steps, and what they cost."""

    alpha_m: float
    gamma: float
    beta: float
    newton_tolerance: float
    least: float
    bound: float = 0.0
    rate: float = math.inf
    t: float = 0.0
    branch: float = 0.0
    start: float = 0.0
    end: float = 0.0
    h: float = 0.0
    taken: int = 0
    total: int = 0
    filled: int = 0
    residuals: int = 0
    jacobians: int = 0
    failures: int = 0
    rejected: int = 0


@dataclass(slots=True)
class AlphaRun:
    """A run under way.

    Attributes
    ----------
    form, linear
        Equations of a step, and the factors of their matrix.
    s
        Numbers.
    q, v, ddq, a, lam
        The motion: `a` is the algorithmic acceleration, `ddq` the one of the bodies.
    at
        The prediction of the step under way.
    a_p
        Its algorithmic acceleration.
    x, start, change, nonzeros
        Unknowns, where their iteration began, a change of them, and the matrix.
    weights
        One over the scales of the coordinates.
    rows
        (t, q, v, ddq, lam) of the steps taken.
    """

    form: StepSums
    linear: Any
    s: AlphaNumbers
    q: Array
    v: Array
    ddq: Array
    a: Array
    lam: Array
    at: Predicted
    a_p: Array
    x: Array
    start: Array
    change: Array
    nonzeros: Array
    weights: Array
    rows: Array


def fixed_steps(run: AlphaRun) -> int:
    """Equal steps until there are no more, or no room for more rows."""
    s = run.s
    while s.taken < s.total:
        if s.filled == run.rows.shape[0]:
            return FULL
        s.taken += 1
        last = s.taken == s.total
        code = _advance(run, s.end if last else s.taken * s.h + s.start)
        if code != DONE:
            return code
        _store(run)
    return DONE


def _store(run: AlphaRun) -> None:
    s, row, n = run.s, run.rows[run.s.filled], run.q.size
    row[0] = s.t
    combine(row[1 : 1 + n], (1.0,), (run.q,))
    combine(row[1 + n : 1 + 2 * n], (1.0,), (run.v,))
    combine(row[1 + 2 * n : 1 + 3 * n], (1.0,), (run.ddq,))
    combine(row[1 + 3 * n :], (1.0,), (run.lam,))
    s.filled += 1


def _advance(run: AlphaRun, t: float) -> int:
    """The motion one step later, at t."""
    s, at, x, c = run.s, run.at, run.x, run.at.coefficients
    n, end, h = run.q.size, run.q.size + run.lam.size, s.h
    # Prediction: q'' as before; d is measured from there.
    combine(run.a_p, (1.0 / (1.0 - s.alpha_m), -s.alpha_m / (1.0 - s.alpha_m)), (run.ddq, run.a))
    motion = (run.q, run.v, run.a, run.a_p)
    combine(at.q, (1.0, h, h * h * (0.5 - s.beta), h * h * s.beta), motion)
    combine(at.v, (1.0, h * (1.0 - s.gamma), h * s.gamma), motion[1:])
    combine(at.a, (1.0,), (run.ddq,))
    combine(at.before, (1.0,), (run.q,))
    fill(x[:n], 0.0)
    fill(x[end:], 0.0)
    s.bound = max(s.newton_tolerance * c[2] * largest(run.ddq, run.weights), s.least)
    code = _solve(run, t)
    if code != DONE:
        return code
    combine(run.q, (1.0,), (step_position(run.form, at, x),))
    combine(run.v, (1.0, c[0]), (at.v, x[:n]))
    combine(run.ddq, (1.0, c[1]), (at.a, x[:n]))
    combine(run.a, (1.0, 1.0 / c[2]), (run.a_p, x[:n]))
    combine(run.lam, (1.0 / c[2],), (x[n:end],))
    s.t = t
    return DONE


def _solve(run: AlphaRun, t: float) -> int:
    """Improve x until the step equations hold.

    From x with the factors there are, with new ones, and from uniform motion: under a violent load
    the accelerations of light, stiff coordinates are huge for an instant, and it is the better
    guess.
    """
    s, x, n = run.s, run.x, run.q.size
    combine(run.start, (1.0,), (x,))
    if s.rate <= _KEEP_RATE:
        code = _iterate(run, t, False)
        if code == DONE or code == NOT_FINITE:
            return code
        s.failures += 1
    for attempt in range(2):
        combine(x, (1.0,), (run.start,))
        if attempt == 1:
            combine(x[:n], (1.0, s.h, -1.0), (run.q, run.v, run.at.q))
        code = SINGULAR
        if _factorize(run, t):
            code = _iterate(run, t, True)
            if code == DONE or code == NOT_FINITE:
                return code
        s.failures += 1
    return code


def _factorize(run: AlphaRun, t: float) -> bool:
    s = run.s
    step_matrix(run.form, t, s.branch, run.at, run.x, run.nonzeros)
    s.jacobians += 1
    s.rate = 0.0
    return factorize(run.linear, run.nonzeros)


def _iterate(run: AlphaRun, t: float, renew: bool) -> int:
    s, x, change = run.s, run.x, run.change
    own = change[: x.size]
    moved = change[: run.q.size]
    previous = math.inf
    for k in range(_MAX_ITERATIONS):
        step_residual(run.form, t, s.branch, run.at, x, change)
        s.residuals += 1
        solve(run.linear, change)
        combine(x, (1.0, -1.0), (x, own))
        size = norm(moved, run.weights)
        if k == 0 and not math.isfinite(size):
            return NOT_FINITE
        if not size <= 2.0 * previous:
            return NOT_CONVERGED
        if k > 0:
            s.rate = max(size / previous, 1e-4) if previous > 0.0 else 0.0
        rate = s.rate if k > 0 else max(s.rate, 1e-2)
        if rate < 1.0 and size * rate <= s.bound * (1.0 - rate):
            return DONE
        if renew and rate > _SLOW_RATE and not _factorize(run, t):
            return SINGULAR
        previous = size
    return NOT_CONVERGED
