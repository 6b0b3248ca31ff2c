"""`Radau`: adaptive implicit Runge-Kutta method of order 5 on the stabilized index-1 form."""

from __future__ import annotations

from dataclasses import dataclass, replace

from beamdae.errors import require_choice
from beamdae.integrators.error_control import ERROR_CONTROL
from beamdae.integrators.integrator import DEFAULT_RTOL, AdaptiveIntegrator, require_tolerance
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.radau.stepper import RadauStepper
from beamdae.integrators.run_plan import RunPlan

_ERROR_CONTROL = tuple(x for x in ERROR_CONTROL if x != "all")


@dataclass(frozen=True)
class Radau(AdaptiveIntegrator):
    """Three-stage Radau IIA of order 5, variable step, on the stabilized index-1 form.

    Y_i = y_n + h sum_j a_ij Y'_j with R(t_n + c_i h, Y_i, Y'_i) = 0, c = ((4 - sqrt 6)/10,
    (4 + sqrt 6)/10, 1), and y_{n+1} = Y_3: collocation by polynomials of degree 3. The method is
    L-stable: modes too fast for the step are damped, not resolved. Constraints hold at every step.
    Positions and velocities are of order 5. Multipliers and, in constrained directions,
    accelerations are of order 3 (Hairer, Lubich & Roche, Lecture Notes in Mathematics 1409, 1989,
    for the index-2 form, which has the same stages). RADAU5: Hairer & Wanner, Solving ODEs II,
    1996, section IV.8.

    Departures from RADAU5: the error estimate includes constraints. Axial and shear forces of beams
    and forces of springs are unknowns of Newton's iteration, so that steps do not depend on
    slenderness and stiffness. An iteration that stagnates at rounding errors has converged. Error
    weights come from the scales of the mechanism.

    Parameters
    ----------
    rtol
        Relative tolerance, 1e-14 to 0.1; absolute tolerances follow from the scales of the
        mechanism. Defaults to 1e-4: positions and deflections within 1 % of half their range, or
        0.3 % with material damping.
    error_control
        Components in the error test: "positions"; "rigid velocities" (positions, and velocities of
        rigid bodies and floating frames); or "velocities" (positions and all velocities). "auto"
        chooses by the stiffness of the mechanism. Multipliers are tested only if drivers and joints
        prescribe all motions, which then do not reveal their errors.
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
        If `rtol` is outside [1e-14, 0.1], `max_step` or `time_limit` is not positive, `max_steps`
        is not a whole number of at least 1, or another setting is not one of the listed values.
    """

    rtol: float = DEFAULT_RTOL
    error_control: str = "auto"
    max_step: float | None = None
    max_steps: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_tolerance(self)
        require_choice("Radau", "error_control", self.error_control, _ERROR_CONTROL)

    @property
    def pilot(self) -> Radau:
        """Integrator of pilot runs."""
        return replace(self, rtol=PILOT_RTOL)

    def method_on(self, plan: RunPlan) -> RadauStepper:
        """Return the stepper for a plan."""
        return RadauStepper(self.rtol, self.error_control, self.max_step, plan)
