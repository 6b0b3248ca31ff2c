"""User-written forces as formulas of the motion of attachments."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca

from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    require_sequence,
    set_fields,
    short_repr,
)
from beamdae.parts.attachments import Attachment, require_attachment
from beamdae.parts.forces.formula_checks import (
    as_vector,
    evaluate_formula,
    list_entries,
    require_column,
    require_continuous_formula,
    require_function,
)
from beamdae.parts.forces.loads import ForceFormula, PointForce
from beamdae.parts.part import LOAD, PlacedPoint
from beamdae.symbolic.signals import as_scalar
from beamdae.symbolic.statements import (
    SX,
    ForceKernel,
    Local,
    Quantity,
    Variable,
    rebuilt_for_mesh,
)


class PointMotion(NamedTuple):
    """Motion of an attachment, as passed to the law of a `ForceLaw`.

    Attributes
    ----------
    position
        Position (x, y) in the inertial frame [m].
    angle
        Angle of the section or body [rad]; 0 for a particle.
    velocity
        Velocity (vx, vy) of the point in the inertial frame [m/s].
    rate
        Rate of the angle [rad/s].
    """

    position: Any
    angle: Any
    velocity: Any
    rate: Any


@dataclass(frozen=True)
class _LawFormula:
    """Formula of the loads of a law, and their values by "Fx1", "Fy1", "M1", "Fx2", ...

    Attributes
    ----------
    part
        Name of the part, for messages.
    inclinations
        Angle of the section or body at each point in the reference configuration [rad].
    law, energy, dissipative
        As in `ForceLaw`.
    """

    part: str
    inclinations: tuple[float, ...]
    law: Callable[..., Any]
    energy: Callable[..., Any] | None
    dissipative: bool

    def __call__(
        self, local: Local, points: Sequence[PlacedPoint]
    ) -> tuple[ForceKernel, Mapping[str, SX]]:
        motions = [
            _motion_of(x.position, x.rotation + angle, local.dot(x.position), local.dot(x.rotation))
            for x, angle in zip(points, self.inclinations, strict=True)
        ]
        loads = evaluate_loads(self.part, self.law, motions, local.time[0])
        energy = SX(0)
        if self.energy is not None:
            value = evaluate_formula(self.part, "energy", self.energy, *motions)
            energy = require_column(self.part, "energy", value, 1)
        placements = ca.vertcat(*(x for point in points for x in point))
        # Power that is not stored in the energy.
        net_power = ca.dot(loads, local.dot(placements)) + local.dot(energy)
        powers = ca.vertcat(0, -net_power) if self.dissipative else ca.vertcat(net_power, 0)
        force = -ca.jtimes(placements, local.q, loads, True)
        kernel = ForceKernel(local, force, ca.vertcat(0, energy, 0), powers)
        return kernel, dict(zip(_load_columns(len(points)), ca.vertsplit(loads), strict=True))


def _load_columns(count: int) -> dict[str, Variable]:
    """Return the columns of the loads on points, by the names of their values."""
    numbered = {f"{x.name}{k + 1}": x for k in range(count) for x in LOAD}
    return {x: Variable(x if count > 1 else y.name, y.unit) for x, y in numbered.items()}


def _motion_of(position: SX, angle: SX, velocity: SX, rate: SX) -> PointMotion:
    return PointMotion(as_vector(position), as_scalar(angle), as_vector(velocity), as_scalar(rate))


def evaluate_loads(part: str, law: Callable[..., Any], motions: Sequence[PointMotion], t: SX) -> SX:
    """Return the loads (Fx, Fy, M) on all attachments as one column.

    Raises
    ------
    BeamdaeError
        If the call of the law fails, or the law returns loads of the wrong number or length.
    """
    value = evaluate_formula(part, "law", law, *motions, t)
    if len(motions) == 1:
        loads = [value]
    else:
        loads = list(value) if isinstance(value, (tuple, list)) else []
    if len(loads) != len(motions):
        raise BeamdaeError(
            f"{part}: law must return a list of {len(motions)} loads, (Fx, Fy) or (Fx, Fy, M) for "
            f"each attachment, got {short_repr(value)}."
        )
    return ca.vertcat(*(_load_column(part, load) for load in loads))


def _load_column(part: str, load: Any) -> SX:
    count = len(list_entries(load))
    if count not in (2, 3):
        raise BeamdaeError(
            f"{part}: each load returned by law must be (Fx, Fy) or (Fx, Fy, M), got "
            f"{short_repr(load)}."
        )
    column = require_column(part, "law", load, count)
    return column if count == 3 else ca.vertcat(column, 0)


@dataclass(frozen=True, eq=False)
class ForceLaw(PointForce):
    """Forces and moments on attachments as a formula of their motion and of time.

    In the energy balance, the law is a load, unless `energy` or `dissipative` is given.

    Parameters
    ----------
    name
        Unique name.
    on
        One attachment, or a list of attachments.
    law
        Function `law(a, b, ..., t)` of one object per attachment and the time t [s]. Each object
        has the attributes `position` (x, y) [m], `angle` [rad], `velocity` (vx, vy) [m/s] and
        `rate` [rad/s] in the inertial frame. The function returns the load (Fx, Fy) or (Fx, Fy, M)
        [N, N m] on a single attachment, or a list of loads, one per attachment.
        Formulas consist of NumPy functions (np.sin, np.sqrt, np.tanh, np.maximum, np.abs, ...) and
        products of arrays (a @ b, np.dot), and must not have jumps: write np.maximum(x, 0.0) for
        one-sided forces and np.tanh(x / scale) for signs. Forces between attachments are not
        balanced automatically: return both action and reaction.
    energy
        Function `energy(a, b, ...)` of the same objects: a potential [J] of positions and angles.
        The potential is part of the strain energy; only the remaining power of the law is that of a
        load or of damping.
    dissipative
        If True, the law is damping instead of a load in the energy balance.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `on` is neither an attachment nor a list of attachments, none of them
        can move, `law` or `energy` is not a continuous formula of its arguments, the law returns
        loads of the wrong number or length or a moment on a particle, or `dissipative` is not a
        bool.

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
    _is_shared = False

    def __post_init__(self) -> None:
        convert_fields(self)
        if isinstance(self.on, Attachment):
            attachments: tuple[Any, ...] = (self.on,)
        else:
            what = "an attachment such as beam.end, or a list of attachments"
            attachments = tuple(require_sequence(self.name, "on", self.on, what)) or (self.on,)
        set_fields(self, on=tuple(require_attachment(self.name, "on", one) for one in attachments))
        if not sum(one.size for one in self.on):
            raise BeamdaeError(
                f"{self.name}: none of the attachments can move; attach the force to a body."
            )
        if not isinstance(self.dissipative, bool):
            raise BeamdaeError(
                f"{self.name}: dissipative must be True or False, "
                f"got {short_repr(self.dissipative)}."
            )
        self._require_valid()

    def _require_valid(self) -> None:
        require_function(self.name, "law", self.law)
        motions = [
            _motion_of(
                SX.sym("position", 2), SX.sym("angle"), SX.sym("velocity", 2), SX.sym("rate")
            )
            for _ in self.on
        ]
        t = SX.sym("t")
        arguments = [ca.vertcat(*m.position, m.angle, *m.velocity, m.rate) for m in motions]
        loads = evaluate_loads(self.name, self.law, motions, t)
        require_continuous_formula(self.name, "law", loads, [*arguments, t])
        for k, on in enumerate(self.on):
            if not on.has_angle and not loads[3 * k + 2].is_zero():
                raise BeamdaeError(
                    f"{self.name}: {on} is a particle without an angle; law must "
                    "return (Fx, Fy) for this attachment."
                )
        if self.energy is not None:
            require_function(self.name, "energy", self.energy)
            value = evaluate_formula(self.name, "energy", self.energy, *motions)
            energy = require_column(self.name, "energy", value, 1)
            placements = [ca.vertcat(*m.position, m.angle) for m in motions]
            what = "positions and angles"
            require_continuous_formula(self.name, "energy", energy, placements, what)

    @property
    def points(self) -> dict[str, Attachment]:
        """The attachments, by the name "on" or, if there are several, "1", "2", ..."""
        names = ["on"] if len(self.on) == 1 else [str(k + 1) for k in range(len(self.on))]
        return dict(zip(names, self.on, strict=True))

    @property
    def _observed_points(self) -> tuple[str, ...]:
        """Names of all points."""
        return tuple(self.points)

    @property
    def _formula(self) -> ForceFormula:
        inclinations = tuple(x.inclination for x in self.on)
        return _LawFormula(self.name, inclinations, self.law, self.energy, self.dissipative)

    @property
    @rebuilt_for_mesh
    def load(self) -> Quantity:
        """Load Fx, Fy [N] and M [N m]; with several attachments, Fx1, Fy1, M1, Fx2, ..."""
        return self._observe_values(_load_columns(len(self.on)))
