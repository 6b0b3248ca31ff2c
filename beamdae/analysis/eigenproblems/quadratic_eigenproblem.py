"""Damped and gyroscopic modes: (l^2 M + l C + K) x + H mu = 0, (J + l V) x = 0.

The quadratic eigenvalue problem is linearized and inverted about a real shift (Tisseur &
Meerbergen, SIAM Rev. 43 (2001) 235). Dense matrices give all eigenvalues of small systems. For
large systems, Arnoldi's method gives the eigenvalues near the shift.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.analysis.eigenproblems.block_krylov import (
    BlockKrylov,
    converge,
    takes_longer_than_dense,
)
from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.analysis.eigenproblems.symmetric_eigenproblem import (
    MAX_DENSE_COORDINATES,
    MAX_FALLBACK_COORDINATES,
    ZERO_SQUARE_RATIO,
    UndampedModes,
    combine_images,
    convergence_error,
    is_symmetric,
    is_symmetric_matrix,
    orthonormal_motions,
    quadratic_form_rounding,
)
from beamdae.errors import BeamdaeError
from beamdae.linear.saddle_point import factorize_saddle_point

Array = np.ndarray

# Eigenvalues up to this fraction of the shift may be zero, because the error of a double zero is
# the square root of rounding. They are zero if their strain energy does not exceed this factor
# times its rounding error.
_ZERO_RATIO = 1e-5
_ZERO_ENERGY_FACTOR = 1e4
# Shift relative to the geometric mean of the lowest and highest frequency of interest; a factor of
# one would hit the frequency of a single mode. If all modes are requested, the lowest ten determine
# the shift.
_SHIFT_RATIO = 0.6
_DEFAULT_MODE_COUNT = 10
# The undamped modes may be an invariant space without the modes that strong dampers slow down.
# These are found from as many random vectors as modes, at least this number, in this number of
# blocks.
_MIN_RANDOM_VECTORS = 2
_MIN_BLOCKS = 3
# Relative residual that suffices to know on which side of a circle an eigenvalue lies.
_LOCATION_ACCURACY = 1e-3
# Number of further blocks that must not change the wanted modes if strongly damped modes are not
# located: the projection mixes fast and slow decays of stiff motions, which hardly converge.
_CONFIRMATIONS = 1
# Relative residual from which inverse iteration takes over, its largest number of steps, and the
# relative step after which it has converged, because its error is the square of the step.
_REFINABLE_ACCURACY = 1e-5
_MAX_REFINEMENTS = 4
_REFINED_STEP = 1e-6
# Estimates that differ by at most this fraction are in a cluster.
_CLUSTER_RATIO = 1e-4
# Eigenvalues that differ by at most this fraction, and whose shapes have at least this correlation,
# are the same.
_EQUAL_TOLERANCE = 1e-6
_EQUAL_CORRELATION = 0.99
# Rounding errors of the stiffness in the metric of the energy, relative to its inertia.
_MAX_ENERGY_ROUNDING = 1e-6
# Eigenvalues of the inverse below this fraction of the largest eigenvalue are lost in rounding.
_MIN_INVERSE_RATIO = 1e-13
# Real and imaginary parts up to these fractions of the eigenvalue are rounding errors.
_REAL_TOLERANCE = 1e-12
_IMAGINARY_TOLERANCE = 1e-9
# Free motions are dependent if their singular value is below this fraction of the largest one.
_RANK_TOLERANCE = 1e-3
# Eigenvalues of problems without symmetry amplify rounding errors up to this factor.
_ROUNDING_AMPLIFICATION = 20.0
# The two parts of a split double eigenvalue are closer than this multiple of the square root of
# rounding errors, and their mean growth rate is at most this fraction of either growth rate.
_SPLIT_RATIO = 4.0
_MEAN_GROWTH_RATIO = 1e-2
# Squared eigenvalues within this factor of the size of rounding are zero if they are zero in the
# undamped problem.
_ZERO_SQUARE_MARGIN = 4.0
# Dampers that slow a free motion down at a rate below this fraction of the shift are rounding.
_ZERO_RATE_RATIO = 1e-12
# Prevents division by zero.
_TINY = 1e-300


class QuadraticProblem:
    """Quadratic eigenvalue problem (l^2 M + l C + K) x + H mu = 0, (J + l V) x = 0.

    With y = (x, l x), the problem becomes l E y = A y with constant matrices E and A. For a shift
    s, the eigenvalues of (A - s E)^-1 E are 1 / (l - s).

    Parameters
    ----------
    lin
        Linearized equations with the matrices M, C, K, H, J and V.
    undamped
        Modes of the undamped problem. Their frequencies determine the shift. Free motions on which
        no damper acts are treated separately if the equations are symmetric, because rounding would
        turn their double zero eigenvalues into slow vibrations of thin beams.
    count
        Number of modes of interest, or None for all modes.
    """

    def __init__(
        self, lin: LinearizedEquations, undamped: UndampedModes, count: int | None
    ) -> None:
        self.lin, self.tangent, self.e = lin, lin.tangent, lin.equations
        squares = undamped.squares
        self._undamped_shapes = undamped.shapes
        self._growth_square = float(np.max(-squares, initial=0.0))
        self._undamped_free = undamped.shapes[:, squares == 0.0]
        # The shift is in the middle of the modes of interest, so that low and high modes lose equal
        # accuracy.
        order = np.argsort(np.abs(squares), kind="stable")
        wanted = order[squares[order] != 0.0][: count or _DEFAULT_MODE_COUNT]
        rates, self._wanted_shapes = np.sqrt(np.abs(squares[wanted])), undamped.shapes[:, wanted]
        self.shift = float(_SHIFT_RATIO * np.sqrt(rates[0] * rates[-1])) if len(rates) else 1.0
        self._highest_rate = float(rates[-1]) if len(rates) else self.shift
        self._is_symmetric = is_symmetric(lin) and is_symmetric_matrix(lin.tangent.damping)
        self._free = self._find_undamped_free_motions()
        self._weighted_free = self.tangent.mass @ self._free

    @cached_property
    def _has_rates(self) -> bool:
        """True if the eigenvalue l itself occurs in the problem, not only its square."""
        matrices = (self.tangent.damping, self.tangent.velocity_jacobian)
        return any(np.any(matrix.data) for matrix in matrices)

    @cached_property
    def _solve_shifted(self) -> Callable[[Array], Array]:
        """Solver of the saddle-point matrix at the shift, which dense matrices do not require.

        Raises
        ------
        BeamdaeError
            If the equations are singular at the shift.
        """
        tangent, s = self.tangent, self.shift
        solve = factorize_saddle_point(
            tangent.stiffness + s * tangent.damping + s**2 * tangent.mass,
            tangent.reactions,
            tangent.position_jacobian + s * tangent.velocity_jacobian,
        )
        if solve is None:
            raise _singular_error()
        return solve

    def _find_undamped_free_motions(self) -> Array:
        """Return the free motions (n, k) on which no damper acts, scaled to x^T M x = 1.

        The result is empty if C or the undamped problem (see `is_symmetric`) is not symmetric:
        follower loads and rotation couple free motions to other modes.
        """
        free = self._undamped_free
        if not (free.shape[1] and self._is_symmetric):
            return free[:, :0]
        mass, damping = self.tangent.mass, self.tangent.damping
        lower = la.cholesky(free.T @ (mass @ free), lower=True)
        free = la.solve_triangular(lower, free.T, lower=True).T
        rates, vectors = la.eigh(free.T @ (damping @ free))
        free = free @ vectors
        zero_rates = quadratic_form_rounding(damping, free) + _ZERO_RATE_RATIO * self.shift
        return free[:, rates <= zero_rates]

    def solve(
        self, count: int | None, max_damping_ratio: float = 1.0
    ) -> tuple[Array, Array, Array]:
        """Return the eigenvalues nearest to the shift, (k,) [1/s], and their mode shapes, (n, k).

        The third result contains other motions (n, j), whose stiffness is lost in rounding, but
        which are no independent free motions.

        The modes are not sorted, and there are usually more than `count`. If `count` is None, only
        modes that are lost in rounding are missing. Each conjugate pair is represented by the
        eigenvalue with positive imaginary part.

        If `max_damping_ratio` is below 1, modes with a larger damping ratio do not count, and may
        be missing. Sparse matrices then give the other modes up to the highest undamped frequency
        of interest, which may be fewer than `count`.

        Raises
        ------
        BeamdaeError
            If the equations are singular at the shift.
        """
        e, n = self.e, self.e.n
        available = 2 * (n - e.m - self._free.shape[1]) + len(e.nonholonomic_rows)
        if not available or (count is not None and self._free.shape[1] >= count):
            values, none = np.zeros(self._free.shape[1], complex), np.zeros((n, 0))
            return values, self._free.astype(complex), none
        # Twice the number, for conjugate pairs, and six more because ordering by 1 / (l - s)
        # differs from ordering by l.
        number = available if count is None else min(available, 2 * count + 6)
        if count is not None and n > MAX_DENSE_COORDINATES and number < n:
            # The two eigenvalues of a double zero are often one free motion.
            doubled = self._undamped_free.shape[1] - self._free.shape[1]
            number = count - self._free.shape[1] + doubled
            solution = self._solve_few(number, max_damping_ratio)
            if solution is not None and max_damping_ratio == 1.0:
                missing = count - len(solution[0])
                if missing > 0:  # Other eigenvalues are the same free motion, too.
                    solution = self._solve_few(number + missing, max_damping_ratio)
            if solution is not None:
                return solution
            if n > MAX_FALLBACK_COORDINATES:
                raise convergence_error(count)
        has_nonholonomic = len(e.nonholonomic_rows) > 0
        return self._select(
            *(self._solve_linearized(number) if has_nonholonomic else self._solve_projected())
        )

    def _solve_few(self, count: int, max_damping_ratio: float) -> tuple[Array, Array, Array] | None:
        """Return the result of `solve` from sparse matrices, or None if it does not converge.

        `count` includes eigenvalues that are lost in rounding.
        """
        solution = (
            self._solve_sparse(count, max_damping_ratio)
            if self._has_rates
            else self._solve_sparse_squares(count)
        )
        return None if solution is None else self._select(*solution)

    def _solve_linearized(self, count: int) -> tuple[Array, Array]:
        """Return `count` eigenvalues and shapes from the dense inverse of the linearization."""
        n, e = self.e.n, self.e
        scales = np.concatenate([e.position_scales, self.shift * e.position_scales])
        images = np.stack([self._apply_inverse(column) for column in np.diag(scales)], axis=1)
        inverses, vectors = la.eig(images / scales[:, None])
        shapes = (vectors * scales[:, None])[:n]
        order = np.argsort(-np.abs(inverses), kind="stable")[:count]
        order = order[_is_accurate(inverses)[order]]
        return self.shift + 1.0 / inverses[order], shapes[:, order]

    def _solve_sparse(self, count: int, max_damping_ratio: float) -> tuple[Array, Array] | None:
        """Return the `count` eigenvalues with the smallest |l| and their shapes, or None.

        Conjugate eigenvalues count once; for `max_damping_ratio`, see `solve`. The Krylov space
        begins with the undamped modes, as displacements and as velocities, and with random motions.
        It only locates the eigenvalues, and inverse iteration refines them.
        The result is None if it does not converge.
        """
        n, s, tangent = self.e.n, self.shift, self.tangent
        n_random = max(count, _MIN_RANDOM_VECTORS)
        motions = np.random.default_rng(0).standard_normal((n_random, 2 * n))
        scales = np.concatenate([self.e.position_scales, s * self.e.position_scales])
        modes = sp.block_diag([self._undamped_shapes, s * self._undamped_shapes]).toarray()
        start = np.hstack([modes, (scales * motions).T])
        work = (_MIN_BLOCKS * start.shape[1]) ** 3
        is_hopeless = takes_longer_than_dense(work, 2 * n) or (
            max_damping_ratio == 1.0 and self._reaches_slow_decays()
        )
        if n <= MAX_FALLBACK_COORDINATES and is_hopeless:
            return None
        start = np.stack([self._apply_inverse(y) for y in start.T], axis=1)
        krylov = BlockKrylov(
            self._apply_inverse,
            start,
            self._krylov_metric(),
            is_symmetric=False,
            blocks=_MIN_BLOCKS,
        )

        is_selective = max_damping_ratio < 1.0
        limit = self._highest_rate if is_selective else np.inf
        confirmations = _CONFIRMATIONS if is_selective else 0

        def find_wanted(values: Array) -> tuple[Array, float]:
            """Return a mask of the wanted eigenvalues, and the largest |l| of interest."""
            sizes = np.abs(values)
            is_candidate = values.real >= -max_damping_ratio * sizes
            # Either eigenvalue of a conjugate pair counts half.
            numbers = is_candidate * np.where(values.imag != 0.0, 0.5, 1.0)
            order = np.argsort(sizes, kind="stable")
            last = min(int(np.searchsorted(np.cumsum(numbers[order]), count)), len(order) - 1)
            highest = min(float(sizes[order[last]]), limit)
            return is_candidate & (sizes <= highest), highest

        def rounding(inverses: Array, vectors: Array) -> Array:
            shapes = vectors[:n]
            inertia = np.abs(np.einsum("ij,ij->j", shapes.conj(), tangent.mass @ shapes))
            squares = inertia * (s**2 + np.abs(s + 1.0 / inverses) ** 2)
            return quadratic_form_rounding(tangent.stiffness, shapes) / squares

        for accuracy in (_REFINABLE_ACCURACY, 0.0):

            def required_accuracy(inverses: Array, accuracy: float = accuracy) -> Array:
                values = s + 1.0 / inverses
                is_wanted, highest = find_wanted(values)
                # No eigenvalue outside this circle about the shift is smaller.
                is_near = np.abs(values - s) <= highest + s
                ratios = -values.real / np.abs(values)
                is_near &= ratios <= 0.5 * (1.0 + max_damping_ratio)
                others = np.where(is_near, _LOCATION_ACCURACY, np.inf)
                return np.where(is_wanted, accuracy, others)

            if not converge(krylov, required_accuracy, rounding, confirmations):
                return None
            values = s + 1.0 / krylov.values
            is_wanted, highest = find_wanted(values)
            is_other = ~is_wanted & (np.abs(values) <= highest)
            is_other &= krylov.residuals <= _REFINABLE_ACCURACY
            (wanted,), (others,) = np.nonzero(is_wanted), np.nonzero(is_other)
            solution = values[wanted], krylov.vectors(wanted)[:n]
            refined = self._refine_modes(*solution) if accuracy else None
            if refined is not None:
                solution = refined
                break
        return (
            np.append(solution[0], values[others]),
            np.hstack([solution[1], krylov.vectors(others)[:n]]),
        )

    def _reaches_slow_decays(self) -> bool:
        """Return True if the decays of material damping are among the wanted modes.

        With a damping matrix b K, this is so if the rate of the highest wanted mode exceeds 1 / b,
        which is half of its critical damping. The slow decays of all stiff motions have about the
        rate 1 / b and are too close to each other to be separated. Dampers between points, which
        act on few coordinates, cause few decays.
        """
        damping, highest = self.tangent.damping, self._wanted_shapes[:, -1:]
        if 2 * np.count_nonzero(damping.diagonal()) < self.e.n or not highest.size:
            return False
        return bool(np.sum(highest * (damping @ highest)) >= self._highest_rate)

    def _krylov_metric(self) -> sp.csr_array:
        """Return the metric of the Krylov space, that of the energy.

        In this metric, projections of problems without damping have no eigenvalues far off the
        imaginary axis, which would have to converge, and those of strongly damped stiff motions
        converge. Inertia exceeds the rounding errors of the stiffness.
        """
        tangent = self.tangent
        bounds = quadratic_form_rounding(tangent.stiffness, self._undamped_shapes)
        square = max(self.shift**2, float(np.max(bounds, initial=0.0)) / _MAX_ENERGY_ROUNDING)
        stiffness = 0.5 * (tangent.stiffness + tangent.stiffness.T)
        # Positive definite also for unstable states.
        weight = stiffness + (square + 2.0 * self._growth_square) * tangent.mass
        return sp.csr_array(sp.block_diag([weight, tangent.mass]))

    def _refine_modes(self, values: Array, shapes: Array) -> tuple[Array, Array] | None:
        """Return the upper eigenvalues and their shapes after inverse iteration, or None.

        The result is None if a mode does not converge, leaves its estimate, or is found twice.
        Modes of a cluster keep their estimates instead, which are linearly independent: there,
        inverse iteration may lead from two estimates to one mode. Values near zero, which may be
        free motions, remain as they are.
        """
        mass, stiffness = self.tangent.mass, self.tangent.stiffness
        is_upper = values.imag >= 0.0
        starts, shapes = values[is_upper], shapes[:, is_upper]
        inertia = np.abs(np.einsum("ij,ij->j", shapes.conj(), mass @ shapes))
        estimates = shapes / np.sqrt(inertia)
        rounding = quadratic_form_rounding(stiffness, estimates)
        is_close = np.abs(starts[:, None] - starts) <= _CLUSTER_RATIO * np.abs(starts)
        is_clustered = np.sum(is_close, axis=1) > 1
        values, shapes = starts.copy(), estimates.copy()
        (refined,) = np.nonzero(np.abs(starts) > _ZERO_RATIO * self.shift)
        for k in refined:
            mode = self._refine_mode(starts[k], estimates[:, k], rounding[k])
            if mode is not None:
                values[k], shapes[:, k] = mode
            elif not is_clustered[k]:
                return None

        def find_twins() -> Array:
            """Return the pairs of refined modes that are the same, (pairs, 2)."""
            correlations = np.abs(shapes.conj().T @ (mass @ shapes))
            is_equal = np.abs(values[:, None] - values) <= _EQUAL_TOLERANCE * np.abs(values)
            pairs = np.argwhere(np.triu(is_equal & (correlations > _EQUAL_CORRELATION), 1))
            return pairs[np.any(np.isin(pairs, refined), axis=1)]

        for first, second in find_twins():
            if is_close[first, second]:
                values[second], shapes[:, second] = starts[second], estimates[:, second]
        return None if len(find_twins()) else (values, shapes)

    def _refine_mode(
        self, start: complex, x: Array, rounding: float
    ) -> tuple[complex, Array] | None:
        """Return an eigenvalue and its shape after inverse iteration, or None if it fails.

        Newton's method for nonlinear eigenproblems (Ruhe, SIAM J. Numer. Anal. 10 (1973) 674).
        `rounding` is the rounding error of the squared eigenvalue.
        """
        tangent, value = self.tangent, start
        for _ in range(_MAX_REFINEMENTS):
            solve = factorize_saddle_point(
                tangent.stiffness + value * tangent.damping + value**2 * tangent.mass,
                tangent.reactions,
                tangent.position_jacobian + value * tangent.velocity_jacobian,
            )
            if solve is None:
                return None
            weighted = tangent.mass @ x
            right = 2.0 * value * weighted + tangent.damping @ x
            x = solve(np.concatenate([right, tangent.velocity_jacobian @ x]))[: self.e.n]
            # x^H M x = 1 before the iteration.
            step = -1.0 / np.vdot(weighted, x)
            value += step
            x = x / np.sqrt(np.abs(np.vdot(x, tangent.mass @ x)))
            if abs(step) <= _REFINED_STEP * abs(value) + rounding / abs(value):
                break
        else:
            return None
        # Rounding may give a real eigenvalue a negative imaginary part.
        if value.imag < 0.0:
            value, x = value.conjugate(), x.conj()
        has_left = abs(value - start) > _LOCATION_ACCURACY * abs(start - self.shift)
        return None if has_left else (value, x)

    def _solve_sparse_squares(self, count: int) -> tuple[Array, Array] | None:
        """Return eigenvalues and shapes as `_solve_sparse` does, for problems without damping.

        The eigenvalues of the inverse of K + s^2 M times M are 1 / (s^2 - l^2). This space has half
        the size, and it converges with the squares of the frequencies.
        """
        n, s, tangent = self.e.n, self.shift, self.tangent
        n_random = max(count, _MIN_RANDOM_VECTORS)
        motions = np.random.default_rng(0).standard_normal((n_random, n))
        zeros = np.zeros(self.e.m)

        def apply_inverse(x: Array) -> Array:
            image = self._solve_shifted(np.concatenate([tangent.mass @ x, zeros]))[:n]
            return image - self._free @ (self._weighted_free.T @ image)

        start = np.hstack([self._undamped_shapes, (self.e.position_scales * motions).T])
        start = np.stack([apply_inverse(x) for x in start.T], axis=1)
        krylov = BlockKrylov(
            apply_inverse,
            start,
            sp.csr_array(tangent.mass),
            is_symmetric=False,
            blocks=_MIN_BLOCKS,
        )

        def required_accuracy(inverses: Array) -> Array:
            squares = s**2 - 1.0 / inverses
            sizes = np.abs(squares)
            highest = np.sort(sizes)[min(count, len(sizes)) - 1]
            # No eigenvalue outside this circle about the square of the shift is smaller.
            is_near = np.abs(squares - s**2) <= highest + s**2
            accuracy = np.where(is_near, _LOCATION_ACCURACY, np.inf)
            return np.where(sizes <= highest, 0.0, accuracy)

        def rounding(inverses: Array, shapes: Array) -> Array:
            inertia = np.abs(np.einsum("ij,ij->j", shapes.conj(), tangent.mass @ shapes))
            squares = inertia * (s**2 + np.abs(s**2 - 1.0 / inverses))
            return quadratic_form_rounding(tangent.stiffness, shapes) / squares

        if not converge(krylov, required_accuracy, rounding):
            return None
        (wanted,) = np.nonzero(required_accuracy(krylov.values) == 0.0)
        return _roots_of_squares(s**2 - 1.0 / krylov.values[wanted], krylov.vectors(wanted))

    def _solve_projected(self) -> tuple[Array, Array]:
        """Return eigenvalues and shapes from dense matrices, projected onto admissible motions.

        Free motions that are treated separately and eigenvalues lost in rounding are missing.
        Problems without damping are solved for l^2, which is twice as accurate and prevents
        rounding from moving eigenvalues off the imaginary axis.
        """
        tangent, e, s = self.tangent, self.e, self.shift
        free = sp.csc_array(self._weighted_free.T)
        rows = sp.csc_array(sp.vstack([tangent.position_jacobian, free]))
        basis = orthonormal_motions(e, rows, tangent.mass)
        weighted = tangent.mass @ basis
        images = -s * self._invert_columns(weighted)
        by_rate = weighted.T @ images
        damping = tangent.damping @ basis
        if not np.any(damping):
            # Eigenvalues of the inverse of K + s^2 M times s M are s / (s^2 - l^2).
            inverses, vectors = la.eig(-by_rate)
            is_accurate = _is_accurate(inverses)
            inverses, vectors = inverses[is_accurate], vectors[:, is_accurate]
            shapes = combine_images(images @ vectors, basis @ vectors, tangent.mass)
            return _roots_of_squares(s**2 - s / inverses, shapes)
        damped_images = images - self._invert_columns(damping)
        by_position = weighted.T @ damped_images
        count = len(by_rate)
        matrix = np.block([[by_position, by_rate], [np.eye(count) / s + by_position, by_rate]])
        inverses, vectors = la.eig(matrix)
        is_accurate = _is_accurate(inverses)
        inverses, vectors = inverses[is_accurate], vectors[:, is_accurate]
        image = damped_images @ vectors[:count] + images @ vectors[count:]
        shapes = combine_images(image, basis @ vectors[:count], tangent.mass)
        return s + 1.0 / inverses, shapes

    def _invert_columns(self, columns: Array) -> Array:
        """Return the admissible solutions of (K + s C + s^2 M) x + H mu = b for columns b."""
        zeros = np.zeros(self.e.m)
        solutions = [self._solve_shifted(np.concatenate([b, zeros]))[: self.e.n] for b in columns.T]
        images = np.reshape(solutions, (len(solutions), self.e.n)).T
        return images - self._free @ (self._weighted_free.T @ images)

    def _apply_inverse(self, y: Array) -> Array:
        """Return (A - s E)^-1 E y."""
        tangent, n, s = self.tangent, self.e.n, self.shift
        x, w = y[:n], y[n:]
        right = -(tangent.mass @ (w + s * x) + tangent.damping @ x)
        constraints = -(tangent.velocity_jacobian @ x)
        solution = self._solve_shifted(np.concatenate([right, constraints]))[:n]
        image = np.stack([solution, x + s * solution], axis=1)
        # Rounding must not bring back the free motions, whose eigenvalues are the largest.
        image -= self._free @ (self._weighted_free.T @ image)
        return image.T.ravel()

    def _select(self, values: Array, shapes: Array) -> tuple[Array, Array, Array]:
        """Remove rounding errors; keep one eigenvalue of each conjugate pair.

        Nearly zero eigenvalues are replaced by one zero for each independent free motion. The free
        motions that are treated separately are added. The third result contains the motions (n, j)
        that remain.
        """
        tangent = self.tangent
        stiffness, mass, damping = tangent.stiffness, tangent.mass, tangent.damping
        inertia = np.abs(np.einsum("ij,ij->j", shapes.conj(), mass @ shapes))
        shapes = shapes / np.sqrt(np.where(inertia > 0.0, inertia, 1.0))
        energy = np.abs(np.einsum("ij,ij->j", shapes.conj(), stiffness @ shapes))
        rounding, size = quadratic_form_rounding(stiffness, shapes), np.abs(values)
        if not self._is_symmetric:
            rounding = _ROUNDING_AMPLIFICATION * rounding
        is_rotating = not is_symmetric_matrix(damping)
        if is_rotating:
            # Motions of a floating frame have no stiffness, but rotation couples them to the slow
            # elastic modes and their rounding errors.
            slowest = np.argsort(size)[:_DEFAULT_MODE_COUNT]
            rounding = np.maximum(rounding, np.max(rounding[slowest], initial=0.0))
        zero_energy = np.maximum(rounding, ZERO_SQUARE_RATIO * self.shift**2)
        is_zero = size <= _ZERO_RATIO * self.shift
        is_zero &= energy <= _ZERO_ENERGY_FACTOR * zero_energy
        zero_squares = np.maximum(rounding, self.lin.zero_square)
        if self._is_symmetric:
            # The same motions count as free with and without dampers, whatever the rounding.
            is_free = self._undamped_free_share(shapes) > 0.5
            zero_squares *= np.where(is_free, _ZERO_SQUARE_MARGIN, 1.0 / _ZERO_SQUARE_MARGIN)
        is_zero |= size**2 <= zero_squares
        zero_square = float(np.max(zero_squares[is_zero], initial=0.0))
        is_upper = ~is_zero & (values.imag > -_IMAGINARY_TOLERANCE * size)
        if is_symmetric(self.lin):
            is_split = is_rotating & _is_split_double(values, np.sqrt(rounding))
            values = np.where(is_split, values, self._refine_values(values, shapes))
        # Rounding of the stiffness moves an undamped eigenvalue off the imaginary axis. The real
        # part is removed unless dampers dissipate more energy than rounding.
        power = np.abs(np.real(np.einsum("ij,ij->j", shapes.conj(), damping @ shapes)))
        is_damped = power > quadratic_form_rounding(damping, shapes)
        with np.errstate(over="ignore"):  # Infinity is right for an eigenvalue near 0.
            off_axis = np.where(is_damped, 0.0, 0.5 * rounding / np.maximum(size, _TINY))
        off_axis = np.where(is_damped, off_axis, np.maximum(off_axis, _REAL_TOLERANCE * size))
        if is_rotating:
            off_axis = np.where(_is_split_double(values, np.sqrt(rounding)), np.inf, off_axis)
        real = np.where(np.abs(values.real) <= off_axis, 0.0, values.real)
        is_real = np.abs(values.imag) <= _IMAGINARY_TOLERANCE * size
        values = real + 1j * np.where(is_real, 0.0, values.imag)
        independent, others = self._separate_free_motions(shapes[:, is_zero], zero_square)
        free = np.hstack([self._free, independent])
        values = np.concatenate([np.zeros(free.shape[1], complex), values[is_upper]])
        return values, np.hstack([free, shapes[:, is_upper]]), others

    def _undamped_free_share(self, shapes: Array) -> Array:
        """Return the share (k,) of the inertia of each mode that is in undamped free motions."""
        return np.sum(np.abs(self._undamped_free.T @ (self.tangent.mass @ shapes)) ** 2, axis=0)

    def _refine_values(self, values: Array, shapes: Array) -> Array:
        """Return for each mode x the root l of x^H (l^2 M + l C + K) x = 0 nearest to its value.

        M and K are symmetric, so that rounding does not make a mode grow if K and the symmetric
        part of C are positive semidefinite.
        """
        tangent = self.tangent
        m, c, k = (
            np.einsum("ij,ij->j", shapes.conj(), matrix @ shapes)
            for matrix in (tangent.mass, tangent.damping, tangent.stiffness)
        )
        m, k = m.real, k.real
        root = np.sqrt(c**2 - 4.0 * m * k + 0j)
        # The larger sum, and its partner from the product of the roots, do not cancel.
        larger = -0.5 * (c + np.where((c.conj() * root).real >= 0.0, root, -root))
        with np.errstate(divide="ignore", invalid="ignore"):
            roots = np.stack([larger / m, k / larger])
        distances = np.where(np.isfinite(roots), np.abs(roots - values), np.inf)
        nearest = roots[np.argmin(distances, axis=0), np.arange(len(values))]
        return np.where(np.isfinite(nearest), nearest, values)

    def _separate_free_motions(self, shapes: Array, zero_square: float) -> tuple[Array, Array]:
        """Return a basis of the motions without stiffness in the span of shapes, and other motions.

        Together, they span the shapes. Squared frequencies up to `zero_square` are treated as zero.
        """
        if not shapes.shape[1]:
            return shapes, shapes.real
        scales = self.e.position_scales[:, None]
        parts = shapes / scales
        parts = parts / np.maximum(np.linalg.norm(parts, axis=0), _TINY)
        parts = np.hstack([parts.real, parts.imag])
        left_vectors, singular, _ = la.svd(parts, full_matrices=False)
        basis = scales * left_vectors[:, singular > _RANK_TOLERANCE * singular[0]]
        # A double zero eigenvalue, which occurs if the rotation speed may change, has only one free
        # motion. Its generalized eigenvector stretches the mechanism and is removed here.
        stiffness, mass = (
            basis.T @ (x @ basis) for x in (self.tangent.stiffness, self.tangent.mass)
        )
        squares, vectors = la.eigh(0.5 * (stiffness + stiffness.T), 0.5 * (mass + mass.T))
        is_zero = np.abs(squares) <= max(_ZERO_RATIO * self.shift**2, zero_square)
        return (basis @ vectors[:, is_zero]).astype(complex), basis @ vectors[:, ~is_zero]


def _singular_error() -> BeamdaeError:
    return BeamdaeError(
        "modes: the linearized equations are singular; add mass or stiffness to the parts that can "
        "move."
    )


def _roots_of_squares(squares: Array, shapes: Array) -> tuple[Array, Array]:
    """Return the eigenvalues with these squares, and their shapes.

    Either sign of a root is an eigenvalue; complex ones are represented by the upper of each pair.
    """
    is_real = np.abs(squares.imag) <= _IMAGINARY_TOLERANCE * np.abs(squares)
    values = np.sqrt(np.where(is_real, squares.real, squares).astype(complex))
    values = np.where(values.imag < 0.0, -values, values)
    decaying = values.imag == 0.0
    values = np.concatenate([values, -values[decaying]])
    return values, np.hstack([shapes, shapes[:, decaying]])


def _is_accurate(inverses: Array) -> Array:
    """Return a mask of the inverse eigenvalues that are not lost in rounding."""
    return np.abs(inverses) > _MIN_INVERSE_RATIO * np.max(np.abs(inverses))


def _is_split_double(values: Array, spread: Array) -> Array:
    """Return a mask of imaginary double eigenvalues of rotating bodies that rounding has split.

    `spread` is the square root of the rounding error, by which rounding moves double eigenvalues.
    An example is the translation of a free body, seen from the frame that rotates with the body.
    """
    distances = np.abs(values[:, None] - values)
    np.fill_diagonal(distances, np.inf)
    partners = np.argmin(distances, axis=1) if len(values) > 1 else np.zeros(len(values), int)
    is_close = np.min(distances, axis=1, initial=np.inf) <= _SPLIT_RATIO * spread
    mean_growth = 0.5 * np.abs(values.real + values.real[partners])
    return is_close & (mean_growth <= _MEAN_GROWTH_RATIO * np.abs(values.real))
