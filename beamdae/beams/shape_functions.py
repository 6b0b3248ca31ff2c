"""Lagrange shape functions on equidistant nodes (eq. 12), and where they are integrated."""

from __future__ import annotations

from functools import cache

import numpy as np

Array = np.ndarray


def shape_functions(nodes: int, xi: Array, derivative: int = 0) -> Array:
    """Shape functions of `nodes` nodes on [-1, 1], or a derivative, shape (len(xi), nodes)."""
    at = np.asarray(xi, float)[..., None]
    values = np.zeros((*at.shape[:-1], nodes))
    for coefficients in _shape_function_coefficients(nodes, derivative):
        values = values * at + coefficients
    return values


def lagrange_weights(points: Array, xi: float) -> list[float]:
    """What a value at `xi` has of those at `points`: Lagrange's polynomial through them."""
    return [
        float(np.prod((xi - (x := np.delete(points, k))) / (points[k] - x)))
        for k in range(len(points))
    ]


@cache
def gauss_points(count: int) -> tuple[Array, Array]:
    """Gauss points on [-1, 1] and their weights; shared, not to be changed."""
    points, weights = np.polynomial.legendre.leggauss(count)
    for shared in (points, weights):
        shared.setflags(write=False)
    return points, weights


@cache
def _shape_function_coefficients(nodes: int, derivative: int) -> Array:
    """Coefficients of all shape functions, a column each, of the highest power first."""
    at = np.linspace(-1.0, 1.0, nodes)
    found = []
    for i in range(nodes):
        others = np.delete(at, i)
        polynomial = np.poly(others) / np.prod(at[i] - others)
        found.append(np.polyder(polynomial, derivative))
    return np.stack(found, axis=-1)
