"""Linearized equations as the eigenvalue solvers need them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from beamdae.equations.equations_of_motion import PartCoordinates
from beamdae.equations.formulations.tangents import LinearizedCoordinates, Tangent

Array = np.ndarray


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
    """Linearized equations M x'' + C x' + K x + H mu = 0, J x + V x' = 0.

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
            groups.append((self._select(q, g), q))
        return groups

    def _select(self, q: Array, g: Array) -> LinearizedEquations:
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
        )
        return replace(self, equations=equations, tangent=part)
