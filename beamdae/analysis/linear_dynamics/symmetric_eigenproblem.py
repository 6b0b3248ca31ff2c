"""Undamped modes: K x + G^T mu = w^2 M x under G x = 0, of symmetric matrices.

Of small systems by the inverse of K + s M in the null space of G, all at once; of large ones by
Lanczos' method about a shift below the lowest mode, with the multipliers among the unknowns of a
sparse factorization (Ericsson & Ruhe, Math. Comput. 35 (1980) 1251): K is then singular without
harm, and no infinite eigenvalue of the pencil gets in, for all vectors satisfy G x = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh

from beamdae.analysis.linear_dynamics.linearization import Linearization
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.errors import BeamdaeError
from beamdae.linear.saddle_point import factorize_saddle_point

Array = np.ndarray

# Up to so many coordinates all modes are found at once.
ALL_AT_ONCE = 250
# Squares beside the shift that are zero.
STILL = 1e-13
# Singular values of G in natural sizes that are none.
_NULL_SPACE_TOLERANCE = 1e-9
# Beside |x| |K| |x|: what rounding may leave of the stiffness of a motion that nothing resists.
_ROUNDING = 2e-14
# The shift lies so far below the lowest mode, and where it is looked for first.
_BELOW, _FIRST, _LEAST = 0.4, 1e-8, 1e-22
_ROUNDS = 6


class MasslessError(BeamdaeError):
    """A coordinate moves without inertia."""

    def __init__(self, coordinate: str) -> None:
        super().__init__(f"{coordinate}: it can move without inertia, give it a mass or a joint.")
        self.coordinate = coordinate


class UndampedModes(NamedTuple):
    """Squares (k,) of angular frequencies, ascending, and shapes (n, k) with x^T M x = 1."""

    squares: Array
    shapes: Array


class SymmetricProblem:
    """K x + G^T mu = w^2 M x, G x = 0, of the symmetric parts of K and M."""

    def __init__(self, lin: Linearization) -> None:
        own = lin.tangent
        self.e = lin.equations
        self.stiffness = _symmetric_part(own.stiffness)
        self.mass = _symmetric_part(own.mass)
        self.rows = own.acceleration_jacobian(lin.equations)
        self.free, self.still = self.e.n - self.e.m, lin.still

    def lowest(self, count: int | None) -> UndampedModes:
        """The modes nearest to zero, or all."""
        if self.free <= 0:
            return UndampedModes(np.zeros(0), np.zeros((self.e.n, 0)))
        if count is None or self.e.n <= ALL_AT_ONCE or count >= self.free // 2:
            shapes, shift = self._all()
        else:
            shapes, shift = self._few(count)
        return self._refined(shapes, max(STILL * shift, self.still))

    def _refined(self, shapes: Array, still: float) -> UndampedModes:
        """Rayleigh quotients: their error is the square of that of the shapes."""
        shapes = shapes / np.sqrt(np.einsum("ij,ij->j", shapes, self.mass @ shapes))
        squares = np.einsum("ij,ij->j", shapes, self.stiffness @ shapes)
        squares[
            np.abs(squares) <= np.maximum(quadratic_form_rounding(self.stiffness, shapes), still)
        ] = 0.0
        order = np.argsort(squares, kind="stable")
        return UndampedModes(squares[order], shapes[:, order])

    def _all(self) -> tuple[Array, float]:
        """By the inverse of K + s M in the null space of G, accurate for the lowest modes."""
        free = scaled_null_space(self.rows, self.e.position_scales)
        k, m = (free.T @ (matrix @ free) for matrix in (self.stiffness, self.mass))
        try:
            lower = la.cholesky(m, lower=True)
        except la.LinAlgError:
            raise MasslessError(self._massless(m, free)) from None
        squares = la.eigh(k, m, eigvals_only=True)
        s = _shift_below(squares)
        inverse = la.solve(k + s * m, lower)
        product = lower.T @ inverse
        _, vectors = la.eigh(0.5 * (product + product.T))
        return free @ (inverse @ vectors), s

    def _massless(self, mass: Array, free: Array) -> str:
        without = free @ la.eigh(mass)[1][:, 0] / self.e.position_scales
        return self.e.q_names[int(np.argmax(np.abs(without)))]

    def _few(self, count: int) -> tuple[Array, float]:
        """By Lanczos' method about a shift below the lowest."""
        n, m = self.e.n, self.e.m
        inertia = self.mass.diagonal()
        has = inertia > 0.0
        s = _FIRST * float(np.max(np.abs(self.stiffness.diagonal()[has]) / inertia[has])) or 1.0
        least = _LEAST / _FIRST * s
        for _ in range(_ROUNDS):
            solve = factorize_saddle_point(self.stiffness + s * self.mass, self.rows.T, self.rows)
            if solve is None:
                s *= 1.37
                continue

            def inverse(right: Array, solve: Any = solve) -> Array:
                return solve(np.concatenate([np.ravel(right), np.zeros(m)]))[:n]

            operator = LinearOperator((n, n), matvec=inverse, dtype=float)
            begin = inverse(self.mass @ np.cos(np.arange(n) ** 2.0))
            values, shapes = eigsh(
                operator,
                count,
                self.mass,
                -s,
                which="LM",
                v0=begin,
                OPinv=operator,
                ncv=min(n - 1, 2 * count + 20),
            )
            highest = float(np.max(np.abs(values)))
            # Beside a shift far above them modes cannot be told apart.
            if highest >= 1e-4 * s or s <= least:
                break
            s = max(highest, least)
        return shapes, s


