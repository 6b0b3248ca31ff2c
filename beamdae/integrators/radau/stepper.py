"""Runs of Radau: what it weighs errors with, and what a drive asks of its loop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.first_order import (
    FirstOrderBuffers,
    FirstOrderForm,
    formulate_first_order,
)
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.integrators.error_control import (
    POSITION_ROUNDING,
    STIFF_RATIO_RADAU,
    MotionScales,
    motion_scales,
    resolve_error_control,
)
from beamdae.integrators.method import StepError
from beamdae.integrators.radau.step_loop import take_radau_steps
from beamdae.integrators.radau.workspace import (
    ERROR_TOO_LARGE,
    NOT_CONVERGED,
    NOT_FINITE,
    TOO_SMALL,
    RadauWorkspace,
    StepSizeState,
)
from beamdae.integrators.run_plan import RunPlan
from beamdae.native.return_codes import SINGULAR
from beamdae.results.outcome import Statistics

Array = np.ndarray

_FORM = "stabilized-index1"
_ORDER = 5
# Relative to the times of an interval: what differs over it would be lost in rounding.
_MIN_STEP_SHARE = 1e-12
# One costs as much as ten of Ida's.
_STEPS_PER_CHECK = 8
_REASONS = {
    NOT_CONVERGED: "Newton's iteration did not converge at the smallest step; check the model near "
    "this time",
    NOT_FINITE: "the residual is not finite; check laws and start values",
    SINGULAR: "the matrix is singular or not finite; check masses and joints",
    ERROR_TOO_LARGE: "the error test failed at the smallest step; loosen rtol",
    TOO_SMALL: "the step is too small to advance time; check laws and start values",
}

# The largest error over a run stays below 100 rtol (30 rtol with damping) with these.
_TOLERANCE_FACTOR = 0.15
_TOLERANCE_EXPONENT = 0.9
# What Newton's iteration may leave of the local tolerance: at most this much, and less at tight
# tolerances, for the error of order 6 falls faster than the estimate of order 4 that is tested.
_MAX_ITERATION_FRACTION = 0.03
_ITERATION_FRACTION_OF_ROOT = 3.0


@dataclass(frozen=True)
class StepTolerance:
    """Tolerances of a step, for positions and velocities.

    Attributes
    ----------
    local
        Relative to the scales of the mechanism.
    velocities
        Whether the error test sees velocities.
    """

    local: float
    scales: MotionScales
    velocities: bool

    @classmethod
    def from_rtol(cls, rtol: float, scales: MotionScales, velocities: bool) -> StepTolerance:
        """The one that keeps the error of a whole run near `rtol`.

        The estimate falls with the fourth power of the step and the error of a run with the
        fifth, which asks for an exponent of 4/5, but with a lower one where fast modes are
        undamped: 0.9 serves both, on the cases of validation/tolerances.
        """
        return cls(_TOLERANCE_FACTOR * rtol**_TOLERANCE_EXPONENT, scales, velocities)

    @cached_property
    def weights(self) -> Array:
        """One over the tolerances of (q, v)."""
        positions = self.scales.tolerances(self.local)
        return 1.0 / np.concatenate([positions, self.scales.rate * positions])

    @property
    def tested(self) -> Array:
        """One over the tolerances of those the error test sees."""
        return self.weights if self.velocities else self.weights[: len(self.scales.size)]

    @property
    def iteration_weights(self) -> tuple[Array, Array]:
        """One over what Newton's iteration may leave of q, and of v in long steps.

        Velocities count whether they are tested or not: they are where the next step begins, and
        over short steps positions say nothing of them.
        """
        fraction = min(_MAX_ITERATION_FRACTION, _ITERATION_FRACTION_OF_ROOT * np.sqrt(self.local))
        positions, velocities = np.split(self.weights / fraction, 2)
        return np.minimum(positions, self.rounding), velocities

    @property
    def rounding(self) -> Array:
        """One over what rounding leaves of q."""
        return 1.0 / (POSITION_ROUNDING * self.scales.size)


class RadauStepper:
    """Collocation, a few steps at a time."""

    rows_per_step: ClassVar[int] = 3
    steps_per_check: ClassVar[int] = _STEPS_PER_CHECK

    def __init__(
        self, rtol: float, error_control: str, max_step: float | None, solver: str, plan: RunPlan
    ) -> None:
        self._form = form = formulate_first_order(plan.equations, _FORM, apart=True)
        self._scales = size = motion_scales(plan)
        self._control = resolve_error_control(
            error_control,
            _ORDER,
            form.formulation,
            rtol,
            size.rate,
            STIFF_RATIO_RADAU,
            plan.fastest_modes,
        )
        velocities = self._control.policy == "velocities"
        self._tolerance = tolerance = StepTolerance.from_rtol(rtol, size, velocities)
        longest = plan.longest_step("Radau", max_step)
        real = plan.matrix("Radau", form.pattern)
        pair = FactorizedMatrix.from_pattern(form.pattern, complex, pivot_source=real)

        def make(native: bool) -> RadauWorkspace:
            factors = real.make_solver(native, solver), pair.make_solver(native, solver)
            numbers = real.nonzeros, pair.nonzeros
            return _make_workspace(form, form.buffers(native), factors, numbers, tolerance, longest)

        def matrices(run: RadauWorkspace) -> list[tuple[Any, FactorizedMatrix]]:
            return [(run.real, real), (run.pair, pair)]

        self._running = StepLoop(take_radau_steps, make, matrices, form.is_native)
        self._run = self._running.work

    @property
    def resolved_options(self) -> dict[str, Any]:
        """What was chosen."""
        return {
            "error_control": self._control.policy,
            "auto": self._control.reason,
            "method": "Radau",
            "local_tolerance": self._tolerance.local,
        }

    @property
    def counts(self) -> Statistics:
        """What it cost; residuals are counted by stage, factorizations as real and complex ones."""
        run = self._run
        return Statistics(
            rejected_steps=run.rejected,
            residual_calls=run.residuals,
            jacobian_calls=run.jacobians,
            factorizations=run.real.factorizations + run.pair.factorizations,
            solves=run.real.solves + run.pair.solves,
            newton_failures=run.failures,
        )

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin a smooth interval, without factors and without a step before."""
        run, size = self._run, self._run.size
        run.t, run.end, run.branch = start, end, branch
        run.y[:], run.yp[:] = self._form.pack(state)
        run.factorized, run.iterations, run.rate, run.reason = 0.0, 0, 1.0, TOO_SMALL
        size.smallest = _MIN_STEP_SHARE * max(abs(start), abs(end))
        size.manageable = size.longest
        size.next = min(self._scales.first_step(self._tolerance.local, state), size.longest)
        size.before, size.error_before, size.repeated = 0.0, 0.0, 0

    def advance(self, most: int) -> Array:
        """Rows of one to `most` more steps and of the stages inside them.

        Raises
        ------
        StepError
            If there is none.
        """
        run = self._run
        run.most, run.filled = min(most, _STEPS_PER_CHECK), 0
        # Asked again after a failure it fails again: what went before is not lost.
        code = self._running()
        if run.filled == 0:
            raise StepError(_REASONS[code], run.residuals_at[-1])
        return run.rows[: run.filled]


