"""Work arrays of the steps of the generalized-alpha family, which `alpha.c` takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.formulations.step_equations import StepBuffers, StepPrediction

Array = np.ndarray


@dataclass(slots=True)
class Motion:
    """State after a step of length `h` [s].

    `ddq` is the true acceleration q'', `a` the algorithmic acceleration.
    """

    q: Array
    v: Array
    ddq: Array
    a: Array
    lam: Array
    h: float = 0.0


@dataclass(slots=True)
class AlphaWorkspace:
    """Work arrays of a generalized-alpha run.

    Attributes
    ----------
    form, linear
        Equations of a step, and the linear solver of their matrix.
    alpha_m, alpha_f, gamma, beta, defect
        Parameters of the method; see `family.AlphaParameters`.
    current
        Current motion, converted to the length of the next step.
    accepted_motion
        Adaptive steps: motion after the last accepted step.
    prediction, a_predicted
        Predicted state at the end of the step, and predicted algorithmic acceleration.
    ddq_n, a_n, lam_n
        Values at the start of the step.
    step_ratio
        Ratio of the step to the previous step; 0 in the first step.
    x, first_multipliers, change, nonzeros
        Unknowns, first iterate of those besides the increments, correction of the unknowns, and the
        non-zeros of the matrix.
    weights
        Reciprocal scales of the coordinates.
    rows, filled, most
        Rows (t, q, v, ddq, lam) of the steps taken, number of filled rows, and maximum number of
        rows to fill.
    newton_tolerance, min_correction_limit
        Newton tolerance relative to beta h^2 times the largest scaled acceleration, and lower bound
        on `correction_limit`.
    correction_limit, rate
        Newton tolerance of scaled positions in the current step, and last rate of convergence.
    reaction_weights, reaction_factor
        1 for each multiplier if forces depend on reactions or all motions are prescribed, otherwise
        0, and factor that compares corrections of reactions with `correction_limit`, 0 if they are
        not tested.
    t, branch, start_time, end
        Current time, a time inside the interval, and start and end of the interval [s].
    fixed_iterations
        Fixed steps: number of Newton iterations of every step; 0 for as many as the tolerance
        requires.
    has_started
        0 if the starting values of an interval, with the length of the next steps, have just been
        set.
    has_jumped
        1 if held inputs have jumped since the last step.
    states
        Indices of the first-order states.
    step_count, total_steps
        Number of completed steps, and total number of equal steps in the interval.
    tolerance
        Adaptive steps: local error tolerance.
    next_step, max_step, min_step
        Adaptive steps: next step to try and its bounds [s].
    unclipped_step
        Adaptive steps: largest step since the last rejection that only the end of the interval has
        shortened [s].
    steps_checked, max_error, error
        Adaptive steps: number of accepted steps since growth was last considered, largest error of
        these steps, and error of the last attempted step. Errors are relative to the tolerance.
    residuals, jacobians, failures, rejections
        Numbers of residual evaluations, of matrix evaluations, of failed Newton iterations and of
        rejected steps.
    """

    form: StepBuffers
    linear: Any
    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float
    defect: float
    current: Motion
    accepted_motion: Motion
    prediction: StepPrediction
    a_predicted: Array
    ddq_n: Array
    a_n: Array
    lam_n: Array
    x: Array
    first_multipliers: Array
    change: Array
    nonzeros: Array
    weights: Array
    reaction_weights: Array
    rows: Array
    newton_tolerance: float
    min_correction_limit: float
    tolerance: float
    max_step: float
    min_step: float
    states: Array
    fixed_iterations: int = 0
    has_started: int = 0
    has_jumped: int = 0
    filled: int = 0
    step_ratio: float = 0.0
    most: int = 0
    correction_limit: float = 0.0
    reaction_factor: float = 0.0
    rate: float = math.inf
    t: float = 0.0
    branch: float = 0.0
    start_time: float = 0.0
    end: float = 0.0
    step_count: int = 0
    total_steps: int = 0
    next_step: float = 0.0
    unclipped_step: float = 0.0
    steps_checked: int = 0
    max_error: float = 0.0
    error: float = 0.0
    residuals: int = 0
    jacobians: int = 0
    failures: int = 0
    rejections: int = 0
