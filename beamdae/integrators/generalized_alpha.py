"""The generalized-alpha integrator of the paper and its family: Arnold & Bruls on index 3 and 2."""

from __future__ import annotations

import time as clock
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State, step_equations
from beamdae.errors import BeamdaeError, count, finite, one_of, positive
from beamdae.integrators.alpha_adaptive import AdaptiveRun, local_tolerance
from beamdae.integrators.alpha_step import FAMILIES, Parameters, Stepper, parameters
from beamdae.integrators.marching import Progress, Watch, longest_step, plan, reached
from beamdae.integrators.modified_newton import ModifiedNewton, NewtonError
from beamdae.results.solution import Solution, Status
from beamdae.results.trajectory import Segment
from beamdae.symbolic.factorizations import single_threaded

Array = np.ndarray
_MOST_STEPS = 1e9


@dataclass(frozen=True)
class GeneralizedAlpha:
    """Second-order one-step integrator with controllable damping of high frequencies.

    (1 - alpha_m) a_{n+1} + alpha_m a_n = (1 - alpha_f) q''_{n+1} + alpha_f q''_n with Newmark's
    formulas in the algorithmic acceleration a; the equations of motion hold at t_{n+1}.
    Arnold & Bruls, Multibody Syst. Dyn. 18 (2007) 185, doi:10.1007/s11044-007-9084-0.

    Parameters
    ----------
    step
        Step [s]; shortened to end on breakpoints and on the end time. With `rtol`, the first step
        after the start and after every breakpoint.
    rho_inf
        Spectral radius at infinite frequency, 0 (strongest damping) to 1 (none).
    formulation
        "index3" (the paper's) or "stabilized-index2" (Arnold, Bruls & Cardona, Numer. Math. 129
        (2015) 149), which holds the constraints on position and velocity level.
    start
        "cured": starting values that keep the multipliers second order from the first step,
        a0 = q''(0) + (alpha_m - alpha_f) h P q'''(0) and, on index 3,
        v0 + h^2 (1/6 - (alpha_m - alpha_f)/2 - beta) P q'''(0); "plain": without. For "newmark"
        1/2 - gamma stands for alpha_m - alpha_f.
    newton_tolerance
        Bound on the error of Newton's iteration relative to the largest acceleration. Errors of
        the iteration add up in the multipliers of the index-3 form when rho_inf is near 1: for
        convergence studies of lam take 1e-10.
    linear_solver
        "dense", "sparse", or "auto" by size.
    time_limit
        The run is given up after so many seconds; None: no limit.
    family
        "generalized-alpha", "hht" (rho_inf in [1/2, 1]) or "newmark" (of first order unless
        rho_inf = 1): what damps how much, see `alpha_step.parameters`.
    rtol
        None: every step is `step`. Otherwise steps adapt to an estimate of the local error of
        positions (`alpha_step.Stepper.error`) that keeps their error over a run within 100 rtol,
        up to a twentieth of the run and a quarter of the laws' time scale. Multipliers are of
        second order too, but not tested. With rho_inf near 1 nothing damps modes that a step
        passes over: what is left of them keeps steps short.
    max_steps
        With `rtol`: the run is given up after so many steps; None: no limit.
    """

    step: float = 1e-3
    rho_inf: float = 0.8
    formulation: str = "index3"
    start: str = "cured"
    newton_tolerance: float = 1e-7
    linear_solver: str = "auto"
    time_limit: float | None = None
    family: str = "generalized-alpha"
    rtol: float | None = None
    max_steps: int | None = None

    def __post_init__(self) -> None:
        positive("GeneralizedAlpha", "step", self.step)
        one_of("GeneralizedAlpha", "family", self.family, FAMILIES)
        least = 0.5 if self.family == "hht" else 0.0
        if not least <= finite("GeneralizedAlpha", "rho_inf", self.rho_inf) <= 1.0:
            where = " for family 'hht'" if self.family == "hht" else ""
            raise BeamdaeError(
                f"GeneralizedAlpha: rho_inf must lie in [{least:g}, 1]{where}, "
                f"got {self.rho_inf:g}."
            )
        one_of("GeneralizedAlpha", "formulation", self.formulation, ("index3", "stabilized-index2"))
        one_of("GeneralizedAlpha", "start", self.start, ("cured", "plain"))
        positive("GeneralizedAlpha", "newton_tolerance", self.newton_tolerance)
        one_of("GeneralizedAlpha", "linear_solver", self.linear_solver, ("auto", "dense", "sparse"))
        if self.time_limit is not None:
            positive("GeneralizedAlpha", "time_limit", self.time_limit)
        self._check_adaptivity()

    def _check_adaptivity(self) -> None:
        if self.max_steps is not None:
            count("GeneralizedAlpha", "max_steps", self.max_steps)
        if self.rtol is None:
            if self.max_steps is not None:
                raise BeamdaeError(
                    f"GeneralizedAlpha: max_steps needs rtol, with a fixed step the end time tells "
                    f"how many steps there are, got {self.max_steps}."
                )
            return
        if positive("GeneralizedAlpha", "rtol", self.rtol) > 0.1:
            raise BeamdaeError(f"GeneralizedAlpha: rtol must be at most 0.1, got {self.rtol:g}.")
        if self.family == "newmark" and self.rho_inf < 1.0:
            raise BeamdaeError(
                "GeneralizedAlpha: rtol needs a method of second order, family 'newmark' is one "
                f"with rho_inf = 1 only, got {self.rho_inf:g}."
            )

    @property
    def _member(self) -> Parameters:
        return parameters(self.family, self.rho_inf)

    @property
    def alpha_m(self) -> float:
        """Weight of a_n in the average of algorithmic accelerations."""
        return self._member.alpha_m

    @property
    def alpha_f(self) -> float:
        """Weight of q''_n in the average of accelerations."""
        return self._member.alpha_f

    @property
    def gamma(self) -> float:
        """Newmark parameter of the velocities."""
        return self._member.gamma

    @property
    def beta(self) -> float:
        """Newmark parameter (gamma + 1/2)^2 / 4 of the positions."""
        return self._member.beta

    @property
    def label(self) -> str:
        """Short name for tables."""
        family = "" if self.family == "generalized-alpha" else f"family={self.family}, "
        size = f"step={self.step:g}" if self.rtol is None else f"rtol={self.rtol:g}"
        return f"GeneralizedAlpha({family}{size})"

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
        index3 = self.formulation == "index3"
        form = step_equations(equations, not index3)
        newton = ModifiedNewton(form, self.newton_tolerance, self.linear_solver)
        route = plan(equations, times)
        stepper = Stepper(self._member, newton, route.starter, index3)
        setup_time = clock.perf_counter() - begin

        begin = clock.perf_counter()
        watch = Watch(progress, self.time_limit, begin)
        settings: dict[str, Any] = {"integrator": "GeneralizedAlpha", **asdict(self)}
        run: _FixedRun | AdaptiveRun
        if self.rtol is None:
            run = _FixedRun(stepper, self.start == "cured", self.step, watch)
        else:
            run = self._adaptive(stepper, equations, float(times[-1] - times[0]), watch)
            settings["local_tolerance"] = run.tolerance
        trajectory, status = route.march(run)
        wall_time = clock.perf_counter() - begin
        statistics = newton.statistics(trajectory.steps, setup_time, wall_time)
        return Solution(
            equations,
            trajectory,
            reached(times, trajectory),
            status,
            replace(statistics, rejected_steps=run.rejected),
            settings,
        )

    def _adaptive(
        self, stepper: Stepper, equations: EquationsOfMotion, duration: float, watch: Watch
    ) -> AdaptiveRun:
        assert self.rtol is not None
        return AdaptiveRun(
            stepper,
            self.start == "cured",
            self.step,
            longest_step(equations, duration),
            duration,
            local_tolerance(self.rtol),
            self.max_steps,
            watch,
        )


