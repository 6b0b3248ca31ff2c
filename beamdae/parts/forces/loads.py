"""Forces on points, and loads that follow time laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    choice_of,
    convert_fields,
    optional,
    require_pair,
    set_fields,
)
from beamdae.parts.attachments import (
    Attachment,
    require_angle,
    require_attachment,
    require_movable,
    rotate,
)
from beamdae.parts.forces.load_observables import POWER
from beamdae.parts.laws import Law, as_law
from beamdae.parts.part import FORCE, MOMENT, PlacedPoint, PointPart
from beamdae.symbolic.statements import (
    SX,
    ForceKernel,
    ForceStatement,
    Local,
    Quantity,
    Variable,
    rebuilt_for_mesh,
)

# Kernel of a force, and values that can be observed, by name.
ForceFormula = Callable[..., tuple[ForceKernel, Mapping[str, SX]]]


@dataclass(frozen=True)
class _Kernel:
    formula: ForceFormula

    def __call__(self, *arguments: Any) -> ForceKernel:
        return self.formula(*arguments)[0]


class _GeneralizedForce(_Kernel):
    def __call__(self, *arguments: Any) -> Any:
        return super().__call__(*arguments).force


class _Power(_Kernel):
    def __call__(self, local: Local, *arguments: Any) -> Any:
        return -ca.dot(super().__call__(local, *arguments).force, local.v)


@dataclass(frozen=True)
class _Values:
    formula: ForceFormula
    names: tuple[str, ...]

    def __call__(self, *arguments: Any) -> SX:
        _, values = self.formula(*arguments)
        return ca.vertcat(*(values[name] for name in self.names))


class PointForce(PointPart):
    """Force on points, given by a formula of their motion.

    A subclass defines `points` and `_formula`; statements and observables follow.
    """

    @property
    def _formula(self) -> ForceFormula:
        """Function (local, points, *other functions) of a `PointFormula`."""
        raise NotImplementedError

    @property
    def _joint(self) -> Any:
        """Joint on whose reactions the force depends."""
        return None

    @property
    def _observed_points(self) -> tuple[str, ...]:
        """Names of the points to which `force` and `moment` refer; by default the last one."""
        return tuple(self.points)[-1:]

    @property
    def _generalized_force(self) -> Callable[..., SX]:
        return _GeneralizedForce(self._formula)

    @property
    def _source(self) -> dict[str, Any]:
        joint, load = self._joint, {"load_of": self.name}
        return load if joint is None else {**load, "joint": joint.name, "joint_part": joint}

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """Return the forces on all points as one statement."""
        joint, build = self._joint, _Kernel(self._formula)
        multipliers = () if joint is None else joint.multipliers
        kernel, data = self._build_kernel(build, self._functions, len(multipliers))
        name = None if joint is None else joint.name
        return [ForceStatement(self.name, kernel, self._pieces, data, name)]

    def _observe_values(self, columns: Mapping[str, Variable]) -> Quantity:
        """Return values of the formula as a quantity, with columns by their names."""
        build = _Values(self._formula, tuple(columns))
        return self._observe(build, tuple(columns.values()))

    @property
    @rebuilt_for_mesh
    def power(self) -> Quantity:
        """Power [W] of all forces of the part, the rate of the work done on the mechanism.

        In the energy balance, its integral is the work of loads minus the dissipated energy and the
        increase of the strain energy of the part.
        """
        return self._observe(_Power(self._formula), (POWER,))

    @rebuilt_for_mesh
    def load_on(self, place: str, axes: str = "inertial") -> Quantity:
        """Return force Fx, Fy [N] and moment M [N m] on the body of a point, acting at this point.

        The load on a particle has no moment.

        Parameters
        ----------
        place
            Name of the point: "a" or "b" for elements between two points and friction, "point" or
            "surface" for a contact, "on" for a load at one point, "reaction_on" for the second body
            of a moment, "1", "2", ... for a force law with several attachments.
        axes
            "inertial", or "body" for axes that rotate with the body (or with the section of a
            beam); in the reference configuration, these are the inertial axes.

        Raises
        ------
        BeamdaeError
            If `place` is not the name of a point, or `axes` is invalid.
        """
        return self._observe_load(place, axes)

    @property
    @rebuilt_for_mesh
    def force(self) -> Quantity:
        """Force Fx, Fy [N] on the loaded body, in the inertial frame.

        With several loaded points, the columns are Fx1, Fy1, Fx2, ...
        """
        return self._observe_components((0, 1), FORCE, self._observed_points)

    @property
    @rebuilt_for_mesh
    def moment(self) -> Quantity:
        """Moment M [N m] on the loaded body about the loaded point, counter-clockwise.

        With several loaded points that have an angle, the columns are M1, M2, ...

        Raises
        ------
        BeamdaeError
            If the part acts on particles only, which have no angle.
        """
        points = {place: self.points[place] for place in self._observed_points}
        places = tuple(place for place, point in points.items() if point.has_angle)
        if not places:
            first = next(iter(points.values()))
            raise BeamdaeError(
                f"{self.name}: {first} is a particle without an angle, so there is no moment on "
                "it; observe the force."
            )
        return self._observe_components((2,), (MOMENT,), places)

    def _observe_components(
        self, rows: tuple[int, ...], columns: tuple[Variable, ...], places: tuple[str, ...]
    ) -> Quantity:
        is_numbered = len(self._observed_points) > 1
        names = [(place if is_numbered else "", x) for place in places for x in columns]
        numbered = tuple(Variable(f"{x.name}{number}", x.unit) for number, x in names)
        return self._observe_loads(dict.fromkeys(places, rows), numbered)


def load_kernel(local: Local, placement: SX, load: SX) -> ForceKernel:
    """Return the kernel of a load that does work on a placement (positions or angles)."""
    force = -ca.jtimes(placement, local.q, load, True)
    power = ca.dot(local.dot(placement), load)
    return ForceKernel(local, force, powers=ca.vertcat(power, 0))


@dataclass(frozen=True)
class _ForceFormula:
    """Force with components in `axes` that follow the laws."""

    axes: str

    def __call__(
        self, local: Local, points: Sequence[PlacedPoint], *laws: Callable[[SX], SX]
    ) -> tuple[ForceKernel, Mapping[str, SX]]:
        (on,) = points
        load = ca.vertcat(*(law(local.time) for law in laws))
        load = rotate(on.rotation, load) if self.axes == "body" else load
        return load_kernel(local, on.position, load), {}


def _moment_formula(
    local: Local, points: Sequence[PlacedPoint], law: Callable[[SX], SX]
) -> tuple[ForceKernel, Mapping[str, SX]]:
    rotation = points[0].rotation - sum(point.rotation for point in points[1:])
    return load_kernel(local, rotation, law(local.time)), {}


class _Load(PointForce):
    """Load that follows time laws."""

    is_load = True
    name: str
    law: Any

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        return tuple(law.formula for law in self.laws)


@dataclass(frozen=True, eq=False)
class Force(_Load):
    """Force on an attachment with components (Fx, Fy) [N] that follow time laws.

    Parameters
    ----------
    name
        Unique name.
    on
        Attachment on which the load acts.
    law
        Pair of laws (Fx, Fy) [N]: numbers, functions of t [s] or `Law`s.
    axes
        "inertial" (default) for a dead load, or "body" for a follower load. The axes of a follower
        load rotate with the body or section; in the reference configuration, they are the inertial
        axes.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `on` is not an attachment or belongs to the ground, `law` is not a
        pair of valid laws, or `axes` is unknown.

    Examples
    --------
    >>> import beamdae as bd
    >>> ball = bd.PointMass("ball", 0.2, at=(0.0, 1.0))
    >>> push = bd.Force("push", ball.point, (bd.sine(2.0, frequency=5.0), 0.0))
    """

    symbol = "force"
    name: str
    on: Attachment
    law: Any
    axes: str = "inertial"
    inputs = FORCE

    def __post_init__(self) -> None:
        convert_fields(self, on=require_movable, axes=choice_of("inertial", "body"))
        law = require_pair(self.name, "law", self.law, "a pair of laws (Fx, Fy)")
        set_fields(self, law=law)
        _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Time laws of both components."""
        return tuple(as_law(self.name, component) for component in self.law)

    @property
    def points(self) -> dict[str, Attachment]:
        """The attachment, by the name "on"."""
        return {"on": self.on}

    @property
    def _formula(self) -> ForceFormula:
        return _ForceFormula(self.axes)


