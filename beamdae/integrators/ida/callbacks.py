"""Residual and Jacobian callbacks of IDA, and its step loop.

The functions are plain Python over arrays; `native.loops` compiles them if possible.

beamdae's linear solver replaces that of IDA: IDA receives the residual premultiplied by the inverse
of the Jacobian from its last setup, and the identity as Jacobian. The diagonal solver of IDA then
only scales corrections by 2 / (1 + c / c_setup).
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

# Return code of `take_ida_steps` for a step that does not advance time; IDA's codes are negative.
NO_ADVANCE = 10
# Return codes of callbacks that make IDA try a shorter step, or give up.
RECOVERABLE_FAILURE = 1
UNRECOVERABLE_FAILURE = -1

# Maximum number of steps with the same factors. IDA computes new factors only if the step changes
# by a third or Newton's iteration fails, and estimates the rate of convergence only in steps with
# two iterations. In long stretches of equal steps, the stiff directions of beams in absolute
# coordinates turn away from those of the factors, and single iterations leave errors near the
# tolerance. These excite vibrations that reduce the step: a beam that rotates at 6 rad/s took 2.5
# times as many steps. With 20, 50 and 100 steps, the numbers of steps agree within 1 %; CVODE uses
# 50.
MAX_STEPS_PER_FACTORIZATION = 50

# Relative difference below which two steps are equal.
_STEP_ROUNDING = 1e-6


@dataclass(slots=True)
class NewtonState:
    """Equations and linear algebra of IDA's Newton iteration.

    Attributes
    ----------
    form
        Residual and Jacobian of the first-order form.
    linear
        Linear solver with the factors of the Jacobian.
    raw_residual
        Last residual before premultiplication.
    nonzeros
        Non-zeros of the Jacobian.
    kinematic
        Scaling of the kinematic rows.
    correction_fraction
        Fraction of each Newton correction that is applied; see `stepper`.
    branch
        Time [s] inside the smooth interval.
    has_factors
        1 if the Jacobian has been factorized.
    c, age
        Coefficient c of dR/dy + c dR/dy' in the factors, and number of steps since the factors were
        computed.
    renew_address
        Address of a C function that sets new pivots and returns 1 on success.
    residuals, jacobians
        Numbers of evaluations of the residual and the Jacobian.
    """

    form: FirstOrderBuffers
    linear: Any
    raw_residual: Array
    nonzeros: Array
    kinematic: KinematicRowScaling
    correction_fraction: float = 1.0
    branch: float = 0.0
    has_factors: int = 0
    c: float = 0.0
    age: int = 0
    renew_address: int = 0
    residuals: int = 0
    jacobians: int = 0


@dataclass(slots=True)
class SundialsFunctions:
    """Addresses of SUNDIALS functions."""

    IDASolve: int
    IDASetStopTime: int
    IDAGetLastOrder: int
    IDAGetEstLocalErrors: int
    N_VGetArrayPointer: int
    SUNBandMatrix_Data: int


@dataclass(slots=True)
class IdaWorkspace:
    """Work arrays of an IDA run.

    Attributes
    ----------
    newton, sundials
        Newton iteration, and SUNDIALS functions.
    has_impulses
        1 if the unknowns include time integrals of the multipliers; see `Formulation.impulses`.
    rows
        Rows (t, q, v, a, lam) of the steps taken.
    orders
        Number of steps of each order.
    limiting_counts
        Number of steps in which each unknown had the largest error.
    weights
        Error weights that determine the largest error.
    t, y, yp, order, errors
        Arrays in which IDA returns its results.
    t_address, order_address
        Addresses of `t` and `order`.
    y_vector, yp_vector, errors_vector
        Addresses of the SUNDIALS vectors of these arrays.
    memory
        Address of IDA's memory.
    residual_vector
        Address of the SUNDIALS vector that received the last residual.
    end
        End of the smooth interval [s].
    filled, most
        Number of filled rows, and maximum number of rows to fill.
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


def evaluate_preconditioned(newton: NewtonState, t: float, y: Array, yp: Array, out: Array) -> int:
    """Write the residual, premultiplied by the inverse of the last Jacobian, to `out`.

    Without factors, the residual is not premultiplied. `correction_fraction` is applied in both
    cases. Factors that have been used for 50 steps are replaced first. Return the code for IDA.
    """
    if newton.has_factors == 1 and newton.age >= MAX_STEPS_PER_FACTORIZATION:
        code = _compute_factors(newton, t, newton.c, y, yp)
        if code != DONE:
            return code
    evaluate_residual(newton.form, t, newton.branch, y, yp, newton.raw_residual)
    scale_residual(newton.kinematic, y, yp, newton.raw_residual)
    newton.residuals += 1
    combine(out, (newton.correction_fraction,), (newton.raw_residual,))
    if newton.has_factors == 1:
        solve(newton.linear, out)
    return DONE


