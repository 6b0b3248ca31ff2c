"""One-sided contact of a point with a line or a circle, with restitution and friction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    require_finite,
    require_name,
    require_non_negative,
    require_positive,
    set_fields,
    short_repr,
)
from beamdae.parts.attachments import Attachment, require_angle, require_attachment
from beamdae.parts.forces.smooth import positive_part, smooth_sign
from beamdae.parts.forces.surfaces import CircleSurface, LineSurface, perpendicular
from beamdae.parts.laws import MIN_STEPS_PER_TIME_SCALE, Law, as_law
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

_MIN_RESTITUTION = 0.05
# From here on the series of the hysteresis factor is as near as rounding lets the equation be.
_ELASTIC_LIMIT = 1e-5


@dataclass(frozen=True)
class _ContactLaw:
    """A point, the first of so many local coordinates, and a surface of some kind.

    Without friction nothing of it is left in the formulas.
    """

    size: int
    surface: Callable[..., tuple[SX, SX]]
    rubs: bool

    def gap_and_slip(self, local: Local, a: Any, b: Any, drawn: Any) -> tuple[SX, SX]:
        """Gap, and velocity of the point along the surface."""
        place, _ = a(local.q[: self.size])
        root, turn = b(local.q[self.size :])
        way = place - root
        gap, tangent = self.surface(SX(turn), way, drawn())
        carried = local.dot(root) + local.dot(SX(turn)) * perpendicular(way)
        return gap, ca.dot(tangent, local.dot(place) - carried)

    def forces(self, local: Local, gap: SX, slip: SX, own: Any) -> tuple[SX, SX, SX]:
        """Elastic part of the normal force, all of it, and friction against the slip."""
        stiffness, exponent, hysteresis = (own()[k] for k in range(3))
        elastic = stiffness * positive_part(-gap) ** exponent
        normal = elastic * positive_part(1 - hysteresis * local.dot(gap))
        if not self.rubs:
            return elastic, normal, SX(0)
        friction, speed = own()[3], own()[4]
        return elastic, normal, friction * normal * smooth_sign(slip, speed)


@dataclass(frozen=True)
class _ContactKernel(_ContactLaw):
    def __call__(self, local: Local, a: Any, b: Any, drawn: Any, own: Any) -> ForceKernel:
        """The kernel."""
        gap, slip = self.gap_and_slip(local, a, b, drawn)
        elastic, normal, rubbing = self.forces(local, gap, slip, own)
        force = ca.jtimes(slip, local.v, rubbing, True) - ca.jtimes(gap, local.q, normal, True)
        energy = elastic * positive_part(-gap) / (own()[1] + 1)
        dissipated = (elastic - normal) * local.dot(gap) + rubbing * slip
        return ForceKernel(local, force, ca.vertcat(0, energy, 0), powers=ca.vertcat(0, dissipated))


@dataclass(frozen=True)
class _ContactForces(_ContactLaw):
    def __call__(self, local: Local, a: Any, b: Any, drawn: Any, own: Any) -> SX:
        gap, slip = self.gap_and_slip(local, a, b, drawn)
        _, normal, rubbing = self.forces(local, gap, slip, own)
        return ca.vertcat(normal, -rubbing)


def hysteresis_factor(restitution: float, speed: float) -> float:
    """The factor X [s/m] in N = k d^n (1 + X d') that leaves `restitution` of an impact at `speed`.

    With m d'' = -N the speeds v before and e v after an impact obey
    X v (1 + e) = ln((1 + X v) / (1 - e X v)) whatever m, k and n (Gonthier et al., Multibody System
    Dynamics 11, 2004); near e = 1 that is Hunt and Crossley's X = 3 (1 - e) / (2 v).
    """
    e = restitution
    if 1.0 - e < _ELASTIC_LIMIT:
        return 1.5 * (1.0 - e) / speed
    low, high = 0.5 * (1.0 - e), 1.0 / e
    for _ in range(200):
        middle = 0.5 * (low + high)
        lost = 1.0 - e * middle
        if lost <= 0.0 or math.log1p(middle) - math.log(lost) > middle * (1.0 + e):
            high = middle
        else:
            low = middle
    return 0.5 * (low + high) / speed


@dataclass(frozen=True, eq=False)
class Contact(Part):
    """A point that cannot pass a surface: the surface pushes it back and never pulls.

    At a penetration d the normal force is N = stiffness d^exponent max(0, 1 + X d') (Hunt and
    Crossley, J. Appl. Mech. 42, 1975), and friction is -friction N tanh(slip / friction_speed).
    N has exponent - 1 continuous derivatives rounded down where contact begins; with X > 0 its
    slope follows that of d^exponent. The elastic part is in the books as strain energy, the rest
    as dissipated.

    Parameters
    ----------
    name
        Unique name.
    point
        What touches.
    surface
        `bd.LineSurface` or `bd.CircleSurface`.
    stiffness
        [N/m^exponent].
    exponent
        1.5 as of Hertz's spheres (default), at least 1; of 1 the force has a kink.
    restitution
        Speed after over speed before an impact at `impact_speed`, 0.05 to 1; slower impacts lose a
        smaller share.
    impact_speed
        [m/s]; needed where the restitution is less than 1.
    friction
        Coefficient of Coulomb's friction.
    friction_speed
        Slip [m/s] at which friction is 0.76 of Coulomb's; below, it is nearly viscous: what should
        stick creeps.
    longest_step
        Adaptive integrators take no longer steps [s]. A point cannot leave a half-plane unseen, but
        one in free flight may jump over a small circle: give a tenth of the time it takes to
        cross that.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 0.2, at=(0.0, 1.0)))
    >>> floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    >>> bounce = bd.Contact("bounce", ball.point, floor, 1e6, restitution=0.7, impact_speed=4.4)
    """

    symbol = "contact"
    name: str
    point: Attachment
    surface: LineSurface | CircleSurface
    stiffness: float
    exponent: float = 1.5
    restitution: float = 1.0
    impact_speed: float | None = None
    friction: float = 0.0
    friction_speed: float = 1e-3
    longest_step: float | None = None

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("Contact", self.name))
        require_attachment(self.name, "point", self.point)
        if not isinstance(self.surface, (LineSurface, CircleSurface)):
            raise BeamdaeError(
                f"{self.name}: surface must be a LineSurface or a CircleSurface, "
                f"got {short_repr(self.surface)}."
            )
        if not self.point.size + self.surface.on.size:
            raise BeamdaeError(f"{self.name}: neither the point nor the surface moves.")
        set_fields(
            self,
            stiffness=require_positive(self.name, "stiffness", self.stiffness),
            exponent=require_finite(self.name, "exponent", self.exponent),
            restitution=require_finite(self.name, "restitution", self.restitution),
            friction=require_non_negative(self.name, "friction", self.friction),
            friction_speed=require_positive(self.name, "friction_speed", self.friction_speed),
        )
        if self.friction:
            require_angle(self.name, self.surface.on)
        if not 1.0 <= self.exponent <= 10.0:
            raise BeamdaeError(f"{self.name}: exponent must lie in [1, 10], got {self.exponent:g}.")
        if not _MIN_RESTITUTION <= self.restitution <= 1.0:
            raise BeamdaeError(
                f"{self.name}: restitution must lie in [{_MIN_RESTITUTION:g}, 1], got "
                f"{self.restitution:g}."
            )
        if self.longest_step is not None:
            set_fields(
                self, longest_step=require_positive(self.name, "longest_step", self.longest_step)
            )
        if self.impact_speed is not None:
            set_fields(
                self, impact_speed=require_positive(self.name, "impact_speed", self.impact_speed)
            )
        elif self.restitution < 1.0:
            raise BeamdaeError(
                f"{self.name}: restitution={self.restitution:g} needs the impact_speed it is of."
            )

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """The point, and where the surface is fixed."""
        return (self.point, self.surface.on)

    @property
    def laws(self) -> tuple[Law, ...]:
        """One that changes nothing: integrators keep to a quarter of its time scale."""
        if self.longest_step is None:
            return ()
        return (
            replace(
                as_law(self.name, 0.0), time_scale=MIN_STEPS_PER_TIME_SCALE * self.longest_step
            ),
        )

    @property
    def hysteresis(self) -> float:
        """X [s/m] in N, see `hysteresis_factor`."""
        if self.impact_speed is None:
            return 0.0
        return hysteresis_factor(self.restitution, self.impact_speed)

    @property
    def _kind(self) -> tuple[Any, ...]:
        return (self.point.size, type(self.surface).kind, self.friction > 0.0)

    @property
    def _functions(self) -> tuple[Any, ...]:
        numbers = (self.stiffness, self.exponent, self.hysteresis)
        rubbing = (self.friction, self.friction_speed) if self.friction else ()
        own = constant_formula(*numbers, *rubbing)
        drawn = constant_formula(*self.surface.numbers)
        return (self.point.checked_kinematics, self.surface.on.checked_kinematics, drawn, own)

    @property
    def _pieces(self) -> tuple[Any, Any]:
        return (self.point.piece, self.surface.on.piece)

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """Normal force and friction."""
        kind = _ContactKernel(*self._kind)
        size = self.point.size + self.surface.on.size
        kernel, data = build_formula_kernel(kind, self._functions, size)
        return [ForceStatement(self.name, kernel, self._pieces, data)]

    @property
    def force(self) -> Quantity:
        """Normal force N and friction T [N] on the point; T to the right of the outward normal."""
        kind = _ContactForces(*self._kind)
        values, data = FormulaExpression.of(kind, self._functions)
        return Quantity((Named("N", "N"), Named("T", "N")), self._pieces, values, data)

    @property
    def gap(self) -> Quantity:
        """Distance of the point from the surface [m], negative where it penetrates."""
        return self.surface.gap(self.point)
