"""Joints between two attachments; hinge and weld."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, convert_fields
from beamdae.parts.attachments import (
    Attachment,
    largest_distance,
    require_angle,
    require_attachment,
)
from beamdae.parts.joints.kinematic_constraint import KinematicConstraint
from beamdae.parts.point_parts import PlacedPoint
from beamdae.symbolic.statements import SX, Variable

# Relative to the size of the bodies; allows for coordinates rounded by hand.
_MEETING_TOLERANCE = 1e-6


def meeting_tolerance(a: Attachment, b: Attachment) -> float:
    """Return the distance [m] up to which two points are considered coincident."""
    points = np.concatenate([[a.point, b.point], a.body.outline, b.body.outline])
    size = largest_distance(points) or max(1.0, float(np.max(np.abs(points))))
    return _MEETING_TOLERANCE * size


def require_meeting(part: str, a: Attachment, b: Attachment) -> None:
    """Raise BeamdaeError unless two points coincide in the reference configuration."""
    distance = float(np.hypot(*np.subtract(b.point, a.point)))
    # Most points coincide exactly; then the sizes of the bodies are not needed.
    if distance > 0.0 and distance > meeting_tolerance(a, b):
        raise BeamdaeError(
            f"{part}: the two points must coincide in the reference configuration, but "
            f"{a} and {b} are {distance:.6g} m apart."
        )


@dataclass(frozen=True, eq=False)
class Joint(KinematicConstraint):
    """Constraint between two attachments; the base class of most joints.

    A joint is defined by its gap function g, which is zero while the joint is closed. The
    constraint kernel, g', g'', reactions and switching by events follow from g. Subclasses are
    frozen dataclasses that define

    - `gap`, a static method `gap(t, a, b, *gap_parameters, *law_values)` that returns g, a CasADi
      SX with one row for each constraint. `a` and `b` are the attachments in the current
      configuration: `position` (x, y) in the inertial frame [m] and `rotation` from the reference
      configuration [rad].
    - `multipliers`, a `Variable` for each row of g: the name of the constraint, and the unit of
      its multiplier, "N" or "N m".
    - `reactions`, the column name of each multiplier in `reaction`.
    - `gap_parameters`, if g depends on numbers: joints that differ only in these numbers share one
      kernel. If `gap` is an ordinary method, the method may read the numbers from `self` instead; a
      kernel is then built for each joint.
    - `laws`, if g depends on time laws.
    - `points`, if the joint constrains more than two attachments.
    - `symbol`, to draw the joint with the symbol of another joint, such as "link" or "hinge".
    - `slide_direction`, if the joint is a guide that can have `Friction`.
    - `slip`, instead of `gap` or in addition to it, for a constraint that is imposed on velocities
      only, such as a nonholonomic one: a static method with the arguments of `gap`, whose points
      also have a `velocity` [m/s] and an `angular_velocity` [rad/s]. The slip must be linear in
      these velocities.

    Sign convention: `reaction` is -lambda, where G^T lambda enters the equations of motion
    M a - f + G^T lambda = 0 (mass matrix M, accelerations a, forces f, Jacobian G of g). The
    reaction acts on the body of `b` in the direction in which g grows; its power is the reaction
    times g'. With g = |r_b - r_a| - L, a positive reaction pushes the points apart (compression is
    positive); with g = L - |r_b - r_a|, tension is positive.

    Parameters
    ----------
    name
        Unique name.
    a, b
        Attachments of two different bodies, one of which may be the ground.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment, or both belong to the same body.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import beamdae as bd
    >>> import casadi as ca
    >>> from beamdae.symbolic.statements import Variable
    >>> @dataclass(frozen=True, eq=False)
    ... class Pantograph(bd.Joint):
    ...     '''Point b moves as a magnified copy of point a, about the origin.'''
    ...     scale: float = 2.0
    ...     multipliers = (Variable("x", "N"), Variable("y", "N"))
    ...     reactions = ("Fx", "Fy")
    ...     @property
    ...     def gap_parameters(self):
    ...         return (self.scale,)
    ...     @staticmethod
    ...     def gap(t, a, b, scale):
    ...         return b.position - scale * a.position
    """

    symbol = "joint"
    # Points that must not belong to particles.
    _with_angle: ClassVar[tuple[str, ...]] = ()
    name: str
    a: Attachment
    b: Attachment

    def __post_init__(self) -> None:
        convert_fields(self)
        require_attachment(self.name, "first attachment", self.a)
        require_attachment(self.name, "second attachment", self.b)
        if self.a.body is self.b.body:
            raise BeamdaeError(
                f"{self.name}: a joint must connect two different bodies, but both "
                f"attachments belong to {self.a.body.name!r}."
            )
        for point in self._with_angle:
            require_angle(self.name, getattr(self, point))

    @property
    def points(self) -> dict[str, Attachment]:
        """Constrained attachments in argument order, by their names in `reaction_on`."""
        return {"a": self.a, "b": self.b}

    @property
    def slide_direction(self) -> tuple[float, float] | None:
        """Direction (x, y) in which `b` slides on the body of `a` in the reference configuration.

        `Friction` in a guide requires this direction. None for joints that are not guides.
        """
        return None


@dataclass(frozen=True, eq=False)
class Revolute(Joint):
    """Hinge: a common point of two bodies that rotate freely, g = r_b - r_a.

    r_a and r_b are the positions of the points. The reactions Fx and Fy are the components of the
    force on the body of `b` in the inertial frame.

    Parameters
    ----------
    name
        Unique name.
    a, b
        Points of two different bodies, one of which may be the ground. The points must coincide in
        the reference configuration, with a tolerance of 1e-6 times the size of the bodies.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment, both belong to the same body, or the
        points do not coincide in the reference configuration.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> bob = mech.add(bd.RigidBody("bob", mass=1.0, inertia=0.1, center=(1.0, 0.0)))
    >>> hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    >>> mech.observe("hinge", hinge.reaction)
    """

    symbol = "hinge"
    multipliers = (Variable("x", "N"), Variable("y", "N"))
    reactions = ("Fx", "Fy")

    def __post_init__(self) -> None:
        super().__post_init__()
        require_meeting(self.name, self.a, self.b)

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint) -> SX:
        """Return the gap r_b - r_a [m]."""
        return b.position - a.position

    @property
    def _offset_carrier(self) -> str:
        """Name of point `a`, or of `b` if `a` belongs to a particle, which has no axes."""
        return "a" if self.a.has_angle else "b"


@dataclass(frozen=True, eq=False)
class Weld(Joint):
    """Rigid connection of two bodies, g = (r_b - r_a, rotation_b - rotation_a).

    r_a and r_b are the positions of the points. Rotations are measured from the reference
    configuration, so bodies may meet at any angle. The reactions Fx, Fy and M are the components of
    the force on the body of `b` in the inertial frame, and the moment on this body.

    Parameters
    ----------
    name
        Unique name.
    a, b
        Points of two different bodies, one of which may be the ground; neither may be a particle.
        The points must coincide in the reference configuration, with a tolerance of 1e-6 times the
        size of the bodies.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment or is a particle, both belong to the
        same body, or the points do not coincide in the reference configuration.
    """

    _with_angle = ("a", "b")
    symbol = "weld"
    multipliers = (Variable("x", "N"), Variable("y", "N"), Variable("angle", "N m"))
    reactions = ("Fx", "Fy", "M")

    def __post_init__(self) -> None:
        super().__post_init__()
        require_meeting(self.name, self.a, self.b)

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint) -> SX:
        """Return the gap r_b - r_a [m] and the relative rotation [rad]."""
        return ca.vertcat(b.position - a.position, b.rotation - a.rotation)

    @property
    def _offset_carrier(self) -> str:
        """Name of point `a`, whose axes carry the offset of a frozen gap."""
        return "a"
