"""Single shooting: states that repeat after one period, as a problem of the curve engine.

Its linearizations are monodromy matrices minus the identity. One of them costs two to six runs over
a period; Newton's method keeps it as long as it reduces the deviation.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
import scipy.linalg as la

from beamdae.analysis.continuation.critical import Count
from beamdae.analysis.continuation.engine import (
    Control,
    CurveError,
    Point,
    Problem,
    Row,
    prescribe_parameter,
)
from beamdae.analysis.periodic.load_periods import FULL_TURN
from beamdae.analysis.periodic.monodromy import dominant_range
from beamdae.analysis.periodic.period_map import (
    NEWTON_RANK_TOLERANCE,
    PeriodMap,
    PeriodRun,
    equalize_deformations,
)
from beamdae.errors import BeamdaeError, require_positive
from beamdae.integrators import Integrator
from beamdae.results.frequency_response import STABILITY_MARGIN
from beamdae.results.periodic_motion import floquet_multipliers
from beamdae.results.solution import Solution

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
# Corrections of a solution are below this fraction of the tolerance, and those of a period below
# its square, unless deviations stagnate: if they no longer halve, they are errors of the runs.
_CORRECTION_RATIO = 0.1
_STAGNATION_RATIO = 0.5

# A matrix is kept if it reduces the deviation to at most this fraction.
_MAX_CONTRACTION = 0.1
_MAX_PERIOD_CHANGE = 0.5  # of the logarithm of a free period in a correction
# Step of finite differences with respect to the parameter, relative to its range. Tangents have
# errors of the step, and of the errors of runs, about 1e-9, over the step. The distance d of a
# multiplier from 1 amplifies both by 1 / d; it is as small as 2 pi times the damping ratio.
_DIFFERENCE_STEP = 2e-5
# Smaller singular values, relative to the largest, belong to directions in which all states are
# periodic.
_NEUTRAL_RATIO = 1e-9
_DAMPING_RATIO = 0.1  # of corrections with a free period, relative to the deviation
# A run has returned to its final state where it differs by at most this fraction of the range of
# each coordinate and velocity; coordinates with a far smaller range than others are at rest. Number
# of times at which states are compared.
_RETURN_DISTANCE, _REST_RATIO, _RETURN_SAMPLES = 0.2, 1e-6, 4001
# Errors of runs are amplified at resonances without damping.
DAMPING_REMEDY = (
    "add damping, such as damping= of the sections, or, for small motions, use "
    "bd.linearize(...).frequency_response"
)
_TINY = 1e-300  # avoids a division by zero


class Tolerance(NamedTuple):
    """Tolerance of the difference between both ends of a period, relative to the amplitudes.

    Attributes
    ----------
    target
        Difference at which the iteration ends.
    accepted
        Largest difference at which an iteration that stagnates has succeeded.
    correction
        Largest next correction of a solution.
    """

    target: float
    accepted: float
    correction: float

    @classmethod
    def for_integrator(cls, name: str, value: Any, integrator: Integrator) -> Tolerance:
        """Return the tolerance `value`, or the default for the integrator if it is None."""
        if value is not None:
            target, allowance = require_positive(name, "tolerance", value), 1.0
        elif integrator.accuracy.name == "rtol":
            rtol = _TOLERANCE_FACTOR * integrator.accuracy.value
            target, allowance = float(np.clip(rtol, *_TOLERANCE_BOUNDS)), _STAGNATION_ALLOWANCE
        else:
            target, allowance = _FIXED_STEP_TOLERANCE, 1.0
        return cls(target, allowance * target, _CORRECTION_RATIO * target)


@dataclass(frozen=True, eq=False)
class ShootingMatrix:
    """Derivatives of the residual about a run.

    Attributes
    ----------
    run
        The run.
    jacobian
        Monodromy matrix minus the identity, in terms of (q, v), (2 n, 2 n).
    by_parameter
        Derivative with respect to the parameter of the problem, (2 n,).
    """

    run: PeriodRun
    jacobian: Array
    by_parameter: Array

    @classmethod
    def of(
        cls,
        run: PeriodRun,
        *directions: Array,
        is_free: bool = False,
        shift: Array | float = 0.0,
        change: Array | float = 0.0,
        **options: Any,
    ) -> ShootingMatrix:
        """Return the derivatives; those by a parameter follow from its `shift` of the start.

        `change` is that of the deviation. If `is_free`, the parameter is the logarithm of the
        period. The derivatives are exact on these changes and `directions`, see
        `PeriodRun.monodromy`.
        """
        if is_free:
            last = run.solution.trajectory.intervals[-1].state
            change = run.period_map.period * np.concatenate([last.v[-1], last.a[-1]])
            directions += (run.rate,)
        state, end = (np.broadcast_to(x, len(run.scales)) for x in (shift, change))
        columns = run.projection @ end, run.projection @ state, *directions
        monodromy = run.monodromy(*columns, **options)
        jacobian = run.basis @ monodromy @ run.projection - np.eye(len(state))
        return cls(run, jacobian, run.basis @ columns[0] - jacobian @ state)

    @cached_property
    def monodromy(self) -> Array:
        """Monodromy matrix (k, k), in terms of the basis of the run."""
        matrix = self.run.projection @ self.jacobian @ self.run.basis
        return np.asarray(matrix + np.eye(len(matrix)))

    @cached_property
    def persistent(self) -> Array:
        """Disturbances of (q, v) that persist over a period, (2 n, r)."""
        return self.run.basis @ dominant_range(self.monodromy, NEWTON_RANK_TOLERANCE)


@dataclass(frozen=True, eq=False)
class PeriodLinearization:
    """Equations of a periodic motion, linearized about a run.

    The deviation after a period vanishes, in terms of the motions that the joints allow; in their
    complement, the unknowns are those of the consistent state of the run.

    Attributes
    ----------
    problem
        The problem.
    x, p
        Unknowns and parameter.
    run
        The run from the nearest consistent state.
    similar
        Matrix of a similar run, whose range is expected in that of the run; or None.
    is_kept
        True if the matrix of the similar run is kept.
    iterations
        Number of runs before this one.
    """

    problem: PeriodProblem
    x: Array
    p: float
    run: PeriodRun
    similar: ShootingMatrix | None = None
    is_kept: bool = False
    iterations: int = 0

    @cached_property
    def matrix(self) -> ShootingMatrix:
        """Derivatives of the residual."""
        if self.is_kept:
            assert self.similar is not None
            return self.similar
        return self.problem.differentiate(self.run, self.p, self.similar)

    @property
    def residual(self) -> Array:
        """Deviation, and distance from the consistent state."""
        run, off = self.matrix.run, self.x - self.run.state
        return np.asarray(run.basis @ (run.projection @ (self.run.difference + off)) - off)

    @property
    def by_parameter(self) -> Array:
        """Derivative of the residual with respect to the parameter."""
        return self.matrix.by_parameter

    @property
    def alternating(self) -> PeriodLinearization:
        """The linearization with the sum of monodromy matrix and identity in its place."""
        jacobian = self.matrix.jacobian + 2.0 * np.eye(len(self.x))
        return replace(self, similar=replace(self.matrix, jacobian=jacobian), is_kept=True)

    def bordered(self, column: Array, row: Array, corner: float) -> _Inverse:
        """Return the inverse of the bordered Jacobian; states that are all periodic remain.

        Motions without damping belong to families, in which the period changes with the size: if
        it is free, corrections are those of Levenberg and Marquardt, with a damping proportional to
        the deviation (Yamashita & Fukushima, Computing Suppl. 15 (2001) 239).
        """
        run, jacobian = self.matrix.run, self.matrix.jacobian
        column, row = (x.reshape(len(x), -1) for x in (column, row))
        end = np.eye(column.shape[1])
        to, back = (la.block_diag(x, end) for x in run.energy_coordinates)
        matrix = to @ np.block([[jacobian, column], [row.T, corner * end]]) @ back
        if not np.isfinite(matrix).all():
            raise CurveError("the linearized equations are not finite")
        left, sizes, right = np.linalg.svd(matrix)
        damping = 0.0
        if self.problem.is_free:
            damping = _DAMPING_RATIO * min(self.run.relative_deviation, 1.0) * sizes[0]
        is_kept = sizes > _NEUTRAL_RATIO * sizes[0]
        inverse = np.where(is_kept, sizes, 0.0) / (sizes**2 + damping**2 + _TINY)
        return _Inverse(back @ (right.T * inverse) @ (left.T @ to))


class _Inverse(NamedTuple):
    """Inverse of a bordered matrix."""

    values: Array

    def solve(self, right: Array) -> Array:
        """Return the solution for a right-hand side."""
        return np.asarray(self.values @ right)


@dataclass(frozen=True, eq=False)
class PeriodProblem(Problem):
    """Periodic motions: the state is the unknown.

    Attributes
    ----------
    map_at
        Function that returns the map over a period for a parameter.
    tolerance
        Tolerance of the period.
    is_free
        True if the parameter is the logarithm of the period.
    varies
        True if the map depends on another parameter, from 0 to 1.
    base
        A similar motion, which gives the sizes of changes and the first matrix; None before the
        first run.
    iterates
        Linearizations of the last search for a motion.
    """

    map_at: Callable[[float], PeriodMap]
    tolerance: Tolerance
    is_free: bool = False
    varies: bool = False
    base: PeriodLinearization | None = None
    iterates: list[PeriodLinearization] = field(default_factory=list, init=False, repr=False)

    @cached_property
    def weights(self) -> Array:
        """Reciprocal sizes of the unknowns, whose sum of squares is a mean square.

        The number of elements thus hardly matters. Deformations of a beam have the largest size of
        its deformations with the same unit: beside the far smaller amplitudes of axial
        deformations, steps of curves would be short.
        """
        assert self.base is not None
        run = self.base.run
        scales = equalize_deformations(run.solution.equations, run.scales.reshape(2, -1)).ravel()
        return np.asarray(1.0 / (scales * np.sqrt(scales.size)))

    def measure(self, step: Array) -> float:
        """Return the root mean square of a step relative to the amplitudes."""
        return float(np.linalg.norm(step * self.weights))

    def monitor(self, point: Point) -> Count:
        """Return the number of multipliers that leave the unit circle.

        Errors of moduli of oscillations are those of `ResponsePoint.stable`.
        """
        multipliers = floquet_multipliers(point.linearization.matrix.monodromy)
        is_real = multipliers.imag == 0.0
        real, moduli = multipliers.real[is_real], np.abs(multipliers[~is_real])
        return Count(
            int(np.sum(real > 1.0)),
            int(np.sum(moduli > 1.0 + STABILITY_MARGIN)) // 2,
            int(np.sum(real < -1.0)),
        )

    def linearize(
        self, x: Array, p: float, last: PeriodLinearization | None = None
    ) -> PeriodLinearization:
        """Return the equations, linearized about a run; the last matrix is kept if it suffices."""
        assert self.base is not None
        before = last or self.base
        if last is None and p == before.p and np.array_equal(x, before.x):
            self.iterates[:] = [before]
            return before
        if self.is_free and last is not None and abs(p - last.p) > _MAX_PERIOD_CHANGE:
            raise CurveError("the period changes too much in a step")
        run, least = self.shoot(x, p, before.run.amplitudes), self.tolerance.target
        if last is not None:
            # Within the target, errors of the runs would spoil a new matrix.
            least = max(least, _MAX_CONTRACTION * last.run.relative_deviation)
        is_kept = last is None or run.relative_deviation <= least
        count = 0 if last is None else last.iterations + 1
        linear = PeriodLinearization(self, x, p, run, before.matrix, is_kept, count)
        self.iterates[:] = [linear] if last is None else [*self.iterates, linear]
        return linear

    def shoot(self, x: Array, p: float, amplitudes: Array | None) -> PeriodRun:
        """Run one period from the nearest consistent state, with known `amplitudes` or None.

        Raises
        ------
        CurveError
            If the run ends early, or cannot begin.
        """
        try:
            period_map = self.map_at(p)
            q, v = period_map.make_consistent(*np.split(x, 2))
            return PeriodRun(period_map, period_map.run(q, v, amplitudes))
        except CurveError:
            raise
        except (BeamdaeError, la.LinAlgError) as error:
            raise CurveError(str(error).rstrip(".")) from error

    def differentiate(
        self, run: PeriodRun, p: float, similar: ShootingMatrix | None
    ) -> ShootingMatrix:
        """Return the derivatives of the deviation of a run.

        Those by the parameter are differences to a point toward the middle of the range, because
        the model may not exist beyond its ends.
        """
        expected = () if similar is None else (run.projection @ similar.persistent,)
        if not self.varies:
            return ShootingMatrix.of(run, *expected, is_free=self.is_free)
        step = _DIFFERENCE_STEP if p < 0.5 else -_DIFFERENCE_STEP
        period_map = self.map_at(p + step)
        q, v = period_map.make_consistent(*np.split(run.state, 2))
        # With the same amplitudes, the errors of both runs are similar.
        other = PeriodRun(period_map, period_map.run(q, v, run.solution.equations.scales))
        shift, change = other.state - run.state, other.difference - run.difference
        return ShootingMatrix.of(run, *expected, shift=shift / step, change=change / step)

    def is_solved(self, linear: PeriodLinearization, step: Array, size: float, last: float) -> bool:
        """Return True if the deviation is within the tolerance, and so is the next correction.

        If disturbances decay slowly, a motion is off by a multiple of its deviation.
        """
        target, accepted, correction = self.tolerance
        deviation = linear.run.relative_deviation
        least = min((x.run.relative_deviation for x in self.iterates[:-1]), default=np.inf)
        stagnates = deviation > _STAGNATION_RATIO * least and size > _STAGNATION_RATIO * last
        if deviation <= target:
            # The largest change of a coordinate is at most this multiple of their mean square.
            largest = size * np.sqrt(len(linear.x))
            if self.is_free:
                largest = max(largest, abs(step[-1]) / _CORRECTION_RATIO)
            return stagnates or bool(largest <= correction)
        return deviation <= accepted and stagnates and not linear.is_kept

    def complete(self, point: Point, step: Array) -> Point:
        """Return a motion with its own matrix and sizes; it needs no further correction."""
        linear = point.linearization
        # A matrix of this run is kept, one of a similar run is not.
        linear = replace(
            linear,
            problem=self,
            x=linear.run.state,
            similar=linear.matrix,
            is_kept=False,
        )
        problem = replace(self, base=linear)
        self.iterates.clear()
        return replace(point, problem=problem, x=linear.x, linearization=linear)


def solve_shooting(
    period_map: PeriodMap,
    q: Array,
    v: Array,
    tolerance: Tolerance,
    free_period: bool = False,
    amplitudes: Array | None = None,
    before: PeriodLinearization | None = None,
) -> PeriodLinearization:
    """Return the linearization about the best run of Newton's method.

    The method has converged if its `relative_deviation` is at most `tolerance.accepted`. With
    `free_period`, the period is an unknown. `amplitudes`, (n,), are those of a similar motion, or
    None. The matrix of a coarse run `before` may be kept.

    Raises
    ------
    IncompleteRunError
        If the first run ends early, or a later run does even after corrections are halved.
    BeamdaeError
        If loads or drivers are not periodic or, with `free_period`, depend on time.
    """
    x, control = np.concatenate([q, v]), cast("Control", prescribe_parameter)
    p = float(np.log(period_map.period)) if free_period else 0.0

    def map_at(p: float) -> PeriodMap:
        return replace(period_map, period=float(np.exp(p))) if free_period else period_map

    problem = PeriodProblem(map_at, tolerance, free_period)
    run = problem.shoot(x, p, amplitudes)
    if free_period:
        # Corrections are orthogonal to the time derivative at the start.
        rate = run.rate / max(float(np.linalg.norm(run.rate)), _TINY)
        row = rate @ run.projection
        control = lambda y, _: Row(float(row @ (y - x)), np.append(row, 0.0))  # noqa: E731

    similar = before.matrix if before else None
    base = PeriodLinearization(problem, x, p, run, similar, similar is not None)
    problem = replace(problem, base=base)
    try:
        solution = problem.correct(control, control(x, p).value, x, p).linearization
        return cast("PeriodLinearization", solution)
    except CurveError as error:
        if isinstance(error, BeamdaeError):
            raise
        best = min(problem.iterates, key=lambda x: x.run.relative_deviation)
        return replace(best, problem=problem, iterations=problem.iterates[-1].iterations)


def settle_and_solve(
    period_map: PeriodMap, periods: int, tolerance: Tolerance
) -> PeriodLinearization:
    """Return the result of `solve_shooting` after a run of `periods` periods.

    Both begin with coarse runs; accurate runs continue with the last matrix. If these do not lead
    to the motion, all runs are accurate. Corrections excite fast vibrations, which take accurate
    runs thousands of steps; they decay within the long steps of a coarse run.

    Raises
    ------
    IncompleteRunError, BeamdaeError
        As `solve_shooting`.
    """
    coarse = period_map.coarse
    if coarse is not None:
        with suppress(CurveError):
            q, v, amplitudes = coarse.settle(periods)
            limits = Tolerance.for_integrator("periodic", None, coarse.integrator)
            limits = limits._replace(correction=np.inf)
            first = solve_shooting(coarse, q, v, limits, False, amplitudes)
            if first.run.relative_deviation <= limits.accepted:
                q, v = first.run.end_state()
                amplitudes = first.run.amplitudes
                last = solve_shooting(period_map, q, v, tolerance, False, amplitudes, first)
                if last.run.relative_deviation <= tolerance.accepted:
                    return replace(last, iterations=first.iterations + last.iterations)
    q, v, amplitudes = period_map.settle(periods)
    return solve_shooting(period_map, q, v, tolerance, False, amplitudes)


def estimate_period(solution: Solution, is_settled: bool) -> float | None:
    """Return the time [s] after which the state at the start of a run recurs first, or None.

    If `is_settled`, it is the time since the last state that is near that at the end. Differences
    are measured relative to the ranges of (q, v) in the second half of the run.
    """
    trajectory, is_angle = solution.trajectory, solution.equations.is_angle
    times = np.linspace(trajectory.start, trajectory.end, _RETURN_SAMPLES)
    state = trajectory.at(times)[1]
    first = -1 if is_settled else 0
    q, v = state.q - state.q[first], state.v - state.v[first]
    q -= np.where(is_angle, FULL_TURN * np.round(q / FULL_TURN), 0.0)
    changes = np.hstack([q, v])
    ranges = np.ptp(changes[_RETURN_SAMPLES // 2 :], axis=0)
    largest = np.repeat([np.max(x) for x in np.split(ranges, 2)], len(is_angle))
    ranges[ranges <= _REST_RATIO * largest] = np.inf
    distance = np.max(np.abs(changes / ranges), axis=1)
    distance = distance[::-1] if is_settled else distance
    has_left = np.maximum.accumulate(distance > 2.0 * _RETURN_DISTANCE)
    is_near = has_left & (distance < _RETURN_DISTANCE)
    if not is_near.any():
        return None
    first = int(np.argmax(is_near))
    last = first + int(np.argmin(np.append(is_near[first:], False)))
    return float(times[first + np.argmin(distance[first:last])] - times[0])
