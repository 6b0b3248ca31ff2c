"""What the loops of the generalized-alpha family work on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.step_equations import Predicted, StepSums

Array = np.ndarray


@dataclass(slots=True)
class Motion:
    """State after a step `h`; `a` is the algorithmic acceleration, `ddq` the one of the bodies."""

    q: Array
    v: Array
    ddq: Array
    a: Array
    lam: Array
    h: float = 0.0


@dataclass(slots=True)
class AlphaRun:
    """A run under way.

    Attributes
    ----------
    form, linear
        Equations of a step, and the factors of their matrix.
    alpha_m, alpha_f, gamma, beta, defect
        The member of the family.
    now
        The motion, as the step that comes asks for it.
    kept
        The motion as the step left it that led to it.
    at, a_p
        The prediction of the step under way, and its algorithmic acceleration.
    ddq_n, a_n, lam_n
        What it begins with.
    trend
        Its length over that of the step before, or 0 if there is none to go on from.
    x, start, change, nonzeros
        Unknowns, where their iteration began, a change of them, and the matrix.
    weights
        One over the scales of the coordinates.
    rows, filled, most
        (t, q, v, ddq, lam) of the steps taken, how many of the rows are, and are to be at most.
    newton_tolerance, least, bound, rate
        What increments may be off by, relative and at least; for the step under way; and by how
        much the last iteration shrank them.
    t, branch, start_time, end, taken, total
        Where the run is in its interval, and for equal steps how many there are.
    tolerance, next, largest, smallest, seen, worst, error
        For steps that adapt: of the error of one, the step to try and its bounds, how many steps of
        one size were seen, and the largest of their errors.
    """

    form: StepSums
    linear: Any
    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float
    defect: float
    now: Motion
    kept: Motion
    at: Predicted
    a_p: Array
    ddq_n: Array
    a_n: Array
    lam_n: Array
    x: Array
    start: Array
    change: Array
    nonzeros: Array
    weights: Array
    rows: Array
    newton_tolerance: float
    least: float
    tolerance: float
    largest: float
    smallest: float
    filled: int = 0
    trend: float = 0.0
    most: int = 0
    bound: float = 0.0
    rate: float = math.inf
    t: float = 0.0
    branch: float = 0.0
    start_time: float = 0.0
    end: float = 0.0
    taken: int = 0
    total: int = 0
    next: float = 0.0
    seen: int = 0
    worst: float = 0.0
    error: float = 0.0
    residuals: int = 0
    jacobians: int = 0
    failures: int = 0
    rejected: int = 0
