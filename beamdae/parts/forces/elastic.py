"""Forces that do work on a measure of two points: what springs, dampers and bushings share.

A measure is a column of elongations or angles; forces are positive where they resist its growth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, require_name, set_fields
from beamdae.parts.attachments import Attachment, require_attachment
from beamdae.parts.forces.formula_checks import (
    as_vector,
    build_kernel,
    evaluate_formula,
    require_column,
    require_continuous_formula,
    require_function,
)
from beamdae.parts.part import Part
from beamdae.symbolic.formulas import FormulaExpression, build_formula_kernel, constant_formula
from beamdae.symbolic.statements import (
    SX,
    ForceKernel,
    ForceStatement,
    Local,
    Named,
    Quantity,
)


class ElementResponse(NamedTuple):
    """Forces of a measure and what the books say of them.

    Attributes
    ----------
    force
        One for each entry of the measure.
    energy
        Potential [J].
    power
        Of what has no potential and is no damping: power on the mechanism [W].
    dissipated
        Dissipated power [W].
    """

    force: SX
    energy: SX
    power: SX
    dissipated: SX


@dataclass(frozen=True)
class LinearLaw:
    """Stiffness, damping and preload, numbers of each of so many entries of the measure."""

    rows: int

    def __call__(self, x: SX, rate: SX, numbers: Any) -> ElementResponse:
        """At this measure and its rate."""
        listed = [numbers[k] for k in range(3 * self.rows)]
        stiffness, damping, preload = (
            ca.vertcat(*listed[k * self.rows : (k + 1) * self.rows]) for k in range(3)
        )
        force = stiffness * x + damping * rate + preload
        energy = ca.dot(0.5 * stiffness * x + preload, x)
        return ElementResponse(force, energy, SX(0), ca.dot(damping * rate, rate))


@dataclass(frozen=True)
class UserLaw:
    """A law of the user's own: the part that is left without motion, and its damping beside it.

    Without an `energy` the former is booked as the work of a load.
    """

    part: str
    rows: int
    law: Callable[..., Any]
    energy: Callable[..., Any] | None

    def force(self, x: SX, rate: SX) -> SX:
        """The law as a column."""
        given = (x, rate) if self.rows == 1 else (as_vector(x), as_vector(rate))
        said = evaluate_formula(self.part, "law", self.law, *given)
        return require_column(self.part, "law", said, self.rows)

    def stored(self, x: SX) -> SX:
        """The energy, or nothing."""
        if self.energy is None:
            return SX(0)
        given = x if self.rows == 1 else as_vector(x)
        said = evaluate_formula(self.part, "energy", self.energy, given)
        return require_column(self.part, "energy", said, 1)

    def __call__(self, x: SX, rate: SX, numbers: Any) -> ElementResponse:
        """At this measure and its rate."""
        force, still = self.force(x, rate), self.force(x, SX.zeros(self.rows))
        power = -ca.dot(still, rate) if self.energy is None else SX(0)
        return ElementResponse(force, self.stored(x), power, ca.dot(force - still, rate))

    def require_sound(self, size: float) -> None:
        """Refuse what is no formula, or an energy that is not that of the law.

        `size` is about how large the measure may get.
        """
        x, rate = SX.sym("x", self.rows), SX.sym("rate", self.rows)
        require_function(self.part, "law", self.law)
        require_continuous_formula(self.part, "law", self.force(x, rate), (x, rate))
        if self.energy is None:
            return
        require_function(self.part, "energy", self.energy)
        stored = self.stored(x)
        require_continuous_formula(self.part, "energy", stored, (x,))
        still = self.force(x, SX.zeros(self.rows))
        both = ca.Function("both", [x], [ca.densify(ca.gradient(stored, x)), ca.densify(still)])
        for share in (-0.31, -0.03, 0.04, 0.37):
            slope, force = (np.array(y).ravel() for y in both(share * size))
            known = np.isfinite(slope) & np.isfinite(force)
            off = np.abs(slope - force)[known]
            if np.any(off > 1e-6 * np.max(np.abs(force[known]), initial=0.0) + 1e-12):
                raise BeamdaeError(
                    f"{self.part}: the derivative of energy must be the law at rest, at "
                    f"{share * size:.3g} they are {float(slope[0]):.6g} and "
                    f"{float(force[0]):.6g}."
                )


@dataclass(frozen=True)
class _ElementLaw:
    """The measure of two points, the first of so many local coordinates, and its response.

    `rows` is how many numbers are observed of it.
    """

    size: int
    measure: Callable[..., SX]
    response: Callable[..., ElementResponse]
    rows: int

    def at(self, local: Local, a: Any, b: Any, own: Any, drawn: Any) -> tuple[SX, ElementResponse]:
        """The measure, and what it leads to."""
        moved_a, moved_b = a(local.q[: self.size]), b(local.q[self.size :])
        x = self.measure(moved_a, moved_b, drawn())
        return x, self.response(x, local.dot(x), own())


def _magnitude(column: SX, rows: int) -> SX:
    return column if column.numel() == rows else ca.norm_2(column)


@dataclass(frozen=True)
class _ElementKernel(_ElementLaw):
    """The forces on both bodies, with their books."""

    def __call__(self, local: Local, *functions: Any) -> ForceKernel:
        """The kernel."""
        x, said = self.at(local, *functions)
        return ForceKernel(
            local,
            ca.jtimes(x, local.q, said.force, True),
            energies=ca.vertcat(0, said.energy, 0),
            powers=ca.vertcat(said.power, said.dissipated),
        )


@dataclass(frozen=True)
class Deformation(_ElementLaw):
    """The measure, as it is observed."""

    def __call__(self, local: Local, *functions: Any) -> SX:
        """The measure, or how far apart what is measured in two directions is."""
        return _magnitude(self.at(local, *functions)[0], self.rows)


@dataclass(frozen=True)
class ElementForce(_ElementLaw):
    """The forces, as they are observed."""

    def __call__(self, local: Local, *functions: Any) -> SX:
        """The forces, or how large a force of two components is."""
        return _magnitude(self.at(local, *functions)[1].force, self.rows)


@dataclass(frozen=True, eq=False)
class ForceElement(Part):
    """Two attachments between which forces act that depend on how they lie and move.

    A part of this kind states its `measure`, the numbers that takes, and its `response`.
    """

    name: str
    a: Attachment
    b: Attachment

    _forces: ClassVar[tuple[Named, ...]]

    def __post_init__(self) -> None:
        set_fields(self, name=require_name(type(self).__name__, self.name))
        require_attachment(self.name, "first attachment", self.a)
        require_attachment(self.name, "second attachment", self.b)
        if not self.a.size + self.b.size:
            raise BeamdaeError(
                f"{self.name}: neither {self.a} nor {self.b} moves, one of them must."
            )

    @property
    def _measure(self) -> Callable[..., SX]:
        """(a point moved, the other moved, numbers) -> the measure, a function of a module."""
        raise NotImplementedError

    @property
    def _response(self) -> tuple[Callable[..., ElementResponse], tuple[float, ...]]:
        """What the measure leads to, and its numbers."""
        raise NotImplementedError

    @property
    def _drawn(self) -> tuple[float, ...]:
        """Numbers of the measure."""
        raise NotImplementedError

    @cached_property
    def _stated(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """What a `_ElementLaw` is made of, and the formulas it takes."""
        response, numbers = self._response
        functions = (
            self.a.checked_kinematics,
            self.b.checked_kinematics,
            constant_formula(*numbers),
            constant_formula(*self._drawn),
        )
        return (self.a.size, self._measure, response, len(type(self)._forces)), functions

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The forces on both bodies."""
        made, functions = self._stated
        size = self.a.size + self.b.size
        make = build_kernel if isinstance(made[2], UserLaw) else build_formula_kernel
        kernel, data = make(_ElementKernel(*made), functions, size)
        return [ForceStatement(self.name, kernel, (self.a.piece, self.b.piece), data)]

    def observed(self, kind: Callable[..., Any], columns: tuple[Named, ...]) -> Quantity:
        """A `_ElementLaw` of some kind as a quantity."""
        made, functions = self._stated
        values, data = FormulaExpression.of(kind(*made), functions)
        pieces = (self.a.piece, self.b.piece)
        if isinstance(made[2], UserLaw):
            return Quantity(columns, pieces, lambda local: values(local), data)
        return Quantity(columns, pieces, values, data)

    @property
    def force(self) -> Quantity:
        """What it resists the growth of its measure with: tension is positive."""
        return self.observed(ElementForce, type(self)._forces)
