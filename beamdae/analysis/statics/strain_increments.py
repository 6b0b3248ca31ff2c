"""Finite displacements of beams along which strains and section angles are linear.

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
from typing import NamedTuple

import numpy as np

from beamdae.beams.kinematics import LocalAxis
from beamdae.beams.shape_functions import gauss_points, shape_functions
from beamdae.bounded_cache import array_bytes, bounded_cache
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.native.loop_functions import accumulate, combine, multiply, rotate, scatter

Array = np.ndarray

# Beams in a chord frame move linearly if their chord is shorter than this fraction of the
# undeformed one.
_MIN_CHORD_RATIO = 0.1
# Memory of the cached maps [bytes]: about 5 kB per element of a beam.
_MAX_CACHED_BYTES = 16 * 2**20


def _smallest_turn(angle: float) -> float:
    """Return the angle up to full turns, from -pi to pi [rad]."""
    return float(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)


class AxisPlan(NamedTuple):
    """Constant maps of beams whose nodes have absolute positions and section angles.

    Sparse maps are out[rows] += weights * vector[columns].

    Attributes
    ----------
    rows, weights, columns
        Map of coordinates to section angles, x' and y' at all Gauss points, (3 points,).
    step_rows, step_weights, step_columns
        Map of x' and y' to the steps from each node to the next one, (2 points,).
    targets, sources
        Coordinates of the nodes at the end and at the beginning of each step, along the beams.
    """

    rows: Array
    weights: Array
    columns: Array
    step_rows: Array
    step_weights: Array
    step_columns: Array
    targets: Array
    sources: Array


@dataclass(slots=True)
class AxisElements:
    """Beams whose nodes have absolute positions and section angles.

    Attributes
    ----------
    plan
        Constant maps.
    values, changes
        Section angles, x' and y' at all Gauss points, and their changes.
    slopes, product, steps
        Changed x' and y', products with angles, and steps between nodes.
    """

    plan: AxisPlan
    values: Array
    changes: Array
    slopes: Array
    product: Array
    steps: Array

    @classmethod
    def of(cls, beams: Sequence[Array]) -> AxisElements:
        """Return the elements of beams with these coordinates, see `Part.axis_nodes`."""
        plan = _plan_axes(tuple((beam.shape, beam.astype(int).tobytes()) for beam in beams))
        count = len(plan.targets) // 2
        sizes = (3 * count, 3 * count, 2 * count, count, 2 * count)
        return cls(plan, *map(np.zeros, sizes))


@bounded_cache(_MAX_CACHED_BYTES, array_bytes)
def _plan_axes(beams: tuple[tuple[tuple[int, ...], bytes], ...]) -> AxisPlan:
    """Return the maps of beams with these coordinates: shapes and contents of arrays."""
    nodes = [np.frombuffer(content, int).reshape(shape) for shape, content in beams]
    # Elements have as many Gauss points as steps between nodes.
    counts = [len(beam) * (beam.shape[1] - 1) for beam in nodes]
    offsets, begin = sum(counts) * np.arange(3)[:, None, None, None], 0
    maps: list[tuple[Array, ...]] = [(np.zeros(0),) * 3]
    step_maps: list[tuple[Array, ...]] = [(np.zeros(0),) * 3]
    ends = [np.zeros((2, 2, 0))]
    for beam, count in zip(nodes, counts, strict=True):
        degree = beam.shape[1] - 1
        points = begin + np.arange(count).reshape(-1, degree)
        values, slopes = (shape_functions(degree + 1, gauss_points(degree)[0], k) for k in (0, 1))
        x, y, psi = np.moveaxis(beam, -1, 0)
        at = offsets + points[:, :, None]
        weights, columns = np.stack([values, slopes, slopes]), np.stack([psi, x, y])
        maps.append(_broadcast(at, weights[:, None], columns[:, :, None]))
        # A position is determined by its derivative and its first node, which stays in place.
        steps = np.diff(np.linalg.inv(slopes[:, 1:]), axis=0, prepend=0.0)
        step_maps.append(_broadcast(at[:2], steps, (offsets + points[:, None])[:2]))
        ends.append(np.stack([[z[:, 1:], z[:, :-1]] for z in (x, y)], axis=1).reshape(2, 2, -1))
        begin += count
    targets, sources = np.concatenate(ends, axis=2).reshape(2, -1).astype(np.uint32)
    rows, weights, columns = map(np.concatenate, zip(*maps, strict=True))
    step_rows, step_weights, step_columns = map(np.concatenate, zip(*step_maps, strict=True))
    return AxisPlan(
        rows.astype(np.uint32),
        weights,
        columns.astype(np.uint32),
        step_rows.astype(np.uint32),
        step_weights,
        step_columns.astype(np.uint32),
        targets,
        sources,
    )


def _broadcast(*arrays: Array) -> tuple[Array, ...]:
    """Return arrays with a common shape, flattened."""
    return tuple(array.ravel() for array in np.broadcast_arrays(*arrays))


def displace_axes(axes: AxisElements, q: Array, change: Array, result: Array) -> None:
    """Replace the positions in `result` by their displacements from `q` by a finite `change`.

    `result` is a copy of `change` before. Displacements, not positions, are integrated, so that a
    change of zero moves nothing, and rounding errors do not add up along a beam.
    """
    plan, values, changes, slopes = axes.plan, axes.values, axes.changes, axes.slopes
    count, product = axes.product.size, axes.product
    scatter(values, plan.rows, plan.weights, q, plan.columns)
    scatter(changes, plan.rows, plan.weights, change, plan.columns)
    turn, x, y = changes[:count], values[count : 2 * count], values[2 * count :]
    multiply(product, turn, y)
    combine(slopes[:count], (1.0, 1.0, 1.0), (x, changes[count : 2 * count], product))
    multiply(product, turn, x)
    combine(slopes[count:], (1.0, 1.0, -1.0), (y, changes[2 * count :], product))
    rotate(slopes[:count], slopes[count:], turn)
    combine(slopes, (1.0, -1.0), (slopes, values[count:]))
    _place_nodes(axes, result)


def restore_axes(axes: AxisElements, q: Array, other: Array, result: Array) -> None:
    """Replace the positions in `result` by the `change` that `displace_axes` maps to `other`.

    `result` is other - q before.
    """
    plan, values, changes, slopes = axes.plan, axes.values, axes.changes, axes.slopes
    count, product = axes.product.size, axes.product
    scatter(changes, plan.rows, plan.weights, result, plan.columns)
    turn = axes.steps[:count]
    combine(turn, (-1.0,), (changes[:count],))
    scatter(values, plan.rows, plan.weights, other, plan.columns)
    combine(slopes, (1.0,), (values[count:],))
    rotate(slopes[:count], slopes[count:], turn)
    scatter(values, plan.rows, plan.weights, q, plan.columns)
    x, y = values[count : 2 * count], values[2 * count :]
    multiply(product, turn, y)
    combine(slopes[:count], (1.0, -1.0, 1.0), (slopes[:count], x, product))
    multiply(product, turn, x)
    combine(slopes[count:], (1.0, -1.0, -1.0), (slopes[count:], y, product))
    _place_nodes(axes, result)


def _place_nodes(axes: AxisElements, result: Array) -> None:
    """Set displacements of nodes, which continue that of the first node of each beam."""
    plan = axes.plan
    scatter(axes.steps, plan.step_rows, plan.step_weights, axes.slopes, plan.step_columns)
    accumulate(result, plan.targets, plan.sources, axes.steps)


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
    """Finite displacements of a mechanism; only beams with exact strains move nonlinearly.

    Attributes
    ----------
    axes
        Beams whose nodes have absolute positions.
    frame_axes
        Beams in a floating frame.
    """

    axes: AxisElements
    frame_axes: tuple[FrameAxis, ...]

    @classmethod
    def of(cls, e: EquationsOfMotion) -> StrainIncrements:
        """Return the displacements of the mechanism of these equations."""
        rows = {part.name: part.rows for part in e.parts}
        beams, frame_axes = [], []
        for statement in e.statements:
            axis, nodes = statement.part.local_axis, statement.part.axis_nodes
            if axis is not None:
                frame_axes.append(FrameAxis.of(axis, rows[statement.part.name].start))
            if len(nodes):
                beams.append(nodes + rows[statement.part.name].start)
        return cls(AxisElements.of(beams), tuple(frame_axes))

    def displace(self, x: Array, change: Array) -> Array:
        """Return x = (q, ...) displaced by a finite `change`; x + `change` to first order."""
        result = change.copy()
        displace_axes(self.axes, x, change, result)
        result += x
        self.displace_frames(x, change, result)
        return result

    def displace_frames(self, x: Array, change: Array, result: Array) -> None:
        """Replace the coordinates of beams in a floating frame in `result`, see `displace`."""
        for axis in self.frame_axes:
            axis.displace(x, change, result)

    def difference(self, x: Array, other: Array) -> Array:
        """Return the change with which `displace` moves `x` to `other`."""
        result = other - x
        restore_axes(self.axes, x, other, result)
        for axis in self.frame_axes:
            axis.difference(x, other, result)
        return result
