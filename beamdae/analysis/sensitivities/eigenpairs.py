"""Derivatives of eigenvalues and mode shapes by the implicit function theorem.

An eigenvalue l and its vector z = (x, multipliers, forces of stiff parts) solve A(l; p) z = 0 with
the matrix A of `LinearizedEquations.pencil`. With vectors b and c near its null vectors, the
bordered solutions [A b; c^H 0] (u, s) = (dA z, 0) and [A b; c^H 0] (u', s') = (A'(l) z, 0) give the
derivatives along a change dA,

    dl = -s / s',    dz = -u - dl u',

if s' is not zero, as for simple eigenvalues (Fox & Kapoor, AIAA J. 6 (1968) 2426,
doi:10.2514/3.5008; Nelson, AIAA J. 14 (1976) 1201, doi:10.2514/3.7211, who deletes an equation in
place of the border). The part of dz along z follows from the normalization.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.continuation.engine import BorderedFactors, CurveError, factorize_bordered
from beamdae.analysis.eigenproblems.linearized_equations import (
    LinearizedEquations,
    linearize_in_mixed_form,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import Tangent
from beamdae.equations.starts.steady_rotation import rotating_state
from beamdae.linear.orderings import invert_to_power_of_two
from beamdae.parts.rotation import Rotation

Array = np.ndarray

# Inverse iterations for the next eigenvalue.
_GAP_ITERATIONS = 5


@dataclass(frozen=True, eq=False)
class Eigenpair:
    """Eigenvalue that is not zero, and its shape.

    Attributes
    ----------
    lin
        Linearized equations in mixed form.
    value, shape
        Eigenvalue l [1/s] and shape x (n,), with x^H M x = 1.
    """

    lin: LinearizedEquations
    value: complex
    shape: Array

    @cached_property
    def vector(self) -> Array:
        """Shape with its multipliers and forces, z."""
        return self._solve(np.zeros(len(self._row)), 1.0)[0]

    def work(self, change: Array) -> complex:
        """Return w^T dA z for dA z and the left vector w, up to a factor."""
        return self._solve(change)[1]

    def derivative(self, change: Array, mass_change: Array) -> tuple[complex, Array]:
        """Return the derivatives of the eigenvalue and of the normalized shape.

        `change` and `mass_change` are dA z and dM x.
        """
        (by_change, work), (by_value, slope) = self._solve(change), self._by_value
        x, mass, rate = self.shape, self.lin.tangent.mass, -work / slope
        response = -(by_change + rate * by_value)[: len(x)]
        # The shape keeps x^H M x = 1 and the phase of x^T M x.
        share, size = complex(-0.5 * np.real(x.conj() @ mass_change)), x @ (mass @ x)
        if abs(size) > np.sqrt(np.finfo(float).eps):
            plain = x @ (2.0 * (mass @ response) + mass_change)
            share -= 0.5j * float(np.imag(plain)) / float(np.real(size))
        return rate, response + share * x

    @cached_property
    def gap(self) -> float:
        """Distance to the nearest other eigenvalue, relative to |l|, if it is small."""
        vector, size = np.cos(np.arange(len(self._row)) ** 2.0), 1.0
        try:
            for _ in range(_GAP_ITERATIONS):
                vector = self._solve(self._slope @ vector / size)[0]
                size = float(np.linalg.norm(vector)) or 1.0
        except CurveError:
            return 0.0
        return 1.0 / (size * abs(self.value))

    @cached_property
    def _by_value(self) -> tuple[Array, complex]:
        return self._solve(self._slope @ self.vector)

    @cached_property
    def _slope(self) -> sp.csc_array:
        """Derivative of A with respect to l."""
        _, *others = self.lin.pencil.matrices
        terms = (k * self.value ** (k - 1) * x for k, x in enumerate(others, 1))
        return sp.csc_array(sum(terms, sp.csc_array(others[0].shape)))

    @cached_property
    def _row(self) -> Array:
        """Row x^H M of the border."""
        row = self.lin.tangent.mass.T @ self.shape.conj()
        return np.append(row, np.zeros(self.lin.pencil.matrices[0].shape[0] - len(row)))

    @cached_property
    def _bordered(self) -> tuple[Array, BorderedFactors]:
        """Scales of the rows of A, and factors of the bordered matrix."""
        matrix = sp.csc_array(
            sum(self.value**k * x.astype(complex) for k, x in enumerate(self.lin.pencil.matrices))
        )
        sizes = abs(matrix).max(axis=1).toarray().ravel()
        scales = invert_to_power_of_two(sizes)
        scaled = sp.csc_array(sp.diags_array(scales) @ matrix)
        # The second column is not orthogonal to the left vector, even where eigenvalues coalesce.
        border, transposed = scales * self._row.conj(), sp.csc_array(scaled.T)
        unit = np.append(np.zeros(len(scales)), 1.0 + 0j)
        left = factorize_bordered(transposed, self._row, border, 0.0).solve(unit)[:-1]
        column = left.conj() / np.linalg.norm(left)
        return scales, factorize_bordered(scaled, column, self._row, 0.0)

    def _solve(self, right: Array, last: float = 0.0) -> tuple[Array, complex]:
        """Return u and s with [A b; c^H 0] (u, s) = (right, last)."""
        scales, factors = self._bordered
        solution = factors.solve(np.append(scales * right, last).astype(complex))
        return solution[:-1], complex(solution[-1])


def apply_pencil(lin: LinearizedEquations, value: complex, z: Array) -> Array:
    """Return A(l) z."""
    return np.asarray(sum(value**k * (x @ z) for k, x in enumerate(lin.pencil.matrices)))


def linearize_at(
    e: EquationsOfMotion,
    tangent_at: Callable[..., Tangent],
    x: Array,
    idle: Array | None = None,
    rotation: Rotation | None = None,
) -> LinearizedEquations:
    """Return the equations in mixed form about x = (q, multipliers, stiff forces).

    The state is at rest, or in steady rotation. `tangent_at` is a function of a state and a
    conversion of the equations that returns their matrices; see `introduce_resultants` for `idle`.
    """
    q, lam = np.split(x, [e.n])
    if rotation is not None:
        state = rotating_state(e, rotation, q, lam)
    else:
        state = State(q, np.zeros(e.n), np.zeros(e.n), lam)
    return linearize_in_mixed_form(e, state, tangent_at, idle)
