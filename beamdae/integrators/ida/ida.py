"""`Ida`: variable-order, variable-step BDF by SUNDIALS IDA."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.first_order import FIRST_ORDER
from beamdae.errors import require_choice
from beamdae.integrators.drive import drive
from beamdae.integrators.error_control import ERROR_CONTROL
from beamdae.integrators.ida.stepper import IdaStepper
from beamdae.integrators.integrator import DEFAULT_RTOL, AdaptiveIntegrator, require_tolerance
from beamdae.integrators.limits import Progress
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.run_plan import RunPlan
from beamdae.results.solution import Solution

Array = np.ndarray


@dataclass(frozen=True)
class Ida(AdaptiveIntegrator):
    """Variable-order, variable-step BDF (IDA) on a first-order form of the equations of motion.

    R(t, y, y') = 0 with y = (q, v, multipliers) and h_n y'_n = sum_i alpha_{n,i} y_{n-i}, i = 0 to
    k: fixed-leading-coefficient BDF of order k = 1 to 5. Newton's iteration starts from the
    extrapolated polynomial through the last k + 1 values; the difference between this prediction
    and the solution gives the error estimate. IDA selects step and order. Brenan, Campbell &
    Petzold, Numerical Solution of Initial-Value Problems in Differential-Algebraic Equations, SIAM
    1996; Hindmarsh et al., ACM Trans. Math. Softw. 31 (2005) 363, doi:10.1145/1089014.1089020.

    Departures from IDA's defaults: beamdae computes the consistent start, including accelerations,
    and names dependent constraints; the order is limited to 2 where BDF of orders 3 to 5 is
    unstable; error weights come from the scales of the mechanism; and the residual is premultiplied
    by the inverse of its last Jacobian (`core/ida.c`), so that beamdae factorizes and solves the
    linear systems.

    The entry "ida" of `Solution.integrator` is "shared libraries" if its callbacks are in
    the core, and "scikit-sundae" if they are called through that package. The results of both
    agree within the tolerance. Without the core, the error test includes multipliers in runs
    with friction, nonholonomic constraints or only prescribed motions. With the core,
    `Solution.integrator` also contains "orders" (number of steps per order), "error_test_failures"
    and "limited_by": up to three unknowns that most often had the largest error of a step, with the
    fraction of such steps.

    Parameters
    ----------
    rtol
        Relative tolerance, 1e-14 to 0.1; absolute tolerances follow from the scales of the
        mechanism. Defaults to 1e-4.
    formulation
        "stabilized-index1" (default) or "ggl". "index2", "index1" and "index3" are for comparisons.
        With "index2" and "index1", positions drift off the constraints and may jump to another
        branch at singular positions (such as a parallelogram on its second pass; see
        `Solution.warnings`). With "index3", errors far exceed rtol: for a rigid slider-crank,
        errors were 20 to 170 rtol in positions and 160 to 1400 rtol in velocities; reactions of a
        parallelogram were wrong by 10 to 24 % of half their range at rtol=1e-4, by 0.5 % at 1e-6.
    error_control
        Components in the error test: "positions"; "rigid velocities" (positions, and velocities of
        rigid bodies and chord frames); "velocities" (positions and all velocities); or "all" (also
        multipliers). "auto" chooses by formulation and by the stiffness of the mechanism.
    max_order
        Highest order, 1 to 5. "auto" is 2 if fast modes are undamped or lightly damped, otherwise
        5.
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
        is not a whole number of at least 1, another setting is not one of the listed values, or (in
        a run) scikit-sundae cannot be imported.
    """

    rtol: float = DEFAULT_RTOL
    formulation: str = "stabilized-index1"
    error_control: str = "auto"
    max_order: int | str = "auto"
    max_step: float | None = None
    max_steps: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_tolerance(self)
        require_choice("Ida", "formulation", self.formulation, FIRST_ORDER)
        require_choice("Ida", "error_control", self.error_control, ERROR_CONTROL)
        require_choice("Ida", "max_order", self.max_order, ("auto", 1, 2, 3, 4, 5))

    def integrate(
        self, equations: EquationsOfMotion, times: Array, progress: Progress | None = None
    ) -> Solution:
        """Integrate over the output times; see `Integrator.integrate`."""
        # With an unstable order set by the user, the pilot run would measure spurious vibrations.
        pilot = replace(self, rtol=PILOT_RTOL, max_order="auto")
        return drive(self, equations, times, self.method_on, progress, pilot.method_on)

    def method_on(self, plan: RunPlan) -> IdaStepper:
        """Return the stepper for a plan."""
        return IdaStepper(
            self.rtol,
            self.formulation,
            self.error_control,
            self.max_order,
            self.max_step,
            plan,
        )
