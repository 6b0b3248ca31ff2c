"""Damped and gyroscopic modes: (l^2 M + l C + K) x + H mu = 0, (J + l V) x = 0.

The quadratic eigenvalue problem is linearized and inverted about a real shift (Tisseur &
Meerbergen, SIAM Rev. 43 (2001) 235). Dense matrices give all eigenvalues of small systems. For
large systems, Arnoldi's method gives the eigenvalues near the shift.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from scipy.sparse.linalg import LinearOperator, eigs

from beamdae.analysis.linear_dynamics.linearization import Linearization
from beamdae.analysis.linear_dynamics.symmetric_eigenproblem import (
    MAX_DENSE_COORDINATES,
    ZERO_SQUARE_RATIO,
    quadratic_form_rounding,
    scaled_null_space,
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
# Number of power iterations that prepare the start vector of Arnoldi's method.
_START_ITERATIONS = 3
# Eigenvalues of the inverse below this fraction of the largest eigenvalue are lost in rounding.
_MIN_INVERSE_RATIO = 1e-13
# Real and imaginary parts up to these fractions of the eigenvalue are rounding errors.
_REAL_TOLERANCE = 1e-12
_IMAGINARY_TOLERANCE = 1e-9
# Free motions are dependent if their singular value is below this fraction of the largest one.
_RANK_TOLERANCE = 1e-3
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
    squares
        Squared frequencies of the undamped problem [1/s^2], which determine the shift.
    count
        Number of modes of interest, or None for all modes.

    Raises
    ------
    BeamdaeError
        If the equations are singular at the shift.
    """

    def __init__(self, lin: Linearization, squares: Array, count: int | None) -> None:
        self.lin, self.tangent, self.e = lin, lin.tangent, lin.equations
        # The shift is in the middle of the modes of interest, so that low and high modes lose equal
        # accuracy.
        rates = np.sort(np.sqrt(np.abs(squares[squares != 0.0])))[: count or _DEFAULT_MODE_COUNT]
        self.shift = float(_SHIFT_RATIO * np.sqrt(rates[0] * rates[-1])) if len(rates) else 1.0
        tangent, s = self.tangent, self.shift
        solve = factorize_saddle_point(
            tangent.stiffness + s * tangent.damping + s**2 * tangent.mass,
            tangent.reactions,
            tangent.position_jacobian + s * tangent.velocity_jacobian,
        )
        if solve is None:
            raise BeamdaeError(
                "modes: the linearized equations are singular; add mass or stiffness "
                "to the parts that can move."
            )
        self._solve_shifted = solve

    def solve(self, count: int | None) -> tuple[Array, Array]:
        """Return the eigenvalues nearest to the shift, (k,) [1/s], and their mode shapes, (n, k).

        The modes are not sorted, and there are usually more than `count`. If `count` is None, only
        modes that are lost in rounding are missing. Each conjugate pair is represented by the
        eigenvalue with positive imaginary part.
        """
        e, n = self.e, self.e.n
        available = 2 * (n - e.m) + len(e.nonholonomic_rows)
        if not available:
            return np.zeros(0, complex), np.zeros((n, 0), complex)
        # Twice the number, for conjugate pairs, and six more because ordering by 1 / (l - s)
        # differs from ordering by l.
        number = available if count is None else min(available, 2 * count + 6)
        scales = np.tile(e.position_scales, 2)
        scales[n:] *= self.shift
        if n <= MAX_DENSE_COORDINATES or number >= n:
            basis = scaled_null_space(self.tangent.acceleration_jacobian(e), e.position_scales)
            if len(e.nonholonomic_rows):
                basis = np.diag(e.position_scales)
            state_basis = la.block_diag(basis, self.shift * basis)
            images = np.stack([self._apply_inverse(column) for column in state_basis.T], axis=1)
            matrix = la.lstsq(state_basis / scales[:, None], images / scales[:, None])[0]
            inverses, vectors = la.eig(matrix)
            shapes = (state_basis @ vectors)[:n]
        else:
            operator = LinearOperator(
                (2 * n, 2 * n),
                lambda y: self._apply_inverse(np.ravel(y) * scales) / scales,
                dtype=float,
            )
            # Deterministic start vector that is not orthogonal to any mode.
            start = np.cos(np.arange(2 * n) ** 2.0)
            for _ in range(_START_ITERATIONS):
                start = operator @ start
            inverses, vectors = eigs(
                operator, number, which="LM", v0=start, ncv=min(2 * n - 1, 2 * number + 20)
            )
            shapes = (vectors * scales[:, None])[:n]
        order = np.argsort(-np.abs(inverses), kind="stable")[:number]
        is_accurate = np.abs(inverses[order]) > _MIN_INVERSE_RATIO * np.max(np.abs(inverses))
        order = order[is_accurate]
        return self._select(self.shift + 1.0 / inverses[order], shapes[:, order])

    def _apply_inverse(self, y: Array) -> Array:
        """Return (A - s E)^-1 E y."""
        tangent, n, s = self.tangent, self.e.n, self.shift
        x, w = y[:n], y[n:]
        right = -(tangent.mass @ (w + s * x) + tangent.damping @ x)
        constraints = -(tangent.velocity_jacobian @ x)
        solution = self._solve_shifted(np.concatenate([right, constraints]))[:n]
        return np.concatenate([solution, x + s * solution])

    def _select(self, values: Array, shapes: Array) -> tuple[Array, Array]:
        """Remove rounding errors; keep one eigenvalue of each conjugate pair.

        Nearly zero eigenvalues are replaced by one zero for each independent free motion.
        """
        tangent = self.tangent
        stiffness, mass, damping = tangent.stiffness, tangent.mass, tangent.damping
        inertia = np.abs(np.einsum("ij,ij->j", shapes.conj(), mass @ shapes))
        shapes = shapes / np.sqrt(np.where(inertia > 0.0, inertia, 1.0))
        energy = np.abs(np.einsum("ij,ij->j", shapes.conj(), stiffness @ shapes))
        rounding, size = quadratic_form_rounding(stiffness, shapes), np.abs(values)
        zero_energy = np.maximum(rounding, ZERO_SQUARE_RATIO * self.shift**2)
        is_zero = size <= _ZERO_RATIO * self.shift
        is_zero &= energy <= _ZERO_ENERGY_FACTOR * zero_energy
        is_zero |= size**2 <= self.lin.zero_square
        is_upper = ~is_zero & (values.imag > -_IMAGINARY_TOLERANCE * size)
        # Rounding of the stiffness moves an undamped eigenvalue off the imaginary axis. The real
        # part is removed unless dampers dissipate more energy than rounding.
        power = np.abs(np.real(np.einsum("ij,ij->j", shapes.conj(), damping @ shapes)))
        is_damped = power > quadratic_form_rounding(damping, shapes)
        off_axis = np.where(is_damped, 0.0, 0.5 * rounding / np.maximum(size, _TINY))
        off_axis = np.maximum(off_axis, _REAL_TOLERANCE * size)
        real = np.where(np.abs(values.real) <= off_axis, 0.0, values.real)
        is_real = np.abs(values.imag) <= _IMAGINARY_TOLERANCE * size
        values = real + 1j * np.where(is_real, 0.0, values.imag)
        free = self._independent_free_motions(shapes[:, is_zero])
        values = np.concatenate([np.zeros(free.shape[1], complex), values[is_upper]])
        return values, np.hstack([free, shapes[:, is_upper]])

    def _independent_free_motions(self, shapes: Array) -> Array:
        """Return a basis of the motions without stiffness in the span of these shapes."""
        if not shapes.shape[1]:
            return shapes
        scales = self.e.position_scales[:, None]
        parts = np.hstack([shapes.real, shapes.imag]) / scales
        parts = parts / np.maximum(np.linalg.norm(parts, axis=0), _TINY)
        left_vectors, singular, _ = la.svd(parts, full_matrices=False)
        basis = scales * left_vectors[:, singular > _RANK_TOLERANCE * singular[0]]
        # A double zero eigenvalue, which occurs if the rotation speed may change, has only one free
        # motion. Its generalized eigenvector stretches the mechanism and is removed here.
        stiffness, mass = (
            basis.T @ (x @ basis) for x in (self.tangent.stiffness, self.tangent.mass)
        )
        squares, vectors = la.eigh(0.5 * (stiffness + stiffness.T), 0.5 * (mass + mass.T))
        is_zero = np.abs(squares) <= _ZERO_RATIO * self.shift**2
        return (basis @ vectors[:, is_zero]).astype(complex)
