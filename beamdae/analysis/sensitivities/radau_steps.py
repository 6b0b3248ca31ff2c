"""Steps of a Radau run that are differentiated: their stages, and the Newton matrices of these.

The functions of a workspace are plain Python over arrays; `native.loops` compiles them if possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from beamdae.equations.formulations.first_order import FirstOrderForm, evaluate_residual
from beamdae.equations.formulations.kinematic_reduction import (
    KinematicReduction,
    reduce_kinematics,
)
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.integrators.error_control import MotionScales
from beamdae.integrators.radau.coefficients import T_INVERSE, A, C
from beamdae.integrators.radau.stages import (
    correct_stages,
    derive_velocities,
    factorize_matrices,
    set_stages,
)
from beamdae.integrators.radau.stepper import StepTolerance, make_workspace
from beamdae.integrators.radau.workspace import RadauWorkspace
from beamdae.native.loop_functions import combine, fill, max_norm
from beamdae.native.return_codes import DONE, NOT_CONVERGED, NOT_FINITE
from beamdae.results.trajectory import Interval
from beamdae.symbolic.sums.kernel_sums import SumPlan

Array = np.ndarray

# Newton iterations of the stages of the run, which are converged except for the corrections of
# positions; the run does not store these.
_STAGE_ITERATIONS = 2
# Systems of equations of the stages are solved to this fraction of the size of each block of the
# solution, ...
_TOLERANCE = 1e-12
# ... or to rounding errors, which the corrections of a block reveal if they are below this
# fraction and do not decrease by half. Whole blocks may be rounding errors: a parameter may change
# only reactions.
_ROUNDING = 1e-7
_STAGNATION_RATE = 0.5
# Smaller values have no relative accuracy; those of damped motions decay to it.
_UNDERFLOW = float(np.finfo(float).tiny / np.finfo(float).eps)
MAX_ITERATIONS = 60
# Stages are predicted from the last step if it was not shorter by more than this factor.
MAX_STEP_RATIO = 1.5


@dataclass(frozen=True)
class StageMatrices:
    """Newton matrices of the stages of a Radau run.

    Attributes
    ----------
    pattern, jacobian, reduction
        See `reduce_kinematics`.
    real, complex_
        The two matrices.
    """

    pattern: sp.csc_array
    jacobian: SumPlan
    reduction: KinematicReduction
    real: FactorizedMatrix
    complex_: FactorizedMatrix

    @classmethod
    def of(cls, form: FirstOrderForm) -> StageMatrices:
        """Return the matrices of a form, not yet evaluated."""
        pattern, jacobian, reduction = reduce_kinematics(form)
        real = FactorizedMatrix.from_pattern(pattern)
        complex_ = FactorizedMatrix.from_pattern(pattern, complex, pivot_source=real)
        return cls(pattern, jacobian, reduction, real, complex_)

    def make_workspace(self, form: FirstOrderForm, native: bool) -> RadauWorkspace:
        """Return work arrays for the stages."""
        equations = form.equations
        scales = equations.position_scales
        motion = MotionScales(scales, scales, 1.0, 1.0)
        buffers = form.buffers(native)
        buffers.jacobian = self.jacobian.sum(native, equations.p)
        return make_workspace(
            form,
            buffers,
            self.pattern,
            self.reduction,
            (self.real.make_solver(native, "auto"), self.real.nonzeros),
            (self.complex_.make_solver(native, "auto"), self.complex_.nonzeros),
            StepTolerance(1.0, motion, np.ones(equations.n, bool)),
            math.inf,
        )

    def step_fields(self, form: FirstOrderForm, interval: Interval, native: bool) -> dict[str, Any]:
        """Return the fields of `RadauSteps` for the steps of an interval."""
        run = self.make_workspace(form, native)
        run.branch = interval.branch
        return {
            "run": run,
            "stages": np.zeros((3, form.size)),
            "rates": np.zeros((3, form.size)),
            "times": np.ascontiguousarray(interval.t),
            "rows": np.ascontiguousarray(np.hstack(interval.rows)),
            "scales": 1.0 / form.equations.position_scales,
            "unit_weights": np.ones(form.equations.m),
            "sizes": np.zeros((2, 3)),
        }


@dataclass(slots=True, kw_only=True)
class RadauSteps:
    """Work arrays of a loop over the steps of a run.

    Attributes
    ----------
    run
        Work arrays of the stages of the run.
    stages, rates
        Stages Y and Y' of the run, (3, size).
    times, rows
        Start and steps of the interval (steps + 1,) [s], and states (q, v, a, lam) at its start and
        at all stages, (3 steps + 1, 3n + m).
    scales, unit_weights
        Reciprocal scales of the coordinates, (n,); ones (m,).
    sizes
        Largest corrections and values of up to three blocks of unknowns, (2, 3).
    largest
        Largest ratio of both in the last iteration; infinite before the first one.
    """

    run: RadauWorkspace
    stages: Array
    rates: Array
    times: Array
    rows: Array
    scales: Array
    unit_weights: Array
    sizes: Array
    largest: float = math.inf


def restore_stages(known: RadauSteps, step: int, h: float) -> int:
    """Compute the stages of a step of length `h` [s], factorize the matrices; return the code."""
    run, n = known.run, known.run.form.n
    m = known.rows.shape[1] - 3 * n
    first = 3 * step
    start = known.rows[first]
    stages = run.stages
    reactions = (
        known.rows[first + 1][3 * n :],
        known.rows[first + 2][3 * n :],
        known.rows[first + 3][3 * n :],
    )
    fill(run.y, 0.0)
    combine(run.y[: 2 * n], (1.0,), (start[: 2 * n],))
    for i in range(3):
        row = known.rows[first + 1 + i]
        fill(stages[i], 0.0)
        combine(stages[i][: 2 * n], (1.0, -1.0), (row[: 2 * n], start[: 2 * n]))
        factors = (h * A[i, 0], h * A[i, 1], h * A[i, 2])
        combine(stages[i][2 * n : 2 * n + m], factors, reactions)
    for i in range(3):
        factors = (T_INVERSE[i, 0], T_INVERSE[i, 1], T_INVERSE[i, 2])
        combine(run.w[i], factors, (stages[0], stages[1], stages[2]))
    derive_velocities(run, h)
    set_stages(run, h)
    code = factorize_matrices(run, h)
    if code != DONE:
        return code
    for _ in range(_STAGE_ITERATIONS):
        for i in range(3):
            t, residual = run.t + C[i] * h, run.stage_residuals[i]
            evaluate_residual(run.form, t, run.branch, run.stages[i], run.rates[i], residual)
        correct_stages(run, h)
        set_stages(run, h)
    for i in range(3):
        combine(known.stages[i], (1.0,), (run.stages[i],))
        combine(known.rates[i], (1.0,), (run.rates[i],))
    return DONE


def measure_block(
    known: RadauSteps, block: int, change: Array, value: Array, weights: Array
) -> None:
    """Enlarge the `sizes` of a block to those of a correction and of a value."""
    known.sizes[0, block] = _larger(known.sizes[0, block], max_norm(change, weights))
    known.sizes[1, block] = _larger(known.sizes[1, block], max_norm(value, weights))


def _larger(one: float, other: float) -> float:
    """Return the larger number; NaN if `other` is NaN."""
    return one if one > other else other


def judge_corrections(known: RadauSteps) -> int:
    """Return DONE or NOT_FINITE, or NOT_CONVERGED if another iteration is needed.

    `sizes` are those of the iteration; they are reset.
    """
    previous, largest, smallest = known.largest, 0.0, math.inf
    for block in range(3):
        change, size = known.sizes[0, block], known.sizes[1, block]
        known.sizes[0, block] = 0.0
        known.sizes[1, block] = 0.0
        if not math.isfinite(change):
            return NOT_FINITE
        if size > _UNDERFLOW:
            largest = max(largest, change / size)
            smallest = min(smallest, change / size)
    known.largest = largest
    if largest <= _TOLERANCE:
        return DONE
    # The first iteration does not reveal the rate of convergence.
    rate = largest / previous
    if previous < math.inf and rate < 1.0 and largest * rate <= _TOLERANCE * (1.0 - rate):
        return DONE
    return DONE if rate > _STAGNATION_RATE and smallest <= _ROUNDING else NOT_CONVERGED
