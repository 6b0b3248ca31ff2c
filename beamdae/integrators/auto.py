"""Automatic choice of the integrator by natural modes, damping and rtol."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.integrators.drive import drive
from beamdae.integrators.ida.ida import Ida
from beamdae.integrators.integrator import AdaptiveIntegrator, Progress, require_tolerance
from beamdae.integrators.method import Method
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.radau.radau import Radau
from beamdae.integrators.run_plan import RunPlan
from beamdae.results.solution import Solution

Array = np.ndarray


@dataclass(frozen=True)
class Auto(AdaptiveIntegrator):
    """Choose `Ida` or `Radau`, whichever is cheaper at this tolerance.

    `Ida` is chosen except in two cases, in which the fifth-order `Radau` is cheaper:

    - Lightly damped modes limit BDF to order 2, and rtol is below 3e-6. Each further digit would
      then take several times as many steps.
    - The fastest modes are 30 to 300 times faster than the motion, so that BDF would resolve them.

    validation/tolerances prints the cost of both integrators.

    Parameters
    ----------
    rtol
        Relative tolerance; absolute tolerances follow from the scales of the mechanism.
    max_step
        Longest step [s]. Defaults to a twentieth of the run, or to a quarter of the time scale of
        the laws if this is shorter.
    max_steps
        Maximum number of steps. Defaults to no limit; the run still stops if its steps become too
        short to reach the end (`limits.StallDetector`).
    time_limit
        Maximum wall time [s]. Defaults to no limit.
    """

    rtol: float = 1e-5
    max_step: float | None = None
    max_steps: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_tolerance(self)

    def integrate(
        self, equations: EquationsOfMotion, times: Array, progress: Progress | None = None
    ) -> Solution:
        """Integrate over the output times; see `Integrator.integrate`."""
        return drive(self, equations, times, self._choose_method, progress, self._pilot_method)

    def _choose_method(self, plan: RunPlan) -> Method:
        stepper = Ida(self.rtol, max_step=self.max_step).method_on(plan)
        if not stepper.prefers_radau:
            return stepper
        return Radau(self.rtol, max_step=self.max_step).method_on(plan)

    def _pilot_method(self, plan: RunPlan) -> Method:
        return Ida(PILOT_RTOL, max_step=self.max_step).method_on(plan)
