"""The ground, rigid bodies and their shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

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
from beamdae.parts.part import Drawing, Part
from beamdae.read_only import read_only
from beamdae.symbolic.formula import Formula, cache_kernels
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Piece, Variable

# Number of segments of a circle in drawings.
_CIRCLE_SEGMENTS = 48
# Smallest area of a polygon, relative to its bounding box; smaller areas are rounding errors.
_MIN_AREA_RATIO = 1e-12


class Shape(NamedTuple):
    """Plane shape of a rigid body.

    Attributes
    ----------
    area
        Area [m^2]; for a rod, the length [m].
    gyration2
        Inertia about the center of mass, divided by the mass [m^2].
    center
        Center of mass [m].
    outline
        Points of the outline [m].
    """

    area: float
    gyration2: float
    center: tuple[float, float]
    outline: tuple[tuple[float, float], ...]

    def mass_of(
        self, part: str, mass: Any, density: Any, thickness: Any, name: str = "thickness"
    ) -> float:
        """Return `mass` [kg], or the density [kg/m^3] times the volume.

        Parameters
        ----------
        part
            Name of the body, for messages.
        mass, density, thickness
            None if not given. For a rod, `thickness` is the area of the cross-section [m^2].
        name
            Name of the argument `thickness` in messages.

        Raises
        ------
        BeamdaeError
            If the values are neither the mass alone nor both density and thickness, or a value is
            not positive.
        """
        if (mass is None) == (density is None) or (density is None) != (thickness is None):
            raise BeamdaeError(f"{part}: pass either mass=, or both density= and {name}=.")
        if mass is not None:
            return require_positive(part, "mass", mass)
        return (
            require_positive(part, "density", density)
            * require_positive(part, name, thickness)
            * self.area
        )


def _measure_polygon(part: str, points: Any) -> Shape:
    """Return a polygonal plate with corners in either orientation.

    The mass properties follow from Green's theorem.

    Raises
    ------
    BeamdaeError
        If the corners are fewer than 3, enclose no area, repeat or are not in order around the
        polygon.
    """
    entries = require_sequence(part, "points", points, "at least 3 pairs (x, y)")
    if len(entries) < 3:
        raise BeamdaeError(f"{part}: points must be at least 3 pairs (x, y), got {len(entries)}.")
    corners = np.array([require_point(part, f"point {k}", xy) for k, xy in enumerate(entries)])
    # Relative to the mean of the corners, to avoid cancellation for a body far from the origin.
    middle = corners.mean(axis=0)
    x, y = (corners - middle).T
    nx, ny = np.roll(x, -1), np.roll(y, -1)
    cross = x * ny - nx * y
    size = float(np.ptp(x)) * float(np.ptp(y))
    area = 0.5 * float(cross.sum())
    if not abs(area) > _MIN_AREA_RATIO * size:
        raise BeamdaeError(f"{part}: points must enclose an area, got {area:g} m^2.")
    _require_simple(part, corners)
    center = np.array([((x + nx) * cross).sum(), ((y + ny) * cross).sum()]) / (6.0 * area)
    polar = float(((x * x + x * nx + nx * nx + y * y + y * ny + ny * ny) * cross).sum()) / 12.0
    gyration2 = polar / area - float(center @ center)
    cx, cy = (center + middle).tolist()
    return Shape(abs(area), gyration2, (cx, cy), tuple(map(tuple, corners.tolist())))


def _require_simple(part: str, corners: Array) -> None:
    """Raise BeamdaeError if corners repeat, or edges meet at points other than common corners."""
    edges = np.roll(corners, -1, axis=0) - corners
    if (repeated := np.flatnonzero(~edges.any(axis=1))).size:
        x, y = corners[repeated[0]]
        raise BeamdaeError(
            f"{part}: the point ({x:g}, {y:g}) m is repeated; give each corner once."
        )
    # Rows: edges; columns: edges whose start and end are left (1), right (-1) or on the line (0).
    starts = np.sign(_cross(edges[:, None], corners - corners[:, None]))
    ends = np.roll(starts, -1, axis=1)
    low, high = (f(corners, corners + edges) for f in (np.minimum, np.maximum))
    overlap = np.all((low[:, None] <= high) & (low <= high[:, None]), axis=-1)
    meet = (starts * ends <= 0.0) & (starts * ends <= 0.0).T & overlap
    n = len(corners)
    distance = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    # Neighbors share a corner; they overlap if the second one goes back.
    folds = (starts == 0.0) & (ends == 0.0) & (edges @ edges.T < 0.0)
    meet = np.where((distance > 1) & (distance < n - 1), meet, folds)
    pairs = np.argwhere(np.triu(meet, 1))
    if len(pairs):
        a, c = corners[pairs[0]]
        raise BeamdaeError(
            f"{part}: the edges that begin at ({a[0]:g}, {a[1]:g}) m and ({c[0]:g}, "
            f"{c[1]:g}) m meet; list the points in order around the polygon."
        )


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


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
        first, last = require_point(name, "a", a), require_point(name, "b", b)
        length = float(np.hypot(*np.subtract(last, first)))
        if length == 0.0:
            raise BeamdaeError(f"{name}: a and b must differ, but both are {first} m.")
        center = 0.5 * (first[0] + last[0]), 0.5 * (first[1] + last[1])
        shape = Shape(length, length**2 / 12.0, center, (first, last))
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
        x, y = require_point(name, "center", center)
        radius = require_positive(name, "radius", radius)
        angle = 2.0 * np.pi * np.arange(_CIRCLE_SEGMENTS) / _CIRCLE_SEGMENTS
        rim = np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=-1)
        # The radius to the first corner shows the rotation of the disk.
        outline = ((x, y), *map(tuple, rim.tolist()), tuple(rim[0].tolist()))
        shape = Shape(np.pi * radius**2, 0.5 * radius**2, (x, y), outline)
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
        angle = require_finite(name, "angle", angle)
        x, y = require_point(name, "center", center)
        width = require_positive(name, "width", width)
        height = require_positive(name, "height", height)
        c, s = np.cos(angle), np.sin(angle)
        corners = 0.5 * np.array(
            [(-width, -height), (width, -height), (width, height), (-width, height)]
        )
        rotated = corners @ np.array([(c, s), (-s, c)]) + (x, y)
        outline = tuple(map(tuple, rotated.tolist()))
        shape = Shape(width * height, (width**2 + height**2) / 12.0, (x, y), outline)
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
        shape = _measure_polygon(name, points)
        return cls._from_shape(name, shape, start, mass, density, thickness)

    @classmethod
    def _from_shape(
        cls, name: str, shape: Shape, start: dict[str, Any], *mass_or_density: Any
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
