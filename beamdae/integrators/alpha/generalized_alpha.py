"""`GeneralizedAlpha`: generalized-alpha, HHT and Newmark methods in index-3 or index-2 form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.core.library import load_core
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.errors import (
    BeamdaeError,
    choice_of,
    convert_fields,
    format_distinct,
    require_finite,
    require_positive,
)
from beamdae.integrators.alpha.family import (
    FAMILIES,
    AlphaParameters,
    AlphaStart,
    family_parameters,
)
from beamdae.integrators.alpha.plain import PlainAlpha
from beamdae.integrators.alpha.stepper import AdaptiveAlphaStepper, FixedAlphaStepper
from beamdae.integrators.error_control import (
    count_periods,
    motion_scales,
    plan_multiplier_tolerances,
    weigh_velocities,
)
from beamdae.integrators.integrator import (
    Accuracy,
    Integrator,
    Method,
    require_limits,
    require_tolerance,
)
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.radau.radau import Radau
from beamdae.integrators.run_plan import SMALL_DEFORMATION_SHARE, RunPlan

# Local tolerance / (rtol / number of periods)^(3/2), calibrated so that the largest error of
# positions stays below 100 rtol in most cases of validation/tolerances.
_TOLERANCE_FACTOR = 4.0
# Factor of the local tolerance with one-sided forces, which are not smooth: 9 of 40 balls thrown at
# pegs were over 100 rtol off (up to 255), with this factor none (up to 53, validation/robustness).
# Such runs take 1.5 times the steps.
_ONE_SIDED_FACTOR = 0.125


FORMULATIONS = ("index3", "stabilized-index2")


@dataclass(frozen=True)
class GeneralizedAlpha(Integrator):
    """Second-order one-step integrator with adjustable damping of high frequencies.

    (1 - alpha_m) a_{n+1} + alpha_m a_n = (1 - alpha_f) q''_{n+1} + alpha_f q''_n with Newmark's
    formulas in the algorithmic acceleration a; the equations of motion hold at t_{n+1}.
    Arnold & Bruls, Multibody Syst. Dyn. 18 (2007) 185, doi:10.1007/s11044-007-9084-0.

    Departures from the paper: starting values for which multipliers are second-order accurate from
    the first step (`start`), unknowns and equations scaled so that the condition number of the
    matrix does not depend on the step, a Newton iteration that reuses its factors, and adaptive
    steps (`rtol`).

    Parameters
    ----------
    step
        Step [s], shortened so that steps end at breakpoints and at the end time. `simulate` warns
        if the error, estimated by a second run, exceeds 4 % of half the range of a column. With
        `rtol`, `step` limits the first step after the start, every breakpoint and every event that
        switches parts.
    rho_inf
        Spectral radius at infinite frequency, from 0 (strongest damping) to 1 (none).
    formulation
        "index3" (the paper's) or "stabilized-index2" (Arnold, Bruls & Cardona, Numer. Math. 129
        (2015) 149), which enforces the constraints on position and velocity level.
    start
        "cured": starting values a0 = q''(0) + (alpha_m - alpha_f) h P q'''(0) and, in the index-3
        form, v0 + h^2 (1/6 - (alpha_m - alpha_f)/2 - beta) P q'''(0), for which multipliers are
        second-order accurate from the first step; P q''' is the jerk that the joints prescribe. For
        "newmark", 1/2 - gamma replaces alpha_m - alpha_f. "plain": no corrections.
    newton_tolerance
        Bound on the Newton error of accelerations relative to the largest acceleration, both in
        units of the scales of their coordinates. With the default, the Newton error was less than
        1/100 of the discretization error, or 1/50 for multipliers (published systems, steps of 0.25
        to 4 ms). If rho_inf is near 1, Newton errors accumulate in the multipliers of the index-3
        form: use 1e-10 for convergence studies of lam.
    time_limit
        Maximum wall time [s]. Defaults to no limit.
    family
        "generalized-alpha", "hht" (rho_inf in [1/2, 1]) or "newmark" (first order unless
        rho_inf = 1); see `family.family_parameters`.
    rtol
        Relative tolerance for adaptive steps. Defaults to None: steps are fixed. Adaptive steps
        follow an estimate of the local errors of positions (`family.AlphaParameters.defect`) and,
        without natural modes that are much faster than the motion, of velocities, calibrated to
        keep the position errors of a run below 100 rtol; multipliers are tested only if joints and
        drivers prescribe all motions.
        Motion that changes abruptly (orbits, stick-slip) and the deflections of freely vibrating
        beams may exceed this bound, which `Auto` and `Radau` keep (validation/tolerances). Steps
        are at most a twentieth of the run and a quarter of the time scale of the laws. With rho_inf
        near 1, unresolved modes are hardly damped and keep the steps short.
    max_steps
        Maximum number of adaptive steps. Defaults to no limit; the run still stops if its steps
        become too short to reach the end (`limits.PaceCheck`).

    Raises
    ------
    BeamdaeError
        If `step`, `newton_tolerance` or `time_limit` is not positive, `rho_inf` is outside [0, 1]
        ([1/2, 1] for "hht"), `rtol` is outside [1e-14, 0.1] or given for "newmark" with
        rho_inf < 1, `max_steps` is given without `rtol` or is not a whole number of at least 1, or
        another setting is not one of the listed values.
    """

    step: float = 1e-3
    rho_inf: float = 0.8
    formulation: str = "index3"
    start: str = "cured"
    newton_tolerance: float = 1e-6
    time_limit: float | None = None
    family: str = "generalized-alpha"
    rtol: float | None = None
    max_steps: int | None = None

    def __post_init__(self) -> None:
        convert_fields(
            self,
            step=require_positive,
            rho_inf=require_finite,
            newton_tolerance=require_positive,
            family=choice_of(*FAMILIES),
        )
        least = 0.5 if self.family == "hht" else 0.0
        if not least <= self.rho_inf <= 1.0:
            where = " for family 'hht'" if self.family == "hht" else ""
            lower, upper, given = format_distinct(least, 1.0, self.rho_inf)
            raise BeamdaeError(
                f"GeneralizedAlpha: rho_inf must lie in [{lower}, {upper}]{where}, got {given}."
            )
        convert_fields(
            self, formulation=choice_of(*FORMULATIONS), start=choice_of("cured", "plain")
        )
        require_limits(self)
        self._check_adaptivity()

    def _check_adaptivity(self) -> None:
        if self.rtol is None:
            if self.max_steps is not None:
                raise BeamdaeError(
                    f"GeneralizedAlpha: max_steps = {self.max_steps} requires rtol, "
                    "because the end time and the step determine the number of fixed steps; "
                    "omit max_steps or set rtol."
                )
            return
        require_tolerance(self)
        if self.family == "newmark" and self.rho_inf < 1.0:
            raise BeamdaeError(
                "GeneralizedAlpha: rtol requires a method of second order, but family "
                f"'newmark' is of first order with rho_inf = {self.rho_inf:g}; set "
                "rho_inf = 1 or another family."
            )

    @property
    def _member(self) -> AlphaParameters:
        return family_parameters(self.family, self.rho_inf)

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
        """Newmark's parameter of the velocities, (3 - rho_inf) / (2 (1 + rho_inf))."""
        return self._member.gamma

    @property
    def beta(self) -> float:
        """Newmark's parameter of the positions, (gamma + 1/2)^2 / 4."""
        return self._member.beta

    @property
    def accuracy(self) -> Accuracy:
        """Relative tolerance `rtol` if it is set, otherwise the step [s]."""
        return Accuracy("step", self.step) if self.rtol is None else Accuracy("rtol", self.rtol)

    @property
    def order(self) -> int:
        """1 with `rtol`; 2 with a fixed step, or 1 for "newmark" with `rho_inf` < 1."""
        damped = self.family == "newmark" and self.rho_inf < 1.0
        return 1 if self.rtol is not None or damped else 2

    @property
    def label(self) -> str:
        """Short name with `accuracy`, and `family` unless it is the default, for tables."""
        family = "" if self.family == "generalized-alpha" else f"family={self.family}, "
        name, value = self.accuracy
        return f"GeneralizedAlpha({family}{name}={value:g})"

    @property
    def pilot(self) -> Radau | None:
        """`Radau` for adaptive steps, otherwise None."""
        # At loose tolerances, a method of second order may leave the motion that it should measure.
        return None if self.rtol is None else Radau(PILOT_RTOL)

    def method_on(self, plan: RunPlan) -> Method:
        """Return the stepper for a plan."""
        index3 = self.formulation == "index3"
        form = formulate_step(plan.equations, not index3)
        start = AlphaStart(self._member, plan.starter, index3, self.start == "cured")
        scales = plan.scales
        if plan.amplitudes is not None:
            # Not reduced by small deformations: the accelerations of the index-3 form are
            # inaccurate in constrained directions, and these errors reduced the steps until the
            # run failed.
            scales = np.maximum(scales, SMALL_DEFORMATION_SHARE * plan.amplitudes.part_scales)
        common = (form, start, scales, self.newton_tolerance)
        if self.rtol is None:
            stepper = PlainAlpha if load_core() is None else FixedAlphaStepper
            return stepper(*common, step=self.step)
        is_one_sided = any(term.kernel.is_one_sided for term in plan.equations.forces)
        return AdaptiveAlphaStepper(
            *common,
            first=self.step,
            largest=plan.longest_step(None),
            duration=plan.duration,
            tolerance=local_tolerance(self.rtol, count_periods(plan), is_one_sided),
            velocity_weights=weigh_velocities(plan, scales),
            multipliers=plan_multiplier_tolerances(plan, motion_scales(plan), self.rtol),
        )


def local_tolerance(rtol: float, periods: float = 1.0, is_one_sided: bool = False) -> float:
    """Return the local error tolerance that keeps the error of a run near `rtol`.

    The local error is of order h^3, and the error of a run is of order h^2. The error of a run is
    therefore proportional to `rtol` if the local tolerance is proportional to rtol^(3/2); cf.
    `ErrorControl.tolerance`. Errors of the period add up over the N = `periods` periods of the
    motion, so that rtol / N takes the place of `rtol`. With one-sided forces, such as contacts, the
    tolerance is an eighth.
    """
    factor = _TOLERANCE_FACTOR * (_ONE_SIDED_FACTOR if is_one_sided else 1.0)
    return factor * (rtol / periods) ** 1.5
