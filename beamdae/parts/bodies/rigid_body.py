"""The ground and rigid bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    optional,
    require_finite,
    require_name,
    require_point,
    require_positive,
    require_sequence,
    set_fields,
)
from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.bodies import plane_shapes
from beamdae.parts.part import Drawing, Part
from beamdae.read_only import read_only
from beamdae.symbolic.formula import Formula, cache_kernels
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Piece, Variable

Array = np.ndarray

_NO_ROWS = read_only(sp.csr_array((0, 0)))
_ALL_ROWS = read_only(sp.eye_array(3, format="csr"))


def _fixed_point(q: SX, point: Any) -> tuple[SX, SX]:
    return ca.vertcat(SX(point[0]), point[1]), SX(0)


def _body_point(q: SX, arm: Any) -> tuple[SX, SX]:
    return q[:2] + rotate(q[2], arm), q[2]


@cache_kernels
def _rigid_body_kernel() -> ForceKernel:
    """Return the inertia and weight of a rigid body; the data are mass, inertia and gravity."""
    local = Local(3, 4)
    mass, inertia, gravity = local.data[0], local.data[1], local.data[2:]
    force = ca.vertcat(mass * (local.a[:2] - gravity), inertia * local.a[2])
    kinetic = 0.5 * (mass * ca.sumsqr(local.v[:2]) + inertia * local.v[2] ** 2)
    energies = ca.vertcat(kinetic, 0, -mass * ca.dot(gravity, local.q[:2]))
    return ForceKernel(local, force, energies, reused=True)


@dataclass(frozen=True, eq=False)
class Ground(Part):
    """Inertial frame, without coordinates."""

    name: str = "ground"

    point_syntax = "mech.ground.at(x, y)"

    def at(self, x: float, y: float) -> Attachment:
        """Return the fixed point (x, y).

        Parameters
        ----------
        x, y
            Position in the inertial frame [m].

        Returns
        -------
        Attachment
            The point, for joints, forces and observables.

        Raises
        ------
        BeamdaeError
            If `x` or `y` is not a finite number.
        """
        point = require_point(self.name, "point", (x, y))
        return Attachment(self, point, 0.0, _NO_ROWS, Formula(_fixed_point, point))

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """Return the drawing of the fixed points to which other parts refer."""
        return Drawing("ground", list(attached))


@dataclass(frozen=True, eq=False)
class RigidBody(Part):
    """Rigid body with the position (x, y) of the center of mass and the angle as coordinates.

    `rod`, `disk`, `plate` and `polygon` compute mass, center and inertia from a shape.

    Parameters
    ----------
    name
        Unique name.
    mass
        Mass [kg].
    inertia
        Moment of inertia about the center of mass [kg m^2].
    center
        Center of mass (x, y) [m] in the reference configuration, in which the angle is zero.
    velocity, angular_velocity
        Initial velocity of the center of mass [m/s] and initial angular velocity [rad/s]. Values
        that are given, also zero, are kept if the joints allow it, and the connected bodies move
        with them. By default (None), the body follows the joints.
    shape
        Points (x, y) of the outline in the reference configuration [m], for drawings and for the
        size of the body. If empty (default), drawings show a line through the points at which parts
        are attached.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `mass` or `inertia` is not positive, another number is not finite, or
        `center`, `velocity` or a point of `shape` is not a pair of numbers.

    Examples
    --------
    >>> import beamdae as bd
    >>> wheel = bd.RigidBody("wheel", mass=2.0, inertia=0.05, center=(0.0, 0.3))
    >>> bar = bd.RigidBody.rod("bar", (0.0, 0.0), (1.0, 0.0), density=7850.0, area=1e-4)
    >>> round(bar.mass, 3)
    0.785
    """

    name: str
    mass: float
    inertia: float
    center: tuple[float, float] = (0.0, 0.0)
    velocity: tuple[float, float] | None = None
    angular_velocity: float | None = None
    shape: tuple[tuple[float, float], ...] = ()

    point_syntax = "its .at(x, y)"

    def __post_init__(self) -> None:
        corners = require_sequence(self.name, "shape", self.shape, "points (x, y)")
        convert_fields(
            self,
            mass=require_positive,
            inertia=require_positive,
            center=require_point,
            velocity=optional(require_point),
            angular_velocity=optional(require_finite),
        )
        set_fields(
            self,
            shape=tuple(
                require_point(self.name, f"shape point {k}", x) for k, x in enumerate(corners)
            ),
        )

    @classmethod
    def rod(
        cls,
        name: str,
        a: tuple[float, float],
        b: tuple[float, float],
        mass: float | None = None,
        density: float | None = None,
        area: float | None = None,
        **start: Any,
    ) -> RigidBody:
        """Return a thin straight rod; mass m and length l give the inertia m l^2 / 12.

        Parameters
        ----------
        name
            Unique name.
        a, b
            End points (x, y) in the reference configuration [m].
        mass
            Mass [kg]; alternatively, give density and area.
        density
            Density [kg/m^3].
        area
            Area of the cross-section [m^2].
        **start
            Initial `velocity` [m/s] and `angular_velocity` [rad/s].

        Raises
        ------
        BeamdaeError
            If the points coincide, a value is invalid, an unknown argument is given, or the
            arguments are neither the mass alone nor both density and area.
        """
        name = require_name("RigidBody.rod", name)
        shape = plane_shapes.rod(name, a, b)
        return cls._from_shape(name, shape, start, mass, density, area, "area")

    @classmethod
    def disk(
        cls,
        name: str,
        center: tuple[float, float],
        radius: float,
        mass: float | None = None,
        density: float | None = None,
        thickness: float | None = None,
        **start: Any,
    ) -> RigidBody:
        """Return a solid disk; mass m and radius r give the inertia m r^2 / 2.

        Parameters
        ----------
        name
            Unique name.
        center
            Center (x, y) in the reference configuration [m].
        radius
            Radius [m].
        mass
            Mass [kg]; alternatively, give density and thickness.
        density
            Density [kg/m^3].
        thickness
            Thickness [m].
        **start
            Initial `velocity` [m/s] and `angular_velocity` [rad/s].

        Raises
        ------
        BeamdaeError
            If a value is invalid, an unknown argument is given, or the arguments are neither the
            mass alone nor both density and thickness.
        """
        name = require_name("RigidBody.disk", name)
        shape = plane_shapes.disk(name, center, radius)
        return cls._from_shape(name, shape, start, mass, density, thickness)

    @classmethod
    def plate(
        cls,
        name: str,
        center: tuple[float, float],
        width: float,
        height: float,
        angle: float = 0.0,
        mass: float | None = None,
        density: float | None = None,
        thickness: float | None = None,
        **start: Any,
    ) -> RigidBody:
        """Return a rectangular plate.

        Mass m, width w and height h give the inertia m (w^2 + h^2) / 12.

        Parameters
        ----------
        name
            Unique name.
        center
            Center (x, y) in the reference configuration [m].
        width, height
            Lengths of the sides along and across the direction `angle` [m].
        angle
            Direction of the width in the reference configuration [rad].
        mass
            Mass [kg]; alternatively, give density and thickness.
        density
            Density [kg/m^3].
        thickness
            Thickness [m].
        **start
            Initial `velocity` [m/s] and `angular_velocity` [rad/s].

        Raises
        ------
        BeamdaeError
            If a value is invalid, an unknown argument is given, or the arguments are neither the
            mass alone nor both density and thickness.
        """
        name = require_name("RigidBody.plate", name)
        shape = plane_shapes.plate(name, center, width, height, angle)
        return cls._from_shape(name, shape, start, mass, density, thickness)

    @classmethod
    def polygon(
        cls,
        name: str,
        points: Sequence[tuple[float, float]],
        mass: float | None = None,
        density: float | None = None,
        thickness: float | None = None,
        **start: Any,
    ) -> RigidBody:
        """Return a polygonal plate; mass, center and inertia follow from Green's theorem.

        Parameters
        ----------
        name
            Unique name.
        points
            Corners (x, y) in the reference configuration [m], in either orientation.
        mass
            Mass [kg]; alternatively, give density and thickness.
        density
            Density [kg/m^3].
        thickness
            Thickness [m].
        **start
            Initial `velocity` [m/s] and `angular_velocity` [rad/s].

        Raises
        ------
        BeamdaeError
            If the corners are fewer than 3, enclose no area, repeat or are not in order around the
            polygon, a value is invalid, an unknown argument is given, or the arguments are neither
            the mass alone nor both density and thickness.

        Examples
        --------
        >>> import beamdae as bd
        >>> corners = [(0.0, 0.0), (0.3, 0.0), (0.0, 0.3)]
        >>> gusset = bd.RigidBody.polygon("gusset", corners, density=7850.0, thickness=0.01)
        >>> [round(x, 6) for x in (gusset.mass, *gusset.center)]
        [3.5325, 0.1, 0.1]
        """
        name = require_name("RigidBody.polygon", name)
        shape = plane_shapes.polygon(name, points)
        return cls._from_shape(name, shape, start, mass, density, thickness)

    @classmethod
    def _from_shape(
        cls, name: str, shape: plane_shapes.Shape, start: dict[str, Any], *mass_or_density: Any
    ) -> RigidBody:
        mass = shape.mass_of(name, *mass_or_density)
        unknown = sorted(start.keys() - {"velocity", "angular_velocity"})
        if unknown:
            raise BeamdaeError(
                f"{name}: a shape accepts only velocity and angular_velocity besides "
                f"the dimensions, got {', '.join(unknown)}."
            )
        return cls(name, mass, mass * shape.gyration2, shape.center, shape=shape.outline, **start)

    @property
    def coordinates(self) -> tuple[Variable, ...]:
        """Name and unit of the position (x, y) of the center of mass and of the angle."""
        return (Variable("x", "m"), Variable("y", "m"), Variable("angle", "rad"))

    @property
    def initial_position(self) -> Array:
        """Center of mass [m] in the reference configuration, and angle 0 [rad], shape (3,)."""
        return np.array([*self.center, 0.0])

    @property
    def initial_velocity(self) -> Array:
        """Initial velocity [m/s] and angular velocity [rad/s], shape (3,)."""
        return np.array([*(self.velocity or (0.0, 0.0)), self.angular_velocity or 0.0])

    @property
    def outline(self) -> Array:
        """Points of the shape, or the center of mass if there is no shape, (k, 2) [m]."""
        return np.array(self.shape or [self.center])

    def at(self, x: float, y: float) -> Attachment:
        """Return the material point at (x, y) in the reference configuration.

        The point need not lie inside the shape.

        Parameters
        ----------
        x, y
            Position in the reference configuration [m].

        Returns
        -------
        Attachment
            The point, for joints, forces and observables.

        Raises
        ------
        BeamdaeError
            If `x` or `y` is not a finite number.
        """
        point = require_point(self.name, "point", (x, y))
        arm = (point[0] - self.center[0], point[1] - self.center[1])
        return Attachment(self, point, 0.0, _ALL_ROWS, Formula(_body_point, arm))

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Return inertia and weight as one statement."""
        data = np.array([[self.mass], [self.inertia], [gravity[0]], [gravity[1]]])
        return [ForceStatement(self.name, _rigid_body_kernel(), (Piece(self, _ALL_ROWS),), data)]

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """Return the drawing of the shape or, without a shape, of a line through the attachments.

        Lines join attachments outside the shape to it. Without a shape, if there is at most one
        attachment, the line ends at the center of mass.
        """
        if self.shape:
            outline = _join(self.shape, self.center, [x.point for x in attached])
            return Drawing("rigid", [self.at(*point) for point in outline])
        line = list(attached)
        center = self.at(*self.center)
        if len(line) < 2 and center.point not in {attachment.point for attachment in line}:
            line.append(center)
        return Drawing("rigid", line)


def _join(outline: Any, center: Any, points: Sequence[Any]) -> Any:
    """Return an outline with lines to the points outside, from the nearest points of its edges."""
    for point in np.reshape(points, (-1, 2)):
        starts = np.array(outline)
        edges = np.roll(starts, -1, axis=0) - starts
        shares = ((point - starts) * edges).sum(1) / np.maximum(
            (edges**2).sum(1), np.finfo(float).tiny
        )
        feet = starts + np.clip(shares, 0.0, 1.0)[:, None] * edges
        distances = np.hypot(*(point - feet).T)
        k = int(np.argmin(distances))
        # The nearest point of a convex outline lies between an outer point and the center.
        if (point - feet[k]) @ (center - feet[k]) <= 0.0 < distances[k]:
            outline = np.insert(starts, k + 1, [feet[k], point, feet[k]], axis=0)
    return outline
