"""Newton corrector for the static equations bordered by one control equation."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.analysis.statics.path_controls import Control, PathDirection
from beamdae.analysis.statics.stability import Stability, assess_stability
from beamdae.analysis.statics.strain_increments import StrainIncrements
from beamdae.equations.starts.rigid_motions import DisplacementMeasure
from beamdae.linear.factorizations import Factorization, SingularMatrixError, create_factorization
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

_MAX_ITERATIONS = 15
# Newton corrections are relative to the size of the mechanism, angles in rad.
_DIVERGENCE_LIMIT = 0.5
_CONVERGENCE_TOLERANCE = 1e-10
# A correction below this size is also accepted if it exceeds this fraction of the previous one,
# because rounding errors of stiff beams may prevent smaller corrections.
_STAGNATION_TOLERANCE = 1e-6
_STAGNATION_RATIO = 0.1


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
    """

    system: LoadedEquations = field(repr=False)
    x: Array
    mu: float
    iterations: int = 0

    @cached_property
    def stability(self) -> Stability:
        """Stability of the equilibrium, computed on first access."""
        return assess_stability(self.system, self.x, self.mu)


@dataclass
class Corrector:
    """Newton's method for one load stage, with a count of its iterations.

    It solves F(x; mu) = 0, c(x, mu) = target with the bordered matrix [[F_x, F_mu], [c_x, c_mu]],
    where c is the control. Except with load control, this matrix is in general regular at limit
    points, although F_x is singular.
    """

    system: LoadedEquations
    iterations: int = 0

    @cached_property
    def displacement_measure(self) -> DisplacementMeasure:
        """Measure of the displacements of the bodies, for the size of corrections."""
        return DisplacementMeasure.of(self.system.equations)

    @cached_property
    def _increments(self) -> StrainIncrements:
        return StrainIncrements.of(self.system.equations)

    def displace(self, x: Array, change: Array) -> Array:
        """Return x = (q, lam) displaced by a finite change, see `strain_increments`."""
        return self._increments.displace(x, change)

    def interpolate(self, x: Array, other: Array, position: float) -> Array:
        """Return unknowns between `x` (position 0) and `other` (position 1)."""
        return self.displace(x, position * self._increments.difference(x, other))

    @cached_property
    def _bordered(self) -> tuple[sp.csc_array, Array, Array]:
        """CSC pattern of the bordered matrix, and indices of F_x and the last row in its data."""
        pattern, size = self.system.pattern, self.system.pattern.shape[0]
        tangent_positions = np.arange(pattern.nnz) + column_indices(pattern)
        row_positions = np.append(pattern.indptr[1:] + np.arange(size), pattern.nnz + size + size)
        indptr = np.append(pattern.indptr + np.arange(size + 1), pattern.nnz + 2 * size + 1)
        indices = np.zeros(indptr[-1], np.int32)
        indices[tangent_positions], indices[row_positions] = pattern.indices, size
        indices[indptr[size] :] = np.arange(size + 1)
        bordered = sp.csc_array(
            (np.ones(len(indices)), indices, indptr), shape=(size + 1, size + 1)
        )
        return bordered, tangent_positions, row_positions

    @cached_property
    def _solver(self) -> Factorization:
        return create_factorization(self._bordered[0])

    def _factorize(self, tangent: Array, by_factor: Array, row: tuple[Array, float]) -> None:
        pattern, tangent_positions, row_positions = self._bordered
        size = len(by_factor)
        nonzeros = np.zeros(pattern.nnz)
        nonzeros[tangent_positions], nonzeros[row_positions] = tangent, np.append(*row)
        nonzeros[pattern.indptr[size] : -1] = by_factor
        try:
            self._solver.factorize(nonzeros)
        except SingularMatrixError:
            raise CorrectorError("the tangent stiffness is singular at the next point") from None

    def correct(self, control: Control, target: float, x: Array, mu: float) -> EquilibriumPoint:
        """Return the equilibrium near (x, mu) at which the control equals `target`.

        Raises
        ------
        CorrectorError
            If Newton's method diverges, meets a singular matrix or forces that are not finite, or
            takes more than 15 iterations.
        """
        last_size = np.inf
        for k in range(_MAX_ITERATIONS):
            forces, by_factor = self.system.residual(x, mu)
            residual = np.append(forces, control.value(x, mu) - target)
            if not np.all(np.isfinite(residual)):
                raise CorrectorError("the forces are not finite at the next point")
            self._factorize(self.system.tangent(x, mu), by_factor, control.gradient(x, mu))
            change = -self._solver.solve(residual)
            size = self.displacement_measure.farthest(change[: self.system.equations.n])
            if not size <= _DIVERGENCE_LIMIT:
                raise CorrectorError("Newton's method diverges")
            x, mu = self.displace(x, change[:-1]), mu + float(change[-1])
            self.iterations += 1
            stagnates = size <= _STAGNATION_TOLERANCE and size > _STAGNATION_RATIO * last_size
            if size <= _CONVERGENCE_TOLERANCE or stagnates:
                return EquilibriumPoint(self.system, x, mu, k + 1)
            last_size = size
        raise CorrectorError(f"Newton's method did not converge in {_MAX_ITERATIONS} iterations")

    def path_tangent(self, point: EquilibriumPoint, control: Control) -> PathDirection:
        """Return the derivative of (x, mu) with respect to the control along the path.

        Raises
        ------
        CorrectorError
            If the bordered matrix is singular: the control does not change along the path, or paths
            cross at the point.
        """
        x, mu = point.x, point.mu
        _, by_factor = self.system.residual(x, mu)
        self._factorize(self.system.tangent(x, mu), by_factor, control.gradient(x, mu))
        direction = self._solve(np.append(np.zeros(len(x)), 1.0))
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
        self._factorize(self.system.tangent(point.x, point.mu), mode, (mode, 0.0))
        return PathDirection(self._solve(np.append(-by_factor, 0.0))[:-1], 1.0)

    def _solve(self, right: Array) -> Array:
        solution = self._solver.solve(right)
        if not np.all(np.isfinite(solution)):
            raise CorrectorError("the tangent stiffness is singular at the next point")
        return solution