@dataclass
class _FixedRun:
    """Segments with a constant step."""

    stepper: Stepper
    cured: bool
    step: float
    watch: Watch
    rejected: ClassVar[int] = 0

    def __call__(
        self, start: float, end: float, phase: float, state: State
    ) -> tuple[Segment, Status]:
        wanted = np.ceil((end - start) / self.step - 1e-6)
        steps = int(max(min(wanted, _MOST_STEPS), 1))
        try:
            if wanted > _MOST_STEPS:
                raise MemoryError
            t = np.linspace(start, end, steps + 1)
            rows = State(*(np.empty((steps + 1, len(x))) for x in state))
        except MemoryError:
            reason = f"{wanted:.3g} steps from t = {start:g} s need more memory than there is"
            rows = State(*(x[None] for x in state))
            at_start = Segment(np.array([start]), rows, phase)
            return at_start, Status(False, f"{reason}; take a larger step")
        for row, x in zip(rows, state, strict=True):
            row[0] = x
        taken, stopped = self._march(t, phase, rows)
        status = Status(stopped is None, stopped or "reached the end")
        return Segment(t[: taken + 1], State(*(x[: taken + 1] for x in rows)), phase), status

    def _march(self, t: Array, phase: float, rows: State) -> tuple[int, str | None]:
        """Fill the rows; returns how many steps were taken, and why no more."""
        h = (t[-1] - t[0]) / (len(t) - 1)
        time = np.array([t[0], phase])
        motion = self.stepper.start(time, State(*(x[0] for x in rows)), h, self.cured)
        for k in range(1, len(t)):
            time[0] = t[k]
            try:
                motion = self.stepper.advance(time, motion)
                stop = self.watch(t[k]) if k % self.watch.interval == 0 else None
            except NewtonError as problem:
                return k - 1, f"stopped at t = {t[k - 1]:.6g} s: {problem}"
            except KeyboardInterrupt:
                return k - 1, f"interrupted at t = {t[k - 1]:.6g} s"
            for row, x in zip(rows, motion.state, strict=True):
                row[k] = x
            if stop is not None:
                return k, stop
        return len(t) - 1, None
