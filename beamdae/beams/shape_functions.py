"""Lagrange shape functions on equidistant nodes (eq. 12)."""

from __future__ import annotations

from functools import cache

import numpy as np


def shape_functions(nodes: int, xi: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Shape functions of `nodes` nodes on [-1, 1], or a derivative, shape (len(xi), nodes)."""
    polynomials = _polynomials(nodes, derivative)
    return np.stack([np.polyval(polynomial, xi) for polynomial in polynomials], axis=-1)


@cache
def _polynomials(nodes: int, derivative: int) -> list[np.ndarray]:
    at = np.linspace(-1.0, 1.0, nodes)
    found = []
    for i in range(nodes):
        others = np.delete(at, i)
        polynomial = np.poly(others) / np.prod(at[i] - others)
        found.append(np.polyder(polynomial, derivative))
    return found
