"""Finite displacements of beams along which strains and section angles, not positions, are linear.

A displacement that is linear in the positions of nodes stretches a bent beam by the square of its
rotation. The axial force of this stretch is (length / height)^2 times larger than that of bending,
so that Newton's method in positions needs more and shorter steps the thinner a beam is. The cure is
to let strains change linearly, as in mixed formulations (D. Magisano, L. Leonetti & G. Garcea, Int.
J. Numer. Methods Eng. 109 (2017) 1237). Here, it is applied to the positions alone: r' = dr/dxi at
the Gauss points of an element determines the positions of its nodes, and

    r' <- R(dpsi) (r' + dr' - dpsi J r'),

with the increments dr' and dpsi of Newton's method, the rotation R and J r' = (-r'_y, r'_x). This
agrees with r' + dr' to first order, and adds exactly the linear increments of the strains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beamdae.beams.shape_functions import gauss_points, shape_functions
from beamdae.equations.equations_of_motion import EquationsOfMotion

Array = np.ndarray


@dataclass(frozen=True)
class AxisElements:
    """Elements of equal degree whose nodes have absolute positions and section angles.

    Attributes
    ----------
    x, y, psi
        Indices of the coordinates of the nodes, (elements, nodes) each.
    first
        Index of the first element of the beam to which each element belongs, (elements,).
    values, slopes
        Shape functions and their derivatives at the Gauss points, (nodes - 1, nodes).
    integrals
        Integrals from the first node to each node of a polynomial with given values at the Gauss
        points, (nodes, nodes - 1).
    """

    x: Array
    y: Array
    psi: Array
    first: Array
    values: Array
    slopes: Array
    integrals: Array

    @classmethod
    def of(cls, beams: Sequence[Array]) -> AxisElements:
        """Return the elements of beams with these coordinates, see `Part.axis_nodes`."""
        x, y, psi = np.moveaxis(np.concatenate(beams), -1, 0)
        counts = [len(beam) for beam in beams]
        first = np.repeat(np.cumsum(counts) - counts, counts)
        nodes = x.shape[1]
        points = gauss_points(nodes - 1)[0]
        values, slopes = (shape_functions(nodes, points, k) for k in (0, 1))
        # A position is determined by its derivative and its first node, which stays in place.
        integrals = np.vstack([np.zeros(nodes - 1), np.linalg.inv(slopes[:, 1:])])
        return cls(x, y, psi, first, values, slopes, integrals)

    def displace(self, q: Array, change: Array, result: Array) -> None:
        """Replace the positions in `result` by those displaced from `q` by a finite `change`."""
        turn = change[self.psi] @ self.values.T
        slope, slope_change = ((z[self.x] + 1j * z[self.y]) @ self.slopes.T for z in (q, change))
        self._integrate(np.exp(1j * turn) * (slope + slope_change - 1j * turn * slope), result)

    def difference(self, q: Array, other: Array, result: Array) -> None:
        """Replace the positions in `result` by the `change` with which `displace` gives `other`."""
        turn = (other - q)[self.psi] @ self.values.T
        slope, other_slope = ((z[self.x] + 1j * z[self.y]) @ self.slopes.T for z in (q, other))
        self._integrate(np.exp(-1j * turn) * other_slope - slope + 1j * turn * slope, result)

    def _integrate(self, slopes: Array, result: Array) -> None:
        """Set the positions of nodes, which continue those of the first node of each beam."""
        along = slopes @ self.integrals.T
        ends = np.cumsum(along[:, -1])
        begins = ends - along[:, -1]
        start = result[self.x[self.first, 0]] + 1j * result[self.y[self.first, 0]]
        position = along + (start + begins - begins[self.first])[:, None]
        result[self.x], result[self.y] = position.real, position.imag


@dataclass(frozen=True)
class StrainIncrements:
    """Finite displacements of a mechanism; bodies other than exact beams move linearly."""

    groups: tuple[AxisElements, ...]

    @classmethod
    def of(cls, e: EquationsOfMotion) -> StrainIncrements:
        """Return the displacements of the mechanism of these equations."""
        rows = {part.name: part.rows for part in e.parts}
        by_degree: dict[int, list[Array]] = {}
        for statement in e.statements:
            nodes = statement.part.axis_nodes
            if len(nodes):
                first = rows[statement.part.name].start
                by_degree.setdefault(nodes.shape[1], []).append(nodes + first)
        return cls(tuple(AxisElements.of(beams) for beams in by_degree.values()))

    def displace(self, x: Array, change: Array) -> Array:
        """Return x = (q, ...) displaced by a finite `change`; x + `change` to first order."""
        result = x + change
        for group in self.groups:
            group.displace(x, change, result)
        return result

    def difference(self, x: Array, other: Array) -> Array:
        """Return the change with which `displace` moves `x` to `other`."""
        result = other - x
        for group in self.groups:
            group.difference(x, other, result)
        return result
