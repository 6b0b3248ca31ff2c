"""Stability of an equilibrium under constant loads.

If the forces have a potential, the negative eigenvalues of the tangent stiffness are the unstable
directions, whatever the inertia and the damping (theorem of Kelvin, Tait and Chetaev). Otherwise,
the growing modes of the linearized equations of motion are counted.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh, splu

from beamdae.analysis.eigenproblems.eigensolution import (
    UNSTABLE,
    EigenSolution,
    classify_modes,
    damping_ratios,
    solve_eigenproblem,
)
from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.analysis.statics.null_vectors import row_sizes
from beamdae.analysis.statics.saddle_elimination import (
    ASYMMETRY_TOLERANCE,
    NEGLIGIBLE_STIFFNESS,
    SPARSE_ZERO_TOLERANCE,
    zero_tolerance,
)
from beamdae.analysis.statics.slender_modes import (
    ERROR_FLOOR,
    ERROR_MULTIPLE,
    reduce_stiffness,
    refine_modes,
    refine_subspace,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError
from beamdae.linear.orderings import compute_bordered_ordering

Array = np.ndarray

# Largest number of coordinates of a symmetric stiffness for dense matrices; beyond, matrices are
# sparse.
MAX_DENSE_STIFFNESS = 150
# Number of modes among which growing ones are counted under loads without a potential.
_MODE_COUNT = 12
# Modes with a larger damping ratio are not about to grow. Strong damping slows many modes down to
# nearly the same rate of decay; they do not count among `_MODE_COUNT`.
_MAX_GROWTH_DAMPING = 0.5
# Rounding errors of zero eigenvalues of dense eigenvalue solvers, relative to the largest entry of
# the stiffness. For sparse elimination, the reference is the largest diagonal entry.
_ZERO_TOLERANCE = 1e-15
# Number of eigenvalues nearest to zero computed for large matrices, and their relative tolerance.
_NEAREST_COUNT = 4
_LANCZOS_TOLERANCE = 1e-10
# Eigenvalues up to this multiple of the rounding errors of zero eigenvalues are computed again from
# differences of the forces; maximum number of such eigenvalues. If none of these exceeds the second
# multiple, rounding errors mix their modes.
_REFINED_MULTIPLE = 1e3
_MIXED_MULTIPLE = 1e3
# Largest bound on errors of refined eigenvalues, relative to the largest of them.
_MAX_FLOOR_RATIO = 1e-3
_REFINED_COUNT = 4
# Prevents division by zero for modes that vanish.
_TINY = 1e-300


@dataclass(frozen=True)
class Stability:
    """Eigenvalues of the tangent stiffness at an equilibrium under constant loads.

    Attributes
    ----------
    eigenvalues
        Eigenvalues of Z^T S K S Z [J], ascending: all of them, or those nearest to zero. Empty if
        the forces have no potential, the joints allow no motion or the stability is unknown. S is
        the diagonal matrix of `LoadedEquations.scales`. The columns of S Z span the
        motions that the joints allow; those of Z are orthonormal.
    modes
        Mode shapes, (n, number of eigenvalues), scaled so that the largest absolute component,
        relative to `EquationsOfMotion.position_scales`, is 1.
    negative_count
        Number of negative eigenvalues; for forces without a potential, number of growing modes, in
        which an oscillation counts twice. -1 if unknown.
    zero_tolerance
        Eigenvalues up to this magnitude [J] are zero up to rounding.
    growth
        Eigenvalues [1/s] of the growing modes under forces without a potential; otherwise empty.
    growing_modes
        Real parts of the shapes of the modes in `growth`, (n, k); empty if `growth` is empty.
    squares
        Squared eigenvalues [1/s^2] of the modes under forces without a potential if nothing is
        damped; otherwise empty.
    damping_ratio
        Smallest damping ratio of the damped modes under forces without a potential; 0 if nothing
        is damped, or if the forces have a potential.
    """

    eigenvalues: Array
    modes: Array
    negative_count: int
    zero_tolerance: float = 0.0
    growth: Array = field(default_factory=lambda: np.zeros(0, complex))
    growing_modes: Array = field(default_factory=lambda: np.zeros((0, 0)))
    squares: Array = field(default_factory=lambda: np.zeros(0, complex))
    damping_ratio: float = 0.0

    @property
    def oscillation_count(self) -> int:
        """Number of growing oscillations (flutter) under forces without a potential."""
        return int(np.sum(self.growth.imag > 0.0))

    @property
    def free_count(self) -> int:
        """Number of eigenvalues, among those computed, that are zero up to rounding."""
        return int(np.sum(np.abs(self.eigenvalues) <= self.zero_tolerance))

    @property
    def unstable_count(self) -> int:
        """`negative_count` without eigenvalues that are zero up to rounding; -1 if unknown."""
        is_rounding = (self.eigenvalues < 0.0) & (self.eigenvalues >= -self.zero_tolerance)
        return max(self.negative_count - int(np.sum(is_rounding)), -1)

    def eigenvalue(self, index: int) -> float:
        """Return the eigenvalue [J] at `index` in ascending order; nan if it was not computed.

        `index` counts all eigenvalues from 0, including those that are not in `eigenvalues`.
        """
        position = self._array_index(index)
        return (
            float(self.eigenvalues[position])
            if 0 <= position < len(self.eigenvalues)
            else float("nan")
        )

    def mode(self, index: int) -> Array:
        """Return the mode shape (n,) of the eigenvalue at `index`; see `eigenvalue`."""
        return self.modes[:, self._array_index(index)]

    def discriminant(self, square: complex) -> float:
        """Return the discriminant [1/s^4] of the two squared eigenvalues nearest to `square`.

        It is positive if both modes vibrate, zero if their frequencies coincide, and negative if
        one of them grows. It is nan if `squares` has less than two elements.
        """
        order = np.argsort(np.abs(self.squares - square))
        nearest = self.squares[order[:2]]
        if len(nearest) < 2:
            return float("nan")
        if np.any(nearest.imag):
            largest = nearest[np.argmax(np.abs(nearest.imag))]
            return -4.0 * float(largest.imag) ** 2
        return float(nearest[0].real - nearest[1].real) ** 2

    def _array_index(self, index: int) -> int:
        return int(np.sum(self.eigenvalues < 0.0)) + index - self.negative_count


def assess_stability(system: LoadedEquations, x: Array, mu: float) -> Stability:
    """Return the stability of the equilibrium x = (q, lam) under the load factor mu.

    Negative eigenvalues are counted for the stiffness projected onto the motions that the joints
    allow. If the forces have no potential, growing modes are counted instead.
    """
    stability = _assess(system, x, mu)
    sizes = np.abs(stability.modes) / system.equations.position_scales[:, None]
    return replace(stability, modes=stability.modes / np.max(sizes, axis=0, initial=_TINY))


def _assess(system: LoadedEquations, x: Array, mu: float) -> Stability:
    """Return the result of `assess_stability`, with mode shapes of any size."""
    n, scale = system.equations.n, system.scales
    if n > MAX_DENSE_STIFFNESS:
        modes = system.bordered.nearest_modes(x, mu, _NEAREST_COUNT, _LANCZOS_TOLERANCE)
        if modes is not None:
            zero = zero_tolerance(modes.size, SPARSE_ZERO_TOLERANCE)
            count = modes.negative_count
            stability = _build_stability(modes.eigenvalues, modes.vectors, scale, zero, count)
            return _refine_small_eigenvalues(system, x, mu, stability)
    tangent = system.matrix(system.tangent(x, mu))
    stiffness = sp.csc_array(tangent[:n, :n]) * scale * scale[:, None]
    gradients = sp.csr_array(tangent[n:, :n]) * scale
    # The stiffness may vanish at a critical point, where rounding is that of its terms.
    drawn = system.matrix(system.tangent(np.append(system.equations.q0, np.zeros(len(x) - n)), 0.0))
    terms = sp.csc_array(drawn[:n, :n]) * scale * scale[:, None]
    size = max(float(np.max(np.abs(each.data), initial=0.0)) for each in (stiffness, terms))
    unknown = Stability(np.zeros(0), np.zeros((n, 0)), -1)
    try:
        if len(x) < 2 * n and system.bordered.has_follower_loads(x, mu):
            return _assess_motion(system, x, mu)
        if system.bordered.has_negligible_asymmetry(x, mu):
            stiffness = 0.5 * (stiffness + stiffness.T)
        if n <= MAX_DENSE_STIFFNESS:
            dense = _dense_stability(stiffness.toarray(), gradients.toarray(), scale, size)
            if dense is None:
                return _assess_motion(system, x, mu)
            return _refine_small_eigenvalues(system, x, mu, dense)
        skew = sp.csc_array(stiffness - stiffness.T)
        if np.max(np.abs(skew.data), initial=0.0) > ASYMMETRY_TOLERANCE * size:
            return _assess_motion(system, x, mu)
        stability = _sparse_stability(sp.csc_array(stiffness), sp.csr_array(gradients), scale)
        return _refine_small_eigenvalues(system, x, mu, stability)
    except (RuntimeError, ArpackError, BeamdaeError):
        return unknown


def _dense_stability(
    stiffness: Array, gradients: Array, scale: Array, size: float
) -> Stability | None:
    """Return the stability from the eigenvalues of the stiffness; None without a potential.

    `size` is the size of the terms of the stiffness.
    """
    m = len(gradients)
    basis = la.qr(gradients.T)[0][:, m:] if m else np.eye(len(scale))
    if not basis.shape[1]:
        return Stability(np.zeros(0), np.zeros((len(scale), 0)), 0)
    projected = basis.T @ stiffness @ basis
    zero = zero_tolerance(size, _ZERO_TOLERANCE)
    asymmetry = np.max(np.abs(projected - projected.T))
    if asymmetry > max(ASYMMETRY_TOLERANCE * float(np.max(np.abs(projected))), zero):
        return None
    eigenvalues, vectors = la.eigh(0.5 * (projected + projected.T))
    return _build_stability(eigenvalues, basis @ vectors, scale, zero)


def _refine_small_eigenvalues(
    system: LoadedEquations, x: Array, mu: float, stability: Stability
) -> Stability:
    """Return the stability with the smallest eigenvalues from differences of the forces.

    The result is `stability` if they are not more accurate than the stiffness matrix.
    """
    eigenvalues, scale = stability.eigenvalues, system.scales
    nearest = np.argsort(np.abs(eigenvalues))[:_REFINED_COUNT]
    sizes, zero = np.abs(eigenvalues[nearest]), stability.zero_tolerance
    if not np.any(sizes < _REFINED_MULTIPLE * zero):
        return stability
    basis = la.qr(stability.modes[:, nearest] / scale[:, None], mode="economic")[0]
    refined = None
    if zero > NEGLIGIBLE_STIFFNESS and np.max(sizes) < _MIXED_MULTIPLE * zero:
        refined = refine_subspace(system, x, mu, basis, basis)
        basis = basis if refined is None else refined
    ritz, change = reduce_stiffness(system, x, mu, scale[:, None] * basis)
    values, shares = la.eigh(0.5 * (ritz + ritz.T))
    # Differences are less accurate than the stiffness if a beam is thick, or if the forces are not
    # smooth, for example where a contact begins.
    other = ritz - change
    error = float(np.max(np.abs(values - la.eigvalsh(0.5 * (other + other.T)))))
    if error > zero:
        return stability
    count = stability.negative_count - int(np.sum(eigenvalues[nearest] < 0.0))
    count += int(np.sum(values < 0.0))
    eigenvalues, modes = eigenvalues.copy(), stability.modes / scale[:, None]
    modes = modes / la.norm(modes, axis=0)
    eigenvalues[nearest], modes[:, nearest] = values, basis @ shares
    order = np.argsort(eigenvalues)
    floor = ERROR_FLOOR * zero
    if refined is not None:
        floor = min(floor, _MAX_FLOOR_RATIO * float(np.max(np.abs(values))))
    zero = max(floor, ERROR_MULTIPLE * error)
    return _build_stability(eigenvalues[order], modes[:, order], scale, zero, count)


def _assess_motion(system: LoadedEquations, x: Array, mu: float) -> Stability:
    """Return the stability from the growing modes of the equations of motion about x.

    Raises
    ------
    BeamdaeError
        If the linearized equations are singular.
    """
    e = system.equations
    state = ConsistencySolver(e).rest_state(x[: e.n])._replace(lam=x[e.n :])
    linearized = LinearizedEquations(e, system.motion_tangent(state, mu))
    solution = merge_modes(
        [
            refine_modes(system, x, mu, linearized, modes)
            for modes in solve_slowest_modes(linearized, e)
        ]
    )
    kinds = classify_modes(linearized, solution)
    is_growing = np.array([kind == UNSTABLE for kind in kinds], bool)
    growth = solution.values[is_growing]
    count = len(growth) + int(np.sum(growth.imag > 0.0))
    is_damped = np.any(linearized.tangent.damping.data)
    ratios = np.abs(damping_ratios(linearized, solution))
    return Stability(
        np.zeros(0),
        np.zeros((e.n, 0)),
        count,
        growth=growth,
        growing_modes=solution.shapes[:, is_growing].real,
        squares=np.zeros(0, complex) if is_damped else solution.values**2,
        damping_ratio=float(np.min(ratios[ratios > 0.0])) if np.any(ratios) else 0.0,
    )


def solve_slowest_modes(
    linearized: LinearizedEquations, e: EquationsOfMotion
) -> list[EigenSolution]:
    """Return the slowest modes of each group of coupled parts of `e`.

    They contain `_MODE_COUNT` of those that do not decay strongly. All modes of a small structure
    may be faster than as many modes of a large one.

    Raises
    ------
    BeamdaeError
        If the equations are singular, or if they are too many to compute these modes.
    """
    solutions = []
    for group, rows in linearized.split(e.parts):
        modes = solve_eigenproblem(group, _MODE_COUNT, max_damping_ratio=_MAX_GROWTH_DAMPING)
        shapes = np.zeros((e.n, modes.shapes.shape[1]), complex)
        shapes[rows] = modes.shapes
        others = None
        if modes.others is not None:
            others = np.zeros((e.n, modes.others.shape[1]))
            others[rows] = modes.others
        solutions.append(EigenSolution(modes.values, shapes, others))
    return solutions


def merge_modes(solutions: list[EigenSolution]) -> EigenSolution:
    """Return all modes in ascending order of |eigenvalue|."""
    values = np.concatenate([modes.values for modes in solutions])
    shapes = np.hstack([modes.shapes for modes in solutions])
    order = np.argsort(np.abs(values), kind="stable")
    return EigenSolution(values[order], shapes[:, order])


def _build_stability(
    eigenvalues: Array, modes: Array, scale: Array, zero: float, negative_count: int | None = None
) -> Stability:
    """Return the stability; `negative_count` is required if negative eigenvalues are missing."""
    count = int(np.sum(eigenvalues < 0.0)) if negative_count is None else negative_count
    return Stability(eigenvalues, scale[:, None] * modes, count, zero)


def _sparse_stability(stiffness: sp.csc_array, gradients: sp.csr_array, scale: Array) -> Stability:
    """Return the stability from the eigenvalues nearest to zero and the signs of pivots.

    The saddle-point matrix [[K - s I + r G^T G, G^T], [G, 0]] has m negative eigenvalues besides
    those of K - s I in the null space of G, for any r (Sylvester's law of inertia). r keeps leading
    pivots nonzero if bodies would be free without their joints. The shift s lies in the widest gap
    between the computed eigenvalues, because rounding errors may change the signs of pivots if an
    eigenvalue is close to s.
    """
    n, m = stiffness.shape[0], gradients.shape[0]
    if n == m:
        return Stability(np.zeros(0), np.zeros((n, 0)), 0)
    size = float(np.max(np.abs(stiffness.diagonal()), initial=0.0)) or 1.0
    zero = zero_tolerance(size, SPARSE_ZERO_TOLERANCE)
    # Pivots, and with them rounding errors, would depend on the units of stiffness and joints.
    gradients = sp.csr_array(gradients * (size / row_sizes(gradients))[:, None])
    identity, zero_block = sp.eye_array(n), sp.csc_array((m, m))

    def saddle_matrix(block: sp.csc_array) -> sp.csc_array:
        return sp.block_array([[block, gradients.T], [gradients, zero_block]], format="csc")

    weight = sp.block_diag([identity, zero_block], format="csc")
    # The matrix may be singular at zero, so it is shifted.
    solver = splu(sp.csc_matrix(saddle_matrix(stiffness + zero * identity)))
    inverse = LinearOperator(weight.shape, matvec=solver.solve, dtype=float)
    # Deterministic start vector that is not orthogonal to any mode.
    start = np.concatenate([np.cos(np.arange(n) ** 2.0), np.zeros(m)])
    eigenvalues, vectors = eigsh(
        saddle_matrix(stiffness),
        min(_NEAREST_COUNT, n - m),
        weight,
        sigma=-zero,
        OPinv=inverse,
        v0=solver.solve(weight @ start),
        tol=_LANCZOS_TOLERANCE,
    )
    order = np.argsort(eigenvalues)
    eigenvalues = eigenvalues[order]
    shift = _widest_gap(eigenvalues)
    joint_stiffness = sp.csc_array(gradients.T @ gradients)
    shifted = saddle_matrix(stiffness - shift * identity + joint_stiffness / size)
    negative_count = _count_negative_pivots(shifted, n) - m
    negative_count -= int(np.sum((eigenvalues >= 0.0) & (eigenvalues < shift)))
    negative_count += int(np.sum((eigenvalues < 0.0) & (eigenvalues >= shift)))
    return _build_stability(eigenvalues, vectors[:n, order], scale, zero, max(negative_count, 0))


def _widest_gap(eigenvalues: Array) -> float:
    """Return the value farthest from all `eigenvalues`: zero, or the middle of two of them.

    The eigenvalues must be ascending, and nearest to zero of all.
    """
    candidates = np.append(0.5 * (eigenvalues[1:] + eigenvalues[:-1]), 0.0)
    distances = np.min(np.abs(candidates[:, None] - eigenvalues), axis=1)
    return float(candidates[np.argmax(distances)])


def _count_negative_pivots(matrix: sp.csc_array, n: int) -> int:
    """Return the number of negative pivots of an elimination in order, coordinates first."""
    order = compute_bordered_ordering(sp.csc_array(matrix[:n, :n])).order
    order = np.concatenate([order, np.arange(n, matrix.shape[0])])
    reordered = sp.csc_matrix(sp.csc_array(matrix[order][:, order]))
    factors = splu(reordered, "NATURAL", 0.0, options={"SymmetricMode": True})
    return int(np.sum(factors.U.diagonal() < 0.0))
