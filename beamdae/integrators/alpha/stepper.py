"""Runs of the generalized-alpha family: what a drive asks of its loops."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.step_equations import StepEquations, StepPrediction
from beamdae.errors import BeamdaeError
from beamdae.integrators.alpha.family import AlphaStart
from beamdae.integrators.alpha.jerk import AdaptiveAlphaWorkspace, JerkEquations
from beamdae.integrators.alpha.step_loop import (
    ERROR_TOO_LARGE,
    FIRST_STEP,
    NOT_CONVERGED,
    NOT_FINITE,
    NOT_RESUMED,
    set_step,
    take_adaptive_steps,
    take_fixed_steps,
)
from beamdae.integrators.alpha.workspace import AlphaWorkspace, Motion
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.integrators.method import StepError
from beamdae.native.return_codes import SINGULAR
from beamdae.results.outcome import Statistics

Array = np.ndarray

# What rounding leaves of an increment, relative to the scale of its coordinate or to the size of
# the mechanism. Ten times as much would show in the sixth digit of long runs.
_POSITION_ROUNDING = 1e-15
# Smallest step over the length of the run.
_MIN_STEP_SHARE = 1e-9
_STEPS_PER_CHECK = 64
_REASONS = {
    NOT_CONVERGED: "Newton's iteration did not converge",
    NOT_FINITE: "the residual is not finite",
    SINGULAR: "the matrix is singular or not finite",
    ERROR_TOO_LARGE: "the error test failed",
    NOT_RESUMED: "the joints have become dependent on each other",
}
_ADVICE = {NOT_FINITE: "check laws and start values"}


class AlphaStepper:
    """What fixed and adaptive steps have in common."""

    rows_per_step: ClassVar[int] = 1
    steps_per_check: ClassVar[int] = _STEPS_PER_CHECK
    _loop: ClassVar[Any]

    def __init__(
        self,
        form: StepEquations,
        start: AlphaStart,
        scales: Array,
        newton_tolerance: float,
        linear_solver: str,
        *,
        bounds: tuple[float, float, float] = (1.0, 1.0, 1.0),
    ) -> None:
        """`bounds` are the tolerance of a step, the largest and the smallest one."""
        self._starting = start
        tolerance, largest, smallest = bounds
        n, m = form.equations.n, form.equations.m
        matrix, weights = FactorizedMatrix.of(form.pattern), 1.0 / scales
        size = float(np.max(form.equations.position_scales * weights))

        def motion() -> Motion:
            q, v, ddq, a = np.zeros((4, n))
            return Motion(q, v, ddq, a, np.zeros(m))

        def make(native: bool) -> AlphaWorkspace:
            def vector() -> Array:
                return np.zeros(n)

            member = start.member
            return self._made(
                native,
                form=form.buffers(native),
                linear=matrix.linear(native, linear_solver),
                alpha_m=member.alpha_m,
                alpha_f=member.alpha_f,
                gamma=member.gamma,
                beta=member.beta,
                defect=member.defect,
                now=motion(),
                kept=motion(),
                at=StepPrediction(vector(), vector(), vector(), vector(), np.zeros(3)),
                a_p=vector(),
                ddq_n=vector(),
                a_n=vector(),
                lam_n=np.zeros(m),
                x=np.zeros(form.size),
                start=np.zeros(form.size),
                change=np.zeros(form.pattern.shape[0]),
                nonzeros=matrix.nonzeros,
                weights=weights,
                rows=np.zeros((_STEPS_PER_CHECK, 1 + 3 * n + m)),
                newton_tolerance=newton_tolerance,
                least=_POSITION_ROUNDING * max(1.0, size),
                tolerance=tolerance,
                largest=largest,
                smallest=smallest,
            )

        def matrices(run: AlphaWorkspace) -> list[tuple[Any, FactorizedMatrix]]:
            return [(run.linear, matrix), *self._more_matrices(run)]

        is_native = form.is_native and self._is_native
        self._running = StepLoop(type(self)._loop, make, matrices, is_native)
        self._run = self._running.work
        self._code = 0

    @property
    def _is_native(self) -> bool:
        """Whether all that the loop takes besides its equations can be had in machine code."""
        return True

    def _made(self, native: bool, **parts: Any) -> AlphaWorkspace:
        """What the loop works on; `native` tells for which kind of it."""
        return AlphaWorkspace(**parts)

    def _more_matrices(self, run: Any) -> list[tuple[Any, FactorizedMatrix]]:
        """Further ones it factorizes."""
        return []

    @property
    def counts(self) -> Statistics:
        """What it cost."""
        run = self._run
        return Statistics(
            rejected_steps=run.rejected,
            residual_calls=run.residuals,
            jacobian_calls=run.jacobians,
            factorizations=run.linear.factorizations,
            solves=run.linear.solves,
            newton_failures=run.failures,
        )

    def advance(self, most: int) -> Array:
        """Rows of one to `most` more steps.

        Raises
        ------
        StepError
            If there is none.
        """
        run = self._run
        run.most, run.filled = min(most, _STEPS_PER_CHECK), 0
        if self._code >= 0:
            while (code := self._running()) == FIRST_STEP:
                self._begin_with(run.next)
            # What went before a failure is not lost.
            self._code = code
        if run.filled == 0:
            raise StepError(self._reason(self._code))
        return run.rows[: run.filled]

    def _begin(self, start: float, end: float, branch: float, state: State) -> None:
        run = self._run
        run.t = run.start_time = start
        run.end, run.branch = end, branch
        self._code, self._start = 0, state

    def _begin_with(self, h: float) -> None:
        """Begin the interval with steps h."""
        run = self._run
        try:
            found = self._starting.initial_motion(np.array([run.t, run.branch]), self._start, h)
        except BeamdaeError as problem:
            raise StepError(str(problem)) from problem
        for name in ("q", "v", "ddq", "a", "lam"):
            getattr(run.now, name)[:] = getattr(found, name)
        set_step(run, h)

    def _reason(self, code: int) -> str:
        return f"{_REASONS[code]}; {_ADVICE.get(code, 'take a smaller step')}"


class FixedAlphaStepper(AlphaStepper):
    """Steps of equal length in each interval, as near to the one wanted as its end allows."""

    _loop = staticmethod(take_fixed_steps)
    resolved_options: ClassVar[dict[str, Any]] = {}

    def __init__(self, *form: Any, step: float) -> None:
        super().__init__(*form)
        self._step = step

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin a smooth interval."""
        self._begin(start, end, branch, state)
        run = self._run
        run.taken, run.total = 0, max(int(np.ceil((end - start) / self._step - 1e-6)), 1)
        run.kept.h = 0.0
        self._begin_with((end - start) / run.total)


