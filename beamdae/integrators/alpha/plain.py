"""Generalized-alpha with fixed steps in plain Python: the reference of `core/alpha.c`.

It is used where the core cannot be compiled. Newton's iteration evaluates a matrix at each step.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.step_equations import StepEquations, StepPrediction
from beamdae.errors import BeamdaeError
from beamdae.integrators.alpha.family import AlphaStart, Motion
from beamdae.integrators.integrator import (
    MATRIX_SINGULAR,
    RESIDUAL_NOT_FINITE,
    STEPS_PER_CHECK,
    StepError,
    count_equal_steps,
)
from beamdae.linear.factorizations import SingularMatrixError, create_factorization
from beamdae.results.outcome import Statistics

Array = np.ndarray

_MAX_ITERATIONS = 12
# Corrections that decrease by less than this factor are rounding errors, if they are below
# `_MAX_ROUNDING` relative to the scales.
_STAGNATION_RATE = 0.5
_MAX_ROUNDING = 1e-9


class PlainAlpha:
    """Stepper with equal steps of at most `step` [s] in each interval; see `FixedAlphaStepper`."""

    resolved_options: ClassVar[dict[str, Any]] = {}
    steps_per_check: ClassVar[int] = STEPS_PER_CHECK

    def __init__(
        self,
        form: StepEquations,
        start: AlphaStart,
        scales: Array,
        newton_tolerance: float,
        *,
        step: float,
    ) -> None:
        self._form, self._start, self._scales = form, start, scales
        self._newton_tolerance, self._step = newton_tolerance, step
        self._linear, self._residuals = create_factorization(form.pattern), 0

    @property
    def counts(self) -> Statistics:
        """Numbers of function calls, factorizations and solutions so far."""
        linear = self._linear
        return Statistics(
            residual_calls=self._residuals,
            jacobian_calls=linear.factorizations,
            factorizations=linear.factorizations,
            solves=linear.solves,
        )

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin the smooth interval from `start` to `end` [s] at a consistent state."""
        self._times = np.linspace(start, end, 1 + count_equal_steps(end - start, self._step))
        self._k, self._branch = 0, branch
        h = (end - start) / (len(self._times) - 1)
        try:
            self._motion = self._start.initial_motion(np.array([start, branch]), state, h)
        except BeamdaeError as problem:
            raise StepError(str(problem)) from problem
        self._before = self._motion

    def step(self) -> tuple[float, State]:
        """Take one step; return the new time [s] and state."""
        member, now, before = self._start.member, self._motion, self._before
        n, m, h = len(now.q), len(now.lam), now.h
        c_v, c_a, c_f = member.coefficients(h)
        # q'' and the multipliers are extrapolated; x[:n] corrects the predicted positions.
        ddq = 2.0 * now.ddq - before.ddq
        averages = (1.0 - member.alpha_f) * ddq + member.alpha_f * now.ddq - member.alpha_m * now.a
        a = averages / (1.0 - member.alpha_m)
        q = now.q + h * now.v + h * h * ((0.5 - member.beta) * now.a + member.beta * a)
        v = now.v + h * ((1.0 - member.gamma) * now.a + member.gamma * a)
        x = np.zeros(self._form.size)
        x[n : n + m] = c_f * (2.0 * now.lam - before.lam)
        time = np.array([self._times[self._k + 1], self._branch])
        at = StepPrediction(q, v, ddq, now.q, np.array([c_v, c_a, c_f]))
        self._solve(time, at, x)
        d, lam = x[:n], x[n : n + m] / c_f
        position = self._form.position(time, at, x)
        self._before = now
        self._motion = Motion(position, v + c_v * d, ddq + c_a * d, a + d / c_f, lam, h)
        self._k += 1
        return float(time[0]), State(position, self._motion.v, self._motion.ddq, lam)

    def _solve(self, time: Array, at: StepPrediction, x: Array) -> None:
        """Solve the step equations for x by Newton's iteration with one matrix."""
        form, n, previous = self._form, len(at.q), np.inf
        padding = np.zeros(form.pattern.shape[0] - form.size)
        largest = np.max(np.abs(self._motion.ddq / self._scales), initial=0.0)
        limit = max(self._newton_tolerance * at.coefficients[2] * largest, np.finfo(float).eps)
        try:
            self._linear.factorize(form.jacobian(time, at, x))
        except SingularMatrixError:
            raise StepError(MATRIX_SINGULAR, step=self._motion.h) from None
        for _ in range(_MAX_ITERATIONS):
            residual = form.residual(time, at, x)
            self._residuals += 1
            if not np.isfinite(residual).all():
                raise StepError(RESIDUAL_NOT_FINITE, step=self._motion.h)
            change = self._linear.solve(np.concatenate([residual, padding]))[: form.size]
            x -= change
            size = float(np.linalg.norm(change[:n] / self._scales))
            if size <= limit or _STAGNATION_RATE * previous < size <= _MAX_ROUNDING:
                return
            previous = size
        raise StepError(
            "Newton's iteration did not converge; use a smaller step, or check the model",
            step=self._motion.h,
        )
