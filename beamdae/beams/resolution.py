"""Resolution of beams: errors estimated by the Legendre coefficients of strains, and next meshes.

In elements of degree p, the strains at the p Gauss points are polynomials of degree p - 1. The
Legendre coefficients of a resolved motion decrease exponentially, so that the last two of them, the
tail, measure what higher degrees would add (Aurentz & Trefethen, ACM Trans. Math. Softw. 43 (2017)
33, choose the lengths of Chebyshev series in this way).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from beamdae.beams.kinematics import FormulationKinematics, Kinematics
from beamdae.beams.mesh import Mesh
from beamdae.beams.shape_functions import gauss_points
from beamdae.beams.strains import AXIAL, BENDING, SHEAR
from beamdae.curves.plane_curves import PlaneCurve

Array = np.ndarray

# Errors by the tail t at degree p: 16 t / p^2 for motions, whose derivatives the strains are, and
# 3 t for strains and section forces (measured).
_MOTION_FACTOR, _FORCE_FACTOR = 16.0, 3.0
_MIN_RATE = 0.25  # of the logarithm of coefficients per degree
MAX_DEGREE, _SPLIT_DEGREE = 12, 8  # above the first, elements of the second degree are divided
# Strains of rigid beams are rounding errors, and so are the shear forces of pure bending, which are
# compared with bending moment per length.
_MIN_STRAIN, _MIN_SHEAR_RATIO = 1e-11, 1e-6
# Numbers and degrees of elements of beams without attachments that have similar errors.
_MESHES = ((1, 7), (2, 6), (3, 5), (8, 3))
_MAX_ELEMENTS = 24  # beyond, attachments act like a distributed load
_MAX_CURVATURE_ERROR = 0.05  # of elements, relative to the largest curvature or to 1 / length
_INTERVALS_OF_MODES = 24
_MAX_NUMBERS = 1e6  # of strains that are evaluated together


class Tail(NamedTuple):
    """Legendre coefficients of the strains of a beam that its mesh hardly resolves.

    Attributes
    ----------
    degree
        Degree p of the elements.
    fiber, shear
        Largest of the last two coefficients of the fiber strain, relative to its largest value
        along the beam, and of the shear strain, relative to its largest coefficient. All are root
        mean squares over the states: sudden starts excite high coefficients for a short time.
    rate
        Decrease of the logarithm of the coefficients per degree; that of the larger tail.
    """

    degree: int
    fiber: float
    shear: float
    rate: float

    @property
    def motion_error(self) -> float:
        """Estimated error of positions and their rates, relative to the motion by deformation."""
        return _MOTION_FACTOR * self.fiber / self.degree**2

    @property
    def force_error(self) -> float:
        """Estimated error of section forces, relative to their largest values."""
        return _FORCE_FACTOR * max(self.fiber, self.shear)


def measure_tail(kinematics: Kinematics, q: Array, about: Array | None = None) -> Tail | None:
    """Return the tail of the strains of a beam in the states q (k, n), its coordinates.

    Parameters
    ----------
    kinematics
        Kinematics of the beam.
    q
        States of a run, of a path of equilibria, or of a period.
    about
        State (n,) whose strains are subtracted, for small displacements such as those of modes.

    Returns
    -------
    Tail or None
        None for custom kinematics.
    """
    if not isinstance(kinematics, FormulationKinematics):
        return None
    mesh, points = kinematics.mesh, kinematics.stiffness_points
    degree = mesh.nodes - 1
    transform = _legendre_transform(points)[:degree]
    start = 0.0 if about is None else kinematics.fiber_strains(about[None])
    squares, square_of_fiber = np.zeros((3, degree)), 0.0  # sums over the states
    count = max(int(_MAX_NUMBERS / (3 * points * mesh.elements)), 1)
    for first in range(0, len(q), count):
        strains = kinematics.fiber_strains(q[first : first + count]) - start
        coefficients = np.einsum("ij,cejk->ceik", transform, strains)
        squares += np.sum(np.max(coefficients**2, axis=1), axis=-1)
        fiber_strains = np.abs(strains[AXIAL]) + np.abs(strains[BENDING])
        square_of_fiber += float(np.sum(np.max(fiber_strains, axis=(0, 1)) ** 2))
    sizes, size = np.sqrt(squares / len(q)), math.sqrt(square_of_fiber / len(q))
    of_fiber = sizes[[AXIAL, BENDING]].max(axis=0) / max(size, _MIN_STRAIN)
    least = _MIN_SHEAR_RATIO * _shear_by_bending(kinematics) * size
    of_shear = sizes[SHEAR] / max(float(sizes[SHEAR].max()), least, _MIN_STRAIN)
    (fiber, rate), (shear, shear_rate) = map(_measure_series, (of_fiber, of_shear))
    return Tail(degree, fiber, shear, rate if fiber >= shear else shear_rate)


def choose_mesh(curve: PlaneCurve, arc_lengths: Sequence[float], has_moving_load: bool) -> Mesh:
    """Return the mesh of a beam with element ends at ascending arc lengths [m].

    It is the smallest one of elements of degree 7, 6, 5 or 3 that are at most as long as the beam,
    a half, a third and an eighth of it, or shorter on curves that they would not resolve. With more
    than about 20 arc lengths, it has eight elements of degree 3; with a moving load, at which
    section forces jump or have kinks, at least as many.
    """
    candidates = _MESHES[-1:] if has_moving_load else _MESHES
    meshes = [Mesh(curve, n, p + 1, "curved") for n, p in candidates]
    if meshes[-1].divide(arc_lengths).elements > _MAX_ELEMENTS:
        return meshes[-1]
    resolved = [_resolve_curve(mesh, arc_lengths) for mesh in meshes]
    return min(resolved, key=lambda x: x.node_count)


def _resolve_curve(mesh: Mesh, arc_lengths: Sequence[float]) -> Mesh:
    divided = mesh.divide(arc_lengths)
    turn = max(float(divided.gauss_curvature.max()) * mesh.curve.length, 1.0)
    while divided.elements <= _MAX_ELEMENTS:
        if divided.curvature_error(divided.nodes - 1) <= _MAX_CURVATURE_ERROR * turn:
            break
        mesh = replace(mesh, elements=mesh.elements + 1 + mesh.elements // 4)
        divided = mesh.divide(arc_lengths)
    return divided


def mesh_of_modes(mesh: Mesh) -> Mesh:
    """Return a mesh that resolves ten modes of a beam: of at least 24 intervals between nodes."""
    intervals = mesh.node_count - 1
    return mesh.with_divided_elements(math.ceil(_INTERVALS_OF_MODES / intervals))


def next_mesh(mesh: Mesh, tail: Tail, accuracy: float, *, forces: bool = True) -> Mesh:
    """Return a mesh for an aimed accuracy [-]; the same mesh if the error is small enough.

    Elements have a higher degree, or are divided into elements of degree 8 if the degree would
    exceed 12.

    Parameters
    ----------
    mesh
        Mesh on which the tail was measured.
    tail
        Tail of the strains of its beam.
    accuracy
        Largest error of motions and, if `forces` is True, of section forces.
    forces
        False if section forces are not required.
    """
    error = max(tail.motion_error, tail.force_error * forces)
    if error <= accuracy:
        return mesh
    degree = tail.degree + math.ceil(math.log(error / accuracy) / tail.rate)
    if degree <= MAX_DEGREE:
        return mesh.with_degree(degree)
    return mesh.with_divided_elements(math.ceil(degree / _SPLIT_DEGREE)).with_degree(_SPLIT_DEGREE)


def _measure_series(coefficients: Array) -> tuple[float, float]:
    """Return the larger of the last two coefficients, and their decrease per degree."""
    last, previous = (float(np.max(coefficients[k:][:2])) for k in (-2, -4))
    if not last > 0.0:
        return 0.0, math.inf
    return last, max(0.5 * math.log(max(previous, last) / last), _MIN_RATE)


def _shear_by_bending(kinematics: FormulationKinematics) -> float:
    """Return the shear strain by a shear force M / L, relative to the fiber strain by M."""
    length = kinematics.mesh.curve.length
    section = kinematics.section.at(0.5 * length)
    half_height = math.sqrt(3.0 * section.EI / section.EA)
    return float(section.EI / (section.GA * half_height * length))


def _legendre_transform(points: int) -> Array:
    """Return the matrix from values at Gauss points to Legendre coefficients, (points, points)."""
    xi, weights = gauss_points(points)
    degrees = np.arange(points)
    return (degrees[:, None] + 0.5) * np.polynomial.legendre.legvander(xi, points - 1).T * weights
