"""Residual and Jacobian callbacks of IDA, and the loop over its steps.

Plain Python over arrays that `native.loops` compiles.

IDA's linear solver is replaced by ours without a Krylov iteration around it: IDA gets the residual
premultiplied by the inverse of the Jacobian of its last setup, and the identity as Jacobian. Its
own (diagonal) solver then only scales by 2 / (1 + c / c_setup).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.formulations.first_order import (
    FirstOrderBuffers,
    evaluate_jacobian,
    evaluate_residual,
)
from beamdae.integrators.ida.kinematic_scaling import (
    KinematicRowScaling,
    scale_jacobian,
    scale_residual,
)
from beamdae.native.loop_functions import (
    array_at,
    call_for_int,
    call_for_pointer,
    combine,
    factorize,
    fill,
    locate_largest,
    solve,
)
from beamdae.native.return_codes import DONE, FULL, NEW_PIVOTS
from beamdae.sundials.solver import ONE_STEP

Array = np.ndarray

# Code of `take_ida_steps` for a step that does not advance time; negative codes are IDA's.
NO_ADVANCE = 10
# What a callback returns to have IDA try a shorter step, or give up.
RECOVERABLE_FAILURE = 1
UNRECOVERABLE_FAILURE = -1

# Steps whose lengths differ by less than this share are equal.
_STEP_ROUNDING = 1e-6


@dataclass(slots=True)
class NewtonState:
    """Linear algebra of IDA's Newton iteration.

    Attributes
    ----------
    form
        Equations to solve.
    linear
        Solver with the factors of their Jacobian.
    raw_residual
        The last residual, before it is multiplied.
    nonzeros
        Non-zeros of the Jacobian.
    kinematic
        Scaling of the kinematic rows.
    share
        Share of each Newton correction that is made; see `stepper`.
    branch
        A time inside the smooth interval [s].
    has_factors
        1 if the Jacobian has been factorized.
    renew_address
        Address of a C function that finds other pivots and returns 1 if the search was possible.
    residuals, jacobians
        Numbers of evaluations.
    """

    form: FirstOrderBuffers
    linear: Any
    raw_residual: Array
    nonzeros: Array
    kinematic: KinematicRowScaling
    share: float = 1.0
    branch: float = 0.0
    has_factors: int = 0
    renew_address: int = 0
    residuals: int = 0
    jacobians: int = 0


@dataclass(slots=True)
class SundialsFunctions:
    """Addresses of functions of SUNDIALS."""

    IDASolve: int
    IDASetStopTime: int
    IDAGetLastOrder: int
    IDAGetEstLocalErrors: int
    N_VGetArrayPointer: int
    SUNBandMatrix_Data: int


@dataclass(slots=True)
class IdaWorkspace:
    """Memory of a run of IDA.

    Attributes
    ----------
    newton, sundials
        The linear algebra, and the functions to call.
    has_impulses
        1 if the multipliers are derivatives of unknowns; see `Formulation.impulses`.
    rows
        (t, q, v, a, lam) of the steps taken.
    orders
        Number of steps by order.
    limiting_counts
        Number of steps by the unknown whose error was the largest.
    weights
        Weights of the errors for that count.
    t, y, yp, order, errors
        Arrays in which IDA returns its results.
    t_address, order_address
        Addresses of these numbers.
    y_vector, yp_vector, errors_vector
        Addresses of SUNDIALS' vectors of these arrays.
    memory
        Address of IDA's memory.
    residual_vector
        The vector for which the last residual was requested.
    end
        End of the smooth interval [s].
    filled, most
        Number of rows filled, and how many are requested.
    """

    newton: NewtonState
    sundials: SundialsFunctions
    has_impulses: int
    rows: Array
    orders: Array
    limiting_counts: Array
    weights: Array
    t: Array
    y: Array
    yp: Array
    order: Array
    errors: Array
    t_address: int
    order_address: int
    y_vector: int = 0
    yp_vector: int = 0
    errors_vector: int = 0
    memory: int = 0
    residual_vector: int = 0
    end: float = 0.0
    filled: int = 0
    most: int = 0


def evaluate_preconditioned(newton: NewtonState, t: float, y: Array, yp: Array, out: Array) -> None:
    """Evaluate the residual, multiplied by the inverse of the last Jacobian."""
    evaluate_residual(newton.form, t, newton.branch, y, yp, newton.raw_residual)
    scale_residual(newton.kinematic, y, yp, newton.raw_residual)
    newton.residuals += 1
    combine(out, (newton.share,), (newton.raw_residual,))
    if newton.has_factors == 1:
        solve(newton.linear, out)


def factorize_jacobian(
    newton: NewtonState, t: float, c: float, y: Array, yp: Array, out: Array
) -> int:
    """Factorize dR/dy + c dR/dy' and return the code for IDA.

    IDA has just evaluated the residual at the same point in `out`; it is multiplied again with the
    new factors.
    """
    evaluate_jacobian(newton.form, t, newton.branch, c, y, yp, newton.nonzeros)
    scale_jacobian(newton.kinematic, c, newton.nonzeros)
    newton.jacobians += 1
    newton.has_factors = 0
    code = factorize(newton.linear, newton.nonzeros)
    while code == NEW_PIVOTS:
        # Python finds them without returning to IDA: steps do not depend on the pivots.
        if call_for_int(newton.renew_address, ()) == 0:
            return UNRECOVERABLE_FAILURE
        code = factorize(newton.linear, newton.nonzeros)
    newton.linear.singular = 0
    if code != DONE:
        return RECOVERABLE_FAILURE
    newton.has_factors = 1
    combine(out, (newton.share,), (newton.raw_residual,))
    solve(newton.linear, out)
    return DONE


def residual_callback(run: IdaWorkspace, t: float, y: int, yp: int, out: int) -> int:
    """Evaluate the residual for IDA, which passes addresses of its vectors."""
    run.residual_vector = out
    y_array, yp_array = _vector_array(run, y), _vector_array(run, yp)
    evaluate_preconditioned(run.newton, t, y_array, yp_array, _vector_array(run, out))
    return DONE


def jacobian_callback(
    run: IdaWorkspace,
    t: float,
    c: float,
    y: int,
    yp: int,
    residual_copy: int,
    matrix: int,
    work_1: int,
    work_2: int,
    work_3: int,
) -> int:
    """Factorize the Jacobian for IDA and return the identity to it in `matrix`."""
    out = _vector_array(run, run.residual_vector)
    code = factorize_jacobian(run.newton, t, c, _vector_array(run, y), _vector_array(run, yp), out)
    if code == DONE:
        diagonal = call_for_pointer(run.sundials.SUNBandMatrix_Data, (matrix,))
        fill(array_at(diagonal, run.y.size), 1.0)
    return code


def _vector_array(run: IdaWorkspace, vector: int) -> Array:
    return array_at(call_for_pointer(run.sundials.N_VGetArrayPointer, (vector,)), run.y.size)


def take_ida_steps(run: IdaWorkspace) -> int:
    """Take steps until the interval ends, the rows are full, or IDA fails; return the code."""
    while run.t[0] < run.end:
        if run.filled == run.most:
            return FULL
        before = run.t[0]
        arguments = (run.memory, run.end, run.t_address, run.y_vector, run.yp_vector, ONE_STEP)
        code = call_for_int(run.sundials.IDASolve, arguments)
        if code < 0:
            return code
        if not run.t[0] > before:
            return NO_ADVANCE
        stop = next_stop_time(before, run.t[0], run.end)
        call_for_int(run.sundials.IDASetStopTime, (run.memory, stop))
        _record_order_and_error(run)
        _store_row(run)
    return DONE


def next_stop_time(before: float, t: float, end: float) -> float:
    """Return the time [s] at which the step after one from `before` to `t` ends at the latest.

    If another step of the same length left a shorter one, the rest is split into two equal steps.
    Multipliers of index 2 and 3 have the errors of velocities and positions divided by the step:
    after a very short last step they were off by a fifth of their size.
    """
    step, remaining = t - before, end - t
    if (1.0 + _STEP_ROUNDING) * step < remaining < 2.0 * step:
        return t + 0.5 * remaining
    return end


def _record_order_and_error(run: IdaWorkspace) -> None:
    """Count the order of the last step, and the unknown with its largest error."""
    call_for_int(run.sundials.IDAGetLastOrder, (run.memory, run.order_address))
    run.orders[run.order[0]] += 1
    call_for_int(run.sundials.IDAGetEstLocalErrors, (run.memory, run.errors_vector))
    run.limiting_counts[locate_largest(run.errors, run.weights)] += 1


def _store_row(run: IdaWorkspace) -> None:
    row, n, y, yp = run.rows[run.filled], run.newton.form.n, run.y, run.yp
    m = row.size - 1 - 3 * n
    row[0] = run.t[0]
    combine(row[1 : 1 + 2 * n], (1.0,), (y[: 2 * n],))
    combine(row[1 + 2 * n : 1 + 3 * n], (1.0,), (yp[n : 2 * n],))
    multipliers = yp if run.has_impulses == 1 else y
    combine(row[1 + 3 * n :], (1.0,), (multipliers[2 * n : 2 * n + m],))
    run.filled += 1
