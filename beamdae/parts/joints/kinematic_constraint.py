"""Constraints between attachments: kernels and reactions from a gap or a slip function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from types import MethodType
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, require_choice
from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.laws import Law
from beamdae.parts.part import Part
from beamdae.symbolic.formula import FormulaExpression, build_formula_kernel, constant_formula
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    NonholonomicKernel,
    Piece,
    Quantity,
    Variable,
    rebuilt_for_mesh,
)


class PlacedPoint(NamedTuple):
    """Attachment in the current configuration, as passed to a gap function.

    Attributes
    ----------
    position
        Position (x, y) in the inertial frame [m], a column.
    rotation
        Rotation of the body or section from the reference configuration [rad]; 0 for a particle.
    """

    position: SX
    rotation: SX


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


def load_columns(at: Attachment) -> tuple[Variable, ...]:
    """Return the columns of a load on an attachment: Fx, Fy and, except for a particle, M."""
    return (Variable("Fx", "N"), Variable("Fy", "N"), Variable("M", "N m"))[
        : 3 if at.has_angle else 2
    ]


def resolve_load(axes: str, rotation: SX, force: SX, moment: Any = None) -> SX:
    """Return a force in "inertial" or "body" axes, followed by the moment if one is given.

    `force` has the components in inertial axes; `rotation` is the angle of the body axes [rad].
    """
    components = rotate(-rotation, force) if axes == "body" else force
    return components if moment is None else ca.vertcat(components, moment)


def _negative_multipliers(local: Local) -> SX:
    return -local.lam


@dataclass(frozen=True)
class PointFunction:
    """A gap or slip function in local coordinates.

    The arguments of a call are the kinematics of the points, a formula that returns the parameters
    (if there are any), and the laws. Equal instances build equal expressions.

    Attributes
    ----------
    sizes
        Number of local coordinates of each point.
    n_parameters
        Number of parameters.
    function
        Function (t, *points, *parameters, *values of the laws) -> SX.
    """

    sizes: tuple[int, ...]
    n_parameters: int
    function: Callable[..., SX]

    def place_points(self, local: Local, functions: Sequence[Any]) -> list[PlacedPoint]:
        """Return the points in the current configuration."""
        ends = np.cumsum([0, *self.sizes]).tolist()
        return [
            PlacedPoint(*kinematics(local.q[first:last]))
            for kinematics, (first, last) in zip(functions, pairwise(ends), strict=False)
        ]

    def evaluate(self, local: Local, points: Sequence[Any], functions: Sequence[Any]) -> SX:
        """Return the value of the function for the given points."""
        others = list(functions[len(self.sizes) :])
        parameters: list[Any] = []
        if self.n_parameters:
            values = others.pop(0)()
            parameters = [values[k] for k in range(self.n_parameters)]
        laws = [law(local.time) for law in others]
        return self.function(local.time[0], *points, *parameters, *laws)


def add_velocities(local: Local, points: Sequence[PlacedPoint]) -> list[MovingPoint]:
    """Return the points with their velocities."""
    return [
        MovingPoint(*point, local.dot(point.position), local.dot(SX(point.rotation)))
        for point in points
    ]


class _GapKernel(PointFunction):
    def __call__(self, local: Local, *functions: Any) -> ConstraintKernel:
        points = self.place_points(local, functions)
        return ConstraintKernel(local, self.evaluate(local, points, functions))


class _SlipKernel(PointFunction):
    def __call__(self, local: Local, *functions: Any) -> NonholonomicKernel:
        points = add_velocities(local, self.place_points(local, functions))
        return NonholonomicKernel(local, self.evaluate(local, points, functions))


@dataclass(frozen=True)
class _PointLoad:
    """Force and moment that the multipliers exert on one of the points.

    Attributes
    ----------
    gap, slip
        Constraint functions, whose multipliers are concatenated in this order.
    n_gap
        Number of multipliers of the gap.
    point
        Index of the point.
    axes
        "inertial" or "body".
    has_angle
        False for a particle, whose load has no moment.
    """

    gap: PointFunction | None
    slip: PointFunction | None
    n_gap: int
    point: int
    axes: str
    has_angle: bool

    def __call__(self, local: Local, *functions: Any) -> SX:
        first = self.gap or self.slip
        assert first is not None
        placed = first.place_points(local, functions)
        position, rotation = placed[self.point]
        load = SX.zeros(3)
        if self.gap is not None:
            # The load is conjugate to the placement of the point, here a free variable.
            free = SX.sym("point", 3)
            points = list(placed)
            points[self.point] = PlacedPoint(free[:2], free[2])
            g = self.gap.evaluate(local, points, functions)
            load = -ca.jtimes(g, free, local.lam[: self.n_gap], True)
            load = ca.densify(ca.substitute(load, free, ca.vertcat(position, rotation)))
        if self.slip is not None:
            rate = SX.sym("rate", 3)
            moving = add_velocities(local, placed)
            moving[self.point] = MovingPoint(position, rotation, rate[:2], rate[2])
            slip = self.slip.evaluate(local, moving, functions)
            load = load - ca.densify(ca.jtimes(slip, rate, local.lam[self.n_gap :], True))
        return resolve_load(self.axes, rotation, load[:2], load[2] if self.has_angle else None)


class KinematicConstraint(Part):
    """Constraints between attachments, defined by a `gap` function, a `slip` function or both.

    `Joint` describes both functions. Subclasses define their attachments in `points`.
    """

    gap: ClassVar[Callable[..., Any] | None] = None
    slip: ClassVar[Callable[..., Any] | None] = None

    @property
    def points(self) -> dict[str, Attachment]:
        """Constrained attachments in argument order, by their names in `reaction_on`."""
        raise NotImplementedError

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
    def offset_carrier(self) -> str | None:
        """Name of the point in whose axes the first two offsets of a frozen gap are constant.

        If None, the offsets are used without rotation. For frozen gaps, see `activate`.
        """
        return None

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """Local coordinates of all points."""
        return tuple(point.piece for point in self.points.values())

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
        columns = tuple(
            Variable(name, multiplier.unit)
            for name, multiplier in zip(self.reactions, self.multipliers, strict=True)
        )
        values, _ = FormulaExpression.of(_negative_multipliers, ())
        return Quantity(columns, (), values, joint=self.name, joint_part=self)

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
        points = self.points
        require_choice(self.name, "place", place, tuple(points))
        require_choice(self.name, "axes", axes, ("inertial", "body"))
        at = points[place]
        build = _PointLoad(
            None if self.gap is None else self._point_function(self.gap),
            None if self.slip is None else self._point_function(self.slip),
            self.n_gap_rows,
            list(points).index(place),
            axes,
            at.has_angle,
        )
        return self.observe(build, load_columns(at))

    def constraints(self) -> list[ConstraintStatement]:
        """Return the constraints of the joint: rows of the gap, then rows of the slip."""
        return self.state_constraints(self.gap, self.gap_parameters, self.laws)

    def state_constraints(
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
        rows, statements = self.n_gap_rows, []
        if gap is not None:
            build = _GapKernel(self._sizes, len(parameters), gap)
            functions = self.argument_functions(parameters, laws)
            statements.append(self._statement(build, functions, self.multipliers[:rows]))
        if self.slip is not None:
            slip = _SlipKernel(self._sizes, len(self.gap_parameters), self.slip)
            functions = self.argument_functions(self.gap_parameters, self.laws)
            statements.append(self._statement(slip, functions, self.multipliers[rows:]))
        return statements

    def observe(self, build: Callable[..., SX], columns: tuple[Variable, ...]) -> Quantity:
        """Return a quantity of the points and multipliers; see `PointFunction` for `build`."""
        values, data = FormulaExpression.of(
            build, self.argument_functions(self.gap_parameters, self.laws)
        )
        if self._reads_self:
            # A function that reads `self` is not cached for other models.
            return Quantity(
                columns, self.pieces, lambda local: values(local), data, self.name, self
            )
        return Quantity(columns, self.pieces, values, data, self.name, self)

    def _statement(
        self,
        build: Callable[..., Any],
        functions: Sequence[Callable[..., Any]],
        multipliers: tuple[Variable, ...],
    ) -> ConstraintStatement:
        kernel, data = build_formula_kernel(
            build, functions, sum(self._sizes), len(multipliers), shared=not self._reads_self
        )
        return ConstraintStatement(self.name, kernel, self.pieces, multipliers, data)

    @property
    def _reads_self(self) -> bool:
        """True if gap or slip are methods that read `self`: their kernels are not shared."""
        return isinstance(self.gap, MethodType) or isinstance(self.slip, MethodType)

    @property
    def _sizes(self) -> tuple[int, ...]:
        return tuple(point.size for point in self.points.values())

    def argument_functions(
        self, parameters: Sequence[float], laws: Sequence[Law]
    ) -> tuple[Callable[..., Any], ...]:
        """Return the functions to pass to a `PointFunction`."""
        kinematics = (point.checked_kinematics for point in self.points.values())
        constants = (constant_formula(*parameters),) if parameters else ()
        return (*kinematics, *constants, *(law.formula for law in laws))

    def _point_function(self, function: Callable[..., Any]) -> PointFunction:
        return PointFunction(self._sizes, len(self.gap_parameters), function)

    @cached_property
    def n_gap_rows(self) -> int:
        """Number of gap multipliers, which precede the slip multipliers."""
        if self.slip is None:
            return len(self.multipliers)
        if self.gap is None:
            return 0
        functions = self.argument_functions(self.gap_parameters, self.laws)
        local, gap = Local(sum(self._sizes)), self._point_function(self.gap)
        g = gap.evaluate(local, gap.place_points(local, functions), functions)
        return int(g.shape[0])
