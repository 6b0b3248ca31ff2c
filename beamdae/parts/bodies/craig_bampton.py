"""Craig-Bampton reduction of free planar bodies, and checks of their matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackError, LinearOperator, SuperLU, eigsh, splu

from beamdae.errors import BeamdaeError, short_repr

Array = np.ndarray
RIGID_COUNT = 3  # rigid motions of a planar body
# Asymmetry of matrices, and forces and masses of rigid motions, relative to their sizes.
_ROUNDING = 1e-6
# Error of rigid motions as static deflections: a mechanism has some of their size, by rounding.
_MAX_RIGID_ERROR = 1e-3


def rigid_motions(nodes: Array, size: int, center: Sequence[float]) -> Array:
    """Return the displacements in translations by 1 m and a rotation by 1 rad, (size, 3)."""
    motions = np.zeros((len(nodes), size // len(nodes), RIGID_COUNT))
    motions[:, 0, 0] = motions[:, 1, 1] = 1.0
    motions[:, 0, 2], motions[:, 1, 2] = center[1] - nodes[:, 1], nodes[:, 0] - center[0]
    motions[:, 2:, 2] = 1.0
    return motions.reshape(size, RIGID_COUNT)


def center_of_mass(nodes: Array, mass: Any, axis: int = 0) -> tuple[float, Array]:
    """Return the mass [kg] of translations along an axis, and its center (x, y) [m]."""
    node_size = mass.shape[0] // len(nodes)
    along = rigid_motions(nodes, mass.shape[0], (0.0, 0.0))[:, axis]
    masses = (mass @ along)[axis::node_size]
    return float(np.sum(masses)), masses @ nodes / np.sum(masses)


def require_matrix(name: str, what: str, value: Any) -> sp.csc_array:
    """Return a dense or sparse matrix of finite real numbers in sparse form."""
    try:
        entries = value if sp.issparse(value) else np.asarray(value)
        is_valid = entries.ndim == 2 and not np.iscomplexobj(entries)
        matrix = sp.csc_array(entries, dtype=float) if is_valid else None
    except Exception:  # Foreign array types may raise anything.
        matrix = None
    if matrix is None or not np.isfinite(matrix.data).all():
        raise BeamdaeError(
            f"{name}: {what} must be a matrix of finite real numbers, rows by columns, got "
            f"{short_repr(value)}."
        )
    return matrix


def require_free_body(
    name: str, mass: Any, stiffness: Any, nodes: Any
) -> tuple[sp.csc_array, sp.csc_array, Array]:
    """Return the matrices and the nodes of a free body."""
    places = require_matrix(name, "nodes", nodes).toarray()
    if places.shape[1] != 2 or len(places) < 2:
        raise BeamdaeError(
            f"{name}: nodes must be at least two points (x, y), got {short_repr(nodes)}."
        )
    sizes = [(k * len(places), k * len(places)) for k in (2, 3)]
    matrices = [
        require_matrix(name, what, x) for what, x in (("mass", mass), ("stiffness", stiffness))
    ]
    shapes = [x.shape for x in matrices]
    for what, matrix in zip(("mass", "stiffness"), matrices, strict=True):
        if matrix.shape not in sizes or shapes[0] != shapes[1]:
            raise BeamdaeError(
                f"{name}: {what} must be a square matrix with 2 or 3 rows for each of the "
                f"{len(places)} nodes, as many as the other matrix, got mass of the shape "
                f"{shapes[0]} and stiffness of the shape {shapes[1]}."
            )
        difference, largest = abs(matrix - matrix.T).max(), abs(matrix).max()
        if difference > _ROUNDING * largest:
            raise BeamdaeError(
                f"{name}: {what} must be a symmetric matrix, but mirrored entries differ by up to "
                f"{difference:.3g}, with a largest entry of {largest:.3g}."
            )
    m, k = (sp.csc_array(0.5 * (x + x.T)) for x in matrices)
    rigid = rigid_motions(places, m.shape[0], places[0])
    forces = np.max(np.abs(k @ rigid), axis=0)
    if np.any(forces > _ROUNDING * np.max(abs(k) @ np.abs(rigid), axis=0)):
        raise BeamdaeError(
            f"{name}: stiffness must be that of the free body, but resists rigid motions; remove "
            "the supports, and check the order of nodes and rows."
        )
    _require_equal_masses(name, m, places)
    return m, k, places


def _require_equal_masses(name: str, mass: sp.csc_array, nodes: Array) -> None:
    """Require the same positive mass with the same center along both axes, without coupling."""
    rigid = rigid_motions(nodes, mass.shape[0], (0.0, 0.0))
    total = float(rigid[:, 0] @ (mass @ rigid[:, 0]))
    if total > 0.0:
        (x, of_x), (y, of_y) = (center_of_mass(nodes, mass, axis) for axis in (0, 1))
        coupling = rigid[:, 0] @ (mass @ rigid[:, 1])
        is_equal = max(abs(y - x), abs(coupling)) <= _ROUNDING * x
        if is_equal and np.max(np.abs(of_x - of_y)) <= _ROUNDING * np.max(np.ptp(nodes, axis=0)):
            return
        found = f"{x:g} kg at {_format_point(of_x)} and {y:g} kg at {_format_point(of_y)}"
    else:
        found = f"{total:g} kg along x"
    raise BeamdaeError(
        f"{name}: mass must be the same positive mass in both directions, got {found}."
    )


def _format_point(point: Array) -> str:
    return f"({point[0]:g}, {point[1]:g}) m"


def unit_mass_factors(name: str, mass: Any, motions: Array) -> Array:
    """Return the factors with which the motions (n, k) have a mass of 1 kg.

    Raises
    ------
    BeamdaeError
        If the mass of a motion, or of a sum of motions, is not positive.
    """
    reduced = motions.T @ (mass @ motions)
    sizes = np.diag(reduced)
    smallest = float(np.min(sizes))
    if smallest > 0.0:
        factors = 1.0 / np.sqrt(sizes)
        smallest = float(la.eigvalsh(factors[:, None] * reduced * factors)[0])
        if smallest > np.finfo(float).eps * len(sizes):
            return np.asarray(factors)
    raise BeamdaeError(
        f"{name}: mass must be positive for all motions of the frame, the interface and the modes, "
        f"but is {smallest:.2g} for one; add the missing mass or rotary inertia, pass fewer modes, "
        "or check the sign."
    )


def require_positive_stiffness(name: str, stiffness: Any, shapes: Array) -> None:
    """Require that the stiffness of no shape, or sum of shapes (n, k), is negative."""
    values = la.eigvalsh(shapes.T @ (stiffness @ shapes))
    if values[0] < -_ROUNDING * abs(values[-1]):
        raise BeamdaeError(
            f"{name}: stiffness must not be negative for any shape, but is {values[0]:.3g} N/m for "
            "one; check its sign."
        )


def find_modes(
    name: str, mass: Any, stiffness: Any, nodes: Array, interface: list[int], count: int
) -> Array:
    """Return Craig-Bampton modes without rigid motions, (n, k), in ascending order of frequency.

    Parameters
    ----------
    name
        Name of the body.
    mass, stiffness, nodes
        See `require_free_body`.
    interface
        Indices of the nodes of the interface.
    count
        Number of modes with a fixed interface; fewer if fewer have mass.

    Raises
    ------
    BeamdaeError
        If the interface does not hold the body, or a matrix is not positive.
    """
    n, node_size = mass.shape[0], mass.shape[0] // len(nodes)
    rigid = rigid_motions(nodes, n, np.mean(nodes, axis=0))
    rigid[:, 2] /= np.max(np.ptp(nodes, axis=0))
    held = (np.array(interface, int)[:, None] * node_size + np.arange(node_size)).ravel()
    inner = np.setdiff1d(np.arange(n), held)
    if len(set(interface)) < len(interface) or np.linalg.matrix_rank(rigid[held]) < RIGID_COUNT:
        raise BeamdaeError(
            f"{name}: interface must contain different nodes that hold the body if they are fixed: "
            f"two, or one with a rotation, got {short_repr(interface)}."
        )
    static, fixed = np.eye(n)[:, held], np.zeros((n, 0))
    if len(inner):
        of_inner, coupling = (sp.csc_matrix(stiffness[inner][:, x]) for x in (inner, held))
        factors = _factorize(name, of_inner)
        static[inner] = -factors.solve(coupling.toarray())
        errors = np.abs(static @ rigid[held] - rigid).reshape(len(nodes), node_size, -1)
        if np.max(errors[:, :2]) > _MAX_RIGID_ERROR:
            raise _not_connected(name)
        inertia = sp.csc_matrix(mass[inner][:, inner])
        found = _fixed_interface_modes(name, inertia, of_inner, factors, count)
        fixed = np.zeros((n, found.shape[1]))
        fixed[inner] = found
    basis = np.hstack([static, fixed])
    # Of the same size: a rotation by 1 rad may have a billionth of the mass of a translation.
    sizes = unit_mass_factors(name, mass, basis)
    basis *= sizes
    coefficients = np.zeros((basis.shape[1], RIGID_COUNT))
    coefficients[: len(held)] = rigid[held] / sizes[: len(held), None]
    coefficients /= np.linalg.norm(coefficients, axis=0)
    reduced = [basis.T @ (x @ basis) for x in (stiffness, mass)]
    elastic = la.null_space(coefficients.T @ reduced[1])
    _, modes = la.eigh(*(elastic.T @ x @ elastic for x in reduced))
    shapes = basis @ elastic @ modes
    # The largest displacement of a node is 1 m, in any axes.
    displacements = shapes.reshape(len(nodes), node_size, -1)[:, :2]
    return np.asarray(shapes / np.max(np.linalg.norm(displacements, axis=1), axis=0))


def _factorize(name: str, stiffness: sp.csc_matrix) -> SuperLU:
    """Return the factors of a positive definite matrix, whose pivots are positive."""
    try:
        factors = splu(
            stiffness, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError:  # A pivot is zero.
        raise _not_connected(name) from None
    if np.any(factors.U.diagonal() <= 0.0):
        raise _not_connected(name)
    return factors


def _not_connected(name: str) -> BeamdaeError:
    return BeamdaeError(
        f"{name}: with the interface fixed, the stiffness is singular or negative; connect all "
        "nodes, and check its sign."
    )


def _fixed_interface_modes(
    name: str, mass: sp.csc_matrix, stiffness: sp.csc_matrix, factors: SuperLU, count: int
) -> Array:
    """Return the modes of the lowest frequencies, without those of no mass.

    Of the inverse problem M x = (1 / w^2) K x: lumped masses leave rotations without mass.
    """
    n = mass.shape[0]
    if not count:
        return np.zeros((n, 0))
    if count < n - 1:
        inverse = LinearOperator(stiffness.shape, matvec=factors.solve, dtype=float)
        # Neither symmetric nor antisymmetric, as modes of symmetric bodies are.
        start = np.cos(np.arange(n) ** 2.0)
        try:
            values, modes = eigsh(mass, count, stiffness, Minv=inverse, v0=start, which="LA")
        except ArpackError as problem:
            raise BeamdaeError(
                f"{name}: the {count} modes with a fixed interface were not found ({problem}); "
                "pass fewer modes."
            ) from None
    else:
        values, modes = la.eigh(mass.toarray(), stiffness.toarray())
        values, modes = values[-count:], modes[:, -count:]
    has_mass = values > n * np.finfo(float).eps * np.max(values)
    return np.asarray(modes[:, has_mass])
