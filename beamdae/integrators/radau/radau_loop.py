"""Steps of three-stage Radau IIA that pass the error test.

Plain Python over arrays: `native.loops` compiles it, and where that cannot be had it runs as it is.
"""

from __future__ import annotations

from beamdae.integrators.method import fitted
from beamdae.integrators.radau.coefficients import C
from beamdae.integrators.radau.stages import (
    MAX_ITERATIONS,
    estimate_error,
    set_stages,
    solve_stages,
)
from beamdae.integrators.radau.workspace import ERROR_TOO_LARGE, TOO_SMALL, RadauRun
from beamdae.linear.return_codes import DONE, FULL, NEW_PIVOTS
from beamdae.native.vectors import combine, largest

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


def radau_steps(run: RadauRun) -> int:
    """Steps that pass the error test, as many as are asked for and there are."""
    size = run.size
    while run.t < run.end:
        if run.filled == 3 * run.most:
            return FULL
        left = run.end - run.t
        h = fitted(size.next, left)
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
