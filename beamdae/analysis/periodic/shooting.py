"""Single shooting: Newton's method for a state that repeats after one period."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.periodic.monodromy import (
    EXACT_RANK,
    MAX_HALVINGS,
    DisturbanceBasis,
    LinearizationError,
    VariationalEquations,
    assemble_monodromy,
    dominant_range,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError, require_positive
from beamdae.integrators import Integrator, Radau
from beamdae.integrators.amplitudes import Amplitudes
from beamdae.integrators.redundant_constraints import remove_redundant
from beamdae.integrators.step_thinning import keep_all_steps
from beamdae.interrupts import Interrupted
from beamdae.parts.joints.drivers import Driver
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory
from beamdae.simulation import as_equations

Array = np.ndarray

# Defaults and limits of `periodic` and `frequency_response`.
DEFAULT_RTOL = 1e-8
MAX_SETTLING_PERIODS = 10_000

# Default tolerance of a period: this multiple of the relative tolerance of the integrator, within
# bounds that rounding errors and Newton's method require, or a fixed value for fixed steps.
_TOLERANCE_FACTOR = 100.0
_TOLERANCE_BOUNDS = (1e-8, 1e-3)
_FIXED_STEP_TOLERANCE = 1e-6
# Adaptive steps change with the start, and with them the errors of a run. An iteration that
# stagnates at them succeeds up to this multiple of the default tolerance.
_STAGNATION_ALLOWANCE = 10.0
# Relative tolerance of the runs that settle and of the first iterations. Vibrations that are not
# part of the periodic motion take most of the time of accurate runs, and more with every
# disturbance of the variational equations. At most this fraction of it is more accurate.
_COARSE_RTOL = 1e-4
_COARSENING_RATIO = 1e-1

# Motions within the tolerance are corrected until the next correction is below this fraction of the
# tolerance, or the last one left more than this fraction of the deviation.
_CORRECTION_RATIO = 0.1
_EXHAUSTED_CONTRACTION = 0.5

# Number of output times in a period, including both ends.
_OUTPUT_TIMES = 201
FULL_TURN = 2.0 * np.pi
# Loads are periodic if, after a period, forces change by less than this fraction of the largest
# force, and constraints by less than this fraction of the size of the mechanism or of 1 rad. Both
# are compared at these fractions of a period. Multiples of the golden ratio keep harmonics from
# having the same phase at all of them, as the 12th has after each twelfth of a period.
_REPETITION_TOLERANCE = 1e-6
COMPARED_FRACTIONS = np.sort(np.arange(1.0, 12.0) * (np.sqrt(1.25) - 0.5) % 1.0)
# Loads are constant if they are periodic with these fractions of a period.
_TEST_PERIODS = (0.29, 0.618)
# Loads that do not change within a period must not change later by more than this multiple of their
# range. They are compared after these numbers of periods; the last one is 1100 s for a period of
# 1e-9 s. Rounding of later times would change the phase of loads by more than 1e-4 periods.
_MAX_LATER_RANGE = 10.0
_LATER_PERIODS = 2.0 ** np.arange(1.0, 41.0)
# Search for the period that is suggested instead: first step and largest change, relative to the
# period, and maximum number of steps.
_PERIOD_STEP = 1e-5
_MAX_PERIOD_CHANGE = 0.05
_MAX_SECANT_STEPS = 12
# Maximum number of Newton iterations, and largest permitted first correction relative to the
# amplitudes, unless the deviation is larger. It grows by this factor with each shortened correction
# that changes the deviation as predicted: near a resonance with little damping, the amplitude is
# thousands of times that of the first run.
_MAX_ITERATIONS = 25
_MAX_CHANGE = 3.0
_CHANGE_GROWTH = 10.0
_MAX_STRETCH = 0.2  # largest permitted change of an unknown period, relative to the period
# A run has returned to its final state where it differs by at most this fraction of the range of
# each coordinate and velocity; coordinates with a far smaller range than others are at rest. Number
# of times at which states are compared.
_RETURN_DISTANCE = 0.2
_REST_RATIO = 1e-6
_RETURN_SAMPLES = 4001
_REFINED_RETURN_SAMPLES = 201  # around the nearest of these times
_TINY = 1e-300  # avoids a division by zero
# Maximum number of halvings of a Newton step if the run does not reach the end of the period.
_MAX_HALVINGS = 5
# A matrix is kept for the next Newton step if the last step reduced the deviation as predicted
# within this fraction, full steps to at most this fraction: a run costs a period, a new matrix two
# to six. Meanwhile, the runs improve the matrix, unless the period is an unknown: those of undamped
# strips spoil it.
_MAX_PREDICTION_ERROR = 0.3
_MAX_FREE_PREDICTION_ERROR = 0.1
# Rank tolerance of Newton's matrix. Disturbances that shrink below it within a period need no
# linearization: Newton's method leaves them to the run (Lust, Roose, Spence & Champneys, SIAM J.
# Sci. Comput. 19 (1998) 1188). With 1e-2, kept matrices do not reduce the deviation of stiff beams.
_NEWTON_RANK_TOLERANCE = 1e-4
# Disturbances with smaller singular values, relative to the largest, are not expected in the next
# matrix.
_EXPECTED_RANK_TOLERANCE = 1e-6
# Number of steps of runs without stages in each step of the variational equations.
_STEPS_PER_NODE = 4.0
# Error of the stages of the variational equations, relative to the rank tolerance of a matrix.
_STAGE_TOLERANCE_RATIO = 1e-2
# Smaller singular values, relative to the largest, belong to directions in which all states are
# periodic.
_NEUTRAL_RATIO = 1e-9


class Tolerance(NamedTuple):
    """Tolerance of the difference between both ends of a period, relative to the amplitudes.

    Attributes
    ----------
    target
        Difference at which the iteration ends.
    accepted
        Largest difference at which an iteration that stagnates has succeeded.
    """

    target: float
    accepted: float

    @classmethod
    def for_integrator(cls, name: str, value: Any, integrator: Integrator) -> Tolerance:
        """Return the tolerance `value`, or the default for the integrator if it is None."""
        if value is not None:
            target = require_positive(name, "tolerance", value)
            return cls(target, target)
        if integrator.accuracy.name != "rtol":
            return cls(_FIXED_STEP_TOLERANCE, _FIXED_STEP_TOLERANCE)
        target = float(np.clip(_TOLERANCE_FACTOR * integrator.accuracy.value, *_TOLERANCE_BOUNDS))
        return cls(target, _STAGNATION_ALLOWANCE * target)

    def is_met(self, deviation: float, correction: float, contraction: float) -> bool:
        """Return True if an iteration may end at this deviation, relative to the amplitudes.

        If disturbances decay slowly, a motion is off by a multiple of its deviation after a period.
        Therefore, the next `correction` must be below a tenth of the tolerance, unless the last one
        no longer halved the deviation: `contraction` is the ratio of the last two deviations, or
        infinite after one run.
        """
        is_accurate = correction <= _CORRECTION_RATIO * self.target
        return deviation <= self.target and (
            is_accurate or self.is_exhausted(deviation, contraction)
        )

    def is_exhausted(self, deviation: float, contraction: float) -> bool:
        """Return True if a deviation within the tolerance is at the level of the errors of runs.

        Then, the last correction no longer halved it; see `is_met`.
        """
        return deviation <= self.target and _EXHAUSTED_CONTRACTION < contraction < np.inf


class _Stagnation(NamedTuple):
    """Newton's method stops after this many `iterations` without halving a small `deviation`."""

    deviation: float
    iterations: int


