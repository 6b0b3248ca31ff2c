"""Joints: constraints between attachments from a gap or a slip function; hinge and weld."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MethodType
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, convert_fields
from beamdae.parts.attachments import (
    Attachment,
    largest_distance,
    require_angle,
    require_attachment,
)
from beamdae.parts.laws import Law
from beamdae.parts.part import PlacedPoint, PointPart
from beamdae.symbolic.formula import Formula, constant_formula
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    NonholonomicKernel,
    Quantity,
    Variable,
    formula_quantity,
    rebuilt_for_mesh,
)


class MovingPoint(NamedTuple):
    """Attachment with its velocities, as passed to a slip function.

    Attributes
    ----------
    position, rotation
        As in `PlacedPoint`.
    velocity
        Rate of the position [m/s], a column.
    angular_velocity
        Rate of the rotation [rad/s].
    """

    position: SX
    rotation: SX
    velocity: SX
    angular_velocity: SX


@dataclass(frozen=True)
class GapFormula:
    """A gap function as a formula of placed points.

    The other functions are a formula that returns the parameters, and the laws.

    Attributes
    ----------
    function
        Function (t, *points, *parameters, *values of the laws) -> SX.
    """

    function: Callable[..., SX]
    kernel: ClassVar[type[ConstraintKernel]] = ConstraintKernel

    def __call__(
        self, local: Local, points: Sequence[Any], parameters: Formula, *laws: Callable[[SX], SX]
    ) -> SX:
        """Return the gap."""
        numbers = ca.vertsplit(ca.vec(SX(parameters())))
        values = (law(local.time) for law in laws)
        return self.function(local.time[0], *points, *numbers, *values)


class _SlipFormula(GapFormula):
    """A slip function as a formula of placed points, to which it adds their velocities."""

    kernel = NonholonomicKernel

    def __call__(self, local: Local, points: Sequence[Any], *functions: Any) -> SX:
        moving = [MovingPoint(*x, *map(local.dot, x)) for x in points]
        return super().__call__(local, moving, *functions)


@dataclass(frozen=True)
class _Kernel:
    formula: GapFormula

    def __call__(self, local: Local, *arguments: Any) -> ConstraintKernel:
        return self.formula.kernel(local, self.formula(local, *arguments))


@dataclass(frozen=True)
class _GeneralizedForce:
    """Generalized forces of the multipliers of the gap, followed by those of the slip."""

    gap: GapFormula | None
    slip: GapFormula | None
    n_gap: int

    def __call__(self, local: Local, *arguments: Any) -> SX:
        force = SX.zeros(local.size)
        if self.gap is not None:
            g = self.gap(local, *arguments)
            force += ca.jtimes(g, local.q, local.lam[: self.n_gap], True)
        if self.slip is not None:
            slip = self.slip(local, *arguments)
            force += ca.jtimes(slip, local.v, local.lam[self.n_gap :], True)
        return force


def _negative_multipliers(local: Local) -> SX:
    return -local.lam


class KinematicConstraint(PointPart):
    """Constraints between attachments, defined by a `gap` function, a `slip` function or both.

    `Joint` describes both functions. Subclasses define their attachments in `points`.
    """

    gap: ClassVar[Callable[..., Any] | None] = None
    slip: ClassVar[Callable[..., Any] | None] = None

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Numbers passed to the gap and slip functions after the points."""
        return ()

    @property
    def multipliers(self) -> tuple[Variable, ...]:
        """Name of each constraint and unit of its multiplier, "N" or "N m".

        Raises
        ------
        BeamdaeError
            If the subclass does not define `multipliers`.
        """
        raise BeamdaeError(
            f"{self.name}: {type(self).__name__} has no multipliers; define a Variable "
            "for each row of the gap."
        )

    @property
    def reactions(self) -> tuple[str, ...]:
        """Name of the column of `reaction` for each multiplier.

        Raises
        ------
        BeamdaeError
            If the subclass does not define `reactions`.
        """
        raise BeamdaeError(
            f"{self.name}: {type(self).__name__} has no reactions; define a column "
            "name for each multiplier."
        )

    @property
    def _offset_carrier(self) -> str | None:
        """Name of the point in whose axes the first two offsets of a frozen gap are constant.

        If None, the offsets are used without rotation. For frozen gaps, see `activate`.
        """
        return None

    @property
    def reaction(self) -> Quantity:
        """Reaction of each constraint [N] or [N m], positive in the direction of increasing gap.

        Raises
        ------
        BeamdaeError
            If the joint does not define one column in `reactions` for each multiplier.
        """
        if len(self.reactions) != len(self.multipliers):
            raise BeamdaeError(
                f"{self.name}: reactions must have one name per multiplier, got "
                f"{len(self.reactions)} for {len(self.multipliers)}."
            )
        columns = [
            Variable(name, multiplier.unit)
            for name, multiplier in zip(self.reactions, self.multipliers, strict=True)
        ]
        return formula_quantity(columns, (), _negative_multipliers, **self._source)

    @rebuilt_for_mesh
    def reaction_on(self, place: str = "b", axes: str = "inertial") -> Quantity:
        """Return force Fx, Fy [N] and moment M [N m] on the body of a point, acting at this point.

        The load on a particle has no moment.

        Parameters
        ----------
        place
            Name of the point in `points`: "a", "b" or a name that the joint defines.
        axes
            "inertial", or "body" for axes that rotate with the body (or with the section of a
            beam); in the reference configuration, these are the inertial axes, also for an oblique
            beam, whose axial force is N of `Beam.section_forces`.

        Raises
        ------
        BeamdaeError
            If `place` is not the name of a point, or `axes` is invalid.
        """
        return self._observe_load(place, axes)

    def constraints(self) -> list[ConstraintStatement]:
        """Return the constraints of the joint: rows of the gap, then rows of the slip."""
        return self._state_constraints(self.gap, self.gap_parameters, self.laws)

    def _state_constraints(
        self, gap: Callable[..., Any] | None, parameters: Sequence[float], laws: Sequence[Law]
    ) -> list[ConstraintStatement]:
        """Return the constraints of the joint with another gap; the slip is unchanged.

        Parameters
        ----------
        gap
            Gap function, or None.
        parameters, laws
            Parameters and laws of this function.

        Raises
        ------
        BeamdaeError
            If the joint has neither a gap nor a slip.
        """
        if gap is None and self.slip is None:
            raise BeamdaeError(
                f"{self.name}: {type(self).__name__} has no constraint; define gap or slip."
            )
        rows, statements = self._n_gap_rows, []
        if gap is not None:
            functions = list_functions(parameters, laws)
            multipliers = self.multipliers[:rows]
            statements.append(self._statement(GapFormula(gap), functions, multipliers))
        if (slip := self._slip_formula) is not None:
            statements.append(self._statement(slip, self._functions, self.multipliers[rows:]))
        return statements

    def _statement(
        self,
        formula: GapFormula,
        functions: Sequence[Callable[..., Any]],
        multipliers: tuple[Variable, ...],
    ) -> ConstraintStatement:
        kernel, data = self._build_kernel(_Kernel(formula), functions, len(multipliers))
        return ConstraintStatement(self.name, kernel, self._pieces, multipliers, data)

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        return list_functions(self.gap_parameters, self.laws)

    @property
    def _is_shared(self) -> bool:
        # Methods that read `self` may return other values for other joints.
        return not (isinstance(self.gap, MethodType) or isinstance(self.slip, MethodType))

    @property
    def _gap_formula(self) -> GapFormula | None:
        return None if self.gap is None else GapFormula(self.gap)

    @property
    def _slip_formula(self) -> GapFormula | None:
        return None if self.slip is None else _SlipFormula(self.slip)

    @property
    def _generalized_force(self) -> Callable[..., SX]:
        return _GeneralizedForce(self._gap_formula, self._slip_formula, self._n_gap_rows)

    @property
    def _source(self) -> dict[str, Any]:
        return {"joint": self.name, "joint_part": self}

    @cached_property
    def _n_gap_rows(self) -> int:
        """Number of gap multipliers, which precede the slip multipliers."""
        if self.slip is None:
            return len(self.multipliers)
        if (gap := self._gap_formula) is None:
            return 0
        formula, functions = self._arguments(gap, self._functions)
        return int(formula(Local(sum(self._sizes)), *functions).shape[0])


def list_functions(
    parameters: Sequence[float], laws: Sequence[Law]
) -> tuple[Callable[..., Any], ...]:
    """Return the functions that a `GapFormula` receives after the points."""
    return (constant_formula(*parameters), *(law.formula for law in laws))


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
class _MeetingJoint(Joint):
    """Joint of two points that coincide in the reference configuration."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_meeting(self.name, self.a, self.b)

    @property
    def _offset_carrier(self) -> str:
        """Name of point `a`, or of `b` if `a` belongs to a particle, which has no axes."""
        return "a" if self.a.has_angle else "b"


@dataclass(frozen=True, eq=False)
class Revolute(_MeetingJoint):
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

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint) -> SX:
        """Return the gap r_b - r_a [m]."""
        return b.position - a.position


@dataclass(frozen=True, eq=False)
class Weld(_MeetingJoint):
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

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint) -> SX:
        """Return the gap r_b - r_a [m] and the relative rotation [rad]."""
        return ca.vertcat(b.position - a.position, b.rotation - a.rotation)
