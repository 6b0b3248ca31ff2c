"""Null vectors of a nearly singular tangent, and a function that vanishes if it is singular.

Under forces without a potential, the tangent is not symmetric, and its left and right null vectors
differ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from beamdae.analysis.statics.load_scaling import LoadedEquations

Array = np.ndarray

# Inverse iterations; each reduces the other components by the ratio of eigenvalues, which is small.
_ITERATIONS = 3
# Refinement ends if it changes the vectors by less than this fraction, which rounding of the
# differences limits to 1e-7; maximum number. At L/h = 1e5, it takes two refinements, and at 1e7
# with 8 elements five to ten (measured).
_FINAL_REFINEMENT = 1e-6
_MAX_REFINEMENTS = 12
# Soft motions have less than this stiffness, relative to the largest one. Its rounding errors are
# smaller by the same factor.
_SOFT_RATIO = 1e-7
# Samples of a stiffness with other last digits of the coordinates, and bound on its error as a
# multiple of their standard deviation.
_SAMPLE_COUNT = 6
_ROUNDING_MULTIPLE = 4.0
_UNIT_ROUNDOFF = 0.5 * float(np.finfo(float).eps)
# Coordinates are rounded as if they were at least this large, in natural sizes.
_MIN_COORDINATE = 0.3
# Largest change of the step of differences between samples.
_STEP_VARIATION = 0.3


class Scales(NamedTuple):
    """Natural sizes of the unknowns (q, lam), (n + m,), and of the energy [J]."""

    unknowns: Array
    energy: float


def natural_scales(system: LoadedEquations, x: Array, mu: float) -> Scales:
    """Return sizes that make stiffness and constraints equally large.

    The scaled tangent S F_x S / energy, with the sizes S of the unknowns, has entries of up to 1.
    """
    n, sizes = system.equations.n, system.scales
    tangent = system.matrix(system.tangent(x, mu))
    stiffness = sp.csc_array(tangent[:n, :n]) * sizes * sizes[:, None]
    energy = float(np.max(np.abs(stiffness.data), initial=0.0)) or 1.0
    rows = row_sizes(sp.csr_array(tangent[n:, :n]) * sizes)
    return Scales(np.append(sizes, energy / rows), energy)


def row_sizes(gradients: sp.csr_array) -> Array:
    """Return the largest absolute entry of each row of G, (m,); 1 for rows of zeros."""
    if not gradients.shape[0]:
        return np.zeros(0)
    rows = abs(gradients).max(axis=1).toarray().ravel()
    return np.where(rows > 0.0, rows, 1.0)


@dataclass(frozen=True)
class SingularityTest:
    """Function g of an equilibrium that is zero where the tangent is singular.

    [[F_x, left], [right^T, 0]] (v, g) = (0, 1), with the scaled tangent, defines g. It changes sign
    where an eigenvalue does.

    Attributes
    ----------
    scales
        Natural scales of the tangent.
    left, right
        Approximate left and right null vectors (n + m,) of the scaled tangent.
    """

    scales: Scales
    left: Array
    right: Array

    @classmethod
    def near(cls, system: LoadedEquations, x: Array, mu: float) -> SingularityTest:
        """Return the test with the null vectors of the tangent at a nearly singular equilibrium."""
        scales = natural_scales(system, x, mu)
        # Deterministic vector that is not orthogonal to any mode.
        start = np.cos(np.arange(len(x)) ** 2.0)
        test = cls(scales, start / np.linalg.norm(start), start / np.linalg.norm(start))
        for _ in range(_ITERATIONS):
            left, right = test._solve(system, x, mu)
            test = cls(scales, left / np.linalg.norm(left), right / np.linalg.norm(right))
        return test

    def value(self, system: LoadedEquations, x: Array, mu: float) -> float:
        """Return g, accurate also for thin beams, see `LoadedEquations.multiply_tangent`."""
        left, right = self.left[:, None], self.right[:, None]
        return float(solve_bordered_tangent(system, x, mu, self.scales, left, right).values[0, 0])

    @property
    def mode(self) -> Array:
        """Right null vector (n + m,), not scaled."""
        return self.scales.unknowns * self.right

    def _solve(self, system: LoadedEquations, x: Array, mu: float) -> tuple[Array, Array]:
        """Return approximate left and right null vectors."""
        solver, unit = self.factorize(system, x, mu)
        right, left = solver.solve(unit), solver.solve(unit, "T")
        return left[:-1], right[:-1]

    def factorize(self, system: LoadedEquations, x: Array, mu: float) -> tuple[SuperLU, Array]:
        """Return the factors of the bordered matrix, and the right-hand side (0, 1)."""
        left, right = self.left[:, None], self.right[:, None]
        solver = _factorize(system, x, mu, self.scales, left, right)
        return solver, np.append(np.zeros(len(x)), 1.0)


class BorderedSolution(NamedTuple):
    """Solution (V, G) of [[F_x, left], [right^T, 0]] (V, G) = (0, I), with the scaled tangent.

    V spans the result of an inverse iteration. The eigenvalues of -G near zero are those of F_x if
    `left` and `right` span its modes.

    Attributes
    ----------
    vectors, values
        V, (n + m, k), and G, (k, k).
    correction
        Last relative change of V by iterative refinement.
    """

    vectors: Array
    values: Array
    correction: float


def solve_bordered_tangent(
    system: LoadedEquations, x: Array, mu: float, scales: Scales, left: Array, right: Array
) -> BorderedSolution:
    """Return the solution, refined by differences of the forces, accurate for thin beams.

    `left` and `right`, (n + m, k), make the bordered matrix regular. If rounding errors of the
    stiffness exceed the stiffness in soft motions, refinement diverges, and `correction` is large.
    """
    (unknowns, energy), size = scales, len(x)
    solver = _factorize(system, x, mu, scales, left, right)
    identity = np.eye(left.shape[1])
    solution = solver.solve(np.vstack([np.zeros_like(left), identity]))
    correction = np.inf
    for _ in range(_MAX_REFINEMENTS):
        v, g = solution[:size], solution[size:]
        product = system.multiply_tangent(x, mu, unknowns[:, None] * v)
        forces = unknowns[:, None] / energy * product + left @ g
        change = solver.solve(np.vstack([-forces, identity - right.T @ v]))
        lengths = np.linalg.norm(change[:size], axis=0) / np.linalg.norm(v, axis=0)
        last, correction = correction, float(np.max(lengths))
        if not correction < last:
            break
        solution += change
        if correction <= _FINAL_REFINEMENT:
            break
    return BorderedSolution(solution[:size], solution[size:], correction)


def remove_stiff_motions(
    system: LoadedEquations, x: Array, mu: float, scales: Scales, vectors: Array
) -> Array:
    """Return scaled unknowns (n + m, k) without motions that are stiff compared with the others.

    (K + s)^-1 with a shift s above the stiffness of soft motions hardly changes these motions.

    Raises
    ------
    RuntimeError
        If the shifted matrix is singular.
    """
    n, size = system.equations.n, len(x)
    shift = sp.csc_array(sp.diags_array(np.where(np.arange(size) < n, _SOFT_RATIO, 0.0)))
    solver = splu(sp.csc_matrix(_scaled_tangent(system, x, mu, scales) + shift))
    right = np.vstack([vectors[:n], np.zeros((size - n, vectors.shape[1]))])
    return solver.solve(right)


def stiffness_rounding(
    system: LoadedEquations, x: Array, mu: float, left: Array, right: Array
) -> float:
    """Return a bound on the rounding error [J] of left^T K right, with displacements (n,).

    Coordinates are multiples of their last digit, which is not small compared with the elongation
    of a thin beam: at the buckling load, 0.8 (h / L)^2 of its length. Therefore, the last digits
    and the steps of the differences are varied (J. Vignes, Math. Comput. Simul. 35 (1993) 233).
    """
    n = len(right)
    direction = np.append(right, np.zeros(len(x) - n))[:, None]
    # Beams in a floating frame have small coordinates, but add their strains to 1.
    sizes = np.maximum(np.abs(x[:n]), _MIN_COORDINATE * system.equations.part_scales)
    phases = np.arange(n) ** 2.0
    samples = []
    for k in range(_SAMPLE_COUNT):
        near = x.copy()
        near[:n] += 2.0 * _UNIT_ROUNDOFF * sizes * np.cos(phases + k)
        step = 1.0 + _STEP_VARIATION * np.cos(float(k))
        samples.append(left @ system.multiply_tangent(near, mu, direction, step)[:n, 0])
    return _ROUNDING_MULTIPLE * float(np.std(samples, ddof=1))


def _factorize(
    system: LoadedEquations, x: Array, mu: float, scales: Scales, left: Array, right: Array
) -> SuperLU:
    tangent = _scaled_tangent(system, x, mu, scales)
    columns, rows = sp.csc_array(left), sp.csc_array(right.T)
    bordered = sp.block_array([[tangent, columns], [rows, None]], format="csc")
    return splu(sp.csc_matrix(bordered))


def _scaled_tangent(system: LoadedEquations, x: Array, mu: float, scales: Scales) -> sp.csc_array:
    unknowns, energy = scales
    tangent = system.matrix(system.tangent(x, mu))
    return sp.csc_array(tangent * unknowns * unknowns[:, None] / energy)