def factorize_jacobian(
    newton: NewtonState, t: float, c: float, y: Array, yp: Array, out: Array
) -> int:
    """Factorize dR/dy + c dR/dy' and return the code for IDA.

    `out` contains the residual that IDA has just evaluated at the same point. On success, it is
    replaced by the raw residual premultiplied with the new factors.
    """
    code = _compute_factors(newton, t, c, y, yp)
    if code == DONE:
        combine(out, (newton.correction_fraction,), (newton.raw_residual,))
        solve(newton.linear, out)
    return code


def _compute_factors(newton: NewtonState, t: float, c: float, y: Array, yp: Array) -> int:
    evaluate_jacobian(newton.form, t, newton.branch, c, y, yp, newton.nonzeros)
    scale_jacobian(newton.kinematic, c, newton.nonzeros)
    newton.jacobians += 1
    newton.has_factors = 0
    code = factorize(newton.linear, newton.nonzeros)
    while code == NEW_PIVOTS:
        # New pivots are set without returning to IDA, so that steps do not depend on the pivots.
        if call_for_int(newton.renew_address, ()) == 0:
            return UNRECOVERABLE_FAILURE
        code = factorize(newton.linear, newton.nonzeros)
    newton.linear.singular = 0
    if code != DONE:
        return RECOVERABLE_FAILURE
    newton.has_factors, newton.c, newton.age = 1, c, 0
    return DONE


def residual_callback(run: IdaWorkspace, t: float, y: int, yp: int, out: int) -> int:
    """Evaluate the preconditioned residual; `y`, `yp` and `out` are `N_Vector` addresses.

    See `evaluate_preconditioned`.
    """
    run.residual_vector = out
    y_array, yp_array = _vector_array(run, y), _vector_array(run, yp)
    return evaluate_preconditioned(run.newton, t, y_array, yp_array, _vector_array(run, out))


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
    """Factorize the Jacobian for IDA; on success, write the identity into `matrix`."""
    out = _vector_array(run, run.residual_vector)
    code = factorize_jacobian(run.newton, t, c, _vector_array(run, y), _vector_array(run, yp), out)
    if code == DONE:
        diagonal = call_for_pointer(run.sundials.SUNBandMatrix_Data, (matrix,))
        fill(array_at(diagonal, run.y.size), 1.0)
    return code


def _vector_array(run: IdaWorkspace, vector: int) -> Array:
    return array_at(call_for_pointer(run.sundials.N_VGetArrayPointer, (vector,)), run.y.size)


def take_ida_steps(run: IdaWorkspace) -> int:
    """Take steps until the interval ends, the rows are full or IDA fails; return the code."""
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
        run.newton.age += 1
        _record_order_and_error(run)
        _store_row(run)
    return DONE


def _store_row(run: IdaWorkspace) -> None:
    """Append the row (t, q, v, a, lam) of the present time."""
    row, y, yp, n = run.rows[run.filled], run.y, run.yp, run.newton.form.n
    m = row.size - 1 - 3 * n
    row[0] = run.t[0]
    combine(row[1 : 1 + 2 * n], (1.0,), (y[: 2 * n],))
    combine(row[1 + 2 * n : 1 + 3 * n], (1.0,), (yp[n : 2 * n],))
    multipliers = yp if run.has_impulses == 1 else y
    combine(row[1 + 3 * n :], (1.0,), (multipliers[2 * n : 2 * n + m],))
    run.filled += 1


def next_stop_time(before: float, t: float, end: float) -> float:
    """Return the latest end [s] of the next step, after a step from `before` to `t` [s].

    If another step of the same length would leave a shorter last step, the remaining time is split
    into two equal steps: in the index-2 and index-3 forms, errors of multipliers are errors of
    velocities or positions divided by powers of the step. After a very short last step, multipliers
    were wrong by a fifth of their size.
    """
    step, remaining = t - before, end - t
    if (1.0 + _STEP_ROUNDING) * step < remaining < 2.0 * step:
        return t + 0.5 * remaining
    return end


def _record_order_and_error(run: IdaWorkspace) -> None:
    """Count the order of the last step and the unknown with the largest error."""
    call_for_int(run.sundials.IDAGetLastOrder, (run.memory, run.order_address))
    run.orders[run.order[0]] += 1
    call_for_int(run.sundials.IDAGetEstLocalErrors, (run.memory, run.errors_vector))
    run.limiting_counts[locate_largest(run.errors, run.weights)] += 1
