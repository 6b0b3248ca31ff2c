"""IDA of SUNDIALS: variable-order, variable-step BDF on a first-order form."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import (
    FIRST_ORDER,
    FirstOrderForm,
    evaluate_residual,
    formulate_first_order,
)
from beamdae.errors import require_choice
from beamdae.integrators.drive import drive
from beamdae.integrators.error_control import (
    ERROR_CONTROL,
    STIFF_RATIO_BDF,
    motion_scales,
    resolve_error_control,
)
from beamdae.integrators.ida.callbacks import NO_ADVANCE
from beamdae.integrators.ida.compiled_solver import CompiledIda
from beamdae.integrators.ida.kinematic_scaling import KinematicRowScaling
from beamdae.integrators.integrator import AdaptiveIntegrator, Progress, require_tolerance
from beamdae.integrators.method import STEP_TOO_SMALL, StepError
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.run_plan import RunPlan
from beamdae.native.llvm import MachineCodeError
from beamdae.results.outcome import Statistics
from beamdae.results.solution import Solution
from beamdae.sundials.library import UnavailableError
from beamdae.sundials.solver import describe_status

Array = np.ndarray

# Where to look for what stopped a run, over what was left of its interval.
_PROBE_SHARE = 1e-6
_RADAU_ADVICE = (
    "lightly damped modes hold BDF up at this tolerance; Radau takes a half to a twentieth of the "
    "time: take Radau(rtol) or Auto(rtol)"
)
# The share that is made of each correction of Newton's iteration where forces depend on multipliers
# or velocities alone are held: multipliers are then among what is tested of it. IDA accepts a first
# correction by the rate at which an iteration converged before, and one of any size where that was
# nothing, as it is of linear equations: where friction turns round, such steps drove multipliers
# off, to 1e7 times their size. With this share no rate is below 1/50, and none is accepted beyond
# 16 tolerances.
_CORRECTION_SHARE = 0.98
# IDA gives up after ten attempts at a step; one that begins an interval is tried again from here.
_RETRY_FACTOR, _MIN_STEP = 1e-4, 1e-300
# Errors are weighed by absolute tolerances; IDA wants a relative one that is not zero.
_NEGLIGIBLE_RTOL = 1e-15


@dataclass(frozen=True)
class Ida(AdaptiveIntegrator):
    """Variable-order, variable-step BDF (IDA) on a first-order form of the equations of motion.

    It runs in machine code ("ida" is "shared libraries" in `Solution.integrator`), or where that
    cannot be had by scikit-sundae's class, with the same steps but for rounding, and for friction
    and nonholonomic constraints: its error test sees their reactions as well. Machine code also
    tells "orders" (steps by order), "error_test_failures", and "limited_by": the unknowns whose
    error was the largest of a step most often, with the share of such steps.

    Parameters
    ----------
    rtol
        Relative tolerance; absolute ones follow from the scales of the mechanism.
    formulation
        "stabilized-index1" (default) or "ggl"; "index2", "index1" and "index3" to compare with: on
        the first two positions drift off the constraints, through a singular position on to
        another branch (a parallelogram on its second pass; `Solution.warnings` tells), and on
        "index3" rtol says little: on a rigid slider-crank positions were off by 20 to 170 rtol,
        velocities by 160 to 1400.
    error_control
        Which components the error test sees: "positions", "velocities" (and positions) or "all"
        (and multipliers); "auto" decides by the stiffness of the mechanism.
    max_order
        1 to 5; "auto" is 2 where fast modes are undamped or lightly damped, 5 otherwise.
    max_step
        Largest step [s]; None: a twentieth of the run, and a quarter of the laws' time scale.
    linear_solver
        "dense", "sparse", or "auto" by size.
    max_steps, time_limit
        The run is given up after so many steps or seconds. None: no limit, but without max_steps it
        is given up as well where no end is in sight, see `limits.Pace`.
    """

    rtol: float = 1e-5
    formulation: str = "stabilized-index1"
    error_control: str = "auto"
    max_order: int | str = "auto"
    max_step: float | None = None
    linear_solver: str = "auto"
    max_steps: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_tolerance(self)
        require_choice("Ida", "formulation", self.formulation, FIRST_ORDER)
        require_choice("Ida", "error_control", self.error_control, ERROR_CONTROL)
        require_choice("Ida", "max_order", self.max_order, ("auto", 1, 2, 3, 4, 5))
        require_choice("Ida", "linear_solver", self.linear_solver, ("auto", "dense", "sparse"))

    def integrate(
        self, equations: EquationsOfMotion, times: Array, progress: Progress | None = None
    ) -> Solution:
        """Integrate from times[0] to times[-1]; see `Integrator.integrate`."""
        return drive(
            self,
            equations,
            times,
            partial(IdaStepper, self),
            progress,
            # At an order that is set but unstable it would see vibrations of its own making.
            partial(IdaStepper, replace(self, rtol=PILOT_RTOL, max_order="auto")),
        )


class IdaStepper:
    """IDA, many steps at a time."""

    rows_per_step: ClassVar[int] = 1
    steps_per_check: ClassVar[int] = 64

    def __init__(self, settings: Ida, plan: RunPlan) -> None:
        self._rtol = settings.rtol
        self._form = formulate_first_order(plan.equations, settings.formulation)
        self._scales = size = motion_scales(plan)
        matter = _multipliers_need_test(plan.equations)
        iterated = matter or len(plan.equations.nonholonomic_rows) > 0
        self._control = resolve_error_control(
            settings.error_control,
            settings.max_order,
            self._form.formulation,
            settings.rtol,
            size.rate,
            STIFF_RATIO_BDF,
            plan.fastest_modes,
            matter,
        )
        self._tolerance = self._control.tolerance(settings.rtol, self._form.size)
        self._longest = plan.longest_step("Ida", settings.max_step)
        options = {
            "rtol": _NEGLIGIBLE_RTOL,
            "atol": self._control.absolute(self._tolerance, size, self._form, iterated),
            "untested": self._control.untested(self._form) if iterated else None,
            "max_order": self._control.max_order,
            "max_step": self._longest,
        }
        iteration = {
            "kinematic": KinematicRowScaling.of_form(self._form, size.position),
            "share": _CORRECTION_SHARE if iterated else 1.0,
        }
        self._ida = _make_solver(self._form, plan, settings.linear_solver, options, iteration)

    @property
    def resolved_options(self) -> dict[str, Any]:
        """What was chosen."""
        note = self._form.formulation.note or (_RADAU_ADVICE if self.prefers_radau else "")
        return {
            "error_control": self._control.policy,
            "max_order": self._control.max_order,
            "auto": self._control.reason,
            "local_tolerance": float(self._tolerance),
            "method": "Ida",
            "ida": self._ida.name,
            **self._ida.step_report,
            **({"note": note} if note else {}),
        }

    @property
    def prefers_radau(self) -> bool:
        """Whether another method takes less at this tolerance."""
        return self._rtol < self._control.loses_below

    @property
    def counts(self) -> Statistics:
        """What it cost."""
        return self._ida.counts

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin a smooth interval."""
        self._t, self._end, self._branch = start, end, branch
        # IDA's own guess knows no accelerations, and fails where they are huge for an instant.
        first = min(self._scales.first_step(self._tolerance, state), self._longest, end - start)
        self._start(first, state)

    def _start(self, first: float, state: State) -> None:
        """Begin with a step of this length [s]."""
        self._first = first
        self._state: State | None = state
        self._ida.start((self._t, self._end), self._branch, *self._form.pack(state), first)

    def advance(self, most: int) -> Array:
        """Rows of one to `most` more steps.

        Raises
        ------
        StepError
            If there is none.
        """
        while not len(rows := self._ida.advance(most)):
            shorter = _RETRY_FACTOR * self._first
            if self._state is None or self._t + shorter == self._t or shorter < _MIN_STEP:
                raise StepError(self._reason, self._ida.last[2])
            self._start(shorter, self._state)
        self._t = float(rows[-1, 0])
        self._state = None
        return rows

    @property
    def _reason(self) -> str:
        # Steps shrink to nothing before a time from which on there is no residual.
        ahead = self._t + _PROBE_SHARE * (self._end - self._t)
        y, yp, last = self._ida.last
        there = np.zeros(self._form.size)
        evaluate_residual(self._form.buffers(), ahead, self._branch, y, yp, there)
        if not (np.isfinite(last).all() and np.isfinite(there).all()):
            return "the residual is not finite; check laws and start values"
        code = self._ida.code
        if code == NO_ADVANCE:
            return STEP_TOO_SMALL
        limits = next(iter(self._ida.step_report.get("limited_by", {})), "")
        most = f", the error of {limits} limits most steps" if limits else ""
        return {
            -3: "the error test failed at the smallest step; loosen rtol or test positions only"
            f"{most}",
            -4: "Newton's iteration did not converge at the smallest step; check the model near "
            "this time, or use another formulation",
        }.get(code, describe_status(code))


def _multipliers_need_test(e: EquationsOfMotion) -> bool:
    """Whether forces depend on multipliers, or nothing but these is left to find."""
    return e.m == e.n or any(force.rows is not None for force in e.structure.forces)


def _make_solver(
    form: FirstOrderForm,
    plan: RunPlan,
    linear_solver: str,
    options: dict[str, Any],
    iteration: dict[str, Any],
) -> Any:
    """IDA with everything in machine code, or as it can be had."""
    if form.is_native:
        with contextlib.suppress(MachineCodeError, UnavailableError):
            return CompiledIda(form, plan.matrix("Ida", form.pattern), options, iteration)
    # Here, for scikit-sundae's class takes SciPy's optimizers along, a third of a run without it.
    from beamdae.integrators.ida.python_solver import SksundaeIda

    return SksundaeIda(form, linear_solver, options, iteration)
