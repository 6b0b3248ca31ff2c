"""What the compiled loop of Radau works on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.formulations.first_order import FirstOrderBuffers

Array = np.ndarray

# Why a step is none.
NOT_CONVERGED, NOT_FINITE, ERROR_TOO_LARGE, TOO_SMALL = -1, -2, -4, -5


@dataclass(slots=True)
class StepSizeState:
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
class RadauWorkspace:
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
    jacobian, real_nonzeros, pair_nonzeros
        R_y at the factors and behind it R_y', and the matrices that are factorized.
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

    form: FirstOrderBuffers
    real: Any
    pair: Any
    size: StepSizeState
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
    jacobian: Array
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
