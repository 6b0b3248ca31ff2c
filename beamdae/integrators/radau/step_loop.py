"""Steps of three-stage Radau IIA that pass the error test.

Plain Python over arrays: `native.loops` compiles it, and where that cannot be had it runs as it is.
"""

from __future__ import annotations

from beamdae.integrators.method import clip_step
from beamdae.integrators.radau.coefficients import C
from beamdae.integrators.radau.stages import (
    MAX_ITERATIONS,
    estimate_error,
    set_stages,
    solve_stages,
)
from beamdae.integrators.radau.workspace import ERROR_TOO_LARGE, TOO_SMALL, RadauWorkspace
from beamdae.native.loop_functions import combine, max_norm
from beamdae.native.return_codes import DONE, FULL, NEW_PIVOTS

# One over the order of what is estimated: the embedded method is of order 3.
_ERROR_EXPONENT = 1.0 / 4.0
_SAFETY = 0.9
_MIN_FACTOR, _MAX_FACTOR = 0.2, 4.0
# An error below this says no more about the next step.
_MIN_ERROR = 1e-2
# A step that would grow by less keeps its size, and with it the factors, if they shrink the
# changes of Newton's iteration to _KEEP_RATE.
_KEPT_GROWTH = 1.2
_KEEP_RATE = 0.05
# Steps too long for Newton's iteration: how far to go back, and how to return from there while it
# converges as fast as this.
_FAILURE_FACTOR = 0.5
_RECOVERY_FACTOR = 1.1
_SLOW_RATE = 0.2


def take_radau_steps(run: RadauWorkspace) -> int:
    """Steps that pass the error test, as many as are asked for and there are."""
    size = run.size
    while run.t < run.end:
        if run.filled == 3 * run.most:
            return FULL
        left = run.end - run.t
        h = clip_step(size.next, left)
        # Of states beyond all numbers the step is none either.
        if size.next != size.next or h < min(size.smallest, left):
            return run.reason
        renew = not _can_reuse_factors(run, h)
        code = solve_stages(run, h, renew)
        if code == NEW_PIVOTS:
            return code
        if code != DONE:
            run.failures += 1
            run.factorized = 0.0
            if renew:
                run.rejected += 1
                run.reason = code
                size.next = size.manageable = _FAILURE_FACTOR * h
                size.repeated = 1
            continue
        estimate_error(run, h)
        error = max_norm(run.error[: run.tested.size], run.tested)
        if error < 1.0:
            _accept_step(run, h, error)
            _store_step(run, h, h == left)
            continue
        run.rejected += 1
        run.reason = ERROR_TOO_LARGE
        size.next = h * min(max(_step_factor(run, error), _MIN_FACTOR), _SAFETY)
        if error != error:
            size.next = error
        size.repeated = 1
    return DONE


def _can_reuse_factors(run: RadauWorkspace, h: float) -> bool:
    """Whether there are factors for this step that shrank the last change by much."""
    return h == run.factorized and run.rate <= _KEEP_RATE


def _step_factor(run: RadauWorkspace, error: float) -> float:
    """By how much the error lets a step grow, less where the iteration was slow."""
    most = 2 * MAX_ITERATIONS
    return _SAFETY * (most + 1) / (most + run.iterations) / error**_ERROR_EXPONENT


def _accept_step(run: RadauWorkspace, h: float, error: float) -> None:
    """Find the step after a step h."""
    size = run.size
    error = max(error, _MIN_ERROR)
    factor = _step_factor(run, error)
    if size.before > 0.0:
        factor *= min(1.0, h / size.before * (size.error_before / error) ** _ERROR_EXPONENT)
    factor = min(max(factor, _MIN_FACTOR), 1.0 if size.repeated == 1 else _MAX_FACTOR)
    if run.rate < _SLOW_RATE:
        size.manageable = min(_RECOVERY_FACTOR * size.manageable, size.longest)
    wanted = min(factor * h, size.manageable)
    keep = h <= wanted and wanted <= _KEPT_GROWTH * h and _can_reuse_factors(run, h)
    size.next = h if keep else wanted
    size.before, size.error_before, size.repeated = h, error, 0
    run.reason = TOO_SMALL


def _store_step(run: RadauWorkspace, h: float, last: bool) -> None:
    """Take the step: the stages are rows, and the last one is where the next step starts."""
    set_stages(run, h)
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