_STAGNATION = _Stagnation(deviation=1e-4, iterations=4)
_COARSE_STAGNATION = _Stagnation(deviation=1e-2, iterations=4)


class IncompleteRunError(BeamdaeError):
    """Raised if a run ends early; `solution` is the incomplete run."""

    def __init__(self, run: str, solution: Solution) -> None:
        reason = solution.status.sentence
        if "loosen rtol" in reason:
            reason += "; rtol is that of integrator=, such as bd.Radau(1e-6)"
        super().__init__(f"periodic: {run} was not finished: {reason}.")
        self.solution = solution


def build_periodic_equations(function: str, model: Any, start: Any = None) -> EquationsOfMotion:
    """Return the equations of a model, for shooting.

    Raises
    ------
    BeamdaeError
        If parts are inactive, or events stop a run, switch parts or cause impacts.
    """
    equations = as_equations(function, model, start)
    if equations.configurations is not None or any(x.do != "record" for x in equations.events):
        raise BeamdaeError(
            f"{function}: inactive parts, impacts and events that stop a run or switch parts "
            "are not supported; remove them, or model contacts by smooth forces such as Contact."
        )
    return equations


class _Mismatch(NamedTuple):
    """Largest difference of loads and drivers after a period.

    Attributes
    ----------
    name
        Coordinate or joint.
    time
        Time at which it occurs [s].
    difference
        Size, as text.
    periods
        Period after which this load or driver repeats at this time [s]; empty if unknown.
    mean_rate
        Mean rate of a driver that repeats beside a uniform motion [rad/s or m/s]; 0 for others.
    """

    name: str
    time: float
    difference: str
    periods: list[float]
    mean_rate: float


def find_nearby_root(function: Callable[[float], float], start: float) -> list[float]:
    """Return the root within 5 % of `start`, by the secant method, as list with up to one entry."""
    a, b = start, start * (1.0 + _PERIOD_STEP)
    f_a, f_b = function(a), function(b)
    for _ in range(_MAX_SECANT_STEPS):
        if f_a == f_b:
            break
        a, b, f_a = b, b - f_b * (b - a) / (f_b - f_a), f_b
        if not abs(b / start - 1.0) < _MAX_PERIOD_CHANGE:
            return []
        f_b = function(b)
    return [float(f"{b:.9g}")]


