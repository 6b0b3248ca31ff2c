"""IDA of SUNDIALS: variable-order, variable-step BDF on a first-order form."""

from __future__ import annotations

import contextlib
import io
import time as clock
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from sksundae.ida import IDA

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import FIRST_ORDER, FirstOrder, State, first_order
from beamdae.errors import one_of
from beamdae.integrators.error_control import ERROR_CONTROL, ErrorControl, Scales, resolve, scales
from beamdae.integrators.marching import (
    Progress,
    Watch,
    longest_step,
    plan,
    reached,
    require_tolerance,
)
from beamdae.integrators.preconditioned import PreconditionedResidual
from beamdae.results.solution import Solution, Status
from beamdae.results.trajectory import Segment
from beamdae.symbolic.factorizations import single_threaded

Array = np.ndarray
_STEPS_BETWEEN_PACKING = 1024


@dataclass(frozen=True)
class Ida:
    """Variable-order, variable-step BDF (IDA) on a first-order form of the equations of motion.

    Parameters
    ----------
    rtol
        Relative tolerance; absolute ones follow from the scales of the mechanism.
    formulation
        "stabilized-index1" (default), "ggl", "index2", "index1" or "index3".
    error_control
        Which components the error test sees: "positions", "velocities" (and positions) or "all"
        (and multipliers); "auto" decides by the stiffness of the mechanism.
    max_order
        1 to 5; "auto" is 2 where fast modes are undamped or lightly damped, 5 otherwise.
    max_step
        Largest step [s]; None: a twentieth of the run, and a quarter of the laws' time scale.
    linear_solver
        "dense", "sparse", or "auto" by size.
    max_steps, time_limit
        The run is given up after so many steps or seconds; None: no limit.
    """

    rtol: float = 1e-5
    formulation: str = "stabilized-index1"
    error_control: str = "auto"
    max_order: int | str = "auto"
    max_step: float | None = None
    linear_solver: str = "auto"
    max_steps: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_tolerance(self)
        one_of("Ida", "formulation", self.formulation, FIRST_ORDER)
        one_of("Ida", "error_control", self.error_control, ERROR_CONTROL)
        one_of("Ida", "max_order", self.max_order, ("auto", 1, 2, 3, 4, 5))
        one_of("Ida", "linear_solver", self.linear_solver, ("auto", "dense", "sparse"))

    @property
    def label(self) -> str:
        """Short name for tables."""
        return f"Ida(rtol={self.rtol:g})"

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
        form = first_order(equations, self.formulation)
        newton = PreconditionedResidual(form, self.linear_solver)
        route = plan(equations, times)
        duration = float(times[-1] - times[0])
        size = scales(equations, route.starter, route.time, route.state, duration)
        fastest_mode = partial(route.starter.fastest_mode, route.time, route.state)
        control = resolve(
            self.error_control, self.max_order, self.formulation, size.rate, fastest_mode
        )
        options = self._options(form, control, size, duration)
        setup_time = clock.perf_counter() - begin

        begin = clock.perf_counter()
        solver = IDA(newton.residual, jacfn=newton.jacobian, **options)
        watch = Watch(progress, self.time_limit, begin)
        trajectory, status = route.march(_Run(solver, newton, form, self.max_steps, watch))
        wall_time = clock.perf_counter() - begin
        return Solution(
            equations,
            trajectory,
            reached(times, trajectory),
            status,
            newton.statistics(setup_time, wall_time),
            {
                "integrator": "Ida",
                **asdict(self),
                "error_control": control.policy,
                "max_order": control.max_order,
                "auto": control.reason,
                "local_tolerance": float(options["rtol"]),
            },
        )

    def _options(
        self, form: FirstOrder, control: ErrorControl, scales: Scales, duration: float
    ) -> dict[str, Any]:
        tolerance = control.tolerance(self.rtol, form.size)
        return {
            "rtol": tolerance,
            "atol": control.absolute(tolerance, scales, form),
            "max_order": control.max_order,
            "max_step": self.max_step or longest_step(form.equations, duration),
            "linsolver": "band",
            "lband": 0,
            "uband": 0,
        }


class _Rows:
    """States of the accepted steps, packed now and then to keep memory small."""

    def __init__(self, form: FirstOrder, start: State) -> None:
        self._form = form
        self._packed = [State(*(x[None] for x in start))]
        self._y: list[Array] = []
        self._yp: list[Array] = []

    def append(self, y: Array, yp: Array) -> None:
        self._y.append(y)
        self._yp.append(yp)
        if len(self._y) == _STEPS_BETWEEN_PACKING:
            self._pack()

    def _pack(self) -> None:
        if self._y:
            rows = self._form.unpack(np.array(self._y), np.array(self._yp))
            self._packed.append(State(*(x.copy() for x in rows)))
            self._y, self._yp = [], []

    @property
    def state(self) -> State:
        self._pack()
        return State(*(np.concatenate(x) for x in zip(*self._packed, strict=True)))


@dataclass
class _Run:
    """One segment, step by step."""

    solver: IDA
    newton: PreconditionedResidual
    form: FirstOrder
    max_steps: int | None
    watch: Watch

    def __call__(
        self, start: float, end: float, phase: float, state: State
    ) -> tuple[Segment, Status]:
        t = [start]
        rows = _Rows(self.form, state)
        self.newton.restart(phase)
        status = Status(True, "reached the end")
        newton, step, look = self.newton, self.solver.step, self._next_look()
        try:
            # SUNDIALS prints its errors; the status says them.
            with contextlib.redirect_stdout(io.StringIO()):
                self.solver.init_step(start, *self.form.pack(state))
                while t[-1] < end:
                    result = step(end, "onestep", end)
                    stuck = not result.t > t[-1]
                    if stuck or not result.success:
                        status = Status(False, self._reason(result, t[-1]))
                        break
                    t.append(result.t)
                    rows.append(result.y, result.yp)
                    newton.steps += 1
                    if newton.steps < look:
                        continue
                    look = self._next_look()
                    if stop := self._stop(result.t, at_end=result.t >= end):
                        status = Status(False, stop)
                        break
        except KeyboardInterrupt:
            status = Status(False, f"interrupted at t = {t[-1]:.6g} s")
        return Segment(np.array(t), rows.state, phase), status

    def _next_look(self) -> int:
        """Number of steps after which to look at limits and progress again."""
        soon = self.newton.steps + self.watch.interval
        return soon if self.max_steps is None else min(soon, self.max_steps)

    def _stop(self, t: float, at_end: bool) -> str | None:
        if self.max_steps is not None and self.newton.steps >= self.max_steps and not at_end:
            return f"max_steps = {self.max_steps} taken, stopped at t = {t:.6g} s"
        return self.watch(t)

    def _reason(self, result: Any, t: float) -> str:
        advice = {
            -3: "the error test failed at the smallest step; loosen rtol or test positions only",
            -4: "Newton's iteration did not converge at the smallest step; check the model near "
            "this time, or use another formulation",
        }.get(result.status, str(result.message).rstrip("."))
        if result.success:
            advice = "the step became too small to advance time; check laws, or loosen rtol"
        if not np.all(np.isfinite(self.newton.last_residual)):
            advice = "the residual is not finite; check laws and start values"
        return f"stopped at t = {t:.6g} s: {advice}"
