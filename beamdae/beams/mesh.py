"""The numbers of a beam's mesh: nodes on its curve, quadrature data, nodal operators."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from beamdae.beams.floating_frame_element import FRAME, NODE, ElementType, shape_functions
from beamdae.curves.plane_curves import PlaneCurve, turned

Array = np.ndarray


class MeshError(ValueError):
    """A mesh that cannot be made; the beam says which."""


@dataclass(frozen=True)
class Mesh:
    """`elements` elements of one type on a curve, in the floating frame `frame`.

    Parameters
    ----------
    curve
        The reference curve.
    kind
        Element type.
    elements
        Number of elements, of equal arc length.
    shape
        "curved": each element interpolates the curve through its nodes (eq. 13); "straight":
        each element is the chord between its end nodes.
    continuity
        "cartesian": neighboring elements share the displacement vector at their node; "local":
        its components along and across either axis (the paper's).
    frame
        "tangent": the floating frame rides on the start section (start node clamped to it);
        "chord": it runs from the start point to the end point.
    """

    curve: PlaneCurve
    kind: ElementType
    elements: int
    shape: str
    continuity: str
    frame: str

    @cached_property
    def origin(self) -> Array:
        """Reference position of the frame's origin, the start point, shape (2,)."""
        return np.asarray(self.curve.point(0.0), float)

    @cached_property
    def frame_angle(self) -> float:
        """Reference angle of the floating frame [rad]."""
        if self.frame == "tangent":
            return float(self.curve.tangent_angle(0.0))
        chord = self.curve.point(self.curve.length) - self.origin
        if np.hypot(*chord) < 1e-6 * self.curve.length:
            raise MeshError(
                "frame 'chord' needs a curve whose ends lie apart, use frame='tangent' for a ring"
            )
        return float(np.arctan2(chord[1], chord[0]))

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return self.elements * (self.kind.nodes - 1) + 1

    def _element_nodes(self) -> Array:
        """Node numbers of each element, shape (elements, nodes)."""
        step = self.kind.nodes - 1
        return step * np.arange(self.elements)[:, None] + np.arange(self.kind.nodes)

    @cached_property
    def node_arc_lengths(self) -> Array:
        """Arc length of each node [m]."""
        return np.linspace(0.0, self.curve.length, self.node_count)

    @cached_property
    def node_points(self) -> Array:
        """Nodes of each element in the floating frame, shape (elements, nodes, 2)."""
        there = self.curve.point(self.node_arc_lengths) - self.origin
        points = turned(there, -self.frame_angle)[self._element_nodes()]
        if self.shape == "straight":
            share = np.linspace(0.0, 1.0, self.kind.nodes)[:, None]
            points = points[:, :1] + share * (points[:, -1:] - points[:, :1])
        return points

    def axis(self, element: Array, xi: Array) -> tuple[Array, Array, Array, Array]:
        """Point (n, 2), angle, curvature and ds/dxi (n,) of the interpolated axis (eqs. 2, 13, 14).

        In the floating frame, at the local coordinates `xi` of the elements `element`.
        """
        nodes = self.node_points[element]
        at, d1, d2 = (
            np.einsum("ei,eik->ek", shape_functions(self.kind.nodes, xi, k), nodes)
            for k in range(3)
        )
        ds = np.hypot(d1[:, 0], d1[:, 1])
        curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / ds**3
        s = (element + 0.5 * (xi + 1.0)) * self.curve.length / self.elements
        smooth = self.curve.tangent_angle(s) - self.frame_angle
        angle = np.arctan2(d1[:, 1], d1[:, 0])
        angle = angle + 2.0 * np.pi * np.round((smooth - angle) / (2.0 * np.pi))
        return at, angle, curvature, ds

    def quadrature_data(self, section: Array, gravity: Array) -> Array:
        """Data columns of the element kernel, shape (n_data, elements)."""
        return np.concatenate(
            [
                self._point_data(self.kind.mass_quadrature, self._mass_columns),
                self._point_data(self.kind.quadrature, self._stiffness_columns),
                np.repeat(np.concatenate([section, gravity])[:, None], self.elements, axis=1),
            ]
        )

    def _point_data(self, points: int, columns: Callable[..., list[Array]]) -> Array:
        xi, weights = np.polynomial.legendre.leggauss(points)
        element = np.repeat(np.arange(self.elements), points)
        values = columns(element, np.tile(xi, self.elements), np.tile(weights, self.elements))
        return np.stack(values, axis=-1).reshape(self.elements, -1).T

    def _mass_columns(self, element: Array, xi: Array, weight: Array) -> list[Array]:
        at, angle, _, ds = self.axis(element, xi)
        return [weight * ds, *turned(at, -angle).T, np.cos(angle), np.sin(angle)]

    def _stiffness_columns(self, element: Array, xi: Array, weight: Array) -> list[Array]:
        _, _, curvature, ds = self.axis(element, xi)
        return [weight * ds, curvature, 1.0 / ds]

    @cached_property
    def coordinates(self) -> sp.csr_array:
        """From the beam's coordinates (x0, y0, theta, free nodal ones) to the elements' local ones.

        Shape (elements * kind.size, 3 + free). Nodal coordinates are (u, v, phi) in the tangent
        frame of the curve at the node. The axes of two neighboring elements meet at a small angle,
        of the order of the cube of their length (of their length for straight ones): with
        "cartesian" continuity each turns the nodal displacement into its own direction there, with
        "local" continuity it is taken over as it is.
        """
        nodes = self._element_nodes()
        element = np.repeat(np.arange(self.elements), self.kind.nodes)
        local = np.tile(np.arange(self.kind.nodes), self.elements)
        node = nodes.ravel()
        turn = self._kink(element, node)
        row = element * self.kind.size + FRAME + NODE * local
        column = NODE * node
        c, s = np.cos(turn), np.sin(turn)
        entries = [(0, 0, c), (0, 1, s), (1, 0, -s), (1, 1, c), (2, 2, np.ones_like(c))]
        rows = np.concatenate([row + i for i, _, _ in entries])
        columns = np.concatenate([column + j for _, j, _ in entries])
        values = np.concatenate([value for _, _, value in entries])
        shape = (self.elements * self.kind.size, NODE * self.node_count)
        nodal = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=shape)) @ self._free
        frame = sp.csr_array(np.tile(np.eye(self.kind.size, FRAME), (self.elements, 1)))
        operator = sp.csr_array(sp.hstack([frame, nodal]))
        operator.eliminate_zeros()
        return operator

    def _kink(self, element: Array, node: Array) -> Array:
        """Angle from the curve's tangent at a node to the element's own axis there."""
        if self.continuity == "local":
            return np.zeros(len(element))
        xi = np.tile(np.linspace(-1.0, 1.0, self.kind.nodes), self.elements)
        tangent = self.curve.tangent_angle(self.node_arc_lengths[node]) - self.frame_angle
        return self.axis(element, xi)[1] - tangent

    @cached_property
    def _free(self) -> sp.csr_array:
        """From the free nodal coordinates to all of them: the conditions of the floating frame."""
        size = NODE * self.node_count
        if self.frame == "tangent":
            return sp.csr_array(sp.eye_array(size, format="csr")[:, NODE:])
        angle = float(self.curve.tangent_angle(self.curve.length)) - self.frame_angle
        along = sp.coo_array(
            ([np.cos(angle), -np.sin(angle)], ([size - 3, size - 2], [0, 0])), shape=(size, 1)
        )
        eye = sp.eye_array(size, format="csr")
        return sp.csr_array(sp.hstack([eye[:, 2 : size - 3], along, eye[:, size - 1 :]]))

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """Names of the free nodal coordinates, in the order of the beam's coordinates."""
        names = [f"{c}{i}" for i in range(self.node_count) for c in ("u", "v", "phi")]
        if self.frame == "tangent":
            return tuple(names[NODE:])
        return (*names[2:-3], "chord", names[-1])

    def locate(self, s: float) -> tuple[int, float]:
        """Element and local coordinate xi of the arc length s [m]."""
        at = s / self.curve.length * self.elements
        element = min(int(at), self.elements - 1)
        xi = 2.0 * (at - element) - 1.0
        return element, float(np.clip(xi, -1.0, 1.0))

    @cached_property
    def errors(self) -> tuple[float, float]:
        """Largest relative error of arc length and largest error of curvature times length.

        Of the elements' interpolated (or straight) axis against the curve: the arc length of an
        element, and the curvature at the stiffness quadrature points.
        """
        xi, weights = np.polynomial.legendre.leggauss(8)
        element = np.repeat(np.arange(self.elements), 8)
        ds = self.axis(element, np.tile(xi, self.elements))[3].reshape(self.elements, 8)
        true = self.curve.length / self.elements
        length_error = float(np.max(np.abs(ds @ weights - true)) / true)
        xi, _ = np.polynomial.legendre.leggauss(self.kind.quadrature)
        element = np.repeat(np.arange(self.elements), self.kind.quadrature)
        xi = np.tile(xi, self.elements)
        s = (element + 0.5 * (xi + 1.0)) * true
        error = np.abs(self.axis(element, xi)[2] - self.curve.curvature(s))
        return length_error, float(error.max() * self.curve.length)
