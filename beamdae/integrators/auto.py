"""The choice between integrators: by the modes of the mechanism, their damping, and rtol."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.integrators.drive import drive
from beamdae.integrators.ida.ida import Ida, IdaStepper
from beamdae.integrators.integrator import AdaptiveIntegrator, Progress, require_tolerance
from beamdae.integrators.method import Method
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.radau.radau import Radau
from beamdae.integrators.run_plan import RunPlan
from beamdae.results.solution import Solution

Array = np.ndarray


@dataclass(frozen=True)
class Auto(AdaptiveIntegrator):
    """Ida or Radau, whichever takes less at this tolerance.

    Ida, but where lightly damped modes keep BDF at order 2 and rtol is below 3e-6, for errors then
    ask for several times as many steps with each digit; and where the fastest modes are 30 to 300
    times as fast as the motion, for BDF resolves those. There Radau, of order 5 and as stable,
    takes over. validation/tolerances prints what each of them takes.

    Parameters
    ----------
    rtol
        Relative tolerance, of the motion of each part.
    max_step
        Largest step [s]; None: a twentieth of the run, and a quarter of the laws' time scale.
    max_steps, time_limit
        The run is given up after so many steps or seconds. None: no limit, but without max_steps it
        is given up as well where no end is in sight, see `limits.Pace`.
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
        """Integrate from times[0] to times[-1]; see `Integrator.integrate`."""
        return drive(self, equations, times, self._chosen, progress, self._scouting)

    def _scouting(self, plan: RunPlan) -> Method:
        return IdaStepper(Ida(PILOT_RTOL, max_step=self.max_step), plan)

    def _chosen(self, plan: RunPlan) -> Method:
        bdf = IdaStepper(Ida(self.rtol, max_step=self.max_step), plan)
        if not bdf.prefers_radau:
            return bdf
        return Radau(self.rtol, max_step=self.max_step).method_on(plan)
