"""Transfer of the coordinates of a beam to a finer mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.beams.beam import Beam
from beamdae.beams.elements import NODE_SIZE
from beamdae.beams.shape_functions import (
    gauss_points,
    lagrange_weights,
    node_positions,
    shape_functions,
)
from beamdae.beams.strains import STRAIN_SIZE
from beamdae.beams.viscoelasticity import StandardLinearSolid

Array = np.ndarray


def prolongation_matrix(coarse: Beam, fine: Beam) -> sp.csc_array:
    """Return the matrix that maps changes of coordinates to a beam with a finer mesh.

    Nodal displacements and rotations are interpolated by the shape functions of the coarse
    elements. The small angles between the axes of coarse and fine elements are neglected, so that
    the result is a start for Newton's method, not a solution.

    Parameters
    ----------
    coarse
        Beam with a built-in formulation.
    fine
        The same beam on a mesh whose elements are parts of those of the coarse mesh.
    """
    mesh, nodes = coarse.mesh, coarse.mesh.nodes
    bounds, fine_bounds = mesh.element_bounds, fine.mesh.element_bounds
    middles = 0.5 * (fine_bounds[1:] + fine_bounds[:-1])
    elements = np.searchsorted(bounds, middles) - 1
    frame, places = np.eye(coarse.rigid_coordinate_count), node_positions(fine.mesh.nodes)
    blocks = []
    for k, half, middle in zip(elements, 0.5 * fine.mesh.element_lengths, middles, strict=True):
        start, end = bounds[k : k + 2]
        xi = (2.0 * middle - start - end + 2.0 * half * places) / (end - start)
        nodal = np.kron(shape_functions(nodes, xi), np.eye(NODE_SIZE))
        block = sp.block_diag([frame, nodal])
        blocks.append(sp.kron(np.eye(1, mesh.elements, k), block))
    target = sp.csr_array(sp.vstack(blocks)) @ coarse.kinematics.operator
    # Elements share nodes, and all share the frame: the equations are consistent up to the
    # neglected angles, and are solved in the least-squares sense.
    operator = sp.csc_array(fine.kinematics.operator)
    normal = splu(sp.csc_matrix(operator.T @ operator))
    return sp.csc_array(normal.solve((operator.T @ target).toarray()))


def prolong_states(coarse: StandardLinearSolid, fine: StandardLinearSolid) -> sp.csc_array:
    """Return the matrix that maps states to those on a finer mesh, see `prolongation_matrix`.

    The strains of the dampers are interpolated between the stiffness points of coarse elements.
    """
    mesh, points = coarse.beam.mesh, coarse.beam.kinematics.element.quadrature
    s = fine.beam.mesh.gauss_arc_lengths(fine.beam.kinematics.element.quadrature)
    at = np.zeros((len(s), mesh.elements, points))
    for k, (element, xi) in enumerate(map(mesh.locate, s.tolist())):
        at[k, element] = lagrange_weights(gauss_points(points)[0], xi)
    strains = sp.kron(at.reshape(len(s), -1), np.eye(STRAIN_SIZE))
    old, new = (np.moveaxis(x.state_sizes, 0, -1).ravel() for x in (coarse, fine))
    return sp.csc_array(sp.diags_array(new) @ strains @ sp.diags_array(1.0 / old))


def prolong_coordinates(
    names: Sequence[str],
    fine_names: Sequence[str],
    pairs: Mapping[str, tuple[Any, Any]],
) -> tuple[sp.csc_array, Array]:
    """Return the map from coordinates q of a mechanism to those with other meshes of beams.

    Parameters
    ----------
    names, fine_names
        Names of the coordinates of both mechanisms.
    pairs
        The beams of both, and the parts whose states depend on their meshes, by name.

    Returns
    -------
    tuple
        Matrix P and vector s; the coordinates are s + P @ q.
    """
    old = {name: k for k, name in enumerate(names)}
    new = {name: k for k, name in enumerate(fine_names)}
    prolongation = sp.lil_array((len(new), len(old)))
    start = np.zeros(len(new))
    for name, (coarse, fine) in pairs.items():
        rows = [new[f"{name}.{c.name}"] for c in fine.coordinates]
        columns = [old[f"{name}.{c.name}"] for c in coarse.coordinates]
        if isinstance(coarse, StandardLinearSolid):
            block = prolong_states(coarse, fine)
        elif fine.mesh is coarse.mesh:
            block = sp.eye_array(len(rows))
        else:
            block = prolongation_matrix(coarse, fine)
        prolongation[np.ix_(rows, columns)] = block.toarray()
        start[rows] = fine.initial_position - block @ coarse.initial_position
    prefixes = tuple(f"{name}." for name in pairs)
    for name in new:
        if not name.startswith(prefixes):
            prolongation[new[name], old[name]] = 1.0
    return sp.csc_array(prolongation), start
