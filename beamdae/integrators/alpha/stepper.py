"""Steppers of `GeneralizedAlpha` with fixed and adaptive steps around the loops of the core."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from beamdae.core.linear_solver import LinearSolver
from beamdae.core.return_codes import (
    DONE,
    ERROR_TOO_LARGE,
    FIRST_STEP,
    NOT_CONVERGED,
    NOT_FINITE,
    SINGULAR,
    STEP_NOT_CHANGED,
)
from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.step_equations import StepEquations, StepPrediction
from beamdae.equations.starts.state_evaluator import plan_constraint_levels
from beamdae.errors import BeamdaeError
from beamdae.integrators.alpha.family import AlphaStart, Motion
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop, make_motion_buffers
from beamdae.integrators.error_control import UNTESTED_MULTIPLIERS, MultiplierTolerances
from beamdae.integrators.integrator import (
    FIXED_STEPS_PER_CHECK,
    STEPS_PER_CHECK,
    StepError,
    allocate_rows,
    count_equal_steps,
)
from beamdae.results.outcome import Statistics

Array = np.ndarray

# Relative difference below which two steps are equal.
SAME_STEP = 1e-9
# Rounding error of an increment, relative to the scale of its coordinate or to the size of the
# mechanism. A value ten times larger would change the sixth digit of long runs.
INCREMENT_ROUNDING = 1e-15
# Shortest adaptive step, relative to the duration of the run.
_MIN_STEP_SHARE = 1e-12
# Longest first step, relative to its smooth interval.
_FIRST_STEP_SHARE = 0.01
# In validation/tolerances, deflections exceeded the bound of the other integrators in a quarter of
# the runs (up to 6 times, and 74 times for an undamped vibration), and positions by more than a
# quarter only on an eccentric orbit (63 times).
_RTOL_NOTE = (
    "rtol controls positions in smooth motion; errors of deflections, reactions and positions in "
    "abrupt motion may exceed the bound; use Radau(rtol) or Auto(rtol), or estimate the errors"
)
_FAILURES = {
    NOT_CONVERGED: "Newton's iteration did not converge",
    NOT_FINITE: "the residual is not finite",
    SINGULAR: "the matrix is singular or not finite",
    ERROR_TOO_LARGE: "the error test failed",
    STEP_NOT_CHANGED: "the constraints have become dependent",
}


class AlphaStepper:
    """Base class of the steppers with fixed and adaptive steps."""

    rows_per_step: ClassVar[int] = 1
    steps_per_check: ClassVar[int] = STEPS_PER_CHECK
    _loop: ClassVar[str]

    def __init__(
        self,
        form: StepEquations,
        start: AlphaStart,
        scales: Array,
        newton_tolerance: float,
        *further: tuple[LinearSolver, FactorizedMatrix],
        **fields: Any,
    ) -> None:
        """Compile the loop, with further matrices, and further fields of its workspace."""
        self._alpha_start = start
        matrix, weights = FactorizedMatrix.from_pattern(form.pattern), 1.0 / scales
        size = float(np.max(form.equations.position_scales * weights))
        n, m, member = form.equations.n, form.equations.m, start.member

        def make_motion() -> Motion:
            q, v, ddq, a = np.zeros((4, n))
            return Motion(q, v, ddq, a, np.zeros(m))

        self._run = run = Workspace(
            "AlphaWorkspace",
            form=form.buffers(),
            linear=matrix.make_solver(),
            alpha_m=member.alpha_m,
            alpha_f=member.alpha_f,
            gamma=member.gamma,
            beta=member.beta,
            defect=member.defect,
            current=make_motion(),
            accepted_motion=make_motion(),
            prediction=StepPrediction(
                np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(3)
            ),
            a_predicted=np.zeros(n),
            ddq_n=np.zeros(n),
            a_n=np.zeros(n),
            lam_n=np.zeros(m),
            x=np.zeros(form.size),
            first_multipliers=np.zeros(form.size - n),
            change=np.zeros(form.pattern.shape[0]),
            nonzeros=matrix.nonzeros,
            weights=weights,
            reaction_weights=np.full(m, float(form.equations.multipliers_matter)),
            rows=allocate_rows(1 + 3 * n + m, self.steps_per_check),
            newton_tolerance=newton_tolerance,
            min_correction_limit=INCREMENT_ROUNDING * max(1.0, size),
            states=np.asarray(form.equations.states, np.intp),
            rate=math.inf,
            **fields,
        )
        pairs = (run.linear, matrix), *further
        self._solvers = [linear for linear, _ in pairs]
        self._step_loop, self._code = StepLoop(self._loop, run, *pairs), 0

    @property
    def workspace(self) -> Workspace:
        """Work arrays of the run."""
        return self._run

    @property
    def counts(self) -> Statistics:
        """Numbers of function calls, rejected steps, factorizations and Newton failures so far."""
        run = self._run
        return Statistics(
            rejected_steps=run.rejections,
            residual_calls=run.residuals,
            jacobian_calls=run.jacobians,
            factorizations=sum(linear.factorizations for linear in self._solvers),
            solves=sum(linear.solves for linear in self._solvers),
            newton_failures=run.failures,
        )

    def advance(self, most: int) -> Array:
        """Take 1 to `most` steps, as the rows permit; return their rows (t, q, v, a, lam).

        Raises
        ------
        StepError
            If no step is possible.
        """
        run = self._run
        run.most, run.filled = min(most, len(run.rows)), 0
        if self._code >= 0:
            while (code := self._step_loop()) == FIRST_STEP:
                self._set_initial_motion(run.next_step)
            # Steps before a failure are returned first; the next call reports the failure.
            self._code = code
        if run.filled == 0:
            raise StepError(self._describe_failure(self._code), step=run.current.h)
        return run.rows[: run.filled]

    def _begin(self, start: float, end: float, branch: float, state: State) -> None:
        run = self._run
        run.t = run.start_time = start
        run.end, run.branch = end, branch
        self._code, self._start_state = 0, state

    def _set_initial_motion(self, h: float) -> None:
        """Set the starting values of the interval for steps `h` [s]."""
        run, time = self._run, np.array([self._run.t, self._run.branch])
        try:
            motion = self._alpha_start.initial_motion(time, self._start_state, h)
        except BeamdaeError as problem:
            raise StepError(str(problem)) from problem
        for name in ("q", "v", "ddq", "a", "lam"):
            getattr(run.current, name)[:] = getattr(motion, name)
        run.current.h, run.has_started = h, 0

    def resume(self, start: float, end: float, q: Array) -> State | None:
        """Continue from `start` to `end` [s] after held inputs have jumped: `ResumableMethod`."""
        run, current = self._run, self._run.current
        if run.t != start or not self._can_resume(end):
            return None
        current.q[:] = q
        run.has_jumped, run.filled = 1, 0
        code = self._step_loop()
        run.has_jumped = 0
        if code != DONE:
            return None
        run.start_time = start
        self._prepare_steps(end)
        return State(*(x.copy() for x in (current.q, current.v, current.ddq, current.lam)))

    def _can_resume(self, end: float) -> bool:
        """Return True if the present motion can be continued to `end` [s]."""
        raise NotImplementedError

    def _prepare_steps(self, end: float) -> None:
        """Set the steps from the present time to `end` [s]."""
        raise NotImplementedError

    def _describe_failure(self, code: int) -> str:
        advice = (
            "check laws and start values"
            if code == NOT_FINITE
            else "use a smaller step, or check the model"
        )
        return f"{_FAILURES[code]}; {advice}"


class FixedAlphaStepper(AlphaStepper):
    """Stepper with equal steps of at most `step` [s] in each interval."""

    resolved_options: ClassVar[dict[str, Any]] = {}
    steps_per_check: ClassVar[int] = FIXED_STEPS_PER_CHECK
    _loop = "take_fixed_steps"

    def __init__(self, *settings: Any, step: float) -> None:
        super().__init__(*settings)
        self._step = step

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin the smooth interval from `start` to `end` [s] at a consistent state."""
        self._begin(start, end, branch, state)
        run = self._run
        run.accepted_motion.h = 0.0
        self._prepare_steps(end)
        self._set_initial_motion((run.end - start) / run.total_steps)

    def _prepare_steps(self, end: float) -> None:
        run = self._run
        run.end, run.step_count = end, 0
        run.total_steps = count_equal_steps(end - run.t, self._step)

    def _can_resume(self, end: float) -> bool:
        """Return True if steps of the present length fill the time to `end` [s]."""
        rest, h = end - self._run.t, self._run.current.h
        return abs(rest / count_equal_steps(rest, self._step) - h) <= SAME_STEP * h


