"""Memory of the step loop of Radau."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.formulations.first_order import FirstOrderBuffers

Array = np.ndarray

# Code of a step that fails, besides those of `return_codes`: the step became too small.
TOO_SMALL = -5


@dataclass(slots=True)
class StepSizeState:
    """Step size control: predicted from the last two errors, limited by Newton's iteration.

    h_{n+1} = 0.9 h_n e_n^(-1/4) min(1, (h_n / h_{n-1}) (e_{n-1} / e_n)^(1/4)); Gustafsson, ACM
    Trans. Math. Softw. 20 (1994) 496. Slender beams need little force to bend and much to stretch:
    Newton's iteration fails if a step rotates an element by more than its slenderness, often long
    before the error test does. Such a step is halved, and its length is regained by small factors.

    Attributes
    ----------
    longest, smallest
        Bounds of a step [s].
    next_step
        Step to try [s].
    newton_limit
        Longest step for Newton's iteration, as far as known [s].
    last_step, last_error
        Last accepted step [s], 0 without one, and its error relative to the tolerance.
    is_retry
        1 if the step under way was rejected before.
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
    """Memory of a run.

    Attributes
    ----------
    form
        Equations.
    real_solver, complex_solver
        Solvers with the factors of the real and of the complex matrix.
    step_size
        Step size control.
    y, yp
        State at the start of the step.
    last_w, w
        W of the last step and of the one under way; see `coefficients`.
    stages, rates, stage_residuals
        Y, Y' and the residual of the stages.
    real_change, complex_change, complex_real, complex_imaginary
        Right-hand sides and solutions of Newton's equations, and the parts of the complex one.
    extrapolation
        Matrix by which W is predicted from that of the last step.
    jacobian
        Non-zeros of R_y, followed by those of R_y', at the last factorization.
    real_nonzeros, complex_nonzeros
        Non-zeros of the matrices.
    entry_rows, entry_columns
        Rows and columns of these non-zeros.
    error, difference
        Error estimate, and the difference to the embedded solution.
    test_weights
        Weights of those of (q, v) that are in the error test.
    iteration_weights
        Weights of (q, v) for Newton's iteration in the step under way.
    velocity_weights, velocity_rounding_weights
        Weights of v in long steps, and of v times the step in short ones, from rounding of q.
    rows, filled, most
        (t, q, v, a, lam) of the stages, the number of rows filled, and of steps requested.
    t, branch, end
        Time reached, a time inside the interval, and its end [s].
    factors_step
        Step of the factors [s], 0 without factors.
    iterations, rate
        Iterations of the last step, and the rate of convergence of the last one.
    failure_code
        Code of the last rejection.
    """

    form: FirstOrderBuffers
    real_solver: Any
    complex_solver: Any
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
    extrapolation: Array
    jacobian: Array
    real_nonzeros: Array
    complex_nonzeros: Array
    entry_rows: Array
    entry_columns: Array
    error: Array
    difference: Array
    test_weights: Array
    iteration_weights: Array
    velocity_weights: Array
    velocity_rounding_weights: Array
    rows: Array
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