@dataclass(frozen=True, eq=False)
class Moment(_Load):
    """Moment [N m] on a body, or between two bodies; counter-clockwise is positive.

    Parameters
    ----------
    name
        Unique name.
    on
        Attachment on which the load acts.
    law
        Moment [N m]: a number, a function of t [s] or a `Law`.
    reaction_on
        Attachment on which the opposite moment acts, as that of a motor on its housing. Defaults to
        none, so that the moment acts from outside.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `on` is not an attachment, belongs to the ground or is a particle,
        `reaction_on` is not an attachment or is a particle, or `law` is invalid.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> base = mech.add(bd.RigidBody("base", mass=2.0, inertia=0.1, center=(0.0, 0.0)))
    >>> arm = mech.add(bd.RigidBody("arm", mass=0.5, inertia=0.02, center=(0.3, 0.0)))
    >>> hinge = mech.add(bd.Revolute("hinge", base.at(0.0, 0.0), arm.at(0.0, 0.0)))
    >>> motor = bd.Moment("motor", arm.at(0.0, 0.0), 0.2, reaction_on=base.at(0.0, 0.0))
    """

    symbol = "moment"
    name: str
    on: Attachment
    law: Any
    reaction_on: Attachment | None = None
    inputs = (MOMENT,)
    _observed_points = ("on",)

    def __post_init__(self) -> None:
        convert_fields(self, on=require_movable, reaction_on=optional(require_attachment))
        for attachment in self.points.values():
            require_angle(self.name, attachment)
        _ = self.laws

    @property
    def points(self) -> dict[str, Attachment]:
        """The attachments, by the names "on" and "reaction_on"."""
        on = {"on": self.on}
        return on if self.reaction_on is None else {**on, "reaction_on": self.reaction_on}

    @property
    def acts_between_attachments(self) -> bool:
        """True if the opposite moment acts on a second point."""
        return self.reaction_on is not None

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Time law of the moment, as a tuple of one entry."""
        return (as_law(self.name, self.law),)

    @property
    def _formula(self) -> ForceFormula:
        return _moment_formula
