"""Flexible bodies from mass and stiffness matrices of finite-element programs.

Free planar bodies are reduced by the method of Craig and Bampton.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackError, LinearOperator, SuperLU, eigsh, splu

from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    optional,
    require_count,
    require_finite,
    require_name,
    require_names,
    require_non_negative,
    require_point,
    require_sequence,
    require_unit,
    set_fields,
    short_repr,
)
from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.part import Drawing, Part
from beamdae.read_only import read_only_data
from beamdae.symbolic.formula import Formula, cache_kernels
from beamdae.symbolic.statements import (
    SX,
    ForceKernel,
    ForceStatement,
    Local,
    Piece,
    Quantity,
    Variable,
)

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


Array = np.ndarray
_FRAME = RIGID_COUNT  # coordinates x, y and angle of the frame


@read_only_data
@dataclass(frozen=True, eq=False)
class ReducedBody(Part):
    """Flexible body in a floating frame whose deformation is a sum of given mode shapes.

    The nodes of a planar finite-element model have two displacements each, or two displacements and
    a rotation. Their displacements relative to the frame, in its axes, are `shapes` times modal
    coordinates, which are small. The kinetic energy is V^T M V / 2 with the absolute velocities V
    of the nodes in the axes of the frame. It contains the inertia coupling of rigid motion and
    deformation, and is exact for elements that interpolate displacements between nodes. The
    stiffness is constant: no centrifugal or geometric stiffness. `from_matrices` computes shapes.

    Matrices and nodes are in kg, m and N; convert those of programs with mm and t.

    Parameters
    ----------
    name
        Unique name.
    mass, stiffness
        Mass matrix [kg] and stiffness matrix [N/m] of the free body, (n, n), dense or SciPy sparse.
        The rows are (x, y) of each node in order, or (x, y, rotation).
    nodes
        Positions (x, y) of the nodes in the reference configuration [m], (n / 2, 2) or (n / 3, 2).
    shapes
        Mode shapes (n, k), without rigid motions. A modal coordinate [m] multiplies each.
    damping
        Retardation time [s]: the damping matrix is `damping` times the stiffness matrix.
    velocity, angular_velocity
        Initial velocity of the center of mass [m/s] and angular velocity [rad/s], see `RigidBody`.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, a matrix or shape has another size, is not finite or not symmetric,
        the stiffness resists rigid motions, the mass differs by direction, a shape is a rigid
        motion, the mass or the stiffness of a motion is negative, or a number is invalid.
    """

    name: str
    mass: Any
    stiffness: Any
    nodes: Any
    shapes: Any
    damping: float = 0.0
    velocity: tuple[float, float] | None = None
    angular_velocity: float | None = None

    point_syntax = "its .at(node)"
    rigid_coordinate_count = _FRAME

    def __post_init__(self) -> None:
        name = require_name("ReducedBody", self.name)
        mass, stiffness, nodes = require_free_body(name, self.mass, self.stiffness, self.nodes)
        shapes = require_matrix(name, "shapes", self.shapes).toarray()
        if len(shapes) != mass.shape[0] or not shapes.shape[1]:
            raise BeamdaeError(
                f"{name}: shapes must be an array of shape ({mass.shape[0]}, k) with k > 0, got "
                f"{shapes.shape}."
            )
        convert_fields(
            self,
            damping=require_non_negative,
            velocity=optional(require_point),
            angular_velocity=optional(require_finite),
        )
        set_fields(self, name=name, mass=mass, stiffness=stiffness, nodes=nodes, shapes=shapes)
        motions = np.hstack([rigid_motions(nodes, mass.shape[0], self.center), shapes])
        sizes = np.linalg.norm(motions, axis=0)
        if not np.all(sizes) or np.linalg.matrix_rank(motions / sizes) < len(sizes):
            raise BeamdaeError(
                f"{name}: shapes must be independent of each other and contain no rigid motion; "
                "omit those that are zero, rigid or sums of others."
            )
        unit_mass_factors(name, mass, motions)
        require_positive_stiffness(name, stiffness, shapes)

    @classmethod
    def from_matrices(
        cls,
        name: str,
        mass: Any,
        stiffness: Any,
        nodes: Any,
        interface: Sequence[int],
        modes: int = 10,
        **settings: Any,
    ) -> ReducedBody:
        """Return a body by Craig-Bampton reduction (AIAA J. 6 (1968) 1313, doi:10.2514/3.4741).

        The shapes span the static deflections by unit displacements of the interface nodes
        (constraint modes) and natural modes with a fixed interface, less the rigid motions. They
        are orthogonal natural modes of the reduced free body, whose frame moves with the mean
        motion of the mass.

        Parameters
        ----------
        name, mass, stiffness, nodes
            See `ReducedBody`.
        interface
            Indices of the nodes to which joints and forces are attached, from 0. They must hold the
            body if they are fixed.
        modes
            Number of modes with a fixed interface. Those up to twice the highest frequency of
            interest suffice.
        **settings
            `damping`, `velocity` and `angular_velocity`, see `ReducedBody`.

        Raises
        ------
        BeamdaeError
            See `ReducedBody`; also if `interface` does not contain indices of different nodes that
            hold the body, or `modes` is not a count.

        Examples
        --------
        A triangle of three bars:

        >>> import numpy as np
        >>> import beamdae as bd
        >>> nodes = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
        >>> stiffness = np.zeros((6, 6))
        >>> for a, b in [(0, 1), (1, 2), (2, 0)]:
        ...     direction = (nodes[b] - nodes[a]) / np.linalg.norm(nodes[b] - nodes[a])
        ...     elongation = np.zeros(6)
        ...     elongation[2 * a : 2 * a + 2], elongation[2 * b : 2 * b + 2] = -direction, direction
        ...     stiffness += 1e4 * np.outer(elongation, elongation)
        >>> truss = bd.ReducedBody.from_matrices("truss", np.eye(6), stiffness, nodes, [0, 1])
        >>> len(truss.coordinates)
        6
        """
        name = require_name("ReducedBody", name)
        model = require_free_body(name, mass, stiffness, nodes)
        entries = require_sequence(name, "interface", interface, "a list of indices of nodes")
        last = len(model[2]) - 1
        of_interface = [require_count(name, "interface", x, least=0, most=last) for x in entries]
        count = require_count(name, "modes", modes, least=0)
        return cls(name, *model, find_modes(name, *model, of_interface, count), **settings)

    @cached_property
    def center(self) -> tuple[float, float]:
        """Center of mass (x, y) in the reference configuration [m], the origin of the frame."""
        _, (x, y) = center_of_mass(self.nodes, self.mass)
        return float(x), float(y)

    @property
    def _node_size(self) -> int:
        return int(self.mass.shape[0] // len(self.nodes))

    @property
    def _count(self) -> int:
        return int(self.shapes.shape[1])

    @property
    def coordinates(self) -> tuple[Variable, ...]:
        """Name and unit of the position and angle of the frame, and of the modal coordinates."""
        frame = (Variable("x", "m"), Variable("y", "m"), Variable("angle", "rad"))
        return (*frame, *(Variable(f"mode{k + 1}", "m") for k in range(self._count)))

    @property
    def initial_position(self) -> Array:
        """Coordinates [m, rad] in the reference configuration."""
        return np.array([*self.center, 0.0, *np.zeros(self._count)])

    @property
    def initial_velocity(self) -> Array:
        """Initial velocity of the frame; zero rates of the modal coordinates."""
        frame = (*(self.velocity or (0.0, 0.0)), self.angular_velocity or 0.0)
        return np.array([*frame, *np.zeros(self._count)])

    @property
    def outline(self) -> Array:
        """Positions of the nodes (k, 2) [m]."""
        return np.asarray(self.nodes)

    @cached_property
    def _inertia(self) -> Array:
        """Reduced mass matrix of the velocities in `_body_kernel`, (3 + 2 k, 3 + 2 k)."""
        rigid = rigid_motions(self.nodes, self.mass.shape[0], self.center)
        turned = np.zeros_like(self.shapes)
        turned[0 :: self._node_size] = -self.shapes[1 :: self._node_size]
        turned[1 :: self._node_size] = self.shapes[0 :: self._node_size]
        vectors = np.hstack([rigid, turned, self.shapes])
        return np.asarray(vectors.T @ (self.mass @ vectors))

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Return inertia, elasticity, damping and weight as one statement."""
        stiffness = self.shapes.T @ (self.stiffness @ self.shapes)
        data = [self._inertia.ravel(), stiffness.ravel(), [self.damping], gravity]
        kernel, piece = _body_kernel(self._count), Piece(self, self._all_rows)
        return [ForceStatement(self.name, kernel, (piece,), np.concatenate(data)[:, None])]

    @property
    def _all_rows(self) -> sp.csr_array:
        return sp.csr_array(sp.eye_array(_FRAME + self._count))

    def at(self, node: int) -> Attachment:
        """Return a node, for joints, forces and observables.

        Nodes without a rotation are particles. Use nodes of the interface for joints and forces:
        a few modes contain their static deflections.

        Parameters
        ----------
        node
            Index of the node, from 0.

        Raises
        ------
        BeamdaeError
            If there is no such node.
        """
        node = require_count(self.name, "node", node, least=0, most=len(self.nodes) - 1)
        first, (x, y) = node * self._node_size, self.nodes[node]
        arm = (x - self.center[0], y - self.center[1])
        rows = self.shapes[first : first + self._node_size]
        has_angle = self._node_size > 2
        motion = Formula(_NodeMotion(self._count, has_angle), (*arm, *rows.ravel()))
        return Attachment(self, (x, y), 0.0, self._all_rows, motion, has_angle)

    def recover(self, matrix: Any, names: Sequence[str], unit: str = "Pa") -> Quantity:
        """Return stresses or other values that are linear in the displacements of the nodes.

        Parameters
        ----------
        matrix
            Values by displacements relative to the frame, in its axes, (len(names), n), such as the
            stress matrix of a finite-element program.
        names
            Names of the columns.
        unit
            Unit of the columns.

        Raises
        ------
        BeamdaeError
            If the matrix has another shape, or a name or the unit is invalid.
        """
        headers = require_names(self.name, "names", names, "a list of names of columns")
        rows = require_matrix(self.name, "matrix", matrix)
        if rows.shape != (len(headers), self.mass.shape[0]):
            raise BeamdaeError(
                f"{self.name}: matrix must have the shape {(len(headers), self.mass.shape[0])}, a "
                f"row for each name and a column for each displacement, got {rows.shape}."
            )
        unit = require_unit(self.name, unit)
        columns = tuple(Variable(x, unit) for x in headers)
        data = (rows @ self.shapes).ravel()
        return Quantity(columns, (Piece(self, self._all_rows),), _recover, data)

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """Return a line through the attached nodes, or through the first and the last node."""
        line = list(attached)
        return Drawing(
            "rigid", line if len(line) > 1 else [self.at(0), self.at(len(self.nodes) - 1)]
        )


