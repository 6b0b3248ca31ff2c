"""Meshes that the program chooses: for deformations, and for modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beamdae.beams.mesh import Mesh
from beamdae.curves.plane_curves import PlaneCurve

Array = np.ndarray

# Numbers and degrees of elements of beams without attachments that have similar errors.
_MESHES = ((1, 7), (2, 6), (3, 5), (8, 3))
_MAX_ELEMENTS = 24  # beyond, attachments act like a distributed load
_MAX_CURVATURE_ERROR = 0.05  # of elements, relative to the largest curvature or to 1 / length
_INTERVALS_OF_MODES = 24


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