@dataclass(frozen=True)
class PeriodMap:
    """Map from a state to the state one period later.

    Attributes
    ----------
    equations
        Equations of motion without redundant constraints.
    integrator
        Integrator of the runs.
    begin, period
        Start and duration of the period [s].
    variational
        Equations linearized along runs.
    is_coarse
        Whether deformations of a beam are resolved relative to the largest one with the same unit.
    """

    equations: EquationsOfMotion
    integrator: Integrator
    begin: float
    period: float
    variational: VariationalEquations
    is_coarse: bool = False

    @classmethod
    def from_equations(
        cls, equations: EquationsOfMotion, integrator: Integrator, begin: float, period: float
    ) -> PeriodMap:
        """Create the map; redundant constraints are removed."""
        reduction = remove_redundant(equations, begin)
        independent = equations if reduction is None else reduction.equations
        return cls(independent, integrator, begin, period, VariationalEquations(independent))

    def with_radau(self) -> PeriodMap:
        """Return the map of Radau with the same rtol; this map if steps are fixed.

        Other methods resolve undamped fast vibrations, which are not part of the motion, with up to
        a hundred times as many steps.
        """
        name, value = self.integrator.accuracy
        if name != "rtol" or isinstance(self.integrator, Radau):
            return self
        return replace(self, integrator=Radau(value))

    def coarsen(self) -> PeriodMap:
        """Return the map for approaching a motion, unless steps are fixed: Radau, a larger rtol.

        The errors of coarse runs of other methods exceed the tolerance of the approach.
        Corrections of large deflections disturb axial deformations, whose vibrations would take
        thousands of steps of a run that resolves them relative to their small amplitudes.
        """
        radau = self.with_radau().integrator
        if not isinstance(radau, Radau) or (radau is self.integrator and self._has_large_rtol):
            return self
        rtol = max(radau.rtol, _COARSE_RTOL)
        return replace(self, integrator=replace(radau, rtol=rtol), is_coarse=True)

    @property
    def _has_large_rtol(self) -> bool:
        return self.integrator.accuracy.value > _COARSENING_RATIO * _COARSE_RTOL

    def run(self, q: Array, v: Array, scales: Array | None = None, periods: int = 1) -> Solution:
        """Integrate over `periods` periods from (q, v); `scales` are known amplitudes, or None.

        Raises
        ------
        IncompleteRunError
            If the run ends early.
        """
        if self.is_coarse and scales is not None:
            scales = equalize_deformations(self.equations, scales)
        equations = replace(self.equations, q0=q, v0=v, scales=scales)
        count = periods * (_OUTPUT_TIMES - 1) + 1
        times = self.begin + self.period * np.linspace(0.0, periods, count)
        with keep_all_steps():
            solution = self.integrator.integrate(equations, times)
        if solution.status.kind == "interrupted":
            raise Interrupted(solution.status.sentence)
        if not solution.status.success or solution.trajectory.end < times[-1]:
            run = "the run over a period" if periods == 1 else "the run to settle"
            raise IncompleteRunError(run, solution)
        return solution

    def settle(self, periods: int) -> tuple[Array, Array, Array | None]:
        """Return the consistent state (q, v) after `periods` periods from the initial conditions.

        Full revolutions of angles are removed. The third value is the amplitudes of the last run,
        (n,), or None. Coarse runs continue with those of the first period, relative to which they
        do not resolve fast vibrations after the start.

        Raises
        ------
        IncompleteRunError
            If a run ends early.
        BeamdaeError
            If a load or driver does not repeat after the first period of a coarse run.
        """
        e = self.equations
        state = ConsistencySolver(e).start_state(self._begin_on_branch, e.q0, e.v0)
        q, v, amplitudes = state.q, state.v, None
        first = min(periods, 1) if self.is_coarse else periods
        for count in (first, periods - first):
            if count:
                solution = self.run(q, v, amplitudes, count)
                if self.is_coarse and amplitudes is None:
                    # After a wrong period, drivers jump and vibrate for tens of thousands of steps.
                    self.require_valid_loads(solution, free_period=False)
                amplitudes = np.split(self.state_scales(solution), 2)[0]
                q, v = self.end_state(solution)
        return q, v, amplitudes

    def end_state(self, solution: Solution) -> tuple[Array, Array]:
        """Return the consistent state (q, v) at the end of a run, without full revolutions."""
        last = solution.trajectory.intervals[-1].state
        q = last.q[-1]
        return self.make_consistent(q - self._full_turns(self.equations.q0, q), last.v[-1])

    def make_consistent(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the consistent state nearest to (q, v) at the start of a period."""
        state = ConsistencySolver(self.equations).state(self._begin_on_branch, q, v)
        return state.q, state.v

    @property
    def _begin_on_branch(self) -> Array:
        """(t, branch) at the start of a period [s]."""
        later = [b for b in self.equations.breakpoints if b > self.begin]
        return np.array([self.begin, 0.5 * (self.begin + min([self.begin + 1.0, *later]))])

    def require_valid_loads(self, solution: Solution, free_period: bool) -> None:
        """Reject loads and drivers that differ one period later or, with `free_period`, ever.

        Raises
        ------
        BeamdaeError
            If a load or driver is not periodic; the message names the coordinate or joint, and the
            period if it is within 5 % of this one.
        """
        if free_period:
            if self.is_autonomous(solution):
                return
            raise BeamdaeError(
                "periodic: loads or drivers depend on time; pass their period with period=."
            )
        mismatch = self._find_mismatch(solution)
        if mismatch is None:
            return
        mechanism, part = self.equations.mechanism, mismatch.name.rpartition(".")[0]
        if mismatch.mean_rate and mechanism and isinstance(mechanism.parts.get(part), Driver):
            raise BeamdaeError(
                f"{mismatch.name}: this driver vibrates about a rotation at "
                f"{mismatch.mean_rate:.6g} rad/s, which makes no whole number of turns in the "
                f"period of {self.period:g} s, so that no motion repeats; for small vibrations "
                "about the rotation, use bd.linearize(..., about=bd.rotation(speed)) and its "
                "frequency_response."
            )
        others = (replace(self, period=x) for x in mismatch.periods)
        period = next((x.period for x in others if x._find_mismatch(solution) is None), None)
        advice = "" if period is None else f", {period:.9g} s"
        raise BeamdaeError(
            f"{mismatch.name}: loads or drivers at t = {mismatch.time:.6g} s differ by "
            f"{mismatch.difference} and do not repeat after the period of {self.period:g} s; set "
            f"period to the period of the loads and drivers{advice}."
        )

    def _find_mismatch(self, solution: Solution) -> _Mismatch | None:
        """Return the largest difference of loads and drivers one period later, or None."""
        e = self.equations
        form = formulate_first_order(e, "ggl")
        interval = solution.trajectory.intervals[0]
        # A run may end before the period does, because loads do not repeat.
        end = max(interval.t[-1], self.begin + self.period)
        times = interval.t[0] + (end - interval.t[0]) * COMPARED_FRACTIONS
        state = interval.at(np.minimum(times, interval.t[-1]))
        revolutions = np.zeros(form.size)
        revolutions[: e.n] = self.full_revolutions(solution)
        change, largest_force = np.zeros((len(times), form.size)), 0.0
        first = form.pack(State(*(x[0] for x in state)))
        values_of_first = []
        for k, t in enumerate(times.tolist()):
            y, yp = form.pack(State(*(x[k] for x in state)))
            now, later = np.array([t, interval.branch]), np.full(2, t + self.period)
            change[k] = np.abs(
                form.residual(later, y + revolutions, yp) - form.residual(now, y, yp)
            )
            values_of_first.append(form.residual(now, *first).copy())
            forces = form.residual(now, y, np.zeros_like(yp))[e.n : 2 * e.n]
            largest_force = max(largest_force, float(np.max(np.abs(forces))))
        sizes = np.full(form.size, min(1.0, e.length))
        # The rows of the velocities contain forces.
        sizes[e.n : 2 * e.n] = largest_force
        excess = change - _REPETITION_TOLERANCE * sizes
        # In a period that is far too short, varying loads do not change noticeably.
        ranges = np.ptp(values_of_first, axis=0)
        is_constant = ranges <= _REPETITION_TOLERANCE * sizes
        later_tolerance = _REPETITION_TOLERANCE * sizes + _MAX_LATER_RANGE * ranges
        for periods in _LATER_PERIODS.tolist():
            later = np.full(2, times[0] + periods * self.period)
            later_change = np.abs(form.residual(later, *first) - values_of_first[0])
            later_excess = later_change - later_tolerance
            excess[0] = np.fmax(excess[0], np.where(is_constant, later_excess, -np.inf))
        row, worst = map(int, np.unravel_index(np.argmax(excess), change.shape))
        if excess[row, worst] <= 0.0:
            return None

        y, yp = form.pack(State(*(x[row] for x in state)))
        now = form.residual(np.array([times[row], interval.branch]), y, yp)[worst]

        def difference_after(period: float) -> float:
            later = np.full(2, times[row] + period)
            return float(form.residual(later, y + revolutions, yp)[worst] - now)

        def change_after(t: float, duration: float) -> float:
            times = np.array([t, interval.branch]), np.full(2, t + duration)
            before, after = (form.residual(x, y, yp)[worst] for x in times)
            return float(after - before)

        # Beside a uniform motion, changes after a period are equal; those of the uniform motion
        # alone are half of it after half a period.
        drifts = [change_after(t, self.period) for t in times.tolist()]
        half = change_after(times[row], 0.5 * self.period)
        tolerance = _REPETITION_TOLERANCE * sizes[worst]
        is_drift = np.ptp(drifts) <= tolerance < abs(drifts[0])
        is_uniform = abs(2.0 * half - drifts[0]) <= tolerance
        size = excess[row, worst] + tolerance
        is_force = e.n <= worst < 2 * e.n
        is_angle = np.concatenate([e.is_angle, e.is_angle, *[e.constraint_is_angle] * 2])
        unit = "rad" if is_angle[worst] else "m"
        if worst >= 2 * e.n + e.m:
            unit += "/s"  # derivatives of the constraints
        return _Mismatch(
            form.names[worst].removeprefix("velocity of ").removeprefix("correction of "),
            float(times[row]),
            f"{size / largest_force:.2g} of the largest force"
            if is_force
            else f"{size:.3g} {unit}",
            find_nearby_root(difference_after, self.period),
            abs(drifts[0]) / self.period if is_drift and not is_uniform else 0.0,
        )

    def is_autonomous(self, solution: Solution) -> bool:
        """Return True if loads and drivers do not depend on time."""
        return all(
            replace(self, period=share * self.period)._find_mismatch(solution) is None
            for share in _TEST_PERIODS
        )

    def full_revolutions(self, solution: Solution) -> Array:
        """Return 2 pi times the number of full revolutions of each angle in a period [rad], (n,).

        The entries of other coordinates are zero.
        """
        last = solution.trajectory.intervals[-1].state.q[-1]
        first = solution.trajectory.intervals[0].state.q[0]
        return self._full_turns(first, last)

    def _full_turns(self, first: Array, last: Array) -> Array:
        turns = FULL_TURN * np.round((last - first) / FULL_TURN)
        return np.where(self.equations.is_angle, turns, 0.0)

    def deviation(self, solution: Solution) -> Array:
        """Return the state at the end of a period minus the state at its start, (2 n,).

        Full revolutions of angles are removed. The end of runs with fixed steps is made consistent:
        their velocities violate the constraints by errors of the steps, the start does not.
        """
        first, last = (
            np.concatenate([x.q[k], x.v[k]])
            for x, k in (
                (solution.trajectory.intervals[0].state, 0),
                (solution.trajectory.intervals[-1].state, -1),
            )
        )
        deviation = last - first
        deviation[: self.equations.n] -= self.full_revolutions(solution)
        if self.integrator.accuracy.name == "step":
            end = self.make_consistent(*np.split(first + deviation, 2))
            deviation = np.concatenate(end) - first
        return deviation

    def state_scales(self, solution: Solution) -> Array:
        """Return natural sizes (2 n,) of (q, v).

        The size of a coordinate is its amplitude, but at most the size of the mechanism or 1 rad.
        The size of a velocity is that of its coordinate times 2 pi / period or, with fast
        vibrations, times the rate of the motion.
        """
        amplitudes = Amplitudes.from_trajectory(solution.equations, solution.trajectory)
        scales = np.minimum(amplitudes.scales, self.equations.position_scales)
        return np.concatenate([scales, max(FULL_TURN / self.period, amplitudes.rate) * scales])


def equalize_deformations(equations: EquationsOfMotion, scales: Array) -> Array:
    """Return scales (..., n) with the largest of the deformations of a part with the same unit."""
    is_angle, scales = equations.is_angle, scales.copy()
    for part in equations.parts:
        rows = np.arange(part.deformations.start, part.deformations.stop)
        for group in (rows[is_angle[rows]], rows[~is_angle[rows]]):
            scales[..., group] = np.max(scales[..., group], axis=-1, initial=0.0, keepdims=True)
    return scales


@dataclass(frozen=True, eq=False)
class PeriodRun:
    """Run over one period from a consistent state.

    Attributes
    ----------
    period_map
        Map from the start to the end of the period.
    solution
        Run over the period.
    scales
        Natural sizes of (q, v), (2 n,).
    relative_deviation
        Largest absolute component of the state at the end of the period minus the state at its
        start, (q, v), relative to `scales`.
    persistent
        Disturbances (2 n, r) that are expected to persist over the period, known from a similar
        run, or None.
    """

    period_map: PeriodMap
    solution: Solution
    scales: Array
    relative_deviation: float
    persistent: Array | None = None

    @classmethod
    def from_state(
        cls,
        period_map: PeriodMap,
        q: Array,
        v: Array,
        persistent: Array | None = None,
        amplitudes: Array | None = None,
    ) -> PeriodRun:
        """Run one period from a consistent state (q, v), with known `amplitudes` (n,) or None.

        Raises
        ------
        IncompleteRunError
            If the run ends early.
        """
        return cls.of_solution(period_map, period_map.run(q, v, amplitudes), persistent)

    @classmethod
    def of_solution(
        cls, period_map: PeriodMap, solution: Solution, persistent: Array | None = None
    ) -> PeriodRun:
        """Return the run over one period with this solution."""
        scales = period_map.state_scales(solution)
        largest = float(np.max(np.abs(period_map.deviation(solution) / scales)))
        return cls(period_map, solution, scales, largest, persistent)

    @cached_property
    def _disturbance_basis(self) -> DisturbanceBasis:
        return self.period_map.variational.admissible_disturbances(
            self.solution.trajectory, self.scales
        )

    @property
    def basis(self) -> Array:
        """Basis of the admissible disturbances at the start, (2 n, k), orthonormal in energy.

        See `VariationalEquations.admissible_disturbances`.
        """
        return self._disturbance_basis.columns

    @property
    def projection(self) -> Array:
        """Matrix (k, 2 n) that expresses disturbances of (q, v) in terms of `basis`."""
        return self._disturbance_basis.projection

    @cached_property
    def deviation(self) -> Array:
        """Difference of the states at the end and at the start in terms of `basis`, (k,)."""
        return self.projection @ self.period_map.deviation(self.solution)

    @property
    def state(self) -> Array:
        """(q, v) at the start of the period, (2 n,)."""
        first = self.solution.trajectory.intervals[0].state
        return np.concatenate([first.q[0], first.v[0]])

    @property
    def amplitudes(self) -> Array:
        """Scales of q, (n,)."""
        return self.scales[: len(self.scales) // 2]

    def propagate(
        self,
        disturbances: Array,
        steps_per_node: float,
        tolerance: float = EXACT_RANK,
        max_halvings: int = MAX_HALVINGS,
    ) -> Array:
        """Propagate disturbances (k, j) over the period; both are in terms of `basis`.

        Raises
        ------
        LinearizationError
            As `VariationalEquations.propagate`.
        """
        columns = self.basis @ disturbances
        return self.projection @ self.period_map.variational.propagate(
            self._linearized_trajectory,
            columns,
            self.scales,
            steps_per_node,
            tolerance,
            max_halvings,
        )

    @cached_property
    def _linearized_trajectory(self) -> Trajectory:
        """The run or, with other adaptive methods, a run by Radau from the same state."""
        radau = self.period_map.with_radau()
        if radau is self.period_map:
            return self.solution.trajectory
        q, v = np.split(self.state, 2)
        return replace(radau, is_coarse=True).run(q, v, self.amplitudes).trajectory

    def monodromy(
        self,
        *directions: Array,
        steps_per_node: float,
        tolerance: float = EXACT_RANK,
        persistent: Array | None = None,
    ) -> Array:
        """Return the monodromy matrix (k, k), in terms of `basis`.

        It maps disturbances at the start of the period to those at its end, and is exact on its
        range and `directions`, (k,) each; see `assemble_monodromy`. `persistent` are disturbances
        that are expected to persist; they default to those of the run.
        """
        size = len(self.deviation)
        persistent = self.persistent if persistent is None else persistent
        stage_tolerance = max(EXACT_RANK, _STAGE_TOLERANCE_RATIO * tolerance)
        return assemble_monodromy(
            lambda columns: self.propagate(columns, steps_per_node, stage_tolerance),
            size,
            np.column_stack([np.zeros((size, 0)), *directions]),
            tolerance,
            None if persistent is None else self.projection @ persistent,
        )

    def resolved_monodromy(
        self, *directions: Array, tolerance: float = _NEWTON_RANK_TOLERANCE
    ) -> Array:
        """Return the monodromy matrix for Newton's method, on steps of the run.

        It is exact on the deviation and `directions`. For runs of `Radau`, this is the derivative
        of the discrete solution. Other adaptive steps are replaced by those of `Radau`.

        Raises
        ------
        LinearizationError
            As `VariationalEquations.propagate`.
        """
        return self.monodromy(
            self.deviation, *directions, steps_per_node=self.steps_per_node, tolerance=tolerance
        )

    def persistent_disturbances(self, monodromy: Array) -> Array:
        """Return the disturbances (2 n, r) that persist according to a monodromy matrix."""
        return self.basis @ dominant_range(monodromy, _EXPECTED_RANK_TOLERANCE)

    @property
    def steps_per_node(self) -> float:
        """Number of steps of the run in each step of the variational equations.

        1 for adaptive steps; more for fixed steps, whose methods are of lower order.
        """
        has_stages = self._linearized_trajectory.intervals[0].nodes_per_step > 1
        return 1.0 if has_stages else _STEPS_PER_NODE

    @property
    def rates(self) -> tuple[Array, Array]:
        """Time derivatives of the state at the start and at the end of the period, (k,) each.

        They are multiplied by the period and expressed in terms of `basis`.
        """
        intervals = self.solution.trajectory.intervals
        first, last = intervals[0].state, intervals[-1].state
        rates = [np.concatenate([x.v[k], x.a[k]]) for x, k in ((first, 0), (last, -1))]
        start, end = (self.period_map.period * (self.projection @ x) for x in rates)
        return start, end

    def prediction_error(self, last: PeriodRun, share: float) -> float:
        """Return the error of the deviation predicted for a share of the Newton step of `last`.

        It is relative to the predicted change of the deviation.
        """
        before, after = (x.period_map.deviation(x.solution) / last.scales for x in (last, self))
        error = np.max(np.abs(after - (1.0 - share) * before))
        return float(error / max(share * np.max(np.abs(before)), _TINY))

    def relative_size(self, change: Array) -> float:
        """Return the largest entry of a change (2 n,) of (q, v), relative to `scales`."""
        return float(np.max(np.abs(change) / self.scales))


def solve_shooting(
    period_map: PeriodMap,
    q: Array,
    v: Array,
    tolerance: Tolerance,
    free_period: bool = False,
    amplitudes: Array | None = None,
) -> tuple[PeriodRun, int]:
    """Return the best result of Newton's method, and the number of iterations.

    The method has converged if `relative_deviation` is at most `tolerance.accepted`. With
    `free_period`, the period is an unknown; the phase condition keeps corrections of the state
    orthogonal to its time derivative. `amplitudes`, (n,), are those of a similar motion, or None.

    Raises
    ------
    IncompleteRunError
        If the first run ends early, or a later run does even after a Newton step is halved five
        times.
    BeamdaeError
        If loads or drivers are not periodic or, with `free_period`, depend on time.
    """
    run, iterations, _ = _iterate(period_map, q, v, tolerance, free_period, None, amplitudes)
    return run, iterations


def settle_and_solve(
    period_map: PeriodMap, periods: int, tolerance: Tolerance
) -> tuple[PeriodRun, int]:
    """Return the result of `solve_shooting` after a run of `periods` periods.

    Both begin with coarse runs of Radau; accurate runs, first of Radau, continue with the last
    matrix. If these do not lead to the motion, all runs are accurate.

    Raises
    ------
    IncompleteRunError, BeamdaeError
        As `solve_shooting`.
    """
    coarse = period_map.coarsen()
    if coarse is not period_map:
        coarse_tolerance = Tolerance.for_integrator("periodic", None, coarse.integrator)
        with suppress(IncompleteRunError, LinearizationError):
            q, v, amplitudes = coarse.settle(periods)
            run, count, linearization = _iterate(
                coarse, q, v, coarse_tolerance, False, None, amplitudes
            )
            accepted, radau = coarse_tolerance.accepted, period_map.with_radau()
            is_final = radau is period_map or period_map._has_large_rtol
            for accurate in (period_map,) if is_final else (radau, period_map):
                if run.relative_deviation > accepted:
                    break
                # Corrections excite fast vibrations, which take accurate runs thousands of steps;
                # they decay within the long steps of a coarse run.
                q, v = run.period_map.end_state(run.solution)
                run, further, linearization = _iterate(
                    accurate, q, v, tolerance, False, linearization, run.amplitudes
                )
                count, accepted = count + further, tolerance.accepted
            if run.relative_deviation <= accepted:
                return run, count
    q, v, amplitudes = period_map.settle(periods)
    run, count, _ = _iterate(period_map, q, v, tolerance, False, None, amplitudes)
    return run, count


def _iterate(
    period_map: PeriodMap,
    q: Array,
    v: Array,
    tolerance: Tolerance,
    free_period: bool,
    linearization: Linearization | None = None,
    amplitudes: Array | None = None,
) -> tuple[PeriodRun, int, Linearization | None]:
    """Return the best result of Newton's method, the number of iterations and the last matrix.

    `amplitudes` are those of a similar motion, (n,), or None.
    """
    persistent = None if linearization is None else linearization.persistent
    try:
        result = PeriodRun.from_state(period_map, q, v, persistent, amplitudes)
    except IncompleteRunError as error:
        if linearization is None:
            period_map.require_valid_loads(error.solution, free_period)
        raise
    # A similar motion has the same loads.
    if linearization is None:
        period_map.require_valid_loads(result.solution, free_period)
    stagnation = _COARSE_STAGNATION if period_map.is_coarse else _STAGNATION
    best, last_halving, contraction = result, 0, np.inf
    largest_change, prediction_error = _MAX_CHANGE, 0.0
    max_error = _MAX_FREE_PREDICTION_ERROR if free_period else _MAX_PREDICTION_ERROR
    for iteration in range(1, _MAX_ITERATIONS + 1):
        if linearization is None:
            if result.relative_deviation <= tolerance.target:
                return result, iteration - 1, linearization
            linearization = Linearization.from_run(result, free_period)
        change, stretch, share = linearization.newton_step(result, largest_change)
        correction = max(result.relative_size(change), abs(stretch))
        if tolerance.is_met(result.relative_deviation, correction, contraction):
            return result, iteration - 1, linearization
        if prediction_error > max_error:
            try:
                linearization = Linearization.from_run(result, free_period)
            except LinearizationError:
                if period_map.is_coarse:
                    return best, iteration - 1, linearization
                raise
            change, stretch, share = linearization.newton_step(result, largest_change)
            correction = max(result.relative_size(change), abs(stretch))
        last, result = result, _shoot_from(result, change, stretch, linearization.persistent)
        if not free_period:
            linearization = linearization.update(last, result)
        contraction = result.relative_deviation / last.relative_deviation
        prediction_error = contraction if share == 1.0 else result.prediction_error(last, share)
        if prediction_error > max_error:
            largest_change = _MAX_CHANGE
        elif share < 1.0:
            largest_change *= _CHANGE_GROWTH
        if result.relative_deviation < 0.5 * best.relative_deviation:
            last_halving = iteration
        best = min(best, result, key=lambda x: x.relative_deviation)
        is_near = best.relative_deviation < stagnation.deviation
        if is_near and iteration - last_halving >= stagnation.iterations:
            return best, iteration, linearization
    return best, _MAX_ITERATIONS, linearization


@dataclass(frozen=True, eq=False)
class Linearization:
    """Newton's matrix at a run, also used for later runs close to it.

    Attributes
    ----------
    run
        The run, in terms of whose basis the matrix is expressed.
    matrix
        Derivative of the deviation with respect to the state, (k, k), or with an unknown period,
        bordered by the derivative with respect to the relative period and by the phase condition.
    persistent
        Disturbances (2 n, r) that persist over the period.
    """

    run: PeriodRun
    matrix: Array
    persistent: Array

    @classmethod
    def from_run(cls, run: PeriodRun, free_period: bool) -> Linearization:
        """Return the linearization at a run."""
        directions = run.rates if free_period else ()
        monodromy = run.resolved_monodromy(*directions)
        start, end = run.rates
        matrix = monodromy - np.eye(len(run.deviation))
        if free_period:
            phase = np.append(start / max(float(np.linalg.norm(start)), _TINY), 0.0)
            matrix = np.vstack([np.column_stack([matrix, end]), phase])
        return cls(run, matrix, run.persistent_disturbances(monodromy))

    def update(self, last: PeriodRun, run: PeriodRun) -> Linearization:
        """Return the linearization that predicts the change of the deviation between two runs.

        Both have the same period.
        The change of the matrix is the smallest possible one (Broyden, Math. Comp. 19 (1965) 577).
        """
        before, after = (x.period_map.deviation(x.solution) for x in (last, run))
        projection = self.run.projection
        shift = projection @ (run.state - last.state)
        error = projection @ (after - before) - self.matrix @ shift
        update = np.outer(error, shift) / max(float(shift @ shift), _TINY)
        return replace(self, matrix=self.matrix + update)

    def newton_step(self, run: PeriodRun, largest: float) -> tuple[Array, float, float]:
        """Return the changes of (q, v), (2 n,), and of the period, relative to the period.

        They are this share of those that remove the deviation, the third value, because changes of
        (q, v) are limited to `largest` times the amplitudes or to the deviation.
        """
        reduced = self.run.projection @ run.period_map.deviation(run.solution)
        right = np.append(reduced, np.zeros(len(self.matrix) - len(reduced)))
        solution = -np.linalg.lstsq(self.matrix, right, rcond=_NEUTRAL_RATIO)[0]
        change = self.run.basis @ solution[: len(reduced)]
        stretch = float(np.sum(solution[len(reduced) :]))
        # Disturbances that decay within the period are corrected by their whole deviation.
        deviations = np.abs(run.period_map.deviation(run.solution))
        limits = np.maximum(largest * run.scales, deviations)
        factor = max(1.0, float(np.max(np.abs(change) / limits)), abs(stretch) / _MAX_STRETCH)
        return change / factor, stretch / factor, 1.0 / factor


def _shoot_from(
    run: PeriodRun,
    change: Array,
    stretch: float,
    persistent: Array,
    halvings: int = _MAX_HALVINGS,
) -> PeriodRun:
    """Run a period from a shifted start; halve the changes as long as the run ends early."""
    period_map = replace(run.period_map, period=run.period_map.period * (1.0 + stretch))
    try:
        q, v = period_map.make_consistent(*np.split(run.state + change, 2))
        return PeriodRun.from_state(period_map, q, v, persistent, run.amplitudes)
    except IncompleteRunError:
        if not halvings:
            raise
        return _shoot_from(run, 0.5 * change, 0.5 * stretch, persistent, halvings - 1)


def estimate_period(solution: Solution) -> float | None:
    """Return the time since a run was last near its final state [s], or None.

    Differences are measured relative to the ranges of (q, v) in the second half of the run.
    """
    trajectory, is_angle = solution.trajectory, solution.equations.is_angle

    def differences(times: Array) -> Array:
        state = trajectory.at(times)[1]
        last = trajectory.intervals[-1].state
        q = state.q - last.q[-1]
        q -= np.where(is_angle, FULL_TURN * np.round(q / FULL_TURN), 0.0)
        return np.concatenate([q, state.v - last.v[-1]], axis=1)

    times = np.linspace(trajectory.end, trajectory.start, _RETURN_SAMPLES)
    changes = differences(times[::-1])[::-1]
    ranges = np.ptp(changes[: _RETURN_SAMPLES // 2], axis=0)
    largest = np.repeat([np.max(x) for x in np.split(ranges, 2)], len(is_angle))
    moves = ranges > _REST_RATIO * np.maximum(largest, _TINY)
    if not moves.any():
        return None
    distance = np.max(np.abs(changes[:, moves] / ranges[moves]), axis=1)
    departed = int(np.argmax(distance > 2.0 * _RETURN_DISTANCE))
    is_near = distance < _RETURN_DISTANCE
    is_near[:departed] = False
    if not departed or not is_near.any():
        return None
    first = int(np.argmax(is_near))
    count = int(np.argmin(np.append(is_near[first:], False)))
    nearest = first + int(np.argmin(distance[first : first + count]))
    earlier, later = times[[min(nearest + 1, len(times) - 1), nearest - 1]]
    around = np.linspace(earlier, later, _REFINED_RETURN_SAMPLES)
    distance = np.linalg.norm(differences(around)[:, moves] / ranges[moves], axis=1)
    return float(trajectory.end - around[np.argmin(distance)])
