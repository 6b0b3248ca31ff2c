"""Transfer of the coordinates of a beam to a finer mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.beams.elements import NODE_SIZE
from beamdae.beams.kinematics import Kinematics
from beamdae.beams.shape_functions import (
    node_positions,
    shape_functions,
)
from beamdae.parts.part import Part

Array = np.ndarray


def prolongation_matrix(coarse: Kinematics, fine: Kinematics) -> sp.csc_array:
    """Return the matrix that maps changes of coordinates to a beam with a finer mesh.

    Nodal displacements and rotations are interpolated by the shape functions of the coarse
    elements. The small angles between the axes of coarse and fine elements are neglected, so that
    the result is a start for Newton's method, not a solution.

    Parameters
    ----------
    coarse
        Kinematics of a built-in formulation.
    fine
        Those of the same beam on a mesh whose elements are parts of those of the coarse mesh.
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
    target = sp.csr_array(sp.vstack(blocks)) @ coarse.operator
    # Elements share nodes, and all share the frame: the equations are consistent up to the
    # neglected angles, and are solved in the least-squares sense.
    operator = sp.csc_array(fine.operator)
    normal = splu(sp.csc_matrix(operator.T @ operator))
    return sp.csc_array(normal.solve((operator.T @ target).toarray()))


def prolong_coordinates(
    names: Sequence[str],
    fine_names: Sequence[str],
    parts: Mapping[str, Part],
    fine_parts: Mapping[str, Part],
) -> tuple[sp.csc_array, Array]:
    """Return the map from coordinates q of a mechanism to those of a copy with other meshes.

    Parameters
    ----------
    names, fine_names
        Names of the coordinates of the mechanism and of the copy.
    parts, fine_parts
        Their parts by name.

    Returns
    -------
    prolongation, start
        Matrix (n', n) and vector (n',): the coordinates are start + prolongation @ q.
    """
    old = {name: k for k, name in enumerate(names)}
    new = {name: k for k, name in enumerate(fine_names)}
    prolongation = sp.lil_array((len(new), len(old)))
    start = np.zeros(len(new))
    for name, coarse in parts.items():
        fine = fine_parts[name]
        rows = [new[f"{name}.{c.name}"] for c in fine.coordinates]
        columns = [old[f"{name}.{c.name}"] for c in coarse.coordinates]
        if rows:
            block = coarse._prolongation_to(fine)
            prolongation[np.ix_(rows, columns)] = block.toarray()
            start[rows] = fine.initial_position - block @ coarse.initial_position
    return sp.csc_array(prolongation), start
