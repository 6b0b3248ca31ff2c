"""Newton's method on static equations with one quantity given: points of an equilibrium path."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.analysis.statics.path_controls import Control, PathDirection
from beamdae.analysis.statics.stability import Stability, assess_stability
from beamdae.equations.starts.displacement_measure import Travel
from beamdae.linear.factorizations import Factorization, SingularMatrixError, create_factorization
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

_ITERATIONS = 15
# A correction may move things by so much of the mechanism (or rad); below _CLOSED the iteration has
# ended, and below _ROUNDED it has where it gets no smaller.
_FAR, _CLOSED, _ROUNDED = 0.5, 1e-10, 1e-6


class CorrectorError(ArithmeticError):
    """A step that does not converge; the message is why, a phrase."""


@dataclass(frozen=True)
class EquilibriumPoint:
    """An equilibrium.

    Attributes
    ----------
    x, mu
        (q, lam) and the load factor.
    iterations
        Of Newton's method.
    """

    system: LoadedEquations = field(repr=False)
    x: Array
    mu: float
    iterations: int = 0

    @cached_property
    def stability(self) -> Stability:
        """What the tangent stiffness says of it."""
        return assess_stability(self.system, self.x, self.system.tangent(self.x, self.mu))


@dataclass
class Corrector:
    """Newton's method for one stage of loading; counts what it does."""

    system: LoadedEquations
    iterations: int = 0

    @cached_property
    def travel(self) -> Travel:
        """How far changes carry things."""
        return Travel.of(self.system.equations)

    @cached_property
    def _bordered(self) -> tuple[sp.csc_array, Array, Array]:
        """Pattern with a last row and column, and where the tangent and the last row are in it."""
        pattern, size = self.system.pattern, self.system.pattern.shape[0]
        column = column_indices(pattern)
        own = np.arange(pattern.nnz) + column
        last = np.append(pattern.indptr[1:] + np.arange(size), pattern.nnz + size + size)
        indptr = np.append(pattern.indptr + np.arange(size + 1), pattern.nnz + 2 * size + 1)
        indices = np.zeros(indptr[-1], np.int32)
        indices[own], indices[last] = pattern.indices, size
        indices[indptr[size] :] = np.arange(size + 1)
        found = (np.ones(len(indices)), indices, indptr)
        return sp.csc_array(found, shape=(size + 1, size + 1)), own, last

    @cached_property
    def _solver(self) -> Factorization:
        return create_factorization(self._bordered[0])

    def _factorize(self, tangent: Array, by_factor: Array, row: tuple[Array, float]) -> None:
        pattern, own, last = self._bordered
        size = len(by_factor)
        nonzeros = np.zeros(pattern.nnz)
        nonzeros[own], nonzeros[last] = tangent, np.append(*row)
        nonzeros[pattern.indptr[size] : -1] = by_factor
        try:
            self._solver.factorize(nonzeros)
        except SingularMatrixError:
            raise CorrectorError("the tangent stiffness is singular there") from None

    def corrected(self, control: Control, target: float, x: Array, mu: float) -> EquilibriumPoint:
        """The equilibrium near (x, mu) with this value of the control.

        Raises
        ------
        StepError
            If Newton's iteration does not end there.
        """
        before = np.inf
        for k in range(_ITERATIONS):
            residual, by_factor = self.system.residual(x, mu)
            off = np.append(residual, control.value(x, mu) - target)
            if not np.all(np.isfinite(off)):
                raise CorrectorError("the forces are not finite there")
            self._factorize(self.system.tangent(x, mu), by_factor, control.row(x, mu))
            change = -self._solver.solve(off)
            far = self._size(change)
            if not far <= _FAR:
                raise CorrectorError("Newton's iteration runs away")
            x, mu, self.iterations = x + change[:-1], mu + float(change[-1]), self.iterations + 1
            if far <= _CLOSED or (far <= _ROUNDED and far > 0.1 * before):
                return EquilibriumPoint(self.system, x, mu, k + 1)
            before = far
        raise CorrectorError(f"Newton's iteration has not converged after {_ITERATIONS} steps")

    def tangent(self, at: EquilibriumPoint, control: Control) -> PathDirection:
        """The direction of the path by the control.

        Raises
        ------
        StepError
            If the control does not change along the path.
        """
        x, mu = at.x, at.mu
        _, by_factor = self.system.residual(x, mu)
        self._factorize(self.system.tangent(x, mu), by_factor, control.row(x, mu))
        way = self._solved(np.append(np.zeros(len(x)), 1.0))
        return PathDirection(way[:-1], float(way[-1]))

    def direction(self, at: EquilibriumPoint, control: Control) -> PathDirection | None:
        """The same; None where the control does not change along the path."""
        try:
            return self.tangent(at, control)
        except CorrectorError:
            return None

    def loaded(self, at: EquilibriumPoint, mode: Array) -> PathDirection:
        """Where a growing factor leads from a point at which the stiffness loses a mode (n + m,).

        Without what goes along the mode itself, of which the equations say nothing.

        Raises
        ------
        StepError
            If more than this mode is lost.
        """
        _, by_factor = self.system.residual(at.x, at.mu)
        self._factorize(self.system.tangent(at.x, at.mu), mode, (mode, 0.0))
        return PathDirection(self._solved(np.append(-by_factor, 0.0))[:-1], 1.0)

    def _solved(self, right: Array) -> Array:
        found = self._solver.solve(right)
        if not np.all(np.isfinite(found)):
            raise CorrectorError("the tangent stiffness is singular there")
        return found

    def _size(self, change: Array) -> float:
        return self.travel.farthest(change[: self.system.equations.n])
