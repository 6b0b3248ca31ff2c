"""Null vectors of the singular tangent at a critical point.

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


class Scales(NamedTuple):
    """Natural sizes of the unknowns (q, lam), (n + m,), and of the energy [J]."""

    unknowns: Array
    energy: float


def natural_scales(system: LoadedEquations, x: Array, mu: float) -> Scales:
    """Return sizes that make stiffness and constraints equally large.

    The scaled tangent S F_x S / energy, with the sizes S of the unknowns, has entries of up to 1.
    """
    n, sizes = system.equations.n, system.equations.part_scales
    tangent = system.matrix(x, mu)
    # All of the stiffness may vanish at a critical point.
    energies = [
        np.max(np.abs((sp.csc_array(each[:n, :n]) * sizes * sizes[:, None]).data), initial=0.0)
        for each in (tangent, system.matrix(x, system.ends[0]))
    ]
    energy = float(max(energies)) or 1.0
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


def _factorize(
    system: LoadedEquations, x: Array, mu: float, scales: Scales, left: Array, right: Array
) -> SuperLU:
    tangent = _scaled_tangent(system, x, mu, scales)
    columns, rows = sp.csc_array(left), sp.csc_array(right.T)
    bordered = sp.block_array([[tangent, columns], [rows, None]], format="csc")
    return splu(sp.csc_matrix(bordered))


def _scaled_tangent(system: LoadedEquations, x: Array, mu: float, scales: Scales) -> sp.csc_array:
    unknowns, energy = scales
    tangent = system.matrix(x, mu)
    return sp.csc_array(tangent * unknowns * unknowns[:, None] / energy)
