"""Damped and gyroscopic modes: (l^2 M + l C + K) x + H mu = 0, (J + l V) x = 0.

Eigenvalues near zero by a real factorization at a shift (Tisseur & Meerbergen, SIAM Rev. 43 (2001)
235): of small systems all at once, of large ones by Arnoldi's method.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from scipy.sparse.linalg import LinearOperator, eigs

from beamdae.analysis.linear_dynamics.linearization import Linearization
from beamdae.analysis.linear_dynamics.symmetric_eigenproblem import (
    ALL_AT_ONCE,
    STILL,
    quadratic_form_rounding,
    scaled_null_space,
)
from beamdae.errors import BeamdaeError
from beamdae.linear.saddle_point import factorize_saddle_point

Array = np.ndarray

# Eigenvalues beside the shift that are zero: a pair that coincides there is off by the root of
# rounding.
_ZERO = 1e-5
# The shift is no frequency of a mode; where all are wanted it is in the middle of so many.
_BELOW, _MANY = 0.6, 10


class QuadraticProblem:
    """(l^2 M + l C + K) x + H mu = 0, (J + l V) x = 0.

    With y = (x, x') = (x, l x) it is l E y = A y; 1 / (l - s) are eigenvalues of (A - s E)^-1 E.
    """

    def __init__(self, lin: Linearization, squares: Array, count: int | None) -> None:
        self.lin, self.own, self.e = lin, lin.tangent, lin.equations
        # In the middle of what is wanted: low and high ones then lose as much to rounding.
        told = np.sort(np.sqrt(np.abs(squares[squares != 0.0])))[: count or _MANY]
        self.rate = float(_BELOW * np.sqrt(told[0] * told[-1])) if len(told) else 1.0
        own, s = self.own, self.rate
        solve = factorize_saddle_point(
            own.stiffness + s * own.damping + s**2 * own.mass,
            own.reactions,
            own.position_jacobian + s * own.velocity_jacobian,
        )
        if solve is None:
            raise BeamdaeError("modes: the linearized equations are singular.")
        self.solve = solve

    def lowest(self, count: int | None) -> tuple[Array, Array]:
        """Eigenvalues (k,) and shapes (n, k) nearest to zero, at least `count` of them, or all."""
        e, n = self.e, self.e.n
        free = 2 * (n - e.m) + len(e.nonholonomic_rows)
        if not free:
            return np.zeros(0, complex), np.zeros((n, 0), complex)
        wanted = free if count is None else min(free, 2 * count + 6)
        scales = np.tile(e.position_scales, 2)
        scales[n:] *= self.rate
        if n <= ALL_AT_ONCE or wanted >= n:
            basis = scaled_null_space(self.own.acceleration_jacobian(e), e.position_scales)
            if len(e.nonholonomic_rows):
                basis = np.diag(e.position_scales)
            whole = la.block_diag(basis, self.rate * basis)
            images = np.stack([self._inverse(column) for column in whole.T], axis=1)
            matrix = la.lstsq(whole / scales[:, None], images / scales[:, None])[0]
            theta, vectors = la.eig(matrix)
            shapes = (whole @ vectors)[:n]
        else:
            operator = LinearOperator(
                (2 * n, 2 * n), lambda y: self._inverse(np.ravel(y) * scales) / scales, dtype=float
            )
            begin = np.cos(np.arange(2 * n) ** 2.0)
            for _ in range(3):
                begin = operator @ begin
            theta, vectors = eigs(
                operator, wanted, which="LM", v0=begin, ncv=min(2 * n - 1, 2 * wanted + 20)
            )
            shapes = (vectors * scales[:, None])[:n]
        order = np.argsort(-np.abs(theta), kind="stable")[:wanted]
        kept = order[np.abs(theta[order]) > 1e-13 * np.max(np.abs(theta))]
        return self._told(self.rate + 1.0 / theta[kept], shapes[:, kept])

    def _inverse(self, y: Array) -> Array:
        """(A - s E)^-1 E y."""
        own, n, s = self.own, self.e.n, self.rate
        x, w = y[:n], y[n:]
        right = -(own.mass @ (w + s * x) + own.damping @ x)
        found = self.solve(np.concatenate([right, -(own.velocity_jacobian @ x)]))[:n]
        return np.concatenate([found, x + s * found])

    def _told(self, values: Array, shapes: Array) -> tuple[Array, Array]:
        """Of conjugate pairs one, of what nothing resists each shape once."""
        stiffness, mass = self.own.stiffness, self.own.mass
        inertia = np.abs(np.einsum("ij,ij->j", shapes.conj(), mass @ shapes))
        shapes = shapes / np.sqrt(np.where(inertia > 0.0, inertia, 1.0))
        energy = np.abs(np.einsum("ij,ij->j", shapes.conj(), stiffness @ shapes))
        rounding, size = quadratic_form_rounding(stiffness, shapes), np.abs(values)
        still = np.maximum(rounding, STILL * self.rate**2)
        zero = (size <= _ZERO * self.rate) & (energy <= 1e4 * still)
        zero |= size**2 <= self.lin.still
        upper = ~zero & (values.imag > -1e-9 * size)
        # What rounding of the stiffness makes of an eigenvalue on one of the axes, unless dampers
        # take or give more than rounding.
        taken = np.abs(np.real(np.einsum("ij,ij->j", shapes.conj(), self.own.damping @ shapes)))
        is_damped = taken > quadratic_form_rounding(self.own.damping, shapes)
        off = np.where(is_damped, 0.0, 0.5 * rounding / np.maximum(size, 1e-300))
        off = np.maximum(off, 1e-12 * size)
        real = np.where(np.abs(values.real) <= off, 0.0, values.real)
        values = real + 1j * np.where(np.abs(values.imag) <= 1e-9 * size, 0.0, values.imag)
        still = self._independent(shapes[:, zero])
        values = np.concatenate([np.zeros(still.shape[1], complex), values[upper]])
        return values, np.hstack([still, shapes[:, upper]])

    def _independent(self, shapes: Array) -> Array:
        """Motions that nothing resists, each once."""
        if not shapes.shape[1]:
            return shapes
        scales = self.e.position_scales[:, None]
        both = np.hstack([shapes.real, shapes.imag]) / scales
        both = both / np.maximum(np.linalg.norm(both, axis=0), 1e-300)
        left, singular, _ = la.svd(both, full_matrices=False)
        basis = scales * left[:, singular > 1e-3 * singular[0]]
        # Where the speed of a rotation may change a double zero has one motion, and beside it what
        # that would stretch.
        energy, inertia = (basis.T @ (x @ basis) for x in (self.own.stiffness, self.own.mass))
        squares, shares = la.eigh(0.5 * (energy + energy.T), 0.5 * (inertia + inertia.T))
        return (basis @ shares[:, np.abs(squares) <= _ZERO * self.rate**2]).astype(complex)
