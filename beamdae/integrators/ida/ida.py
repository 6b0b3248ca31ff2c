"""`Ida`: variable-order, variable-step BDF by SUNDIALS IDA."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from beamdae.core.library import load_core
from beamdae.core.return_codes import NO_ADVANCE
from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.first_order import (
    FIRST_ORDER,
    formulate_first_order,
)
from beamdae.errors import MissingPackageError, format_exception, require_choice
from beamdae.integrators.compiled_run import InputJump
from beamdae.integrators.error_control import (
    ERROR_CONTROL,
    STIFF_RATIO_BDF,
    motion_scales,
    resolve_error_control,
)
from beamdae.integrators.ida.compiled_solver import CompiledIda
from beamdae.integrators.ida.kinematic_scaling import scale_kinematic_rows
from beamdae.integrators.integrator import (
    DEFAULT_RTOL,
    PROBE_SHARE,
    RESIDUAL_NOT_FINITE,
    STEP_TOO_SMALL,
    STEPS_PER_CHECK,
    AdaptiveIntegrator,
    StepError,
    require_tolerance,
)
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.run_plan import RunPlan
from beamdae.parts.laws import MIN_STEPS_PER_TIME_SCALE
from beamdae.results.outcome import Statistics
from beamdae.sundials import UnavailableError, describe_status

Array = np.ndarray

# IDA's return codes after repeated failures of a step.
_ERROR_TEST_FAILED = -3
_NEWTON_FAILED = -4
# Fraction of each Newton correction that is applied if forces depend on multipliers or there are
# nonholonomic constraints, because multipliers are then in the convergence test. IDA judges the
# first correction by an earlier rate of convergence, and accepts any size if this rate was zero, as
# in linear equations. When friction reversed, such steps increased multipliers to 1e7 times their
# size. With this fraction, no rate is below 1/50 and no correction above 16 tolerances is accepted.
_CORRECTION_SHARE = 0.98
# IDA gives up after ten attempts at a step. The first step of an interval is then retried with this
# fraction of its length, ...
_RETRY_FACTOR = 1e-4
# ... unless it becomes shorter than this [s].
_MIN_FIRST_STEP = 1e-300
# Errors are weighted by absolute tolerances; IDA requires a nonzero relative tolerance.
_NEGLIGIBLE_RTOL = 1e-15
# In validation/tolerances (rtol from 1e-3 to 1e-5), 20 % of such runs exceeded the bound, by
# factors up to 6, and none with order 5.
_RADAU_ADVICE = (
    "fast modes limit BDF to order 2, so errors, mainly of deflections, may exceed the bound and "
    "tight tolerances are expensive; use Radau(rtol) or Auto(rtol)"
)


class IdaStepper:
    """Stepper that calls IDA: up to 64 steps per call, or 1 through scikit-sundae."""

    rows_per_step: ClassVar[int] = 1
    steps_per_check: ClassVar[int] = STEPS_PER_CHECK

    def __init__(
        self,
        rtol: float,
        formulation: str,
        error_control: str,
        max_order: int | str,
        max_step: float | None,
        plan: RunPlan,
    ) -> None:
        self._form = formulate_first_order(plan.equations, formulation)
        self._scales = scales = motion_scales(plan)
        multipliers_matter = plan.equations.multipliers_matter
        iterated = multipliers_matter or len(plan.equations.nonholonomic_rows) > 0
        self._control = resolve_error_control(
            error_control,
            max_order,
            self._form.formulation,
            rtol,
            scales.rate,
            STIFF_RATIO_BDF,
            plan.fastest_modes,
            multipliers_matter,
        )
        self._tolerance = self._control.tolerance(rtol, scales, self._form)
        self._longest = plan.longest_step(max_step)
        atol = self._control.absolute_tolerances(self._tolerance, scales, self._form, iterated)
        options = {
            "rtol": _NEGLIGIBLE_RTOL,
            "atol": atol,
            "untested": self._control.untested(self._form) if iterated else None,
            "max_order": self._control.max_order,
            "max_step": self._longest,
        }
        iteration = {
            "kinematic": scale_kinematic_rows(self._form, scales.position / scales.size),
            "correction_fraction": _CORRECTION_SHARE if iterated else 1.0,
        }
        self._ida: Any = None
        if load_core() is not None:
            with contextlib.suppress(UnavailableError):
                matrix = plan.matrix("Ida", self._form.pattern)
                self._ida = CompiledIda(self._form, matrix, options, iteration)
        if self._ida is None:
            # Imported here because it imports SciPy's optimizers, which takes a third of a short
            # run.
            try:
                from beamdae.integrators.ida.python_solver import SksundaeIda
            # OSError: its shared libraries are missing.
            except (ImportError, OSError) as problem:
                raise MissingPackageError(
                    "Ida",
                    f"scikit-sundae cannot be imported ({format_exception(problem)})",
                    "install scikit-sundae, or use Radau or GeneralizedAlpha",
                ) from problem
            self._ida = SksundaeIda(self._form, options, iteration)

    @property
    def resolved_options(self) -> dict[str, Any]:
        """Error control, order, local tolerance and step report of the run."""
        note = self._form.formulation.note or (_RADAU_ADVICE if self._control.is_limited else "")
        return {
            "error_control": self._control.policy,
            "max_order": self._control.max_order,
            "auto": self._control.reason,
            "local_tolerance": self._tolerance,
            "method": "Ida",
            "ida": self._ida.name,
            **self._ida.step_report,
            **({"note": note} if note else {}),
        }

    @property
    def counts(self) -> Statistics:
        """Numbers of function calls, rejected steps, factorizations and Newton failures so far."""
        return self._ida.counts

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin the smooth interval from `start` to `end` [s] at a consistent state."""
        self._t, self._end, self._branch = start, end, branch
        # IDA's estimate ignores accelerations, and fails if they are huge for an instant. A step
        # over the whole interval would miss a pulse that is zero at both of its ends.
        resolving = (end - start) / MIN_STEPS_PER_TIME_SCALE
        first = min(self._scales.first_step(self._tolerance, state), self._longest, resolving)
        self._start(first, state)

    def resume(self, start: float, end: float, q: Array) -> State | None:
        """Continue from `start` to `end` [s] after held inputs have jumped; see `ResumableMethod`.

        Multistep formulas do not hold across the jump: IDA begins again with order 1, unless no
        input has changed.
        """
        if self._t != start:
            return None
        y, yp, _ = self._ida.last_point
        before = State(*(x.copy() for x in self._form.unpack(y, yp)))
        if np.array_equal(q, before.q):
            self._end = end
            self._ida.extend(end)
            return before
        state = self._input_jump.apply(start, self._branch, q, before)
        if state is not None:
            self.begin(start, end, self._branch, state)
        return state

    @cached_property
    def _input_jump(self) -> InputJump:
        return InputJump(self._form.equations)

    def _start(self, first_step: float, state: State) -> None:
        self._first_step = first_step
        self._start_state: State | None = state
        self._ida.start((self._t, self._end), self._branch, *self._form.pack(state), first_step)

    def advance(self, most: int) -> Array:
        """Take 1 to `most` steps, but at most 64; return their rows (t, q, v, a, lam).

        Raises
        ------
        StepError
            If no step is possible.
        """
        while not len(rows := self._ida.advance(most)):
            first_step, state = _RETRY_FACTOR * self._first_step, self._start_state
            if state is None or self._t + first_step == self._t or first_step < _MIN_FIRST_STEP:
                raise StepError(self._describe_failure())
            self._start(first_step, state)
        self._t = float(rows[-1, 0])
        self._start_state = None
        return rows

    def _describe_failure(self) -> str:
        ahead = self._t + PROBE_SHARE * (self._end - self._t)
        y, yp, last_residual = self._ida.last_point
        residual_ahead = self._form.residual(np.array([ahead, self._branch]), y, yp)
        if not (np.isfinite(last_residual).all() and np.isfinite(residual_ahead).all()):
            return RESIDUAL_NOT_FINITE
        code = self._ida.code
        if code == NO_ADVANCE:
            return STEP_TOO_SMALL
        if code == _ERROR_TEST_FAILED:
            unknown = next(iter(self._ida.step_report.get("limited_by", {})), "")
            cause = f" (the step is limited most often by {unknown})" if unknown else ""
            return (
                f"the error test failed even after repeated step reductions{cause}; loosen rtol or "
                "test only positions"
            )
        if code == _NEWTON_FAILED:
            return (
                "Newton's iteration did not converge even after repeated step reductions; check "
                "the model near this time, or use another formulation"
            )
        return describe_status(code)


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

    @property
    def pilot(self) -> Ida:
        """Integrator of pilot runs, with a stable order."""
        # With an unstable order set by the user, the pilot run would measure spurious vibrations.
        return replace(self, rtol=PILOT_RTOL, max_order="auto")

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
