"""Modes of the linearized equations: l^2 M x + l C x + K x + H mu = 0, J x + l V x = 0.

Symmetric undamped problems are solved for squared frequencies, all others as quadratic eigenvalue
problems.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.analysis.eigenproblems.quadratic_eigenproblem import QuadraticProblem
from beamdae.analysis.eigenproblems.symmetric_eigenproblem import SymmetricProblem, is_symmetric
from beamdae.linear.blas_threads import single_threaded

Array = np.ndarray

# Kinds of modes.
RIGID, VIBRATION, DECAY, UNSTABLE = "free motion", "vibration", "decay", "unstable"
# Real parts below this fraction of the eigenvalue are rounding errors.
_GROWTH_TOLERANCE = 1e-9


class EigenSolution(NamedTuple):
    """Eigenvalues and mode shapes, in ascending order of |eigenvalue|.

    Attributes
    ----------
    values
        Eigenvalues [1/s], (k,). Each conjugate pair is represented by the eigenvalue with positive
        imaginary part. For symmetric undamped problems, a growing and a decaying mode of the same
        shape are represented by the growing one.
    shapes
        Mode shapes, (n, k), with x^H M x = 1.
    """

    values: Array
    shapes: Array


@single_threaded
def solve_eigenproblem(
    lin: LinearizedEquations, count: int | None, damped: bool = True
) -> EigenSolution:
    """Return the modes with the smallest |eigenvalue|: at most `count`, or all if it is None.

    If `damped` is False, the symmetric parts of M and K are used, and damping is ignored.
    """
    undamped = SymmetricProblem(lin).solve(count)
    is_undamped = not lin.tangent.damping.nnz or abs(lin.tangent.damping).max() == 0.0
    if not damped or (is_undamped and is_symmetric(lin)):
        values = np.where(undamped.squares < 0.0, 0j, 1j) * np.sqrt(np.abs(undamped.squares))
        values += np.sqrt(np.maximum(-undamped.squares, 0.0))
        return _normalize(lin, values, undamped.shapes.astype(complex), count)
    values, shapes = QuadraticProblem(lin, undamped, count).solve(count)
    return _normalize(lin, values, shapes, count)


def _normalize(
    lin: LinearizedEquations, values: Array, shapes: Array, count: int | None
) -> EigenSolution:
    """Return the modes with the smallest |eigenvalue|, sorted and scaled to x^H M x = 1.

    The phase of each shape is chosen so that the shape is as real as possible.
    """
    mass = lin.tangent.mass
    order = np.argsort(np.abs(values), kind="stable")[:count]
    values, shapes = values[order], shapes[:, order]
    size = np.sqrt(np.abs(np.einsum("ij,ij->j", shapes.conj(), mass @ shapes)))
    phase = np.exp(-0.5j * np.angle(np.einsum("ij,ij->j", shapes, mass @ shapes)))
    shapes = shapes * phase / np.where(size > 0.0, size, 1.0)
    # The sign is chosen so that the largest coordinate is positive.
    if shapes.size:
        relative = shapes.real / lin.equations.position_scales[:, None]
        largest = relative[np.argmax(np.abs(relative), axis=0), np.arange(shapes.shape[1])]
        shapes = shapes * np.where(largest < 0.0, -1.0, 1.0)
    return EigenSolution(values, shapes)


def classify_mode(value: complex) -> str:
    """Return the kind of the mode with this eigenvalue."""
    if value == 0.0:
        return RIGID
    if value.real > _GROWTH_TOLERANCE * abs(value):
        return UNSTABLE
    return VIBRATION if value.imag > 0.0 else DECAY
