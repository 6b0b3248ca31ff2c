"""Finite displacements of beams along which strains and section angles, not positions, are linear.

A displacement that is linear in the positions of nodes stretches a bent beam by the square of its
rotation. The axial force of this stretch is (length / height)^2 times larger than that of bending,
so that Newton's method in positions needs more and shorter steps the thinner a beam is. The cure is
to let strains change linearly, as in mixed formulations (D. Magisano, L. Leonetti & G. Garcea, Int.
J. Numer. Methods Eng. 109 (2017) 1237). Here, it is applied to the positions alone: r' = dr/dxi at
the Gauss points of an element determines the positions of its nodes, and

    r' <- R(dpsi) (r' + dr' - dpsi J r'),

with the increments dr' and dpsi of Newton's method, the rotation R and J r' = (-r'_y, r'_x). This
agrees with r' + dr' to first order, and adds exactly the linear increments of the strains. Beams
with exact strains in a floating frame have the same increments, with the derivatives in this frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from beamdae.beams.kinematics import LocalAxis
from beamdae.beams.shape_functions import gauss_points, shape_functions
from beamdae.equations.equations_of_motion import EquationsOfMotion

Array = np.ndarray


# Beams in a chord frame move linearly if their chord is shorter than this fraction of the
# undeformed one.
_MIN_CHORD_RATIO = 0.1


def _smallest_turn(angle: float) -> float:
    """Return the angle up to full turns, from -pi to pi [rad]."""
    return float(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)


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
class FrameAxis:
    """Axis of a beam with exact strains in a floating frame, see `LocalAxis`.

    Attributes
    ----------
    axis
        Axis of the beam.
    first
        Index of the first coordinate of the beam.
    inverses
        Inverses of the slopes without the first node, (elements, nodes - 1, nodes - 1).
    undeformed
        w of the end of the beam for z = 1 at the Gauss points, minus w for z = 0.
    """

    axis: LocalAxis
    first: int
    inverses: Array
    undeformed: complex

    @classmethod
    def of(cls, axis: LocalAxis, first: int) -> FrameAxis:
        """Return the axis of a beam whose first coordinate has this index."""
        frame_axis = cls(axis, first, np.linalg.inv(axis.slopes[:, :, 1:]), 0j)
        ones = np.ones(axis.slopes.shape[:2], complex)
        return replace(frame_axis, undeformed=frame_axis._integrate(ones)[-1])

    def displace(self, q: Array, change: Array, result: Array) -> None:
        """Replace the coordinates in `result` by those displaced from `q` by a finite `change`."""
        w, phi = self._nodal(q)
        dw, dphi = self._nodal(change)
        z, dz, turn = 1.0 + self._derivative(w), self._derivative(dw), self._at_points(dphi)
        if self._has_short_chord(z):
            return
        z = np.exp(1j * turn) * (z + dz - 1j * turn * z)
        angle, direction = 0.0, self.axis.end_direction
        if direction is not None:
            # The frame turns by an angle such that the end remains on the chord.
            end = direction * self._integrate(z)[-1]
            sine = (direction * self.undeformed).imag / abs(end)
            angle = float(np.angle(end)) - float(np.arcsin(np.clip(sine, -1.0, 1.0)))
            # The end may be on either side of the start.
            other = 2.0 * float(np.angle(end)) - np.pi - angle
            angle = min((_smallest_turn(each) for each in (angle, other)), key=abs)
            z = np.exp(-1j * angle) * z
            result[self.first + self.axis.frame_angle] += angle
        self._set_nodal(result, self._integrate(z - 1.0), phi + dphi - angle)

    def difference(self, q: Array, other: Array, result: Array) -> None:
        """Replace the changes in `result` by those with which `displace` gives `other`."""
        (w, phi), (other_w, other_phi) = self._nodal(q), self._nodal(other)
        z, other_z = (1.0 + self._derivative(each) for each in (w, other_w))
        if self._has_short_chord(z):
            return
        turn = self._at_points(other_phi - phi)
        dz, angle = np.exp(-1j * turn) * other_z - z + 1j * turn * z, 0.0
        direction = self.axis.end_direction
        if direction is not None:
            ends = [direction * self._integrate(each)[-1] for each in (dz, 1j * z)]
            angle = -ends[0].imag / ends[1].imag
            dz = dz + 1j * angle * z
            result[self.first + self.axis.frame_angle] -= angle
        self._set_nodal(result, self._integrate(dz), other_phi - phi + angle)

    def _has_short_chord(self, z: Array) -> bool:
        """Return True if the ends are so close that the direction of the chord is sensitive."""
        if self.axis.end_direction is None:
            return False
        return abs(self._integrate(z)[-1]) < _MIN_CHORD_RATIO * abs(self.undeformed)

    def _nodal(self, q: Array) -> tuple[Array, Array]:
        """Return w and phi of all nodes."""
        nodal = self.axis.factors * q[self.first + self.axis.coordinates]
        return nodal[:, 0] + 1j * nodal[:, 1], nodal[:, 2]

    def _derivative(self, w: Array) -> Array:
        """Return the derivatives of the displacement at the Gauss points, (elements, points)."""
        axis = self.axis
        return np.einsum("epn,en->ep", axis.slopes, axis.kinks * w[axis.nodes])

    def _at_points(self, phi: Array) -> Array:
        return phi[self.axis.nodes] @ self.axis.values.T

    def _integrate(self, derivative: Array) -> Array:
        """Return w of all nodes from derivatives at the Gauss points; w is zero at the start."""
        axis = self.axis
        w = np.zeros(len(axis.coordinates), complex)
        for nodes, kinks, slopes, inverse, z in zip(
            axis.nodes, axis.kinks, axis.slopes, self.inverses, derivative, strict=True
        ):
            others = inverse @ (z - slopes[:, 0] * (kinks[0] * w[nodes[0]]))
            w[nodes[1:]] = others / kinks[1:]
        return w

    def _set_nodal(self, result: Array, w: Array, phi: Array) -> None:
        axis = self.axis
        nodal = np.stack([w.real, w.imag, phi], axis=1)
        is_free = axis.factors == 1.0
        result[self.first + axis.coordinates[is_free]] = nodal[is_free]
        if axis.end_direction is not None:
            chord = (axis.end_direction * w[-1]).real
            result[self.first + axis.coordinates[-1, 0]] = chord


@dataclass(frozen=True)
class StrainIncrements:
    """Finite displacements of a mechanism; only beams with exact strains move nonlinearly."""

    groups: tuple[AxisElements | FrameAxis, ...]

    @classmethod
    def of(cls, e: EquationsOfMotion) -> StrainIncrements:
        """Return the displacements of the mechanism of these equations."""
        rows = {part.name: part.rows for part in e.parts}
        by_degree: dict[int, list[Array]] = {}
        frame_axes = []
        for statement in e.statements:
            axis = statement.part.local_axis
            if axis is not None:
                frame_axes.append(FrameAxis.of(axis, rows[statement.part.name].start))
            nodes = statement.part.axis_nodes
            if len(nodes):
                first = rows[statement.part.name].start
                by_degree.setdefault(nodes.shape[1], []).append(nodes + first)
        return cls((*(AxisElements.of(beams) for beams in by_degree.values()), *frame_axes))

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
