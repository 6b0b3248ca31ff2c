"""The generalized-alpha integrator of the paper: Arnold & Bruls on index 3 and index 2."""

from __future__ import annotations

import time as clock
from dataclasses import asdict, dataclass

import numpy as np

from beamdae.equations import EquationsOfMotion
from beamdae.errors import BeamdaeError, finite, one_of, positive
from beamdae.formulations import State, step_equations
from beamdae.initial import Starter
from beamdae.integrators.marching import Progress, Watch, plan, reached
from beamdae.integrators.modified_newton import ModifiedNewton, NewtonError
from beamdae.linear import single_threaded
from beamdae.solution import Solution, Status
from beamdae.trajectory import Segment

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
        Step [s]; shortened to end on breakpoints and on the end time.
    rho_inf
        Spectral radius at infinite frequency, 0 (strongest damping) to 1 (none).
    formulation
        "index3" (the paper's) or "stabilized-index2" (Arnold, Bruls & Cardona, Numer. Math. 129
        (2015) 149), which holds the constraints on position and velocity level.
    start
        "cured": starting values that keep the multipliers second order from the first step,
        a0 = q''(0) + (alpha_m - alpha_f) h P q'''(0) and, on index 3,
        v0 + h^2 (1/6 - (alpha_m - alpha_f)/2 - beta) P q'''(0); "plain": without.
    newton_tolerance
        Bound on the error of Newton's iteration relative to the largest acceleration. Errors of
        the iteration add up in the multipliers of the index-3 form when rho_inf is near 1: for
        convergence studies of lam take 1e-10.
    linear_solver
        "dense", "sparse", or "auto" by size.
    time_limit
        The run is given up after so many seconds; None: no limit.
    """

    step: float = 1e-3
    rho_inf: float = 0.8
    formulation: str = "index3"
    start: str = "cured"
    newton_tolerance: float = 1e-7
    linear_solver: str = "auto"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        positive("GeneralizedAlpha", "step", self.step)
        if not 0.0 <= finite("GeneralizedAlpha", "rho_inf", self.rho_inf) <= 1.0:
            raise BeamdaeError(
                f"GeneralizedAlpha: rho_inf must lie in [0, 1], got {self.rho_inf:g}."
            )
        one_of("GeneralizedAlpha", "formulation", self.formulation, ("index3", "stabilized-index2"))
        one_of("GeneralizedAlpha", "start", self.start, ("cured", "plain"))
        positive("GeneralizedAlpha", "newton_tolerance", self.newton_tolerance)
        one_of("GeneralizedAlpha", "linear_solver", self.linear_solver, ("auto", "dense", "sparse"))
        if self.time_limit is not None:
            positive("GeneralizedAlpha", "time_limit", self.time_limit)

    @property
    def alpha_m(self) -> float:
        """Parameter (2 rho_inf - 1) / (rho_inf + 1)."""
        return (2.0 * self.rho_inf - 1.0) / (self.rho_inf + 1.0)

    @property
    def alpha_f(self) -> float:
        """Parameter rho_inf / (rho_inf + 1)."""
        return self.rho_inf / (self.rho_inf + 1.0)

    @property
    def gamma(self) -> float:
        """Newmark parameter 1/2 + alpha_f - alpha_m."""
        return 0.5 + self.alpha_f - self.alpha_m

    @property
    def beta(self) -> float:
        """Newmark parameter (gamma + 1/2)^2 / 4."""
        return 0.25 * (self.gamma + 0.5) ** 2

    @property
    def label(self) -> str:
        """Short name for tables."""
        return f"GeneralizedAlpha(step={self.step:g})"

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
        form = step_equations(equations, self.formulation != "index3")
        newton = ModifiedNewton(form, self.newton_tolerance, self.linear_solver)
        route = plan(equations, times)
        setup_time = clock.perf_counter() - begin

        begin = clock.perf_counter()
        watch = Watch(progress, self.time_limit, begin)
        trajectory, status = route.march(_Run(self, route.starter, newton, watch))
        wall_time = clock.perf_counter() - begin
        return Solution(
            equations,
            trajectory,
            reached(times, trajectory),
            status,
            newton.statistics(trajectory.steps, setup_time, wall_time),
            {"integrator": "GeneralizedAlpha", **asdict(self)},
        )


@dataclass
class _Run:
    """One segment with a constant step."""

    settings: GeneralizedAlpha
    starter: Starter
    newton: ModifiedNewton
    watch: Watch

    def __call__(
        self, start: float, end: float, phase: float, state: State
    ) -> tuple[Segment, Status]:
        wanted = np.ceil((end - start) / self.settings.step - 1e-6)
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
        s, newton = self.settings, self.newton
        n, m = rows.q.shape[1], rows.lam.shape[1]
        h = (t[-1] - t[0]) / (len(t) - 1)
        share = (1.0 - s.alpha_f) / (1.0 - s.alpha_m)
        c_q = h**2 * s.beta
        coefficients = np.array([s.gamma / (h * s.beta), 1.0 / (c_q * share), c_q])
        time, x = np.array([t[0], phase]), np.zeros(newton.size)
        q = rows.q[0]
        v, ddq, a = self._started(time, h, State(*(x[0] for x in rows)))
        x[n : n + m] = c_q * rows.lam[0]
        newton.restart()
        for k in range(1, len(t)):
            time[0] = t[k]
            # Prediction: q'' as before; d is measured from there.
            a_p = (ddq - s.alpha_m * a) / (1.0 - s.alpha_m)
            q_p = q + h * v + h**2 * ((0.5 - s.beta) * a + s.beta * a_p)
            v_p = v + h * ((1.0 - s.gamma) * a + s.gamma * a_p)
            x[:n] = 0.0
            x[n + m :] = 0.0
            try:
                newton.aim(c_q, ddq)
                arguments = (time, q_p, v_p, ddq, q, coefficients)
                # Under a violent load the accelerations of light, stiff coordinates are huge for
                # an instant: then uniform motion is the better guess.
                newton.solve(x, *arguments, second_guess=q + h * v - q_p)
                stop = self.watch(t[k]) if k % self.watch.interval == 0 else None
            except NewtonError as problem:
                return k - 1, f"stopped at t = {t[k - 1]:.6g} s: {problem}"
            except KeyboardInterrupt:
                return k - 1, f"interrupted at t = {t[k - 1]:.6g} s"
            ddq = ddq + coefficients[1] * x[:n]
            a = a_p + x[:n] / c_q
            v = v_p + coefficients[0] * x[:n]
            q = newton.position(x, time, q_p, q)
            rows.q[k], rows.v[k], rows.a[k], rows.lam[k] = q, v, ddq, x[n : n + m] / c_q
            if stop is not None:
                return k, stop
        return len(t) - 1, None

    def _started(self, time: Array, h: float, state: State) -> tuple[Array, Array, Array]:
        """Velocities, accelerations and algorithmic accelerations to start from.

        Of the jerk only what the joints prescribe enters, and modes too stiff for the step respond
        to a load that is there at once as they would after the step: both would ring otherwise.
        """
        s = self.settings
        if s.start == "plain":
            return state.v, state.a, state.a
        jerk = self.starter.normal_jerk(time, state, 1e-2 * h)
        ddq, _ = self.starter.acceleration(time, state.q, state.v, stiff_time=0.5 * h)
        a = ddq + (s.alpha_m - s.alpha_f) * h * jerk
        if s.formulation != "index3":
            return state.v, ddq, a
        factor = 1.0 / 6.0 - 0.5 * (s.alpha_m - s.alpha_f) - s.beta
        return state.v + h**2 * factor * jerk, ddq, a