@dataclass(frozen=True)
class _NodeMotion:
    """Motion of a node; `numbers` are its arm, and the rows of its shapes."""

    count: int
    has_angle: bool

    def __call__(self, q: SX, numbers: Any) -> tuple[SX, SX]:
        count = (2 + self.has_angle) * self.count
        rows = ca.reshape(ca.vertcat(*(numbers[2 + k] for k in range(count))), self.count, -1)
        moved = rows.T @ q[_FRAME:]
        place = ca.vertcat(numbers[0], numbers[1]) + moved[:2]
        return q[:2] + rotate(q[2], place), q[2] + (moved[2] if self.has_angle else 0)


def _recover(local: Local) -> SX:
    shape = local.size - _FRAME, local.n_data // (local.size - _FRAME)
    return ca.reshape(local.data, *shape).T @ local.q[_FRAME:]


@cache_kernels
def _body_kernel(count: int) -> ForceKernel:
    """Return the kernel of a body with `count` shapes, from Lagrange's equations.

    The data are the `_inertia`, the stiffness by modal coordinates, the retardation time, and
    gravity.
    """
    size = _FRAME + 2 * count
    local = Local(_FRAME + count, size**2 + count**2 + 3)
    q, v, modal = local.q, local.v, local.q[_FRAME:]
    inertia = ca.reshape(local.data[: size**2], size, size)
    stiffness = ca.reshape(local.data[size**2 : size**2 + count**2], count, count)
    time, gravity = local.data[-3], local.data[-2:]
    # Velocity in the frame, angular velocity, this times modal coordinates, and their rates.
    velocities = ca.vertcat(rotate(-q[2], v[:2]), v[2], v[2] * modal, v[_FRAME:])
    momenta = inertia @ velocities
    momentum = ca.jtimes(velocities, v, momenta, True)
    force = ca.jtimes(momentum, q, v) + ca.jtimes(momentum, v, local.a)
    force -= ca.jtimes(velocities, q, momenta, True)
    center = inertia[0, 0] * q[:2] + rotate(q[2], inertia[:2, _FRAME + count :] @ modal)
    weight = -ca.dot(gravity, center)
    elastic, viscous = stiffness @ modal, time * (stiffness @ v[_FRAME:])
    force += ca.gradient(weight, q) + ca.vertcat(SX.zeros(_FRAME), elastic + viscous)
    energies = ca.vertcat(0.5 * ca.dot(velocities, momenta), 0.5 * ca.dot(modal, elastic), weight)
    powers = ca.vertcat(0, ca.dot(viscous, v[_FRAME:]))
    return ForceKernel(local, force, energies, powers, reused=True)
