"""Stepper of `Radau`: error weights and restarts around the loop of the core."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from beamdae.core.return_codes import (
    ERROR_TOO_LARGE,
    NOT_CONVERGED,
    NOT_FINITE,
    SINGULAR,
    TOO_SMALL,
)
from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.compliant_equations import mix_equations
from beamdae.equations.formulations.first_order import (
    FirstOrderForm,
    formulate_first_order,
    reduce_kinematics,
)
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.integrators.error_control import (
    POSITION_ROUNDING,
    STIFF_RATIO_RADAU,
    motion_scales,
    plan_multiplier_tolerances,
    reduce_tolerance,
    resolve_error_control,
)
from beamdae.integrators.integrator import (
    MATRIX_SINGULAR,
    RESIDUAL_NOT_FINITE,
    StepError,
)
from beamdae.integrators.radau.coefficients import TABLEAU
from beamdae.integrators.run_plan import RunPlan
from beamdae.results.outcome import Statistics

if TYPE_CHECKING:
    from beamdae.integrators.compiled_run import InputJump

Array = np.ndarray

STABILIZED_FORM = "stabilized-index1"
_ORDER = 5
# Shortest step, relative to the larger time of an interval; shorter steps are lost in rounding.
_MIN_STEP_SHARE = 1e-12
# Fewer than with Ida, because a step of Radau costs as much as ten steps of Ida.
_STEPS_PER_CHECK = 8
_STAGES = 3
_FAILURES = {
    NOT_CONVERGED: "Newton's iteration did not converge at the smallest step; check the model near "
    "this time",
    NOT_FINITE: RESIDUAL_NOT_FINITE,
    SINGULAR: MATRIX_SINGULAR,
    ERROR_TOO_LARGE: "the error test failed at the smallest step; check laws and start values, or "
    "loosen rtol",
    TOO_SMALL: "the step is too small to advance time; check laws and start values",
}

# Local tolerance = factor * rtol^exponent by the components in the error test, calibrated so that
# the largest error of a run stays below 100 rtol, or below 30 rtol with damping. Deflections of
# damped beams follow the accelerations of a linkage, which magnify its errors: with a factor of
# 0.6, they exceeded 30 rtol in a fifth of random linkages.
_TOLERANCE_LAWS = {
    "velocities": (0.6, 0.9),
    "rigid velocities": (0.15, 0.9),
    "positions": (0.76, 1),
}
# One-sided forces, such as contacts, are not smooth, and impacts amplify errors.
_ONE_SIDED_LAW = (0.238, 1)
# The local tolerance falls with the number of periods to this power; see `error_control`.
_PERIOD_EXPONENT = 0.5
_PERIOD_EXPONENT_VELOCITIES = 1.0  # if all velocities are tested
# Beyond ten periods: a four-bar that swings freely for 35 periods was wrong by 106, 46 and 30 rtol
# at 1e-3, 1e-4 and 1e-5 without this exponent; with it, by 10, 7 and 16.
_PERIOD_EXPONENT_LONG = 2.0
# Largest permitted Newton error, relative to the local tolerance, ...
_MAX_ITERATION_FRACTION = 0.03
# ... also limited to this factor times the square root of the local tolerance, because the true
# error (order 6) decreases faster than its estimate (order 4).
_ITERATION_FRACTION_OF_ROOT = 3.0
# Largest permitted Newton error, relative to the local tolerance, if the iteration stagnates:
# rounding errors of the velocities of stiff beams are 10 to 30 times the usual limit at rtol 1e-8.
_MAX_STAGNATION_FRACTION = 0.1


class RadauStepper:
    """Stepper of Radau IIA: up to 8 steps per call, with one row per stage."""

    rows_per_step: ClassVar[int] = _STAGES
    steps_per_check: ClassVar[int] = _STEPS_PER_CHECK

    def __init__(
        self,
        rtol: float,
        error_control: str,
        max_step: float | None,
        plan: RunPlan,
    ) -> None:
        self._equations = plan.equations
        self._form = form = formulate_stages(plan.equations)
        self._scales = motion_scales(plan)
        self._control = resolve_error_control(
            error_control,
            _ORDER,
            form.formulation,
            rtol,
            self._scales.rate,
            STIFF_RATIO_RADAU,
            plan.fastest_modes,
        )
        # Errors accumulate over the periods of the motion.
        policy, periods = self._control.policy, self._scales.periods
        is_one_sided = any(term.kernel.is_one_sided for term in form.equations.forces)
        factor, exponent = _ONE_SIDED_LAW if is_one_sided else _TOLERANCE_LAWS[policy]
        by_period = _PERIOD_EXPONENT_VELOCITIES if policy == "velocities" else _PERIOD_EXPONENT
        reduction_by_periods = reduce_tolerance(periods, by_period, _PERIOD_EXPONENT_LONG)
        self._local = factor * rtol**exponent * reduction_by_periods
        pattern, jacobian, reduction = reduce_kinematics(form)
        real = plan.matrix("Radau", pattern)
        complex_ = FactorizedMatrix.from_pattern(pattern, complex, pivot_source=real)
        buffers = form.buffers()
        buffers.jacobian = jacobian.sum(True, plan.equations.p)
        multipliers = plan_multiplier_tolerances(plan, self._scales, rtol)
        n, m, size, reduced_size = plan.equations.n, plan.equations.m, form.size, pattern.shape[0]
        self._run = run = Workspace(
            "RadauWorkspace",
            tableau=TABLEAU,
            form=buffers,
            real_solver=real.make_solver(),
            complex_solver=complex_.make_solver(),
            reduction=reduction,
            step_size=Workspace("StepSizeState", longest=plan.longest_step(max_step)),
            y=np.zeros(size),
            yp=np.zeros(size),
            last_w=np.zeros((3, size)),
            w=np.zeros((3, size)),
            stages=np.zeros((3, size)),
            rates=np.zeros((3, size)),
            stage_residuals=np.zeros((3, size)),
            real_change=np.zeros(size),
            complex_change=np.zeros(size, complex),
            complex_real=np.zeros(size),
            complex_imaginary=np.zeros(size),
            right=np.zeros(reduced_size),
            complex_right=np.zeros(reduced_size, complex),
            extrapolation=np.zeros((3, 3)),
            velocities=np.zeros(n),
            jacobian=np.zeros(reduction.entry_count(pattern)),
            real_nonzeros=real.nonzeros,
            complex_nonzeros=complex_.nonzeros,
            entry_rows=pattern.indices.astype(np.intp),
            entry_columns=np.repeat(np.arange(reduced_size), np.diff(pattern.indptr)),
            error=np.zeros(size),
            difference=np.zeros(size),
            vector=np.zeros(reduced_size),
            product=np.zeros(reduced_size),
            constraint_errors=np.zeros(reduced_size),
            multiplier_weights=multipliers.weights.copy(),
            multiplier_tolerance=multipliers.tolerance,
            shortest_tested_step=multipliers.shortest_step,
            rows=np.zeros((_STAGES * _STEPS_PER_CHECK, 1 + 3 * n + m)),
            rate=1.0,
            failure_code=TOO_SMALL,
            **self._weights(),
        )
        pairs = (run.real_solver, real), (run.complex_solver, complex_)
        self._step_loop = StepLoop("take_radau_steps", run, *pairs)

    def _weights(self) -> dict[str, Any]:
        """Return the weights of the error test and of Newton's iteration, by field.

        Far from the origin, rounding errors of positions may exceed the tolerances of deformations.
        The tolerances of velocities do not grow with them: those of parts that are fixed to the
        ground would allow longer steps than near the origin.

        Newton's iteration includes velocities even if the error test excludes them: the next step
        starts from them, and in short steps positions do not reveal their errors.
        """
        scales, local = self._scales, self._local
        tolerances, near_origin = scales.tolerances(local), POSITION_ROUNDING * scales.size
        rounding = scales.rounding_ratio * near_origin
        positions = 1.0 / np.maximum(tolerances, rounding)
        velocities = 1.0 / (scales.rate * tolerances)
        tested = self._control.tested_velocities(self._form.equations, tangent_frames=True)
        fraction = min(_MAX_ITERATION_FRACTION, _ITERATION_FRACTION_OF_ROOT * np.sqrt(local))
        iterated = np.minimum(positions / fraction, 1.0 / rounding)
        return {
            "test_weights": np.concatenate([positions, velocities * tested]),
            "tested_velocity_weights": velocities * tested,
            "iteration_weights": np.concatenate([iterated, velocities / fraction]),
            "velocity_weights": velocities / fraction,
            "velocity_rounding_weights": 1.0 / near_origin,
            "rounding_ratio": scales.rounding_ratio,
            "stagnation_limit": _MAX_STAGNATION_FRACTION / fraction,
            "law_tolerance": local,
        }

    @property
    def workspace(self) -> Workspace:
        """Work arrays of the run, with its weights."""
        return self._run

    @property
    def resolved_options(self) -> dict[str, Any]:
        """Error control and local tolerance of the run."""
        return {
            "error_control": self._control.policy,
            "auto": self._control.reason,
            "method": "Radau",
            "local_tolerance": self._local,
        }

    @property
    def counts(self) -> Statistics:
        """Numbers of function calls, rejected steps, factorizations and Newton failures so far.

        Residuals are counted per stage, and real and complex factorizations are counted separately.
        """
        run = self._run
        return Statistics(
            rejected_steps=run.rejections,
            residual_calls=run.residuals,
            jacobian_calls=run.jacobians,
            factorizations=run.real_solver.factorizations + run.complex_solver.factorizations,
            solves=run.real_solver.solves + run.complex_solver.solves,
            newton_failures=run.failures,
        )

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin the smooth interval from `start` to `end` [s] at a consistent state.

        Earlier factors are discarded.
        """
        run, size = self._run, self._run.step_size
        run.t, run.branch = start, branch
        self._set_end(start, end)
        run.y[:], run.yp[:] = self._form.pack(state)
        run.factors_step, run.iterations, run.rate, run.failure_code = 0.0, 0, 1.0, TOO_SMALL
        # A long run with a law that changes fast may ask for a first step too small for the clock.
        first = max(self._scales.first_step(self._local, state), size.smallest)
        size.next_step = min(first, size.longest)
        size.last_step, size.last_error, size.is_retry = 0.0, 0.0, 0

    def resume(self, start: float, end: float, q: Array) -> State | None:
        """Continue from `start` to `end` [s] after held inputs have jumped; see `ResumableMethod`.

        The step size and the factors are kept, but the last polynomial does not predict stages,
        unless no input has changed.
        """
        run, size = self._run, self._run.step_size
        if run.t != start:
            return None
        has_jumped = not np.array_equal(q, run.y[: len(q)])
        before = State(*(x.copy() for x in self._form.unpack(run.y, run.yp)))
        state: State | None = before
        if has_jumped:
            state = self._input_jump.apply(start, run.branch, q, before)
            if state is None:
                return None
            run.y[:], run.yp[:] = self._form.pack(state)
            size.last_step, size.last_error, size.is_retry = 0.0, 0.0, 0
        self._set_end(start, end)
        # The last step may have been cut down by the end of a short interval.
        size.next_step = max(size.next_step, size.smallest)
        return state

    def _set_end(self, start: float, end: float) -> None:
        """Set the interval from `start` to `end` [s]."""
        run = self._run
        run.end = end
        run.step_size.smallest = _MIN_STEP_SHARE * max(abs(start), abs(run.end))

    @cached_property
    def _input_jump(self) -> InputJump:
        # Models without sampled inputs start faster without this import.
        from beamdae.integrators.compiled_run import InputJump

        return InputJump(self._equations)

    def advance(self, most: int) -> Array:
        """Take 1 to `most` steps, but at most 8; return rows (t, q, v, a, lam) of all stages.

        Raises
        ------
        StepError
            If no step is possible.
        """
        run = self._run
        run.most, run.filled = min(most, _STEPS_PER_CHECK), 0
        # Steps before a failure are returned first; the next call fails again.
        code = self._step_loop()
        if run.filled == 0:
            raise StepError(_FAILURES[code])
        return run.rows[: run.filled]


def formulate_stages(equations: EquationsOfMotion) -> FirstOrderForm:
    """Return the form of the stages, with the resultants of beams and springs as unknowns."""
    return formulate_first_order(mix_equations(equations), STABILIZED_FORM, apart=True)
