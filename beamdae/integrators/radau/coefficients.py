"""Coefficients of three-stage Radau IIA (order 5), and the basis that decouples its stages.

The inverse of A has a real eigenvalue gamma and a complex pair alpha +- i beta. In terms of W, with
Y - y = T W and h Y' = A^-1 T W, Newton's equations for the stages decouple into real equations with
the matrix R_y + (gamma/h) R_y' and complex equations with alpha + i beta in place of gamma.
Hairer & Wanner, Solving ODEs II, 1996, section IV.8.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

# Nodes c and collocation matrix A, exact for polynomials of degree 2.
C = np.array([4.0 - np.sqrt(6.0), 4.0 + np.sqrt(6.0), 10.0]) / 10.0
_EXPONENTS = np.array([1.0, 2.0, 3.0])
_POWERS = C[:, None] ** _EXPONENTS
A = (_POWERS / _EXPONENTS) @ np.linalg.inv(_POWERS / C[:, None])


def _decouple_stages() -> tuple[float, complex, Array]:
    """Return gamma, alpha + i beta, and T, whose columns end in 1, 1 and 0."""
    values, vectors = np.linalg.eig(np.linalg.inv(A))
    real, upper = np.argmin(np.abs(values.imag)), np.argmax(values.imag)
    x, z = (vectors[:, k] / vectors[-1, k] for k in (real, upper))
    basis = np.stack([x.real, z.real, -z.imag], axis=1)
    return float(values[real].real), complex(values[upper]), basis


REAL_EIGENVALUE, COMPLEX_EIGENVALUE, T = _decouple_stages()
T_INVERSE = np.linalg.inv(T)
# Maps stages to the complex unknown w_1 + i w_2.
TO_COMPLEX = T_INVERSE[1] + 1j * T_INVERSE[2]
# h Y' = RATES W.
RATES = np.linalg.solve(A, T)
# W / (h y') for stages with a constant y'.
UNIFORM = T_INVERSE @ C
# POLYNOMIAL W contains the coefficients of the collocation polynomial, except the constant.
POLYNOMIAL = np.linalg.solve(_POWERS, T)
# EMBEDDED W = h sum_i (b^_i - b_i) Y'_i for the third-order method with the weight 1 / gamma of
# y'_n.
EMBEDDED = np.linalg.solve((_POWERS / C[:, None]).T, [-1.0 / REAL_EIGENVALUE, 0.0, 0.0]) @ RATES
