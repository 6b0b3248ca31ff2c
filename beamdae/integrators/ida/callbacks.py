"""What IDA calls and who calls IDA, to be compiled: residual, Jacobian, and its steps.

Plain Python over arrays, as `alpha_loop`. IDA is given the residual multiplied by the inverse of
the Jacobian of its last setup, and the identity as Jacobian: its own (diagonal) solver then does
nothing but its scaling by 2 / (1 + c / c_setup). That leaves factorization and solution to us,
without the cost of a Krylov iteration around them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.formulations import (
    FirstOrderSums,
    first_order_jacobian,
    first_order_residual,
)
from beamdae.integrators.ida.kinematic_rows import KinematicRows, weigh_jacobian, weigh_residual
from beamdae.linear.return_codes import DONE, FULL, NEW_PIVOTS
from beamdae.native.vectors import (
    array_at,
    call_for_int,
    call_for_pointer,
    combine,
    factorize,
    fill,
    solve,
    where_largest,
)
from beamdae.sundials.solver import ONE_STEP

Array = np.ndarray

# How else the loop comes back; negative codes are IDA's.
NO_ADVANCE = 10

# A step that is longer by less than this share is as long.
_AS_LONG = 1e-6

# What a callback tells IDA: to try a shorter step, or to give up.
_SHORTER, _NEVER = 1, -1


@dataclass(slots=True)
class Newton:
    """The linear algebra of IDA's Newton iteration.

    Attributes
    ----------
    form, linear
        Equations, and the factors of their Jacobian.
    raw, nonzeros
        The residual evaluated last, and the Jacobian.
    kinematic, share
        Weights of its rows, and the share of each correction that is made, see `ida`.
    ready
        Whether there are factors.
    renew
        Address of a C function that has other pivots found, and tells whether they were looked for.
    """

    form: FirstOrderSums
    linear: Any
    raw: Array
    nonzeros: Array
    kinematic: KinematicRows
    share: float = 1.0
    branch: float = 0.0
    ready: int = 0
    renew: int = 0
    residuals: int = 0
    jacobians: int = 0


@dataclass(slots=True)
class Functions:
    """Addresses of functions of SUNDIALS."""

    IDASolve: int
    IDASetStopTime: int
    IDAGetLastOrder: int
    IDAGetEstLocalErrors: int
    N_VGetArrayPointer: int
    SUNBandMatrix_Data: int


@dataclass(slots=True)
class IdaRun:
    """A run under way.

    Attributes
    ----------
    impulses
        Whether multipliers are derivatives of unknowns, see `formulations`.
    rows, filled, most
        (t, q, v, a, lam) of the steps taken, how many of the rows are, and are to be at most.
    orders, limiting
        How many steps were of which order, and had their largest error in which unknown.
    weights
        What errors are multiplied by.
    t, y, yp, order, errors
        What IDA returns its results in; those whose names end with `_at` are the places of
        numbers, or the vectors of arrays.
    memory
        IDA's own.
    pending
        The vector that the last residual was asked for in.
    """

    newton: Newton
    ida: Functions
    impulses: int
    rows: Array
    orders: Array
    limiting: Array
    weights: Array
    t: Array
    y: Array
    yp: Array
    order: Array
    errors: Array
    t_at: int
    y_at: int = 0
    yp_at: int = 0
    order_at: int = 0
    errors_at: int = 0
    memory: int = 0
    pending: int = 0
    end: float = 0.0
    filled: int = 0
    most: int = 0


def preconditioned(newton: Newton, t: float, y: Array, yp: Array, out: Array) -> None:
    """The residual, multiplied by the inverse of the last Jacobian."""
    first_order_residual(newton.form, t, newton.branch, y, yp, newton.raw)
    weigh_residual(newton.kinematic, y, yp, newton.raw)
    newton.residuals += 1
    combine(out, (newton.share,), (newton.raw,))
    if newton.ready == 1:
        solve(newton.linear, out)


def setup(newton: Newton, t: float, c: float, y: Array, yp: Array, out: Array) -> int:
    """Factorize dR/dy + c dR/dy'; what IDA is to be told.

    IDA has just evaluated the residual at the same point, in `out`: that one is multiplied again,
    with the new factors.
    """
    first_order_jacobian(newton.form, t, newton.branch, c, y, yp, newton.nonzeros)
    weigh_jacobian(newton.kinematic, c, newton.nonzeros)
    newton.jacobians += 1
    newton.ready = 0
    code = factorize(newton.linear, newton.nonzeros)
    while code == NEW_PIVOTS:
        # Python finds them, and IDA need not know: steps do not depend on it.
        if call_for_int(newton.renew, ()) == 0:
            return _NEVER
        code = factorize(newton.linear, newton.nonzeros)
    newton.linear.singular = 0
    if code != DONE:
        return _SHORTER
    newton.ready = 1
    combine(out, (newton.share,), (newton.raw,))
    solve(newton.linear, out)
    return DONE


def residual(run: IdaRun, t: float, y: int, yp: int, out: int) -> int:
    """What IDA calls for its residual, with its vectors."""
    run.pending = out
    preconditioned(run.newton, t, _numbers(run, y), _numbers(run, yp), _numbers(run, out))
    return DONE


def jacobian(
    run: IdaRun,
    t: float,
    c: float,
    y: int,
    yp: int,
    copy: int,
    matrix: int,
    work_1: int,
    work_2: int,
    work_3: int,
) -> int:
    """What IDA calls for its Jacobian, with a copy of the residual and vectors to work in."""
    out = _numbers(run, run.pending)
    code = setup(run.newton, t, c, _numbers(run, y), _numbers(run, yp), out)
    if code == DONE:
        diagonal = call_for_pointer(run.ida.SUNBandMatrix_Data, (matrix,))
        fill(array_at(diagonal, run.y.size), 1.0)
    return code


def _numbers(run: IdaRun, vector: int) -> Array:
    return array_at(call_for_pointer(run.ida.N_VGetArrayPointer, (vector,)), run.y.size)


def steps(run: IdaRun) -> int:
    """Steps of IDA, as many as are asked for and there are."""
    while run.t[0] < run.end:
        if run.filled == run.most:
            return FULL
        before = run.t[0]
        given = (run.memory, run.end, run.t_at, run.y_at, run.yp_at, ONE_STEP)
        code = call_for_int(run.ida.IDASolve, given)
        if code < 0:
            return code
        if not run.t[0] > before:
            return NO_ADVANCE
        stop = stop_after(before, run.t[0], run.end)
        call_for_int(run.ida.IDASetStopTime, (run.memory, stop))
        _look(run)
        _store(run)
    return DONE


def stop_after(before: float, t: float, end: float) -> float:
    """Where the step that follows one from `before` to `t` ends at the latest.

    Another one as long would leave a shorter one: two of half of what is left do not. Multipliers
    of index 2 and 3 are errors of velocities and positions over the step, and the last one was off
    by a fifth of its size after a sliver.
    """
    step, left = t - before, end - t
    if (1.0 + _AS_LONG) * step < left < 2.0 * step:
        return t + 0.5 * left
    return end


def _look(run: IdaRun) -> None:
    """Count of which order the step was, and where its error was largest."""
    call_for_int(run.ida.IDAGetLastOrder, (run.memory, run.order_at))
    run.orders[run.order[0]] += 1
    call_for_int(run.ida.IDAGetEstLocalErrors, (run.memory, run.errors_at))
    run.limiting[where_largest(run.errors, run.weights)] += 1


def _store(run: IdaRun) -> None:
    row, n, y, yp = run.rows[run.filled], run.newton.form.n, run.y, run.yp
    m = row.size - 1 - 3 * n
    row[0] = run.t[0]
    combine(row[1 : 1 + 2 * n], (1.0,), (y[: 2 * n],))
    combine(row[1 + 2 * n : 1 + 3 * n], (1.0,), (yp[n : 2 * n],))
    held = yp if run.impulses == 1 else y
    combine(row[1 + 3 * n :], (1.0,), (held[2 * n : 2 * n + m],))
    run.filled += 1
