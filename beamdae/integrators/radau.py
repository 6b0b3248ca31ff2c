"""Radau IIA of order 5: an adaptive implicit Runge-Kutta method on the stabilized index-1 form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State, first_order
from beamdae.errors import one_of
from beamdae.integrators.drive import SCOUTING_RTOL, StepError, drive, fitted
from beamdae.integrators.error_control import STIFF_FOR_RADAU, resolve, scales
from beamdae.integrators.integrator import ByTolerance, Progress, require_tolerance
from beamdae.integrators.radau_newton import C, Collocation
from beamdae.integrators.radau_steps import KEEP_RATE, PredictiveStepSize, Tolerance
from beamdae.integrators.route import Route
from beamdae.results.solution import Solution, Statistics

Array = np.ndarray

_FORM = "stabilized-index1"
_ORDER = 5
# Relative to the times of an interval: what differs over it would be lost in rounding.
_SMALLEST_STEP = 1e-12


@dataclass(frozen=True)
class Radau(ByTolerance):
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
        one_of("Radau", "error_control", self.error_control, ("auto", "positions", "velocities"))
        one_of("Radau", "linear_solver", self.linear_solver, ("auto", "dense", "sparse"))

    def integrate(
        self, equations: EquationsOfMotion, times: Array, progress: Progress | None = None
    ) -> Solution:
        """Integrate from times[0] to times[-1]; see `Integrator.integrate`."""
        return drive(
            self,
            equations,
            times,
            partial(Collocating, self),
            progress,
            partial(Collocating, replace(self, rtol=SCOUTING_RTOL)),
        )


class Collocating:
    """Collocation, a step at a time."""

    # One costs as much as ten of Ida's.
    steps_between_looks: ClassVar[int] = 8

    def __init__(self, settings: Radau, route: Route) -> None:
        self._form = first_order(route.equations, _FORM)
        self._newton = Collocation(self._form, settings.linear_solver)
        self._scales = size = scales(route)
        self._control = resolve(
            settings.error_control,
            _ORDER,
            self._form.formulation,
            settings.rtol,
            size.rate,
            STIFF_FOR_RADAU,
            route.fastest_modes,
        )
        velocities = self._control.policy == "velocities"
        self._tolerance = Tolerance.honest(settings.rtol, size, velocities)
        self._longest = route.longest_step("Radau", settings.max_step)
        self._rejected = 0

    @property
    def resolved(self) -> dict[str, Any]:
        """What was chosen."""
        return {
            "error_control": self._control.policy,
            "auto": self._control.reason,
            "method": "Radau",
            "local_tolerance": self._tolerance.local,
        }

    @property
    def counts(self) -> Statistics:
        """What it cost."""
        return replace(self._newton.counts, rejected_steps=self._rejected)

    def begin(self, start: float, end: float, branch: float, state: State) -> None:
        """Begin a smooth interval."""
        self._newton.restart(branch)
        self._t, self._end = start, end
        self._y, self._yp = self._form.pack(state)
        self._smallest = _SMALLEST_STEP * max(abs(start), abs(end))
        self._size = PredictiveStepSize(
            self._scales.first_step(self._tolerance.local, state), self._longest
        )

    def step(self) -> tuple[float, State, list[tuple[float, State]]]:
        """One step that passes the error test, and its stages."""
        newton, tolerance, size = self._newton, self._tolerance, self._size
        reason = "the step is too small to advance time; check laws and start values"
        while True:
            left = self._end - self._t
            h = fitted(size.next, left)
            # Of states beyond all numbers the step is none either.
            if not h >= min(self._smallest, left):
                raise StepError(reason)
            bounds = tolerance.iteration_weights(h)
            renew = not newton.serves(h, KEEP_RATE)
            if not newton.solve(self._t, self._y, self._yp, h, bounds, renew):
                if renew:
                    self._rejected += 1
                    size.diverged(h)
                    reason = newton.reason
                continue
            error = tolerance.norm(newton.error(self._yp, h))
            if error < 1.0:
                break
            self._rejected += 1
            size.refused(h, error, newton)
            reason = "the error test failed at the smallest step; loosen rtol"
        size.accepted(h, error, newton)
        stages = [
            (self._t + c * h, self._form.unpack(*stage))
            for c, stage in zip(C[:-1], newton.inside(self._y, h), strict=True)
        ]
        self._y, self._yp = newton.end(self._y, h)
        self._t = self._end if h == left else self._t + h
        return self._t, self._form.unpack(self._y, self._yp), stages
