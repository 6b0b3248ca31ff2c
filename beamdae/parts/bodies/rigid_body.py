"""The ground and rigid bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import (
    BeamdaeError,
    require_finite,
    require_name,
    require_point,
    require_positive,
    require_sequence,
    set_fields,
)
from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.bodies import plane_shapes as body_shapes
from beamdae.parts.part import Drawing, Part
from beamdae.symbolic.formulas import Formula
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Named, Piece

Array = np.ndarray


_NO_ROWS = sp.csr_array((0, 0))
_ALL_ROWS = sp.eye_array(3, format="csr")


def _fixed(q: SX, place: Any) -> tuple[SX, SX]:
    return ca.vertcat(SX(place[0]), place[1]), SX(0)


def _carried(q: SX, arm: Any) -> tuple[SX, SX]:
    return q[:2] + rotate(q[2], arm), q[2]


@cache
def _rigid() -> ForceKernel:
    """Inertia and weight of a rigid body; data: mass, inertia, gravity."""
    local = Local(3, 4)
    mass, inertia, weight = local.data[0], local.data[1], local.data[2:]
    force = ca.vertcat(mass * (local.a[:2] - weight), inertia * local.a[2])
    kinetic = 0.5 * (mass * ca.sumsqr(local.v[:2]) + inertia * local.v[2] ** 2)
    energies = ca.vertcat(kinetic, 0, -mass * ca.dot(weight, local.q[:2]))
    return ForceKernel(local, force, energies, reused=True)


@dataclass(frozen=True, eq=False)
class Ground(Part):
    """The inertial frame; it has no coordinates."""

    name: str = "ground"

    def at(self, x: float, y: float) -> Attachment:
        """The fixed point (x, y) [m]."""
        place = require_point(self.name, "point", (x, y))
        return Attachment(self, place, 0.0, _NO_ROWS, Formula(_fixed, place))

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """The fixed points something is attached to."""
        return Drawing("ground", list(attached))


@dataclass(frozen=True, eq=False)
class RigidBody(Part):
    """Rigid body with the coordinates (x, y, angle) of its center of mass.

    Parameters
    ----------
    name
        Unique name.
    mass
        Mass [kg].
    inertia
        Moment of inertia about the center of mass [kg m^2].
    center
        Center of mass in the reference drawing [m]; the angle is zero there.
    velocity, angular_velocity
        At the start [m/s], [rad/s]; made consistent with the joints.
    shape
        Points it is drawn through, of the reference drawing [m]; without any, through the points
        where something is attached.

    `rod`, `disk`, `plate` and `polygon` find mass, center and inertia from a shape.

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
    velocity: tuple[float, float] = (0.0, 0.0)
    angular_velocity: float = 0.0
    shape: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        corners = require_sequence(self.name, "shape", self.shape, "points (x, y)")
        set_fields(
            self,
            shape=tuple(
                require_point(self.name, f"shape point {k}", x) for k, x in enumerate(corners)
            ),
            name=require_name("RigidBody", self.name),
            mass=require_positive(self.name, "mass", self.mass),
            inertia=require_positive(self.name, "inertia", self.inertia),
            center=require_point(self.name, "center", self.center),
            velocity=require_point(self.name, "velocity", self.velocity),
            angular_velocity=require_finite(self.name, "angular_velocity", self.angular_velocity),
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
        """Thin rod between two points [m], of `mass` [kg] or of `density` [kg/m^3] and `area`.

        `start` are `velocity` and `angular_velocity`, also of the shapes below.
        """
        name = require_name("RigidBody.rod", name)
        return cls._of(name, body_shapes.rod(name, a, b, mass, density, area), start)

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
        """Solid disk, of `mass` [kg] or of `density` [kg/m^3] and `thickness` [m]."""
        name = require_name("RigidBody.disk", name)
        found = body_shapes.disk(name, center, radius, mass, density, thickness)
        return cls._of(name, found, start)

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
        """Rectangle of `width` along the direction `angle` [rad] and `height` across it [m].

        Of `mass` [kg], or of `density` [kg/m^3] and `thickness` [m].
        """
        name = require_name("RigidBody.plate", name)
        angle = require_finite(name, "angle", angle)
        found = body_shapes.plate(name, center, width, height, angle, mass, density, thickness)
        return cls._of(name, found, start)

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
        """Polygon through its corners `points` [m], in either order around it.

        Of `mass` [kg], or of `density` [kg/m^3] and `thickness` [m].

        Examples
        --------
        >>> import beamdae as bd
        >>> corners = [(0.0, 0.0), (0.3, 0.0), (0.0, 0.3)]
        >>> gusset = bd.RigidBody.polygon("gusset", corners, density=7850.0, thickness=0.01)
        >>> [round(x, 6) for x in (gusset.mass, *gusset.center)]
        [3.5325, 0.1, 0.1]
        """
        name = require_name("RigidBody.polygon", name)
        return cls._of(name, body_shapes.polygon(name, points, mass, density, thickness), start)

    @classmethod
    def _of(cls, name: str, shape: body_shapes.Shape, start: dict[str, Any]) -> RigidBody:
        others = sorted(start.keys() - {"velocity", "angular_velocity"})
        if others:
            raise BeamdaeError(
                f"{name}: of a shape only velocity and angular_velocity are set as well, "
                f"got {', '.join(others)}."
            )
        mass, inertia, center, outline = shape
        return cls(name, mass, inertia, center, shape=outline, **start)

    @property
    def coordinates(self) -> tuple[Named, ...]:
        """Place of the center of mass, and angle."""
        return (Named("x", "m"), Named("y", "m"), Named("angle", "rad"))

    @property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing."""
        return np.array([*self.center, 0.0])

    @property
    def initial_velocity(self) -> Array:
        """Their rates at the start."""
        return np.array([*self.velocity, self.angular_velocity])

    @property
    def outline(self) -> Array:
        """The shape, or the center of mass."""
        return np.array(self.shape or [self.center])

    def at(self, x: float, y: float) -> Attachment:
        """The material point at (x, y) of the reference drawing [m]."""
        place = require_point(self.name, "point", (x, y))
        arm = (place[0] - self.center[0], place[1] - self.center[1])
        return Attachment(self, place, 0.0, _ALL_ROWS, Formula(_carried, arm))

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Inertia and weight."""
        data = np.array([[self.mass], [self.inertia], [gravity[0]], [gravity[1]]])
        return [ForceStatement(self.name, _rigid(), (Piece(self, _ALL_ROWS),), data)]

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """The shape, or where something is attached, with the center if that is one point."""
        if self.shape:
            return Drawing("rigid", [self.at(*place) for place in self.shape])
        places = list(attached)
        center = self.at(*self.center)
        if len(places) < 2 and center.point not in {a.point for a in places}:
            places.append(center)
        return Drawing("rigid", places)