class AdaptiveAlphaStepper(AlphaStepper):
    """Steps that keep the estimated error of each below a tolerance.

    They begin with `first` in every interval and stay between a billionth of the run and the
    largest one.
    """

    _loop = staticmethod(take_adaptive_steps)

    def __init__(
        self,
        form: StepEquations,
        start: AlphaStart,
        *settings: Any,
        first: float,
        largest: float,
        duration: float,
        tolerance: float,
    ) -> None:
        equations = form.equations
        self._corrects = start.index3 and equations.m > 0
        self._jerks = JerkEquations.of(equations)
        bounds = (tolerance, largest, _MIN_STEP_SHARE * duration)
        super().__init__(form, start, *settings, bounds=bounds)
        self._first = first

    @property
    def _is_native(self) -> bool:
        return self._jerks.is_native

    def _made(self, native: bool, **parts: Any) -> AlphaWorkspace:
        jerk = self._jerks.buffers(native)
        return AdaptiveAlphaWorkspace(**parts, jerk=jerk, corrects=int(self._corrects))

    @property
    def resolved_options(self) -> dict[str, Any]:
        """The tolerance of a step."""
        return {"local_tolerance": self._run.tolerance}

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin a smooth interval."""
        self._begin(start, end, branch, state)
        run = self._run
        run.next = min(self._first, run.largest)
        run.seen, run.worst = 0, 0.0
        run.kept.h = run.now.h = 0.0

    def _more_matrices(self, run: Any) -> list[tuple[Any, FactorizedMatrix]]:
        return [(run.jerk.linear, self._jerks.matrix)]

    def _reason(self, code: int) -> str:
        run = self._run
        if code == NOT_RESUMED:
            # What moves without inertia there has a name.
            time = np.array([run.t, run.branch])
            try:
                self._starting.starter.acceleration(time, run.kept.q, run.kept.v)
            except BeamdaeError as problem:
                return str(problem)
        return (
            f"{_REASONS[code]} even with a step of {run.next:.2g} s; "
            "check laws and start values, or loosen rtol"
        )
