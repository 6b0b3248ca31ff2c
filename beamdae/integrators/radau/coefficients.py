"""Three-stage Radau IIA of order 5, and the basis in which its stages are solved for.

The inverse of A has a real eigenvalue gamma and a pair alpha +- i beta: in W, with Y - y = T W and
h Y' = A^-1 T W, Newton's equations for the stages fall apart into real ones, with the matrix
R_y + (gamma/h) R_y', and complex ones, with alpha + i beta in place of gamma.
Hairer & Wanner, Solving ODEs II, 1996, section IV.8.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

# Nodes, and the weights that integrate polynomials of degree 2 through them exactly.
C = np.array([4.0 - np.sqrt(6.0), 4.0 + np.sqrt(6.0), 10.0]) / 10.0
_EXPONENTS = np.array([1.0, 2.0, 3.0])
_POWERS = C[:, None] ** _EXPONENTS
A = (_POWERS / _EXPONENTS) @ np.linalg.inv(_POWERS / C[:, None])


def _decouple_stages() -> tuple[float, complex, Array]:
    """gamma, alpha + i beta and T; the columns of T end in 1, 1 and 0."""
    values, vectors = np.linalg.eig(np.linalg.inv(A))
    real, pair = np.argmin(np.abs(values.imag)), np.argmax(values.imag)
    x, z = (vectors[:, k] / vectors[-1, k] for k in (real, pair))
    basis = np.stack([x.real, z.real, -z.imag], axis=1)
    return float(values[real].real), complex(values[pair]), basis


REAL_EIGENVALUE, COMPLEX_EIGENVALUE, T = _decouple_stages()
T_INVERSE = np.linalg.inv(T)
# What the complex equations are of: w_1 + i w_2.
TO_PAIR = T_INVERSE[1] + 1j * T_INVERSE[2]
# h Y' = RATES W.
RATES = np.linalg.solve(A, T)
# W of stages that go on with a constant y', over h y'.
UNIFORM = T_INVERSE @ C
# Coefficients of the polynomial through the stages, without its constant, are POLYNOMIAL W.
POLYNOMIAL = np.linalg.solve(_POWERS, T)
# h sum_i (b^_i - b_i) Y'_i of the method of order 3 that gives y'_n the weight 1 / gamma.
EMBEDDED = np.linalg.solve((_POWERS / C[:, None]).T, [-1.0 / REAL_EIGENVALUE, 0.0, 0.0]) @ RATES
