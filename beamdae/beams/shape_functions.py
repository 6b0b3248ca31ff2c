"""Lagrange shape functions, and Gauss quadrature."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache

import casadi as ca
import numpy as np

Array = np.ndarray

MAX_EQUIDISTANT_NODES = 4


def shape_functions(nodes: int, xi: Array, derivative: int = 0) -> Array:
    """Return the Lagrange shape functions, or their derivatives, at local coordinates `xi`.

    Parameters
    ----------
    nodes
        Number of nodes, see `node_positions`.
    xi
        Local coordinates (n,).
    derivative
        Order of the derivative with respect to xi.

    Returns
    -------
    ndarray
        Values, shape (n, nodes).
    """
    at = np.asarray(xi, float)[..., None]
    values = np.zeros((*at.shape[:-1], nodes))
    for coefficients in _shape_function_coefficients(nodes, derivative):
        values = values * at + coefficients
    return values


def weigh_nodes(first: int, rows: Sequence[Array], above: Array | None = None) -> ca.DM:
    """Return the matrix that interpolates the three coordinates of nodes at a point.

    The coordinates of the first node have the indices `first`, `first + 1` and `first + 2`. Each of
    the `rows` of weights of the nodes yields three rows of the matrix, below the rows `above`.
    """
    blocks = [np.pad(np.kron(row, np.eye(3)), ((0, 0), (first, 0))) for row in rows]
    return ca.sparsify(ca.DM(np.vstack(blocks if above is None else [above, *blocks])))


def lagrange_weights(points: Array, xi: float) -> tuple[float, ...]:
    """Return the weights that interpolate values at `points` to `xi` by Lagrange's polynomial."""
    return _lagrange_weights(points.tobytes(), float(xi))


# Runs of a model with other numbers have the same sections.
@lru_cache(maxsize=1024)
def _lagrange_weights(points_bytes: bytes, xi: float) -> tuple[float, ...]:
    points = np.frombuffer(points_bytes)
    return tuple(
        float(np.prod((xi - (x := np.delete(points, k))) / (points[k] - x)))
        for k in range(len(points))
    )


@cache
def node_positions(nodes: int) -> Array:
    """Return the nodes of an element on [-1, 1], as a read-only shared array.

    Up to 4 nodes are equidistant, as in the paper; more are Gauss-Lobatto points, between which
    polynomials do not oscillate.
    """
    positions = np.linspace(-1.0, 1.0, nodes)
    if nodes > MAX_EQUIDISTANT_NODES:
        inner = np.asarray(np.polynomial.Legendre.basis(nodes - 1).deriv().roots(), float)
        positions[1:-1] = 0.5 * (inner - inner[::-1])  # symmetric up to the last bit
    positions.setflags(write=False)
    return positions


@cache
def gauss_points(count: int) -> tuple[Array, Array]:
    """Return Gauss points on [-1, 1] and their weights, as read-only shared arrays."""
    points, weights = np.polynomial.legendre.leggauss(count)
    for array in (points, weights):
        array.setflags(write=False)
    return points, weights


@cache
def _shape_function_coefficients(nodes: int, derivative: int) -> Array:
    """Return the polynomial coefficients, highest power first, one column per shape function."""
    columns, positions = [], node_positions(nodes)
    for i in range(nodes):
        others = np.delete(positions, i)
        polynomial = np.poly(others) / np.prod(positions[i] - others)
        columns.append(np.polyder(polynomial, derivative))
    return np.stack(columns, axis=-1)
