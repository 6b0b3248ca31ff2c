"""Stability of an equilibrium: signs of its tangent stiffness in the motions joints allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh, splu

from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.linear.orderings import compute_bordered_ordering

Array = np.ndarray

# Coordinates up to which matrices are taken as a whole; those that are not symmetric have no other
# way.
_DENSE, _DENSE_SKEW = 150, 600
# Of the largest entry: what rounding leaves of a zero eigenvalue of a matrix taken as a whole, and
# of one by elimination, of fine meshes; and of differences in a matrix that is symmetric: a
# follower load is small beside the stretch of a thin beam.
_ZERO, _SPARSE_ZERO, _SKEW = 2e-14, 4e-15, 1e-13
# Squares of frequencies over the lowest that are beyond rounding, over the highest that are not
# zero, and the share of an imaginary part that is none.
_FAST, _ENDLESS, _REAL = 1e-8, 1e14, 1e-7
# Eigenvalues nearest to zero that are looked for in large matrices.
_NEAREST = 4


@dataclass(frozen=True)
class Stability:
    """What the tangent stiffness says of an equilibrium under loads that do not change.

    Attributes
    ----------
    values
        Eigenvalues of Z^T S K S Z [J], ascending: all of them, or those nearest to zero. S has the
        natural sizes of the coordinates, Z the motions that the joints allow.
    modes
        What moves in each, (n, number of values), one in natural sizes at most.
    negative
        How many are negative, and of forces without a potential those that are not real; -1 where
        that is not known.
    zero
        Below this size they are what rounding leaves of zero.
    """

    values: Array
    modes: Array
    negative: int
    zero: float = 0.0

    @property
    def free(self) -> int:
        """In how many motions nothing resists."""
        return int(np.sum(np.abs(self.values) <= self.zero))

    @property
    def unstable(self) -> int:
        """How many are negative, beyond rounding; -1 where that is not known."""
        rounded = (self.values < 0.0) & (self.values >= -self.zero)
        return max(self.negative - int(np.sum(rounded)), -1)

    def value(self, index: int) -> float:
        """The eigenvalue that has so many below it; nan where it is not known."""
        place = self._place(index)
        return float(self.values[place]) if 0 <= place < len(self.values) else float("nan")

    def mode(self, index: int) -> Array:
        """What moves in it."""
        return self.modes[:, self._place(index)]

    def _place(self, index: int) -> int:
        return int(np.sum(self.values < 0.0)) + index - self.negative


def assess_stability(system: LoadedEquations, x: Array, nonzeros: Array) -> Stability:
    """Stability at x = (q, lam), where the tangent has these non-zeros."""
    n, scale = system.equations.n, system.equations.position_scales
    whole = system.matrix(nonzeros)
    stiffness = sp.csc_array(whole[:n, :n]) * scale * scale[:, None]
    gradients = sp.csr_array(whole[n:, :n]) * scale
    size = float(np.max(np.abs(stiffness.data), initial=0.0))
    skew = sp.csc_array(stiffness - stiffness.T)
    symmetric = np.max(np.abs(skew.data), initial=0.0) <= _SKEW * size
    if n <= _DENSE or (not symmetric and n <= _DENSE_SKEW):
        return _dense_stability(system, x, stiffness.toarray(), gradients.toarray())
    unknown = Stability(np.zeros(0), np.zeros((n, 0)), -1)
    if not symmetric:
        return unknown
    try:
        return _sparse_stability(sp.csc_array(stiffness), sp.csr_array(gradients), scale)
    except (RuntimeError, ArpackError):
        return unknown


def _dense_stability(
    system: LoadedEquations, x: Array, stiffness: Array, gradients: Array
) -> Stability:
    scale, m = system.equations.position_scales, len(gradients)
    free = la.qr(gradients.T)[0][:, m:] if m else np.eye(len(scale))
    if not free.shape[1]:
        return Stability(np.zeros(0), np.zeros((len(scale), 0)), 0)
    own = free.T @ stiffness @ free
    zero = _ZERO * float(np.max(np.abs(stiffness), initial=0.0))
    if np.max(np.abs(own - own.T)) <= max(_SKEW * float(np.max(np.abs(own))), zero):
        values, vectors = la.eigh(0.5 * (own + own.T))
        return _build_stability(values, free @ vectors, scale, zero)
    # Without a potential signs decide nothing: what grows or swings ever farther does.
    under = system.under
    starter = ConsistencySolver(under.equations)
    mass = starter.linearized(under.time, starter.at_rest(x[: len(scale)]))[2].toarray()
    inertia = free.T @ (mass * scale * scale[:, None]) @ free
    return Stability(np.zeros(0), np.zeros((len(scale), 0)), _count_unstable_modes(own, inertia))


def _count_unstable_modes(stiffness: Array, inertia: Array) -> int:
    """How many squares of natural frequencies are negative or complex, but for very fast modes."""
    with np.errstate(divide="ignore", invalid="ignore"):
        # One over them: slow modes are what is exact of these.
        over = la.eigvals(inertia, stiffness)
        over = over[np.isfinite(over)]
        over = over[np.abs(over) < _ENDLESS * np.min(np.abs(over), initial=np.inf)]
        slow = over[np.abs(over) >= _FAST * np.max(np.abs(over), initial=0.0)]
    rough = _REAL * np.abs(slow)
    return int(np.sum((slow.real < -rough) | (np.abs(slow.imag) > rough)))


def _build_stability(
    values: Array, modes: Array, scale: Array, zero: float, negative: int | None = None
) -> Stability:
    """Of eigenvalues and modes in natural sizes; `negative` if not all of those are among them."""
    modes = modes / np.max(np.abs(modes), axis=0, initial=1e-300)
    count = int(np.sum(values < 0.0)) if negative is None else negative
    return Stability(values, scale[:, None] * modes, count, zero)


def _sparse_stability(stiffness: sp.csc_array, gradients: sp.csr_array, scale: Array) -> Stability:
    """Signs by those of the pivots of the saddle matrix, without its eigenvalues.

    [[K + r G^T G, G^T], [G, 0]] has m negative ones besides those of K in the motions that G
    allows, whatever r is (Sylvester's law of inertia); r keeps leading pivots from being zero where
    bodies would be free without their joints.
    """
    n, m = stiffness.shape[0], gradients.shape[0]
    if n == m:
        return Stability(np.zeros(0), np.zeros((n, 0)), 0)
    size = float(np.max(np.abs(stiffness.diagonal()), initial=0.0)) or 1.0
    held = sp.csc_array(gradients.T @ gradients)
    zero = _SPARSE_ZERO * size
    lower = sp.csc_array((m, m))
    # Where nothing resists a motion pivots might be zero.
    stiff = stiffness + size * held + zero * sp.eye_array(n)
    augmented = sp.block_array([[stiff, gradients.T], [gradients, lower]], format="csc")
    negative = _negative_pivots(sp.csc_array(augmented), n) - m
    plain = sp.block_array([[stiffness, gradients.T], [gradients, lower]], format="csc")
    weight = sp.block_diag([sp.eye_array(n), lower], format="csc")
    count = min(_NEAREST, n - m)
    # Beside zero, where the matrix may be singular.
    shift = -zero
    solver = splu(sp.csc_matrix(plain - shift * weight))
    inverse = LinearOperator(plain.shape, matvec=solver.solve, dtype=float)
    begin = np.concatenate([np.cos(np.arange(n) ** 2.0), np.zeros(m)])
    values, vectors = eigsh(
        plain, count, weight, sigma=shift, OPinv=inverse, v0=solver.solve(weight @ begin), tol=1e-10
    )
    order = np.argsort(values)
    rounded = int(np.sum((values < 0.0) & (values >= -zero)))
    return _build_stability(
        values[order], vectors[:n, order], scale, zero, max(negative, 0) + rounded
    )


def _negative_pivots(matrix: sp.csc_array, n: int) -> int:
    """How many pivots are negative in elimination without exchanges, coordinates first."""
    order = compute_bordered_ordering(sp.csc_array(matrix[:n, :n])).order
    order = np.concatenate([order, np.arange(n, matrix.shape[0])])
    ordered = sp.csc_matrix(sp.csc_array(matrix[order][:, order]))
    factors = splu(ordered, "NATURAL", 0.0, options={"SymmetricMode": True})
    return int(np.sum(factors.U.diagonal() < 0.0))
