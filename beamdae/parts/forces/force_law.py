"""Forces of the user's own: formulas of where attachments are and how they move."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, require_name, require_sequence, set_fields, short_repr
from beamdae.parts.attachments import Attachment, require_attachment
from beamdae.parts.forces.formula_checks import (
    as_vector,
    build_kernel,
    evaluate_formula,
    list_entries,
    require_column,
    require_continuous_formula,
    require_function,
)
from beamdae.parts.part import Part
from beamdae.symbolic.formulas import FormulaExpression
from beamdae.symbolic.statements import (
    SX,
    ForceKernel,
    ForceStatement,
    Local,
    Named,
    Quantity,
)


class Motion(NamedTuple):
    """How an attachment lies and moves, as a `ForceLaw` sees it.

    Attributes
    ----------
    position
        (x, y) in the inertial frame [m].
    angle
        Of its section or body [rad]; 0 of a particle.
    velocity
        Of the point [m/s].
    rate
        Of the angle [rad/s].
    """

    position: Any
    angle: Any
    velocity: Any
    rate: Any


@dataclass(frozen=True)
class _AttachedLaw:
    """Attachments in the local coordinates of a kernel, and the law between them."""

    part: str
    on: tuple[Attachment, ...]
    law: Callable[..., Any]
    energy: Callable[..., Any] | None
    dissipative: bool

    def loads(self, local: Local, *moved: Any) -> tuple[SX, SX, SX]:
        """(what the loads act on, the loads, the energy), three entries an attachment."""
        places, motions, first = [], [], 0
        for on, kinematics in zip(self.on, moved, strict=True):
            place, turn = kinematics(local.q[first : first + on.size])
            first += on.size
            motions.append(_point_motion(local, on, place, turn))
            places += [place, turn]
        said = evaluate_loads(self.part, self.law, motions, local.time[0])
        stored = SX(0)
        if self.energy is not None:
            value = evaluate_formula(self.part, "energy", self.energy, *motions)
            stored = require_column(self.part, "energy", value, 1)
        return ca.vertcat(*places), said, stored


@dataclass(frozen=True)
class _LoadKernel(_AttachedLaw):
    def __call__(self, local: Local, *moved: Any) -> ForceKernel:
        """The kernel: virtual work of the loads, and what the books say of it."""
        places, said, stored = self.loads(local, *moved)
        power = ca.dot(said, local.dot(places))
        taken = power + local.dot(stored)
        powers = ca.vertcat(0, -taken) if self.dissipative else ca.vertcat(taken, 0)
        force = -ca.jtimes(places, local.q, said, True)
        return ForceKernel(local, force, ca.vertcat(0, stored, 0), powers)


@dataclass(frozen=True)
class _LoadValues(_AttachedLaw):
    def __call__(self, local: Local, *moved: Any) -> SX:
        return self.loads(local, *moved)[1]


def _point_motion(local: Local, on: Attachment, place: SX, turn: SX) -> Motion:
    velocity = local.dot(place)
    angle = SX(turn) + on.inclination
    return Motion(as_vector(place), angle, as_vector(velocity), local.dot(SX(turn)))


def evaluate_loads(part: str, law: Callable[..., Any], motions: Sequence[Motion], t: SX) -> SX:
    """(Fx, Fy, M) on each attachment, from what the law says of their motion."""
    said = evaluate_formula(part, "law", law, *motions, t)
    each = [said] if len(motions) == 1 else list(said) if isinstance(said, (tuple, list)) else []
    if len(each) != len(motions):
        raise BeamdaeError(
            f"{part}: law must return a list of {len(motions)} loads, (Fx, Fy) or (Fx, Fy, M) for "
            f"each attachment, got {short_repr(said)}."
        )
    return ca.vertcat(*(_load_column(part, load) for load in each))


def _load_column(part: str, load: Any) -> SX:
    count = len(list_entries(load))
    if count not in (2, 3):
        raise BeamdaeError(
            f"{part}: a load of the law must be (Fx, Fy) or (Fx, Fy, M), got {short_repr(load)}."
        )
    column = require_column(part, "law", load, count)
    return column if count == 3 else ca.vertcat(column, 0)


@dataclass(frozen=True, eq=False)
class ForceLaw(Part):
    """Forces and moments on attachments by a formula of their motion and of time.

    Its power is booked as that of a load; see `energy` and `dissipative`.

    Parameters
    ----------
    name
        Unique name.
    on
        An attachment, or several.
    law
        `law(a, b, ..., t)`: of each attachment its `position` (x, y) [m], `angle` [rad], `velocity`
        [m/s] and `rate` [rad/s], all in the inertial frame, and the time [s]. It returns (Fx, Fy)
        or (Fx, Fy, M) [N, N m] for the one attachment, or a list of these, one for each. Numpy
        functions make the formula (np.sin, np.sqrt, np.tanh, np.maximum, np.abs, ...); it must not
        jump, `bd.positive_part` and `bd.smooth_sign` help. Forces that have to add up to nothing
        are the law's own business.
    energy
        `energy(a, b, ...)`, a potential [J] of positions and angles: it is booked as strain energy,
        and what the law does beside it as `dissipative` says.
    dissipative
        Whether that is damping instead of the work of a load.

    Examples
    --------
    >>> import numpy as np
    >>> import beamdae as bd
    >>> block = bd.PointMass("block", 2.0, at=(1.0, 0.0))
    >>> def drag(block, t):
    ...     x, y = block.velocity
    ...     speed = np.sqrt(x**2 + y**2 + 1e-12)
    ...     return (-0.3 * speed * x, -0.3 * speed * y)
    >>> drag = bd.ForceLaw("drag", block.point, drag, dissipative=True)
    """

    symbol = "force law"
    name: str
    on: Any
    law: Callable[..., Any]
    energy: Callable[..., Any] | None = None
    dissipative: bool = False

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("ForceLaw", self.name))
        given = self.on
        if not isinstance(given, Attachment):
            what = "an attachment such as beam.end, or a list of them"
            given = tuple(require_sequence(self.name, "on", given, what)) or (given,)
        else:
            given = (given,)
        set_fields(self, on=tuple(require_attachment(self.name, "on", one) for one in given))
        if not sum(one.size for one in self.on):
            raise BeamdaeError(f"{self.name}: nothing it acts on moves.")
        if not isinstance(self.dissipative, bool):
            raise BeamdaeError(
                f"{self.name}: dissipative must be True or False, got {short_repr(self.dissipative)}."
            )
        self._require_sound()

    def _require_sound(self) -> None:
        """Refuse what is no formula of the motion given, and moments on particles."""
        require_function(self.name, "law", self.law)
        motions = [
            Motion(*(as_vector(x) if x.numel() == 2 else x for x in symbols))
            for symbols in (
                (SX.sym("position", 2), SX.sym("angle"), SX.sym("velocity", 2), SX.sym("rate"))
                for _ in self.on
            )
        ]
        t = SX.sym("t")
        given = [ca.vertcat(*m.position, m.angle, *m.velocity, m.rate) for m in motions]
        said = evaluate_loads(self.name, self.law, motions, t)
        require_continuous_formula(self.name, "law", said, [*given, t])
        for k, on in enumerate(self.on):
            if not on.has_angle and not said[3 * k + 2].is_zero():
                raise BeamdaeError(
                    f"{self.name}: {on} is a particle and has no angle, law must return "
                    "(Fx, Fy) for it."
                )
        if self.energy is not None:
            require_function(self.name, "energy", self.energy)
            value = evaluate_formula(self.name, "energy", self.energy, *motions)
            stored = require_column(self.name, "energy", value, 1)
            places = [ca.vertcat(*m.position, m.angle) for m in motions]
            what = "positions and angles"
            require_continuous_formula(self.name, "energy", stored, places, what)

    @cached_property
    def _moved(self) -> tuple[Any, ...]:
        return (self.name, self.on, self.law, self.energy, self.dissipative)

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The loads."""
        moved, size = [one.checked_kinematics for one in self.on], sum(one.size for one in self.on)
        kernel, data = build_kernel(_LoadKernel(*self._moved), moved, size)
        return [ForceStatement(self.name, kernel, tuple(one.piece for one in self.on), data)]

    @property
    def load(self) -> Quantity:
        """Forces [N] and moment [N m] on each attachment, numbered from 1 where there are more."""
        count = len(self.on)
        columns = tuple(
            Named(f"{what}{k + 1}" if count > 1 else what, unit)
            for k in range(count)
            for what, unit in (("Fx", "N"), ("Fy", "N"), ("M", "N m"))
        )
        values, data = FormulaExpression.of(
            _LoadValues(*self._moved), [one.checked_kinematics for one in self.on]
        )
        pieces = tuple(one.piece for one in self.on)
        return Quantity(columns, pieces, lambda local: values(local), data)