class AdaptiveAlphaStepper(AlphaStepper):
    """Stepper with adaptive steps whose estimated errors stay below a tolerance.

    The first step tried in an interval is at most `first` [s], and no step exceeds `largest` [s].
    The run fails if the error or Newton's iteration requires steps below 1e-12 of its duration.
    """

    _loop = "take_adaptive_steps"

    def __init__(
        self,
        form: StepEquations,
        start: AlphaStart,
        *settings: Any,
        first: float,
        largest: float,
        duration: float,
        tolerance: float,
        velocity_weights: Array,
        multipliers: MultiplierTolerances = UNTESTED_MULTIPLIERS,
    ) -> None:
        jerk, matrix = make_motion_buffers(form.equations, plan_constraint_levels)
        super().__init__(
            form,
            start,
            *settings,
            (jerk.linear, matrix),
            tolerance=tolerance,
            max_step=largest,
            min_step=_MIN_STEP_SHARE * duration,
            jerk=jerk,
            constraint_rate=np.zeros(form.equations.m),
            corrects_velocities=int(start.index3 and form.equations.m > 0),
            velocity_weights=velocity_weights,
            multiplier_weights=multipliers.weights.copy(),
            multiplier_tolerance=multipliers.tolerance,
            shortest_tested_step=multipliers.shortest_step,
            lam_before=np.zeros(form.equations.m),
        )
        self._first_step = first

    @property
    def resolved_options(self) -> dict[str, Any]:
        """Local tolerance, relative to the scales of the coordinates, and a note on `rtol`."""
        return {"local_tolerance": self._run.tolerance, "note": _RTOL_NOTE}

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin the smooth interval from `start` to `end` [s] at a consistent state."""
        self._begin(start, end, branch, state)
        run = self._run
        # A law may vanish at both ends of an interval, such as a pulse.
        run.next_step = min(self._first_step, run.max_step, _FIRST_STEP_SHARE * (end - start))
        run.steps_checked, run.max_error = 0, 0.0
        run.unclipped_step = run.accepted_motion.h = run.current.h = 0.0

    def _can_resume(self, end: float) -> bool:
        return True

    def _prepare_steps(self, end: float) -> None:
        run = self._run
        run.end, run.next_step = end, max(run.next_step, run.unclipped_step)

    def _describe_failure(self, code: int) -> str:
        run = self._run
        if code == STEP_NOT_CHANGED:
            # This error names the coordinate without inertia or the dependent joints.
            time = np.array([run.t, run.branch])
            try:
                self._alpha_start.solver.acceleration(
                    time, run.accepted_motion.q, run.accepted_motion.v
                )
            except BeamdaeError as problem:
                return str(problem)
        return (
            f"{_FAILURES[code]} at a step of {run.next_step:.2g} s; "
            "check laws, masses, joints and start values, or loosen rtol"
        )
