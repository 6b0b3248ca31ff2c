"""Constraints between attachments: kernels and reactions from a gap or a slip function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MethodType
from typing import Any, ClassVar, NamedTuple

import casadi as ca

from beamdae.errors import BeamdaeError
from beamdae.parts.laws import Law
from beamdae.parts.point_parts import PointPart
from beamdae.symbolic.formula import FormulaExpression, constant_formula
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    NonholonomicKernel,
    Quantity,
    Variable,
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

    The other functions are a formula that returns the parameters (if there are any), and the laws.

    Attributes
    ----------
    function
        Function (t, *points, *parameters, *values of the laws) -> SX.
    n_parameters
        Number of parameters.
    """

    function: Callable[..., SX]
    n_parameters: int
    kernel: ClassVar[type[ConstraintKernel]] = ConstraintKernel

    def __call__(self, local: Local, points: Sequence[Any], *functions: Any) -> SX:
        """Return the gap."""
        laws, parameters = list(functions), []
        if self.n_parameters:
            values = laws.pop(0)()
            parameters = [values[k] for k in range(self.n_parameters)]
        return self.function(
            local.time[0], *points, *parameters, *(law(local.time) for law in laws)
        )


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
            formula = GapFormula(gap, len(parameters))
            functions = list_functions(parameters, laws)
            statements.append(self._statement(formula, functions, self.multipliers[:rows]))
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
        return None if self.gap is None else GapFormula(self.gap, len(self.gap_parameters))

    @property
    def _slip_formula(self) -> GapFormula | None:
        return None if self.slip is None else _SlipFormula(self.slip, len(self.gap_parameters))

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
    constants = (constant_formula(*parameters),) if parameters else ()
    return (*constants, *(law.formula for law in laws))