def _make_workspace(
    form: FirstOrderForm,
    buffers: FirstOrderBuffers,
    factors: tuple[Any, Any],
    nonzeros: tuple[Array, Array],
    tolerance: StepTolerance,
    longest: float,
) -> RadauWorkspace:
    n, m, size = form.equations.n, form.equations.m, form.size
    positions, velocities = tolerance.iteration_weights
    return RadauWorkspace(
        form=buffers,
        real=factors[0],
        pair=factors[1],
        size=StepSizeState(longest),
        y=np.zeros(size),
        yp=np.zeros(size),
        before=np.zeros((3, size)),
        w=np.zeros((3, size)),
        stages=np.zeros((3, size)),
        rates=np.zeros((3, size)),
        residuals_at=np.zeros((3, size)),
        change=np.zeros(size),
        pair_change=np.zeros(size, complex),
        pair_real=np.zeros(size),
        pair_imaginary=np.zeros(size),
        ahead=np.zeros((3, 3)),
        jacobian=np.zeros(2 * form.pattern.nnz),
        real_nonzeros=nonzeros[0],
        pair_nonzeros=nonzeros[1],
        of_row=form.pattern.indices.astype(np.int64),
        of_column=np.repeat(np.arange(size), np.diff(form.pattern.indptr)),
        error=np.zeros(size),
        right=np.zeros(size),
        tested=tolerance.tested,
        bounds=np.concatenate([positions, velocities]),
        velocity_bounds=velocities,
        velocity_rounding=tolerance.rounding,
        rows=np.zeros((3 * _STEPS_PER_CHECK, 1 + 3 * n + m)),
    )
