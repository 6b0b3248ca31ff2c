"""Flexible bodies from mass and stiffness matrices of finite-element programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

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
)
from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.bodies.craig_bampton import (
    RIGID_COUNT,
    center_of_mass,
    find_modes,
    require_free_body,
    require_matrix,
    require_positive_stiffness,
    rigid_motions,
    unit_mass_factors,
)
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
    def rigid_coordinate_count(self) -> int:
        """Number of leading coordinates of a rigid motion, 3."""
        return _FRAME

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