def _symmetric_part(matrix: sp.csc_array) -> sp.csc_array:
    return sp.csc_array(0.5 * (matrix + matrix.T))


def scaled_null_space(rows: sp.csc_array, scales: Array) -> Array:
    """Motions that rows allow, orthonormal in natural sizes, (n, free)."""
    if not rows.shape[0]:
        return np.diag(scales)
    matrix = rows.toarray() * scales
    lengths = np.linalg.norm(matrix, axis=1)
    matrix /= np.where(lengths > 0.0, lengths, 1.0)[:, None]
    return scales[:, None] * la.null_space(matrix, rcond=_NULL_SPACE_TOLERANCE)


def quadratic_form_rounding(stiffness: sp.csc_array, shapes: Array) -> Array:
    """What rounding may make of x^H K x, (k,)."""
    sizes = np.abs(shapes)
    return _ROUNDING * np.einsum("ij,ij->j", sizes, abs(stiffness) @ sizes)


def _shift_below(squares: Array) -> float:
    """A shift s > 0 below the lowest of these that rounding lets be told from zero."""
    size = np.abs(squares)
    # Whose inverse is a number.
    told = size[size > max(1e-11 * np.max(size, initial=0.0), 1e-200)]
    return _BELOW * float(np.min(told)) if len(told) else 1.0


@dataclass(frozen=True)
class FrequencyRange:
    """Natural frequencies at the start.

    Attributes
    ----------
    lowest, highest
        Of vibrations [Hz], or None where there are none.
    damping_ratio
        Of the fastest.
    loose
        Motions that nothing drives back.
    falling
        The fastest rate at which a motion leaves the start [1/s], or 0.
    massless
        The coordinate that moves without inertia, or "".
    """

    lowest: float | None
    highest: float | None
    damping_ratio: float
    loose: int
    falling: float
    massless: str


def compute_frequency_range(e: EquationsOfMotion, time: Array, state: State) -> FrequencyRange:
    """Natural frequencies about a consistent state, of the motions its joints allow.

    Constraints must not depend on each other.
    """
    own = compute_tangent(e, time, state)
    try:
        squares, shapes = SymmetricProblem(Linearization(e, e, "start", time, state, own)).lowest(
            None
        )
    except MasslessError as problem:
        return FrequencyRange(None, None, 0.0, 0, 0.0, problem.coordinate)
    rates = np.sqrt(squares[squares > 0.0])
    ratio = 0.0
    if len(rates):
        fastest = shapes[:, -1]
        ratio = float(fastest @ (own.damping @ fastest) / (2.0 * rates[-1]))
    hertz = rates / (2.0 * np.pi)
    return FrequencyRange(
        float(hertz[0]) if len(rates) else None,
        float(hertz[-1]) if len(rates) else None,
        ratio,
        int(np.sum(squares == 0.0)),
        float(np.sqrt(np.max(-squares, initial=0.0))),
        "",
    )
