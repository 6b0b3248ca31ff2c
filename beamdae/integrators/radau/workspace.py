"""Work arrays of the steps of Radau IIA, which `radau.c` takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.core.return_codes import TOO_SMALL
from beamdae.equations.formulations.first_order import FirstOrderBuffers
from beamdae.equations.formulations.kinematic_reduction import KinematicReduction
from beamdae.integrators.radau import coefficients

Array = np.ndarray


@dataclass(frozen=True)
class Tableau:
    """Coefficients of the method, see `coefficients`."""

    nodes: Array
    to_stages: Array
    from_stages: Array
    rates: Array
    rate_blocks: Array
    polynomial: Array
    embedded: Array
    start: Array
    uniform: Array
    eigenvalues: Array


TABLEAU = Tableau(
    coefficients.C,
    np.ascontiguousarray(coefficients.T),
    np.ascontiguousarray(coefficients.T_INVERSE),
    np.ascontiguousarray(coefficients.RATES),
    np.ascontiguousarray(coefficients.RATE_BLOCKS),
    np.ascontiguousarray(coefficients.POLYNOMIAL),
    coefficients.EMBEDDED,
    coefficients.START,
    coefficients.UNIFORM,
    np.array(
        [
            coefficients.REAL_EIGENVALUE,
            coefficients.COMPLEX_EIGENVALUE.real,
            coefficients.COMPLEX_EIGENVALUE.imag,
        ]
    ),
)


@dataclass(slots=True)
class StepSizeState:
    """State of the step size control, which uses the errors of the last two steps.

    h_{n+1} = 0.9 h_n e_n^(-1/4) min(1, (h_n / h_{n-1}) (e_{n-1} / e_n)^(1/4)), within bounds and
    reduced after many Newton iterations; Gustafsson, ACM Trans. Math. Softw. 20 (1994) 496. Slender
    beams are easy to bend and hard to stretch: Newton's iteration may fail for steps that rotate an
    element too far, long before the error test fails. Half of such a step becomes
    `newton_limit`, the limit of the following steps; this limit then grows again by small factors.
    e_n is the error of step n relative to the tolerance.

    Attributes
    ----------
    longest, smallest
        Bounds on the step [s].
    next_step
        Next step to try [s].
    newton_limit
        Longest step [s] for which Newton's iteration is expected to converge.
    last_step, last_error
        Last accepted step [s], 0 at the start of an interval, and its error relative to the
        tolerance.
    is_retry
        1 if the previous attempt at this step was rejected.
    """

    longest: float
    smallest: float = 0.0
    next_step: float = 0.0
    newton_limit: float = 0.0
    last_step: float = 0.0
    last_error: float = 0.0
    is_retry: int = 0


@dataclass(slots=True)
class RadauWorkspace:
    """Work arrays of a Radau run.

    Attributes
    ----------
    form
        Residual and Jacobian of the first-order form.
    real_solver, complex_solver
        Linear solvers of the real and the complex Newton equations.
    reduction
        Unknowns and equations of these systems.
    step_size
        State of the step size control.
    y, yp
        State y and its derivative y' at the start of the step.
    last_w, w
        W of the last step and of the current step; see `coefficients`.
    stages, rates, stage_residuals
        Y, Y' and residuals of the stages.
    real_change, complex_change, complex_real, complex_imaginary
        Right-hand sides and solutions of Newton's equations, and the real and imaginary parts of
        the complex solution.
    right, complex_right
        Right-hand sides and solutions of the reduced equations.
    extrapolation, velocities
        Matrix that predicts W from `last_w`, and velocities derived from positions.
    jacobian
        Parts of the reduced matrices at the last factorization, see `reduce_kinematics`.
    real_nonzeros, complex_nonzeros
        Non-zeros of the reduced matrices.
    entry_rows, entry_columns
        Row and column indices of these non-zeros.
    error, difference
        Error estimate, and difference between the embedded solution and the step.
    vector, product, constraint_errors
        Work arrays of the reduced equations.
    test_weights
        Weights of the components of (q, v) in the error test of the current step.
    tested_velocity_weights
        Weights of v in the error test of long steps, 0 for untested velocities.
    multiplier_weights, multiplier_tolerance
        Weights of the multipliers in the error test, (m,), which fall as the multipliers grow, and
        the tolerance relative to the largest values; (0,) if multipliers are not tested.
    shortest_tested_step
        Step [s] below which multipliers are not tested, because they may jump.
    iteration_weights
        Weights of (q, v) for Newton's iteration in the current step.
    velocity_weights, velocity_rounding_weights
        Weights of v in long steps; weights of (step * v) in short steps, from the rounding errors
        of q near the origin.
    rounding_ratio
        Rounding errors of q relative to those near the origin, for Newton's iteration.
    stagnation_limit
        Largest permitted weighted correction if the iteration stagnates.
    rows, filled, most
        Rows (t, q, v, a, lam) of the stages, number of filled rows, and maximum number of steps to
        take.
    t, branch, end
        Current time, a time inside the interval, and the end of the interval [s].
    factors_step
        Step [s] for which the factors were computed, 0 without factors.
    iterations, rate
        Number of Newton iterations in the last step, and their last rate of convergence.
    residuals, jacobians, failures, rejections
        Numbers of residual evaluations (three per iteration), of Jacobian evaluations, of failed
        Newton iterations and of rejected steps.
    failure_code
        Code of the last rejected attempt at the current or the previous step, or TOO_SMALL if there
        is none.
    tableau
        Coefficients of the method.
    """

    form: FirstOrderBuffers
    real_solver: Any
    complex_solver: Any
    reduction: KinematicReduction
    step_size: StepSizeState
    y: Array
    yp: Array
    last_w: Array
    w: Array
    stages: Array
    rates: Array
    stage_residuals: Array
    real_change: Array
    complex_change: Array
    complex_real: Array
    complex_imaginary: Array
    right: Array
    complex_right: Array
    extrapolation: Array
    velocities: Array
    jacobian: Array
    real_nonzeros: Array
    complex_nonzeros: Array
    entry_rows: Array
    entry_columns: Array
    error: Array
    difference: Array
    vector: Array
    product: Array
    constraint_errors: Array
    test_weights: Array
    tested_velocity_weights: Array
    multiplier_weights: Array
    iteration_weights: Array
    velocity_weights: Array
    velocity_rounding_weights: Array
    rows: Array
    rounding_ratio: float
    stagnation_limit: float
    multiplier_tolerance: float
    shortest_tested_step: float
    filled: int = 0
    most: int = 0
    t: float = 0.0
    branch: float = 0.0
    end: float = 0.0
    factors_step: float = 0.0
    iterations: int = 0
    rate: float = 1.0
    residuals: int = 0
    jacobians: int = 0
    failures: int = 0
    rejections: int = 0
    failure_code: int = TOO_SMALL
    tableau: Tableau = TABLEAU
