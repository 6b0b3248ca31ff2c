"""Radau IIA of order 5: an adaptive implicit Runge-Kutta method on the stabilized index-1 form."""

from __future__ import annotations

import time as clock
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import FirstOrder, State, first_order
from beamdae.errors import one_of
from beamdae.integrators.error_control import resolve, scales
from beamdae.integrators.marching import (
    Progress,
    Watch,
    longest_step,
    plan,
    reached,
    require_tolerance,
)
from beamdae.integrators.radau_newton import Collocation
from beamdae.integrators.radau_steps import KEEP_RATE, StepSize, Tolerance
from beamdae.results.solution import Solution, Status
from beamdae.results.trajectory import Segment
from beamdae.symbolic.factorizations import single_threaded

Array = np.ndarray

_FORM = "stabilized-index1"
_ORDER = 5
# Relative to the times of a segment: what differs over it would be lost in rounding.
_SMALLEST_STEP = 1e-12
# The last step of a segment ends on its end if it comes this near.
_NEARLY = 1.0 - 1e-9
# A step costs as much as ten of Ida's.
_STEPS_BETWEEN_LOOKS = 8


@dataclass(frozen=True)
class Radau:
    """Three-stage Radau IIA of order 5, variable step, on the stabilized index-1 form.

    Y_i = y_n + h sum_j a_ij Y'_j with R(t_n + c_i h, Y_i, Y'_i) = 0, c = ((4 - sqrt 6)/10,
    (4 + sqrt 6)/10, 1), and y_{n+1} = Y_3: collocation by polynomials of degree 3. It is L-stable
    at its full order, so modes too fast for the step are damped, not resolved; and constraints
    hold at every step. Positions and velocities are of order 5, multipliers and, in what the
    joints hold, accelerations of order 3 (Hairer, Lubich & Roche, Lecture Notes in Mathematics
    1409, 1989, for index 2, whose stages these are). Hairer & Wanner, Solving ODEs II, 1996,
    section IV.8: RADAU5.

    Parameters
    ----------
    rtol
        Relative tolerance; absolute ones follow from the scales of the mechanism.
    error_control
        Which components the error test sees: "positions" or "velocities" (and positions); "auto"
        decides by the stiffness of the mechanism. Multipliers are not tested.
    max_step
        Largest step [s]; None: a twentieth of the run, and a quarter of the laws' time scale.
    linear_solver
        "dense", "sparse", or "auto" by size.
    max_steps, time_limit
        The run is given up after so many steps or seconds; None: no limit.
    """

    rtol: float = 1e-5
    error_control: str = "auto"
    max_step: float | None = None
    linear_solver: str = "auto"
    max_steps: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_tolerance(self)
        one_of("Radau", "error_control", self.error_control, ("auto", "positions", "velocities"))
        one_of("Radau", "linear_solver", self.linear_solver, ("auto", "dense", "sparse"))

    @property
    def label(self) -> str:
        """Short name for tables."""
        return f"Radau(rtol={self.rtol:g})"

    @single_threaded
    def integrate(
        self, equations: EquationsOfMotion, times: Array, progress: Progress | None = None
    ) -> Solution:
        """Integrate from times[0] to times[-1]; `times` ascend and are the output times [s].

        A run that fails returns what it reached, with the reason as its status.

        Raises
        ------
        BeamdaeError
            If the model has no consistent start.
        """
        begin = clock.perf_counter()
        form = first_order(equations, _FORM)
        newton = Collocation(form, self.linear_solver)
        route = plan(equations, times)
        duration = float(times[-1] - times[0])
        size = scales(equations, route.starter, route.time, route.state, duration)
        fastest_mode = partial(route.starter.fastest_mode, route.time, route.state)
        control = resolve(self.error_control, _ORDER, _FORM, size.rate, fastest_mode)
        tolerance = Tolerance.honest(self.rtol, size, control.policy == "velocities")
        longest = self.max_step or longest_step(equations, duration)
        setup_time = clock.perf_counter() - begin

        begin = clock.perf_counter()
        watch = Watch(progress, self.time_limit, begin)
        run = _Run(newton, form, tolerance, longest, self.max_steps, watch)
        trajectory, status = route.march(run)
        wall_time = clock.perf_counter() - begin
        return Solution(
            equations,
            trajectory,
            reached(times, trajectory),
            status,
            newton.statistics(run.steps, run.rejected, setup_time, wall_time),
            {
                "integrator": "Radau",
                **asdict(self),
                "error_control": control.policy,
                "auto": control.reason,
                "local_tolerance": tolerance.local,
            },
        )


@dataclass
class _Run:
    """One segment, step by step."""

    newton: Collocation
    form: FirstOrder
    tolerance: Tolerance
    longest: float
    max_steps: int | None
    watch: Watch
    steps: int = 0
    rejected: int = 0

    def __call__(
        self, start: float, end: float, phase: float, state: State
    ) -> tuple[Segment, Status]:
        self.newton.restart(phase)
        rows = [np.concatenate([[start], *state])]
        try:
            stop = self._march(rows, end, state)
        except KeyboardInterrupt:
            stop = f"interrupted at t = {rows[-1][0]:.6g} s"
        parts = np.cumsum([1, *(len(x) for x in state[:-1])])
        t, *columns = np.split(np.array(rows), parts, axis=1)
        status = Status(stop is None, stop or "reached the end")
        return Segment(t[:, 0], State(*columns), phase), status

    def _march(self, rows: list[Array], end: float, state: State) -> str | None:
        """Add a row (t, q, v, a, lam) a step; returns why it had to stop before the end."""
        newton, tolerance = self.newton, self.tolerance
        t, (y, yp) = float(rows[0][0]), self.form.pack(state)
        smallest = _SMALLEST_STEP * max(abs(t), abs(end))
        size = StepSize(tolerance.first_step(state), self.longest)
        reason = "the step is too small to advance time; check laws and start values"
        while t < end:
            left = end - t
            h = left if size.next >= _NEARLY * left else min(size.next, 0.5 * left)
            if h < min(smallest, left):
                return f"stopped at t = {t:.6g} s: {reason}"
            weights = tolerance.weights(y)
            bounds = tolerance.iteration_weights(weights, h)
            renew = not newton.serves(h, KEEP_RATE)
            if not newton.solve(t, y, yp, h, bounds, renew):
                if renew:
                    self.rejected += 1
                    size.diverged(h)
                    reason = newton.reason
                continue
            error = tolerance.norm(newton.error(yp, h), weights)
            if not error < 1.0:
                self.rejected += 1
                size.refused(h, error, newton)
                reason = "the error test failed at the smallest step; loosen rtol"
                continue
            size.accepted(h, error, newton)
            y, yp = newton.end(y, h)
            t = end if h == left else t + h
            rows.append(np.concatenate([[t], *self.form.unpack(y, yp)]))
            self.steps += 1
            if stop := self._stop(t, at_end=t >= end):
                return stop
        return None

    def _stop(self, t: float, at_end: bool) -> str | None:
        if self.max_steps is not None and self.steps >= self.max_steps and not at_end:
            return f"max_steps = {self.max_steps} taken, stopped at t = {t:.6g} s"
        return self.watch(t) if self.steps % _STEPS_BETWEEN_LOOKS == 0 else None
