"""Derivatives of eigenvalues and mode shapes of the linearized equations.

With the mode x, its multipliers mu and z = (x, mu), an eigenvalue l solves

    P(l) z = 0,    P(l) = [[l^2 M + l C + K, H], [J + l V, 0]],

and its derivative along a change dP of the matrices is

    dl = -w^T dP z / (w^T P'(l) z),    P(l)^T w = 0

(Fox & Kapoor, AIAA J. 6 (1968) 2426, doi:10.2514/3.5008, for symmetric matrices; Rogers, AIAA J. 8
(1970) 943, doi:10.2514/3.5795, in general). The derivative of the shape is the solution of

    P dz = -(dP + dl P') z

(Nelson, AIAA J. 14 (1976) 1201, doi:10.2514/3.7211), and its part along z follows from the
normalization. Nelson deletes an equation; here, P is bordered by vectors near z and w.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.tangents import Tangent

Array = np.ndarray

# Inverse iterations for the left and the right null vector, and for the next eigenvalue.
_ITERATIONS = 3
_GAP_ITERATIONS = 5
# Prevents division by zero.
_TINY = 1e-300


@dataclass(frozen=True)
class Pencil:
    """Matrices of P(l) = [[l^2 M + l C + K, H], [J + l V, 0]], or of their derivative.

    Attributes
    ----------
    mass, damping, stiffness
        M, C and K, (n, n) each.
    reactions
        H, (n, m).
    position_jacobian, velocity_jacobian
        J and V, (m, n) each.
    """

    mass: sp.csc_array
    damping: sp.csc_array
    stiffness: sp.csc_array
    reactions: sp.csc_array
    position_jacobian: sp.csc_array
    velocity_jacobian: sp.csc_array

    @classmethod
    def of(cls, e: EquationsOfMotion, tangent: Tangent, damped: bool) -> Pencil:
        """Return the matrices of `solve_eigenproblem`, see there for `damped`."""
        if damped:
            return cls(*tangent[:-1])
        rows = tangent.acceleration_jacobian(e)
        mass, stiffness = (sp.csc_array(0.5 * (x + x.T)) for x in (tangent.mass, tangent.stiffness))
        none = sp.csc_array
        return cls(mass, none(mass.shape), stiffness, sp.csc_array(rows.T), rows, none(rows.shape))

    def at(self, value: complex) -> sp.csc_array:
        """Return P(value)."""
        top = value**2 * self.mass + value * self.damping + self.stiffness
        rows = self.position_jacobian + value * self.velocity_jacobian
        return self._stack(top, self.reactions, rows)

    def slope(self, value: complex) -> sp.csc_array:
        """Return the derivative of P with respect to l."""
        top = 2.0 * value * self.mass + self.damping
        return self._stack(top, sp.csc_array(self.reactions.shape), self.velocity_jacobian)

    def _stack(self, top: sp.csc_array, right: sp.csc_array, rows: sp.csc_array) -> sp.csc_array:
        if not rows.shape[0]:
            return sp.csc_array(top)
        return sp.csc_array(sp.block_array([[top, right], [rows, None]], format="csc"))


@dataclass(frozen=True)
class EigenpairDerivatives:
    """Derivatives of a simple eigenvalue that is not zero, and of its shape.

    Attributes
    ----------
    pencil
        Matrices of the eigenvalue problem.
    scales
        Natural sizes of the coordinates, (n,).
    value, shape
        Eigenvalue l [1/s] and shape x (n,), normalized as in `Modes`.
    """

    pencil: Pencil
    scales: Array
    value: complex
    shape: Array

    def derivative(self, change: Pencil) -> tuple[complex, Array]:
        """Return the derivatives of the eigenvalue and of the normalized shape."""
        n, right = len(self.shape), self._null_vectors[1]
        rate = -self.work(change) / self.slope_work
        forces = -(change.at(self.value) @ right + rate * (self._slope @ right))
        response = self._solve(forces)[:n]
        # The shape keeps x^H M x = 1 and the phase of x^T M x.
        x, mass = self.shape, self.pencil.mass
        conjugate, plain = (y @ (2.0 * (mass @ response) + change.mass @ x) for y in (x.conj(), x))
        size = x @ (mass @ x)
        share = complex(-0.5 * np.real(conjugate))
        if abs(size) > np.sqrt(np.finfo(float).eps):
            share += -0.5j * float(np.imag(plain)) / float(np.real(size))
        return complex(rate), response + share * x

    def work(self, change: Pencil) -> complex:
        """Return w^T dP z."""
        left, right = self._null_vectors
        return complex(left @ (change.at(self.value) @ right))

    @cached_property
    def slope_work(self) -> complex:
        """w^T P'(l) z, which is zero for a double eigenvalue with one shape."""
        left, right = self._null_vectors
        return complex(left @ (self._slope @ right))

    @cached_property
    def gap(self) -> float:
        """Distance to the nearest other eigenvalue, relative to |l|, if it is small."""
        vector = self._scale * np.cos(np.arange(len(self._scale)) ** 2.0)
        size = 1.0
        for _ in range(_GAP_ITERATIONS):
            vector = vector / max(np.max(np.abs(vector / self._scale)), _TINY)
            vector = self._solve(self._slope @ vector)
            size = float(np.max(np.abs(vector / self._scale)))
        return 1.0 / (max(size, _TINY) * abs(self.value)) if np.isfinite(size) else 0.0

    @cached_property
    def _slope(self) -> sp.csc_array:
        return self.pencil.slope(self.value)

    @cached_property
    def _scale(self) -> Array:
        """Natural sizes of (x, mu), with which the entries of P are of similar size."""
        matrix = abs(self.pencil.stiffness) + abs(self.value) ** 2 * abs(self.pencil.mass)
        energy = float(np.max(self.scales * (matrix @ self.scales), initial=_TINY))
        gradients = abs(self.pencil.position_jacobian) + abs(self.value) * abs(
            self.pencil.velocity_jacobian
        )
        rows = gradients @ self.scales
        return np.append(self.scales, energy / np.where(rows > 0.0, rows, 1.0))

    @cached_property
    def _matrix(self) -> sp.csc_array:
        """P(l), scaled symmetrically, but not by `_size`."""
        return sp.csc_array(self.pencil.at(self.value) * self._scale * self._scale[:, None])

    @cached_property
    def _size(self) -> float:
        return max(float(np.max(np.abs(self._matrix.data), initial=0.0)), _TINY)

    @cached_property
    def _bordered(self) -> tuple[SuperLU, Array, Array]:
        """Factors of P bordered by vectors near its null vectors, and these vectors, scaled."""
        start = np.append(self.shape, np.zeros(len(self._scale) - len(self.shape))) / self._scale
        left = right = start / np.linalg.norm(start)
        unit = np.append(np.zeros(len(start)), 1.0 + 0j)
        for k in range(_ITERATIONS + 1):
            column, row = sp.csc_array(left.conj()[:, None]), sp.csc_array(right.conj()[None])
            bordered = sp.block_array(
                [[self._matrix / self._size, column], [row, None]], format="csc"
            )
            factors = splu(sp.csc_matrix(bordered.astype(complex)))
            if k < _ITERATIONS:
                left, right = factors.solve(unit, "T")[:-1], factors.solve(unit)[:-1]
                left, right = left / np.linalg.norm(left), right / np.linalg.norm(right)
        return factors, left, right

    @cached_property
    def _null_vectors(self) -> tuple[Array, Array]:
        """Left vector w, and right vector z whose first part is the shape."""
        _, left, right = self._bordered
        right = self._scale * right
        n, mass = len(self.shape), self.pencil.mass
        share = (self.shape.conj() @ (mass @ self.shape)) / (self.shape.conj() @ (mass @ right[:n]))
        return self._scale * left, share * right

    def _solve(self, forces: Array) -> Array:
        """Return the solution z of P z = `forces` without its part along the null vector."""
        right = np.append(self._scale * forces / self._size, 0.0)
        return self._scale * self._bordered[0].solve(right.astype(complex))[:-1]
