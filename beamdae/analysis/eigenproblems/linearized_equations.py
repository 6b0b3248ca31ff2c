"""Linearized equations as the eigenvalue solvers need them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from beamdae.equations.equations_of_motion import PartCoordinates
from beamdae.equations.formulations.tangents import LinearizedCoordinates, Tangent

Array = np.ndarray

# Asymmetry up to which a matrix is treated as symmetric, relative to its largest entry: of exact
# matrices, and of matrices with finite differences. The first is small because a follower load is
# small compared with the axial stiffness of a thin beam.
_EXACT_TOLERANCE, _DIFFERENCE_TOLERANCE = 1e-13, 1e-9
# Deviation of the directions of reactions from the gradients of the constraints, relative to the
# largest gradient.
_REACTION_TOLERANCE = 1e-12


@dataclass(frozen=True)
class CoordinateSubset:
    """Some of the coordinates and constraints of linearized equations."""

    q_names: tuple[str, ...]
    position_scales: Array
    states: Array
    nonholonomic_rows: Array
    m: int

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.q_names)


@dataclass(frozen=True)
class LinearizedEquations:
    """Linearized equations M x'' + C x' + K x + H mu = 0, J x + V x' - c mu = 0.

    Attributes
    ----------
    equations
        Equations of the active parts with independent constraints.
    tangent
        Matrices of the linearized equations.
    zero_square
        Squared frequencies up to this magnitude [1/s^2] are treated as zero.
    has_differences
        True if the matrices contain errors of finite differences or of the transformation to a
        rotating frame, so that symmetry is tested with a larger tolerance.
    """

    equations: LinearizedCoordinates
    tangent: Tangent
    zero_square: float = 0.0
    has_differences: bool = False

    @cached_property
    def rows(self) -> sp.csc_array:
        """Matrix (m, n) that multiplies accelerations in the differentiated constraints."""
        return self.tangent.acceleration_jacobian(self.equations)

    @property
    def compliance(self) -> Array:
        """Compliances of the constraints, (m,)."""
        compliance = self.tangent.compliance
        return np.zeros(self.equations.m) if compliance is None else compliance

    @cached_property
    def is_symmetric(self) -> bool:
        """True if the eigenproblem without damping is symmetric.

        That is, K and M are symmetric, reactions act along the gradients of the constraints, and
        constraints on velocities do not depend on positions.
        """
        tangent = self.tangent
        tolerance = _DIFFERENCE_TOLERANCE if self.has_differences else _EXACT_TOLERANCE
        for matrix in (tangent.stiffness, tangent.mass):
            if matrix.nnz and abs(matrix - matrix.T).max() > tolerance * abs(matrix).max():
                return False
        # At rest, constraints on velocities constrain the shapes of vibrations.
        rolling = tangent.position_jacobian[self.nonholonomic]
        if rolling.nnz and abs(rolling).max() > 0.0:
            return False
        return self.has_gradient_reactions

    @cached_property
    def has_gradient_reactions(self) -> bool:
        """True if reactions act along the gradients of the constraints."""
        difference = abs(self.tangent.reactions.T - self.rows)
        return not difference.nnz or bool(
            difference.max() <= _REACTION_TOLERANCE * abs(self.rows).max()
        )

    @property
    def has_rates(self) -> bool:
        """True if an eigenvalue itself occurs in the eigenproblem, not only its square."""
        matrices = (self.tangent.damping, self.tangent.velocity_jacobian)
        return len(self.equations.states) > 0 or any(np.any(matrix.data) for matrix in matrices)

    def symmetrized(self) -> LinearizedEquations:
        """Return undamped equations with the symmetric parts of M and K, and reactions along G."""
        tangent, rows = self.tangent, self.rows
        mass, stiffness = (sp.csc_array(0.5 * (x + x.T)) for x in (tangent.mass, tangent.stiffness))
        undamped = tangent._replace(
            mass=mass,
            damping=sp.csc_array(mass.shape),
            stiffness=stiffness,
            reactions=sp.csc_array(rows.T),
            position_jacobian=rows,
            velocity_jacobian=sp.csc_array(rows.shape),
        )
        return replace(self, tangent=undamped)

    @cached_property
    def condensed_stiffness(self) -> sp.csc_array:
        """Stiffness (n, n) that contains compliant constraints, for fast motions and scales."""
        tangent, (compliant,) = self.tangent, np.nonzero(self.compliance)
        reactions, rows = tangent.reactions[:, compliant], tangent.position_jacobian[compliant]
        weights = sp.diags_array(1.0 / self.compliance[compliant])
        return sp.csc_array(tangent.stiffness + reactions @ weights @ rows)

    @property
    def nonholonomic(self) -> Array:
        """Mask of the constraints on velocities, (m,)."""
        mask = np.zeros(self.equations.m, bool)
        mask[self.equations.nonholonomic_rows] = True
        return mask

    def split(self, parts: Sequence[PartCoordinates]) -> list[tuple[LinearizedEquations, Array]]:
        """Return the equations of each group of coupled `parts`, and their coordinates (k,).

        The ground couples no parts.
        """
        e, tangent = self.equations, self.tangent
        blocks = tangent.stiffness, tangent.damping, tangent.mass
        coupling = sum((abs(x) for x in blocks), sp.csc_array((e.n, e.n)))
        constraints = abs(tangent.position_jacobian) + abs(tangent.velocity_jacobian)
        constraints = constraints + abs(tangent.reactions).T
        # One node for each part and each constraint; coordinates without a part are their own.
        nodes = np.arange(e.n)
        for part in parts:
            nodes[part.rows] = part.rows.start
        merge = sp.csc_array((np.ones(e.n), (nodes, np.arange(e.n))), shape=(e.n, e.n))
        graph = sp.block_array(
            [
                [merge @ coupling @ merge.T, merge @ constraints.T],
                [constraints @ merge.T, None if not e.m else sp.csc_array((e.m, e.m))],
            ]
        )
        labels = connected_components(graph, directed=False)[1]
        columns, rows = labels[nodes], labels[e.n :]
        groups = []
        for label in np.unique(columns):
            (q,), (g,) = np.nonzero(columns == label), np.nonzero(rows == label)
            groups.append((self.select(q, g), q))
        return groups

    def select(self, q: Array, g: Array) -> LinearizedEquations:
        """Return the equations of the coordinates `q` and the constraints `g`."""
        e, tangent = self.equations, self.tangent
        equations = CoordinateSubset(
            tuple(e.q_names[k] for k in q),
            e.position_scales[q],
            np.flatnonzero(np.isin(q, e.states)),
            np.flatnonzero(np.isin(g, e.nonholonomic_rows)),
            len(g),
        )
        part = Tangent(
            mass=tangent.mass[q][:, q],
            damping=tangent.damping[q][:, q],
            stiffness=tangent.stiffness[q][:, q],
            reactions=tangent.reactions[q][:, g],
            position_jacobian=tangent.position_jacobian[g][:, q],
            velocity_jacobian=tangent.velocity_jacobian[g][:, q],
            residual=tangent.residual[np.append(q, e.n + g)],
            compliance=None if tangent.compliance is None else tangent.compliance[g],
        )
        return replace(self, equations=equations, tangent=part)
