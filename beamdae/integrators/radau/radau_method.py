"""Runs of Radau: what it weighs errors with, and what a drive asks of its loop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from beamdae.equations.formulations import FirstOrder, FirstOrderSums, State, first_order
from beamdae.integrators.compiled_run import Matrix, Running
from beamdae.integrators.error_control import ROUNDING, STIFF_FOR_RADAU, Scales, resolve, scales
from beamdae.integrators.method import StepError
from beamdae.integrators.radau.radau_loop import radau_steps
from beamdae.integrators.radau.workspace import (
    ERROR_TOO_LARGE,
    NOT_CONVERGED,
    NOT_FINITE,
    TOO_SMALL,
    RadauRun,
    StepSize,
)
from beamdae.integrators.run_plan import Route
from beamdae.linear.return_codes import SINGULAR
from beamdae.results.outcome import Statistics

Array = np.ndarray

_FORM = "stabilized-index1"
_ORDER = 5
# Relative to the times of an interval: what differs over it would be lost in rounding.
_SMALLEST_STEP = 1e-12
# One costs as much as ten of Ida's.
_LOOKS = 8
_REASONS = {
    NOT_CONVERGED: "Newton's iteration did not converge at the smallest step; check the model near "
    "this time",
    NOT_FINITE: "the residual is not finite; check laws and start values",
    SINGULAR: "the matrix is singular or not finite; check masses and joints",
    ERROR_TOO_LARGE: "the error test failed at the smallest step; loosen rtol",
    TOO_SMALL: "the step is too small to advance time; check laws and start values",
}

# The largest error over a run stays below 100 rtol (30 rtol with damping) with these.
_SAFETY = 0.15
_EXPONENT = 0.9
# What Newton's iteration may leave of the local tolerance: at most this much, and less at tight
# tolerances, for the error of order 6 falls faster than the estimate of order 4 that is tested.
_FRACTION = 0.03
_FRACTION_OF_ROOT = 3.0


@dataclass(frozen=True)
class Tolerance:
    """Tolerances of a step, for positions and velocities.

    Attributes
    ----------
    local
        Relative to the scales of the mechanism.
    velocities
        Whether the error test sees velocities.
    """

    local: float
    scales: Scales
    velocities: bool

    @classmethod
    def honest(cls, rtol: float, scales: Scales, velocities: bool) -> Tolerance:
        """The one that keeps the error of a whole run near `rtol`.

        The estimate falls with the fourth power of the step and the error of a run with the
        fifth, which asks for an exponent of 4/5, but with a lower one where fast modes are
        undamped: 0.9 serves both, on the cases of validation/tolerances.
        """
        return cls(_SAFETY * rtol**_EXPONENT, scales, velocities)

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
    def of_iteration(self) -> tuple[Array, Array]:
        """One over what Newton's iteration may leave of q, and of v in long steps.

        Velocities count whether they are tested or not: they are where the next step begins, and
        over short steps positions say nothing of them.
        """
        fraction = min(_FRACTION, _FRACTION_OF_ROOT * np.sqrt(self.local))
        positions, velocities = np.split(self.weights / fraction, 2)
        return np.minimum(positions, self.rounding), velocities

    @property
    def rounding(self) -> Array:
        """One over what rounding leaves of q."""
        return 1.0 / (ROUNDING * self.scales.size)


class Collocating:
    """Collocation, a few steps at a time."""

    rows_per_step: ClassVar[int] = 3
    steps_between_looks: ClassVar[int] = _LOOKS

    def __init__(
        self, rtol: float, error_control: str, max_step: float | None, solver: str, route: Route
    ) -> None:
        self._form = form = first_order(route.equations, _FORM, apart=True)
        self._scales = size = scales(route)
        self._control = resolve(
            error_control,
            _ORDER,
            form.formulation,
            rtol,
            size.rate,
            STIFF_FOR_RADAU,
            route.fastest_modes,
        )
        velocities = self._control.policy == "velocities"
        self._tolerance = tolerance = Tolerance.honest(rtol, size, velocities)
        longest = route.longest_step("Radau", max_step)
        real = route.matrix("Radau", form.pattern)
        pair = Matrix.of(form.pattern, complex, like=real)

        def make(native: bool) -> RadauRun:
            factors = real.linear(native, solver), pair.linear(native, solver)
            numbers = real.nonzeros, pair.nonzeros
            return _run(form, form.buffers(native), factors, numbers, tolerance, longest)

        def matrices(run: RadauRun) -> list[tuple[Any, Matrix]]:
            return [(run.real, real), (run.pair, pair)]

        self._running = Running(radau_steps, make, matrices, form.is_native)
        self._run = self._running.work

    @property
    def resolved(self) -> dict[str, Any]:
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
        size.smallest = _SMALLEST_STEP * max(abs(start), abs(end))
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
        run.most, run.filled = min(most, _LOOKS), 0
        # Asked again after a failure it fails again: what went before is not lost.
        code = self._running()
        if run.filled == 0:
            raise StepError(_REASONS[code], run.residuals_at[-1])
        return run.rows[: run.filled]


def _run(
    form: FirstOrder,
    buffers: FirstOrderSums,
    factors: tuple[Any, Any],
    nonzeros: tuple[Array, Array],
    tolerance: Tolerance,
    longest: float,
) -> RadauRun:
    n, m, size = form.equations.n, form.equations.m, form.size
    positions, velocities = tolerance.of_iteration
    return RadauRun(
        form=buffers,
        real=factors[0],
        pair=factors[1],
        size=StepSize(longest),
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
        rows=np.zeros((3 * _LOOKS, 1 + 3 * n + m)),
    )
