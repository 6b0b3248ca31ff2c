"""Automatic choice of the integrator by the natural modes and the rate of the motion."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, replace

import numpy as np

from beamdae.core.library import load_core
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import MissingPackageError, warn_once
from beamdae.integrators.error_control import needs_radau
from beamdae.integrators.integrator import (
    DEFAULT_RTOL,
    AdaptiveIntegrator,
    Method,
    require_tolerance,
)
from beamdae.integrators.limits import Progress
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.radau.radau import Radau
from beamdae.integrators.run_plan import RunPlan
from beamdae.interrupts import Interrupted, acknowledge
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution

Array = np.ndarray


@dataclass(frozen=True)
class Auto(AdaptiveIntegrator):
    """Choose `Radau` for stiff or long motion, otherwise `Ida`.

    `Radau` is chosen if natural modes are over 300 times faster than the motion, if the run has
    more than 10 periods, with nonholonomic constraints, with friction whose regularization velocity
    the tolerance does not resolve, or with sampled controllers, after whose samples BDF begins
    again at order 1. Steps do not resolve modes that are this fast. If these
    modes are lightly damped, they limit BDF to order 2, whose phase error grows over free
    oscillations, whereas Radau IIA is of order 5 and damps them. Without such modes, BDF of order 5
    takes about the same time as Radau, except in long runs, because its phase errors are larger
    (tables in validation/tolerances). If `Ida` fails, for example near a singular position,
    `Radau` repeats the run, and the run that gets further is returned; `time_limit` applies to both
    together. Without scikit-sundae, `Radau` replaces `Ida`, which a `KernelWarning` reports.

    Parameters
    ----------
    rtol
        Relative tolerance, 1e-14 to 0.1; absolute tolerances follow from the scales of the
        mechanism. Defaults to 1e-4: positions and deflections within 1 % of half their range, or
        0.3 % with material damping.
    max_step
        Longest step [s]. Defaults to a twentieth of the run, or to a quarter of the time scale of
        the laws if this is shorter.
    max_steps
        Maximum number of steps. Defaults to no limit; the run still stops if its steps become too
        short to reach the end (`limits.PaceCheck`).
    time_limit
        Maximum wall time [s]. Defaults to no limit.

    Raises
    ------
    BeamdaeError
        If `rtol` is outside [1e-14, 0.1], `max_step` or `time_limit` is not positive, or
        `max_steps` is not a whole number of at least 1.
    """

    rtol: float = DEFAULT_RTOL
    max_step: float | None = None
    max_steps: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_tolerance(self)

    def integrate(
        self, equations: EquationsOfMotion, times: Array, progress: Progress | None = None
    ) -> Solution:
        """Integrate over the output times; see `Integrator.integrate`."""
        began = clock.perf_counter()
        first = super().integrate(equations, times, progress)
        failed = first.status.kind == "failed" and first.integrator["method"] == "Ida"
        if not failed or load_core() is None:  # Radau needs the core.
            return first
        remaining = self.time_limit
        if remaining is not None:
            remaining -= clock.perf_counter() - began
            if remaining <= 0.0:
                return first
        radau = replace(self._radau, max_steps=self.max_steps, time_limit=remaining)
        end = f"t = {first.trajectory.end:.6g} s"
        try:
            second = radau.integrate(equations, times, progress)
        except KeyboardInterrupt as problem:
            acknowledge()
            longer, status = first, Status("interrupted", f"interrupted at {end}")
            if isinstance(problem, Interrupted) and problem.partial is not None:
                # An interrupt ends the call, whichever run is longer.
                longer, status = self._longer_run(first, problem.partial), problem.partial.status
            raise Interrupted(status.sentence, replace(longer, status=status)) from problem
        return self._longer_run(first, second)

    def _longer_run(self, first: Solution, second: Solution) -> Solution:
        if second.trajectory.end <= first.trajectory.end:
            return first
        end = f"t = {first.trajectory.end:.6g} s"
        note = f"Ida failed at {end}; the run was repeated by Radau"
        own = {"integrator": self.method, "time_limit": self.time_limit, "note": note}
        settings = second.integrator | own
        return replace(second, made_by=self, integrator=settings)

    @property
    def pilot(self) -> Auto:
        """Integrator of pilot runs."""
        return replace(self, rtol=PILOT_RTOL)

    def method_on(self, plan: RunPlan) -> Method:
        """Return the stepper of `Radau` or `Ida` for a plan."""
        if load_core() is not None and needs_radau(plan, self.rtol):
            return self._radau.method_on(plan)
        # Imported here because many runs do not need Ida.
        from beamdae.integrators.ida.ida import Ida

        try:
            return Ida(self.rtol, max_step=self.max_step).method_on(plan)
        except MissingPackageError as problem:
            if load_core() is None:
                raise
            warn_once(f"Auto: {problem.reason}; Radau is used instead of Ida.")
            return self._radau.method_on(plan)

    @property
    def _radau(self) -> Radau:
        return Radau(self.rtol, max_step=self.max_step)
