"""Fixed-step methods on a first-order form, each defined by one compiled step function.

To add a method, write a function `step(run, t, h) -> code` in plain Python over arrays, restricted
to the language that numba compiles and to `native.loop_functions`. It predicts each `ImplicitStage`
and solves it by `solve_stage`. `FixedStepMethod` compiles the function into a loop over steps, or
runs it as plain Python if no compiler is available.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, make_dataclass
from functools import cache
from types import FunctionType
from typing import Any, ClassVar

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.first_order import (
    FirstOrderBuffers,
    evaluate_jacobian,
    evaluate_residual,
    formulate_first_order,
)
from beamdae.integrators.compiled_run import (
    KEEP_RATE,
    MAX_CORRECTION_GROWTH,
    MAX_ITERATIONS,
    MIN_FIRST_RATE,
    MIN_RATE,
    SLOW_RATE,
    FactorizedMatrix,
    StepLoop,
)
from beamdae.integrators.error_control import motion_scales
from beamdae.integrators.limits import require_feasible_step
from beamdae.integrators.method import (
    FIXED_STEPS_PER_CHECK,
    MATRIX_SINGULAR,
    RESIDUAL_NOT_FINITE,
    StepError,
    allocate_rows,
    count_equal_steps,
)
from beamdae.integrators.run_plan import RunPlan
from beamdae.native.loop_functions import combine, factorize, max_norm, solve
from beamdae.native.return_codes import (
    DONE,
    FULL,
    NEW_PIVOTS,
    NOT_CONVERGED,
    NOT_FINITE,
    SINGULAR,
)
from beamdae.results.outcome import Statistics

Array = np.ndarray

_FAILURES = {
    NOT_CONVERGED: "Newton's iteration did not converge; use a smaller step",
    NOT_FINITE: RESIDUAL_NOT_FINITE,
    SINGULAR: MATRIX_SINGULAR,
}


@dataclass(slots=True)
class ImplicitStage:
    """Implicit stage R(t, y, c y + offset) = 0 with the factors of its matrix.

    Attributes
    ----------
    y, yp
        Stage values; the step function sets `y` to a prediction before it calls `solve_stage`.
    offset
        Part of y' that does not depend on y, set by the step function.
    change
        Correction of the Newton iteration.
    linear, nonzeros
        Linear solver, and non-zeros of dR/dy + c dR/dy'.
    prediction
        Copy of the predicted `y`.
    c, rate
        Coefficient c for which the factors were computed, and the last rate of convergence with
        them (infinite without factors).
    """

    y: Array
    yp: Array
    offset: Array
    change: Array
    linear: Any
    nonzeros: Array
    prediction: Array
    c: float = 0.0
    rate: float = math.inf


@dataclass(slots=True)
class StepWorkspace:
    """Work arrays of a run; a subclass adds the stages of the method as fields.

    Attributes
    ----------
    form
        Equations R(t, y, y') = 0 with y = (q, v, multipliers).
    y, yp
        Values at the start of the step; the step function replaces them after a successful step.
    weights
        Reciprocal scales of (q, v), (2 n,).
    newton_tolerance
        Bound on the error of Newton's iteration, relative to the scales.
    has_impulses
        1 if the unknowns include time integrals of the multipliers; see `Formulation.impulses`.
    residual
        Residual in the last Newton iteration of any stage.
    rows, filled, most
        Rows (t, q, v, a, lam) of the steps taken, number of filled rows, and maximum number of
        rows to fill.
    start, end, branch
        Start and end of the interval, and a time inside the interval [s].
    step_count, total_steps
        Number of completed steps, and total number of equal steps in the interval.
    residuals, jacobians, failures
        Numbers of residual and Jacobian evaluations, and number of Newton iterations that failed
        with old factors.
    """

    form: FirstOrderBuffers
    y: Array
    yp: Array
    weights: Array
    newton_tolerance: float
    has_impulses: int
    residual: Array
    rows: Array
    filled: int = 0
    most: int = 0
    start: float = 0.0
    end: float = 0.0
    branch: float = 0.0
    step_count: int = 0
    total_steps: int = 0
    residuals: int = 0
    jacobians: int = 0
    failures: int = 0


# Takes a step from t to t + h [s]: updates y and yp of the workspace and returns DONE, or returns
# an error code.
StepFunction = Callable[[Any, float, float], int]


def solve_stage(run: Any, stage: ImplicitStage, t: float, c: float) -> int:
    """Solve a stage at time `t` [s] by Newton's iteration from its prediction; return the code.

    `c` is the coefficient of y in y' = c y + offset. Factors are reused across steps while the
    iteration converges fast and `c` does not change. If the code is not DONE, the step function
    must return it.
    """
    combine(stage.prediction, (1.0,), (stage.y,))
    if stage.rate <= KEEP_RATE and stage.c == c:
        code = _iterate_newton(run, stage, t, c, False)
        if code in (DONE, NOT_FINITE):
            return code
        run.failures += 1
        combine(stage.y, (1.0,), (stage.prediction,))
    code = _factorize_stage(run, stage, t, c)
    if code == DONE:
        code = _iterate_newton(run, stage, t, c, True)
    return code


def _factorize_stage(run: Any, stage: ImplicitStage, t: float, c: float) -> int:
    combine(stage.yp, (c, 1.0), (stage.y, stage.offset))
    evaluate_jacobian(run.form, t, run.branch, c, stage.y, stage.yp, stage.nonzeros)
    code = factorize(stage.linear, stage.nonzeros)
    stage.c, stage.rate = c, 0.0 if code == DONE else math.inf
    # The step will be repeated with new pivots.
    if code != NEW_PIVOTS:
        run.jacobians += 1
        stage.linear.singular = 0
    return code


def _iterate_newton(run: Any, stage: ImplicitStage, t: float, c: float, may_renew: bool) -> int:
    previous = math.inf
    for k in range(MAX_ITERATIONS):
        combine(stage.yp, (c, 1.0), (stage.y, stage.offset))
        evaluate_residual(run.form, t, run.branch, stage.y, stage.yp, run.residual)
        run.residuals += 1
        combine(stage.change, (1.0,), (run.residual,))
        solve(stage.linear, stage.change)
        combine(stage.y, (1.0, -1.0), (stage.y, stage.change))
        size = max_norm(stage.change[: run.weights.size], run.weights)
        if k == 0 and not math.isfinite(size):
            return NOT_FINITE
        # Negated, so that NaN also ends the iteration.
        if not size <= MAX_CORRECTION_GROWTH * previous:
            return NOT_CONVERGED
        if k > 0:
            stage.rate = max(size / previous, MIN_RATE) if previous > 0.0 else 0.0
        rate = stage.rate if k > 0 else max(stage.rate, MIN_FIRST_RATE)
        if rate < 1.0 and size * rate <= run.newton_tolerance * (1.0 - rate):
            combine(stage.yp, (c, 1.0), (stage.y, stage.offset))
            return DONE
        if may_renew and rate > SLOW_RATE:
            code = _factorize_stage(run, stage, t, c)
            if code != DONE:
                return code
        previous = size
    return NOT_CONVERGED


def store_row(run: Any, n: int, t: float) -> None:
    """Append the row (t, q, v, a, lam) of a first-order form with `n` coordinates."""
    row, y, yp = run.rows[run.filled], run.y, run.yp
    m = row.size - 1 - 3 * n
    row[0] = t
    combine(row[1 : 1 + 2 * n], (1.0,), (y[: 2 * n],))
    combine(row[1 + 2 * n : 1 + 3 * n], (1.0,), (yp[n : 2 * n],))
    multipliers = yp if run.has_impulses == 1 else y
    combine(row[1 + 3 * n :], (1.0,), (multipliers[2 * n : 2 * n + m],))
    run.filled += 1


def step_function(run: Any, t: float, h: float) -> int:
    """Take one step: placeholder that `_loop_over` replaces by the method's step function."""
    raise NotImplementedError


def _take_steps(run: Any) -> int:
    h = (run.end - run.start) / run.total_steps
    while run.step_count < run.total_steps:
        if run.filled == run.most:
            return FULL
        code = step_function(run, run.start + run.step_count * h, h)
        if code != DONE:
            return code
        run.step_count += 1
        last = run.step_count == run.total_steps
        store_row(run, run.form.n, run.end if last else run.start + run.step_count * h)
    return DONE


@cache
def _loop_over(step: StepFunction) -> Callable[[Any], int]:
    """Return `_take_steps` bound to `step`, which numba would not accept as an argument."""
    namespace = {**_take_steps.__globals__, "step_function": step}
    return FunctionType(_take_steps.__code__, namespace, f"{_take_steps.__name__}_{step.__name__}")


class FixedStepMethod:
    """Method with equal steps in each interval on a first-order form, compiled if possible.

    Parameters
    ----------
    plan
        Plan of the run.
    step_function
        `step_function(run, t, h)` takes a step from t to t + h [s]: it reads `run.y` and `run.yp`,
        solves the stages, and updates `run.y` and `run.yp` if all stages converge.
    step
        Step [s], shortened so that steps end at breakpoints and at the end time.
    stages
        Names of the implicit stages, fields of `run`.
    formulation
        First-order form; for "stabilized-index1", y = (q, v, Lam, Mu) and lam = Lam'.
    newton_tolerance
        Bound on the error of Newton's iteration, relative to the scales of positions and
        velocities.

    Raises
    ------
    BeamdaeError
        If the run would take more than 1e8 steps of this length, or `formulation` is unknown.
    """

    rows_per_step: ClassVar[int] = 1
    steps_per_check: ClassVar[int] = FIXED_STEPS_PER_CHECK
    resolved_options: ClassVar[dict[str, Any]] = {}

    def __init__(
        self,
        plan: RunPlan,
        step_function: StepFunction,
        step: float,
        stages: Sequence[str],
        formulation: str = "stabilized-index1",
        newton_tolerance: float = 1e-8,
    ) -> None:
        require_feasible_step(step_function.__name__, "step", step, plan.duration)
        self._step, self._stages = step, tuple(stages)
        self._form = form = formulate_first_order(plan.equations, formulation)
        n, m, scales = form.equations.n, form.equations.m, motion_scales(plan)
        weights = 1.0 / np.concatenate([scales.position, scales.rate * scales.position])
        first = plan.matrix(f"{step_function.__name__} {self._stages[0]}", form.pattern)
        others = [
            FactorizedMatrix.from_pattern(form.pattern, pivot_source=first)
            for _ in self._stages[1:]
        ]
        self._matrices = dict(zip(self._stages, [first, *others], strict=True))
        fields = [(name, ImplicitStage) for name in self._stages]
        workspace_class = make_dataclass(
            "MethodWorkspace", fields, bases=(StepWorkspace,), kw_only=True, slots=True
        )

        def make_stage(matrix: FactorizedMatrix, native: bool) -> ImplicitStage:
            linear = matrix.make_solver(native, "auto")
            y, yp, offset, change, prediction = (np.zeros(form.size) for _ in range(5))
            return ImplicitStage(y, yp, offset, change, linear, matrix.nonzeros, prediction)

        def make_workspace(native: bool) -> Any:
            return workspace_class(
                form=form.buffers(native),
                y=np.zeros(form.size),
                yp=np.zeros(form.size),
                weights=weights,
                newton_tolerance=newton_tolerance,
                has_impulses=int(form.formulation.impulses),
                residual=np.zeros(form.size),
                rows=allocate_rows(1 + 3 * n + m, self.steps_per_check),
                **{name: make_stage(matrix, native) for name, matrix in self._matrices.items()},
            )

        def solvers(run: Any) -> list[tuple[Any, FactorizedMatrix]]:
            return [(getattr(run, name).linear, matrix) for name, matrix in self._matrices.items()]

        loop = _loop_over(step_function)
        self._step_loop = StepLoop(loop, make_workspace, solvers, form.is_native)
        self._run = self._step_loop.work

    @property
    def is_native(self) -> bool:
        """True if the steps run in machine code."""
        return self._step_loop.is_native

    @property
    def counts(self) -> Statistics:
        """Numbers of function calls, factorizations and Newton failures so far."""
        run = self._run
        solvers = [getattr(run, name).linear for name in self._stages]
        return Statistics(
            residual_calls=run.residuals,
            jacobian_calls=run.jacobians,
            factorizations=sum(linear.factorizations for linear in solvers),
            solves=sum(linear.solves for linear in solvers),
            newton_failures=run.failures,
        )

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin the smooth interval from `start` to `end` [s] at a consistent state."""
        run = self._run
        run.start, run.end, run.branch = start, end, branch
        run.step_count, run.total_steps = 0, count_equal_steps(end - start, self._step)
        run.y[:], run.yp[:] = self._form.pack(state)
        for name in self._stages:
            getattr(run, name).rate = math.inf

    def advance(self, most: int) -> Array:
        """Take 1 to `most` steps, as the rows permit; return their rows (t, q, v, a, lam).

        Raises
        ------
        StepError
            If no step is possible.
        """
        run = self._run
        run.most, run.filled = min(most, len(run.rows)), 0
        # Steps before a failure are returned first; the next call fails again.
        code = self._step_loop()
        if run.filled == 0:
            raise StepError(_FAILURES[code], run.residual, self._step)
        return run.rows[: run.filled]
