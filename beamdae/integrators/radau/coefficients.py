"""Coefficients of three-stage Radau IIA (order 5), and the basis that decouples its stages.

The inverse of A has a real eigenvalue gamma and a complex pair alpha +- i beta. In terms of W, with
Y - y = T W and h Y' = A^-1 T W, Newton's equations for the stages decouple into real equations with
the matrix R_y + (gamma/h) R_y' and complex equations with alpha + i beta in place of gamma.
Hairer & Wanner, Solving ODEs II, 1996, section IV.8.

All numbers are evaluated in closed form: LAPACK would round them differently on other processors,
and results would differ between processors.
"""

from __future__ import annotations

import math

import numpy as np

from beamdae.core.tables import Workspace

Array = np.ndarray

_ROOT = math.sqrt(6.0)
# Nodes c, the zeros of M(x) = x^3 - (9 x^2 - 4.5 x + 0.5) / 5, and collocation matrix A, exact for
# polynomials of degree 2.
C = np.array([4.0 - _ROOT, 4.0 + _ROOT, 10.0]) / 10.0
A = np.array(
    [
        [(88.0 - 7.0 * _ROOT) / 360.0, (296.0 - 169.0 * _ROOT) / 1800.0, (3.0 * _ROOT - 2.0) / 225],
        [(296.0 + 169.0 * _ROOT) / 1800.0, (88.0 + 7.0 * _ROOT) / 360.0, -(3 * _ROOT + 2.0) / 225],
        [(16.0 - _ROOT) / 36.0, (16.0 + _ROOT) / 36.0, 1.0 / 9.0],
    ]
)

# Zeros of x^3 - 9 x^2 + 36 x - 60, the characteristic polynomial of A^-1.
_CUBE_ROOT = math.cbrt(3.0)
REAL_EIGENVALUE = 3.0 + _CUBE_ROOT**2 - _CUBE_ROOT
COMPLEX_EIGENVALUE = complex(
    3.0 - 0.5 * (_CUBE_ROOT**2 - _CUBE_ROOT), 0.5 * math.sqrt(3.0) * (_CUBE_ROOT**2 + _CUBE_ROOT)
)


def _eigenpolynomial(x: complex) -> tuple[Array, Array]:
    """Return the eigenvector of A^-1 for the eigenvalue x, and its collocation polynomial.

    The polynomial p satisfies p' = x p at the nodes and p(0) = 0, hence p is proportional to
    x^3 M + x^2 M' + x M'' + M'''. It is scaled to p(1) = 1; its coefficients are those of the first
    to third power.
    """
    values = x**2 * (3.0 * C**2 - 3.6 * C + 0.9) + x * (6.0 * C - 3.6) + 6.0
    coefficients = np.array([0.9 * x**3 - 3.6 * x**2 + 6.0 * x, 3.0 * x**2 - 1.8 * x**3, x**3])
    return values / values[-1], coefficients / values[-1]


def _real_columns(real: Array, upper: Array) -> Array:
    """Return the columns of the real and of the conjugate complex eigenvectors in the basis T."""
    return np.stack([real, upper.real, -upper.imag], axis=1)


_REAL_VECTOR, _REAL_POLYNOMIAL = _eigenpolynomial(REAL_EIGENVALUE)
_VECTOR, _POLYNOMIAL = _eigenpolynomial(COMPLEX_EIGENVALUE)
# The columns of T end in 1, 1 and 0.
T = _real_columns(_REAL_VECTOR, _VECTOR)
_COFACTORS = np.stack([np.cross(T[:, k - 2], T[:, k - 1]) for k in range(3)])
T_INVERSE = _COFACTORS / np.sum(T[:, 0] * _COFACTORS[0])
# h Y' = RATES W.
RATES = _real_columns(REAL_EIGENVALUE * _REAL_VECTOR, COMPLEX_EIGENVALUE * _VECTOR)
# W of the unit stages, which add y_n to all stages.
START = np.sum(T_INVERSE, axis=1)
# W / (h y') for stages with a constant y'.
UNIFORM = np.sum(T_INVERSE * C, axis=1)
# POLYNOMIAL W contains the coefficients of the collocation polynomial, except the constant.
POLYNOMIAL = _real_columns(_REAL_POLYNOMIAL, _POLYNOMIAL)
# Lagrange's polynomials of the nodes at 0.
_AT_START = np.array(
    [C[k - 2] * C[k - 1] / ((C[k - 2] - C[k]) * (C[k - 1] - C[k])) for k in range(3)]
)
# EMBEDDED W = h sum_i (b^_i - b_i) Y'_i for the third-order method with the weight 1 / gamma of
# y'_n.
EMBEDDED = np.sum((-1.0 / REAL_EIGENVALUE * _AT_START)[:, None] * RATES, axis=0)
# h Y' = T RATE_BLOCKS W: w_0 is multiplied by gamma and w_1 + i w_2 by alpha + i beta.
RATE_BLOCKS = np.array(
    [
        [REAL_EIGENVALUE, 0.0, 0.0],
        [0.0, COMPLEX_EIGENVALUE.real, -COMPLEX_EIGENVALUE.imag],
        [0.0, COMPLEX_EIGENVALUE.imag, COMPLEX_EIGENVALUE.real],
    ]
)

TABLEAU = Workspace(
    "Tableau",
    nodes=C,
    to_stages=np.ascontiguousarray(T),
    from_stages=np.ascontiguousarray(T_INVERSE),
    rates=np.ascontiguousarray(RATES),
    rate_blocks=RATE_BLOCKS,
    polynomial=np.ascontiguousarray(POLYNOMIAL),
    embedded=EMBEDDED,
    start=START,
    uniform=UNIFORM,
    eigenvalues=np.array([REAL_EIGENVALUE, COMPLEX_EIGENVALUE.real, COMPLEX_EIGENVALUE.imag]),
)
