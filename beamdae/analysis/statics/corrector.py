"""Newton corrector for the static equations bordered by one control equation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from beamdae.analysis.statics.bordered_system import SINGULAR, Correction, LoadSteps
from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.analysis.statics.null_vectors import stiffness_rounding
from beamdae.analysis.statics.path_controls import Control, LoadControl, PathDirection
from beamdae.analysis.statics.slender_modes import ERROR_FLOOR
from beamdae.analysis.statics.stability import Stability, assess_stability
from beamdae.analysis.statics.strain_increments import StrainIncrements
from beamdae.equations.starts.rigid_motions import DisplacementMeasure
from beamdae.linear.factorizations import SingularMatrixError

Array = np.ndarray


class CorrectorError(ArithmeticError):
    """Raised if a path cannot be computed at a point; the message has no final period."""


@dataclass(frozen=True)
class EquilibriumPoint:
    """Point of an equilibrium path.

    Attributes
    ----------
    system
        Static equations that the point solves.
    x
        (q, lam), shape (n + m,).
    mu
        Load factor.
    iterations
        Number of Newton iterations; 0 for points found in another way.
    certain_count
        Number of negative eigenvalues of the stiffness, if it is known with certainty.
    load_direction
        Derivative of (x, mu) with respect to the load factor, if it is known.
    """

    system: LoadedEquations = field(repr=False)
    x: Array
    mu: float
    iterations: int = 0
    certain_count: int | None = None
    load_direction: PathDirection | None = field(default=None, repr=False)

    @cached_property
    def stability(self) -> Stability:
        """Stability of the equilibrium, computed on first access."""
        return assess_stability(self.system, self.x, self.mu)

    @cached_property
    def _certain_count(self) -> int | None:
        if self.certain_count is not None:
            return self.certain_count
        return self.system.bordered.count_negative_eigenvalues(self.x, self.mu)

    def count_by_pivots(self) -> None:
        """Count negative eigenvalues now, because the factors of this point will be needed."""
        _ = self._certain_count

    @property
    def is_count_certain(self) -> bool:
        """True if forces have a potential and no eigenvalue is zero up to rounding of pivots."""
        return self._certain_count is not None

    @cached_property
    def rounding_ratio(self) -> float:
        """Bound on the rounding error of the smallest eigenvalue that is not zero, relative to it.

        It is zero where the signs of pivots are certain, and nan if all eigenvalues are zero.
        """
        if self._certain_count is not None:
            return 0.0
        eigenvalues, zero = self.stability.eigenvalues, self.stability.zero_tolerance
        elastic = np.flatnonzero(np.abs(eigenvalues) > zero)
        if not len(elastic):
            return np.nan
        softest = elastic[np.argmin(np.abs(eigenvalues[elastic]))]
        mode = self.stability.modes[:, softest]
        mode = mode / np.linalg.norm(mode / self.system.scales)
        rounding = stiffness_rounding(self.system, self.x, self.mu, mode, mode)
        return max(rounding, ERROR_FLOOR * zero) / float(np.abs(eigenvalues[softest]))

    @property
    def negative_count(self) -> int:
        """`Stability.negative_count`, without eigenvalues where the signs of pivots suffice."""
        count = self._certain_count
        return self.stability.negative_count if count is None else count

    @property
    def unstable_count(self) -> int:
        """`Stability.unstable_count`, without eigenvalues where the signs of pivots suffice."""
        count = self._certain_count
        return self.stability.unstable_count if count is None else count

    @property
    def free_count(self) -> int:
        """`Stability.free_count`, without eigenvalues where the signs of pivots suffice."""
        return self.stability.free_count if self._certain_count is None else 0

    @property
    def has_potential(self) -> bool:
        """True if the joints allow motion and eigenvalues of the stiffness determine stability."""
        if self._certain_count is None:
            return bool(len(self.stability.eigenvalues))
        return self.system.equations.n > self.system.equations.m


@dataclass
class Corrector:
    """Newton's method for one load stage, with a count of its iterations.

    It solves F(x; mu) = 0, c(x, mu) = target with the bordered matrix [[F_x, F_mu], [c_x, c_mu]],
    where c is the control. Except with load control, this matrix is in general regular at limit
    points, although F_x is singular.
    """

    system: LoadedEquations
    iterations: int = 0

    @property
    def displacement_measure(self) -> DisplacementMeasure:
        """Measure of the displacements of the bodies, for the size of corrections."""
        return self.system.bordered.measure

    @property
    def _increments(self) -> StrainIncrements:
        return self.system.bordered.increments

    def displace(self, x: Array, change: Array) -> Array:
        """Return x = (q, lam) displaced by a finite change, see `strain_increments`."""
        return self._increments.displace(x, change)

    def interpolate(self, x: Array, other: Array, position: float) -> Array:
        """Return unknowns between `x` (position 0) and `other` (position 1)."""
        return self.displace(x, position * self._increments.difference(x, other))

    def combine(self, unknowns: Sequence[Array], weights: Sequence[float]) -> Array:
        """Return the combination of close points (n + m,) with weights of the sum 1."""
        first = unknowns[0]
        changes = [self._increments.difference(first, x) for x in unknowns]
        return self.displace(first, np.einsum("i,ij->j", weights, changes))

    def correct(self, control: Control, target: float, x: Array, mu: float) -> EquilibriumPoint:
        """Return the equilibrium near (x, mu) at which the control equals `target`.

        Raises
        ------
        CorrectorError
            If Newton's method diverges, meets a singular matrix or forces that are not finite, or
            takes more than 15 iterations.
        """
        return self._accept(self.system.bordered.correct(control, target, x, mu))

    def follow(
        self, control: Control, target: float, begin: EquilibriumPoint, step: PathDirection | None
    ) -> tuple[EquilibriumPoint, Correction]:
        """Return the result of `correct` for the prediction begin + step, and details of it.

        Without a step, the prediction is `begin`.

        Raises
        ------
        CorrectorError
            See `correct`.
        """
        correction = self.system.bordered.correct(control, target, begin.x, begin.mu, step, True)
        point = self._accept(correction)
        if correction.direction is not None:
            point.count_by_pivots()
        return point, correction

    def follow_load(
        self,
        begin: EquilibriumPoint,
        direction: PathDirection,
        target: float,
        steps: tuple[float, float],
        max_steps: int,
    ) -> tuple[list[EquilibriumPoint], LoadSteps] | None:
        """Return the points after steps of load control from `begin`, and details of the steps.

        See `BorderedSystem.follow_load`. The result is None if it is, or if the number of negative
        eigenvalues at `begin` is not certain.
        """
        count = begin.negative_count if begin.is_count_certain and begin.has_potential else None
        if count is None:
            return None
        start = begin.x, begin.mu
        bordered = self.system.bordered
        result = bordered.follow_load(start, direction, target, steps, count, max_steps)
        if result is None:
            return None
        rows = zip(result.x, result.mu.tolist(), result.iterations.tolist(), strict=True)
        points = [EquilibriumPoint(self.system, x, mu, k, count) for x, mu, k in rows]
        self.iterations += result.all_iterations
        return points, result

    def _accept(self, correction: Correction) -> EquilibriumPoint:
        self.iterations += correction.iterations
        if correction.failure is not None:
            raise CorrectorError(correction.failure)
        return EquilibriumPoint(self.system, correction.x, correction.mu, correction.iterations)

    def path_tangent(self, point: EquilibriumPoint, control: Control) -> PathDirection:
        """Return the derivative of (x, mu) with respect to the control along the path.

        Raises
        ------
        CorrectorError
            If the bordered matrix is singular: the control does not change along the path, or paths
            cross at the point.
        """
        if point.load_direction is not None and isinstance(control, LoadControl):
            return point.load_direction
        # The factors of this count are also used for the solution.
        point.count_by_pivots()
        _, by_factor = self.system.residual(point.x, point.mu)
        right = np.append(np.zeros(len(point.x)), 1.0)
        gradient = control.gradient(point.x, point.mu)
        direction = self._solve(point, gradient, by_factor, right)
        return PathDirection(direction[:-1], float(direction[-1]))

    def try_path_tangent(self, point: EquilibriumPoint, control: Control) -> PathDirection | None:
        """Return the result of `path_tangent`, or None if it raises `CorrectorError`."""
        try:
            return self.path_tangent(point, control)
        except CorrectorError:
            return None

    def load_response(self, point: EquilibriumPoint, mode: Array) -> PathDirection:
        """Return the response to the load factor at a branch point, without the critical mode.

        `mode`, (n + m,), is the dual of the null vector of the tangent (see `StepNorm.dual`). The
        component of the response along the null vector is undetermined and set to zero.

        Raises
        ------
        CorrectorError
            If the tangent has further null vectors.
        """
        _, by_factor = self.system.residual(point.x, point.mu)
        response = self._solve(point, (mode, 0.0), mode, np.append(-by_factor, 0.0))
        return PathDirection(response[:-1], 1.0)

    def _solve(
        self, point: EquilibriumPoint, gradient: tuple[Array, float], column: Array, right: Array
    ) -> Array:
        """Return the solution of the system bordered by a row `gradient` and a `column`."""
        try:
            solution = self.system.bordered.solve(point.x, point.mu, gradient, column, right)
        except SingularMatrixError:
            raise CorrectorError(SINGULAR) from None
        if not np.all(np.isfinite(solution)):
            raise CorrectorError(SINGULAR)
        return solution
