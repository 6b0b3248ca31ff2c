"""Natural modes of linearized equations: M x'' + C x' + K x + H mu = 0, J x + V x' = 0."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.linear.linearization import Linearization
from beamdae.analysis.modes.quadratic_problem import QuadraticProblem
from beamdae.analysis.modes.symmetric_problem import SymmetricProblem
from beamdae.linear.factorizations import single_threaded

Array = np.ndarray

# Beside the largest entry: what is no asymmetry, of matrices that are exact and of differences.
_EXACT, _DIFFERENCES = 1e-12, 1e-9


class Eigenmodes(NamedTuple):
    """Eigenvalues [1/s] with their shapes, zeros first, then by size; of pairs the upper one.

    Attributes
    ----------
    values
        (k,), imaginary parts of vibrations positive.
    shapes
        (n, k), x^H M x = 1.
    """

    values: Array
    shapes: Array


def is_conservative(lin: Linearization) -> bool:
    """Whether matrices are symmetric and velocities have no part in forces."""
    own, m = lin.tangent, lin.equations.m
    if own.damping.nnz and abs(own.damping).max() > 0.0:
        return False
    if not (_is_symmetric(own.stiffness) and _is_symmetric(own.mass)):
        return False
    if not m:
        return True
    # At rest constraints on velocities hold the shape of whatever vibrates.
    moving = lin.nonholonomic
    if moving.any() and abs(own.held[moving]).max() > 0.0:
        return False
    rows = own.held_accelerations(lin.equations)
    off = abs(own.reactions.T - rows)
    return bool(off.max() <= _EXACT * abs(rows).max())


def _is_symmetric(matrix: sp.csc_array) -> bool:
    # Derivatives by differences are off by more than rounding.
    return not matrix.nnz or bool(abs(matrix - matrix.T).max() <= _DIFFERENCES * abs(matrix).max())


@single_threaded
def eigenmodes(lin: Linearization, count: int | None, damped: bool = True) -> Eigenmodes:
    """The lowest modes, all if `count` is None.

    With `damped` False those of the symmetric parts of K and M alone.
    """
    lowest = SymmetricProblem(lin).lowest(count)
    if not damped or is_conservative(lin):
        values = np.where(lowest.squares < 0.0, 0j, 1j) * np.sqrt(np.abs(lowest.squares))
        values += np.sqrt(np.maximum(-lowest.squares, 0.0))
        return _sorted(lin, values, lowest.shapes.astype(complex), count)
    return _sorted(lin, *QuadraticProblem(lin, lowest.squares, count).lowest(count), count)


def _sorted(lin: Linearization, values: Array, shapes: Array, count: int | None) -> Eigenmodes:
    """Lowest first, x^H M x = 1, and as real as can be."""
    mass = lin.tangent.mass
    order = np.argsort(np.abs(values), kind="stable")[:count]
    values, shapes = values[order], shapes[:, order]
    size = np.sqrt(np.abs(np.einsum("ij,ij->j", shapes.conj(), mass @ shapes)))
    phase = np.exp(-0.5j * np.angle(np.einsum("ij,ij->j", shapes, mass @ shapes)))
    shapes = shapes * phase / np.where(size > 0.0, size, 1.0)
    # The largest of its coordinates is positive.
    if shapes.size:
        natural = shapes.real / lin.equations.position_scales[:, None]
        largest = natural[np.argmax(np.abs(natural), axis=0), np.arange(shapes.shape[1])]
        shapes = shapes * np.where(largest < 0.0, -1.0, 1.0)
    return Eigenmodes(values, shapes)
