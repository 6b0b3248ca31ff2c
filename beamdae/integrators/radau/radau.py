"""Radau IIA of order 5: an adaptive implicit Runge-Kutta method on the stabilized index-1 form."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import require_choice
from beamdae.integrators.drive import drive
from beamdae.integrators.integrator import AdaptiveIntegrator, Progress, require_tolerance
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.radau.stepper import RadauStepper
from beamdae.integrators.run_plan import RunPlan
from beamdae.results.solution import Solution

Array = np.ndarray


@dataclass(frozen=True)
class Radau(AdaptiveIntegrator):
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
        The run is given up after so many steps or seconds. None: no limit, but without max_steps it
        is given up as well where no end is in sight, see `limits.Pace`.
    """

    rtol: float = 1e-5
    error_control: str = "auto"
    max_step: float | None = None
    linear_solver: str = "auto"
    max_steps: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_tolerance(self)
        require_choice(
            "Radau", "error_control", self.error_control, ("auto", "positions", "velocities")
        )
        require_choice("Radau", "linear_solver", self.linear_solver, ("auto", "dense", "sparse"))

    def integrate(
        self, equations: EquationsOfMotion, times: Array, progress: Progress | None = None
    ) -> Solution:
        """Integrate from times[0] to times[-1]; see `Integrator.integrate`."""
        scout = replace(self, rtol=PILOT_RTOL).method_on
        return drive(self, equations, times, self.method_on, progress, scout)

    def method_on(self, plan: RunPlan) -> RadauStepper:
        """What takes its steps."""
        return RadauStepper(self.rtol, self.error_control, self.max_step, self.linear_solver, plan)
