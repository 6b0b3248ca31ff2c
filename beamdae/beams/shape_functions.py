"""Lagrange shape functions on equidistant nodes (eq. 12)."""

from __future__ import annotations

import numpy as np


def shape_functions(nodes: int, xi: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Shape functions of `nodes` nodes on [-1, 1], or a derivative, shape (len(xi), nodes)."""
    at = np.linspace(-1.0, 1.0, nodes)
    columns = []
    for i in range(nodes):
        others = np.delete(at, i)
        polynomial = np.poly(others) / np.prod(at[i] - others)
        columns.append(np.polyval(np.polyder(polynomial, derivative), xi))
    return np.stack(columns, axis=-1)
