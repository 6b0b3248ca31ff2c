"""Null vectors of a nearly singular tangent, and a function that is zero where it is singular.

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
# Iterative refinements of g. The first one reduces an error of 5 % of the critical load at
# L/h = 1e5 to 1e-5, the second one to 1e-6, and others do not improve it (measured).
_REFINEMENTS = 2


class Scales(NamedTuple):
    """Natural sizes of the unknowns (q, lam), (n + m,), and of the energy [J]."""

    unknowns: Array
    energy: float


def natural_scales(system: LoadedEquations, x: Array, mu: float) -> Scales:
    """Return sizes that make stiffness and constraints equally large.

    The scaled tangent S F_x S / energy, with the sizes S of the unknowns, has entries of up to 1.
    """
    n, sizes = system.equations.n, system.equations.position_scales
    tangent = system.matrix(system.tangent(x, mu))
    stiffness = sp.csc_array(tangent[:n, :n]) * sizes * sizes[:, None]
    energy = float(np.max(np.abs(stiffness.data), initial=0.0)) or 1.0
    gradients = abs(sp.csr_array(tangent[n:, :n]) * sizes)
    rows = np.zeros(tangent.shape[0] - n)
    if len(rows):
        rows = gradients.max(axis=1).toarray().ravel()
    return Scales(np.append(sizes, energy / np.where(rows > 0.0, rows, 1.0)), energy)


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
        unknowns, energy = self.scales
        solver, unit = self.factorize(system, x, mu)
        solution = solver.solve(unit)
        for _ in range(_REFINEMENTS):
            v, g = solution[:-1], solution[-1]
            product = system.multiply_tangent(x, mu, (unknowns * v)[:, None])[:, 0]
            forces = unknowns / energy * product + g * self.left
            solution += solver.solve(unit - np.append(forces, self.right @ v))
        return float(solution[-1])

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
        unknowns, energy = self.scales
        tangent = system.matrix(system.tangent(x, mu)) * unknowns * unknowns[:, None] / energy
        last = sp.csc_array(self.left[:, None])
        bordered = sp.block_array([[tangent, last], [self.right[None], None]], format="csc")
        return splu(sp.csc_matrix(bordered)), np.append(np.zeros(len(x)), 1.0)
