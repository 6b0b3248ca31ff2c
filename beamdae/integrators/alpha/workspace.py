"""Memory of the loops of the generalized-alpha family."""

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

    `ddq` is the acceleration q'' of the bodies, `a` the algorithmic acceleration.
    """

    q: Array
    v: Array
    ddq: Array
    a: Array
    lam: Array
    h: float = 0.0


@dataclass(slots=True)
class AlphaWorkspace:
    """Memory of a run.

    Attributes
    ----------
    form, linear
        Equations of a step, and the solver with the factors of their matrix.
    alpha_m, alpha_f, gamma, beta, defect
        Parameters of the member of the family; see `family.AlphaParameters`.
    current
        The motion, converted to the length of the step to take.
    accepted_motion
        Motion after the last accepted step.
    prediction, a_predicted
        Predicted state of the step, and its algorithmic acceleration.
    ddq_n, a_n, lam_n
        Values at the start of the step.
    step_ratio
        Length of the step over that of the one before; 0 without one before.
    x, first_iterate, change, nonzeros
        Unknowns, their first iterate, their change, and the non-zeros of the matrix.
    weights
        One over the scales of the coordinates.
    rows, filled, most
        (t, q, v, ddq, lam) of the steps taken, the number of rows filled, and of rows requested.
    newton_tolerance, min_correction_limit
        Limit of the error of increments: relative to the largest one, and its least value.
    correction_limit, rate
        Limit of the current step, and the rate of convergence of the last iteration.
    t, branch, start_time, end
        Time reached, a time inside the interval, and its start and end [s].
    step_count, total_steps
        Number of equal steps taken and to take in the interval.
    tolerance
        Adaptive steps: tolerance of the error of a step.
    next_step, max_step, min_step
        Adaptive steps: the step to try and its bounds [s].
    steps_checked, max_error, error
        Adaptive steps: number of accepted steps of this length that were checked, the largest of
        their errors, and the error of the last step, relative to the tolerance.
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
    first_iterate: Array
    change: Array
    nonzeros: Array
    weights: Array
    rows: Array
    newton_tolerance: float
    min_correction_limit: float
    tolerance: float
    max_step: float
    min_step: float
    filled: int = 0
    step_ratio: float = 0.0
    most: int = 0
    correction_limit: float = 0.0
    rate: float = math.inf
    t: float = 0.0
    branch: float = 0.0
    start_time: float = 0.0
    end: float = 0.0
    step_count: int = 0
    total_steps: int = 0
    next_step: float = 0.0
    steps_checked: int = 0
    max_error: float = 0.0
    error: float = 0.0
    residuals: int = 0
    jacobians: int = 0
    failures: int = 0
    rejections: int = 0
