"""The symbols joints, springs, loads and surfaces have in a drawing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.beams.distributed_force import DistributedForce, MovingForce
from beamdae.beams.sliding import SlidingOnBeam
from beamdae.parts.attachments import Attachment
from beamdae.parts.bodies import Ground
from beamdae.parts.bushing import Bushing
from beamdae.parts.contact import Contact
from beamdae.parts.distance import Distance
from beamdae.parts.drivers import Driver, TranslationalDriver
from beamdae.parts.elastic import Elastic
from beamdae.parts.forces import Force, Moment
from beamdae.parts.gears import Gear, RackAndPinion
from beamdae.parts.guides import PointOnLine, Prismatic
from beamdae.parts.joints import Joint, Revolute, Weld
from beamdae.parts.laws import Law
from beamdae.parts.part import Part
from beamdae.parts.rolling import RollingOnCircle, RollingOnLine
from beamdae.parts.skate import Skate
from beamdae.parts.springs import Damper, TorsionSpring
from beamdae.parts.surfaces import CircleSurface, LineSurface
from beamdae.report.pen import JOINT, LOAD, SPRING, Pen, Place

if TYPE_CHECKING:
    pass

Array = np.ndarray

_ALONG_BEAM, _TURNS = 9, 6
# Times at which a load that begins with nothing is looked at [s].
_LATER = (1e-3, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)


@singledispatch
def symbol(part: Part, pen: Pen) -> None:
    """Draw what is no body: by default a dot where it is attached, with its name."""
    for attachment in part.attachments:
        pen.dot(attachment.point, "D", ms=4, color=LOAD if part.is_load else JOINT)
    if part.attachments:
        pen.name(part.attachments[0].point, part.name)


def _grounded(part: Any, pen: Pen) -> None:
    for attachment in part.attachments:
        if isinstance(attachment.body, Ground):
            pen.support(attachment.point)


@symbol.register
def _joint(part: Joint, pen: Pen) -> None:
    _grounded(part, pen)
    pen.dot(part.b.point, "D", ms=5)
    pen.name(part.b.point, part.name)


@symbol.register
def _revolute(part: Revolute, pen: Pen) -> None:
    _grounded(part, pen)
    pen.dot(part.b.point, "o")
    pen.name(part.b.point, part.name)


@symbol.register
def _weld(part: Weld, pen: Pen) -> None:
    _grounded(part, pen)
    pen.dot(part.b.point, "s", mfc=JOINT)
    pen.name(part.b.point, part.name)


@symbol.register(PointOnLine)
@symbol.register(Prismatic)
@symbol.register(TranslationalDriver)
def _guide(part: Any, pen: Pen) -> None:
    _along(pen, part.a.point, part.direction, 3.0)
    if isinstance(part, TranslationalDriver):
        reach = 2.5 * pen.size * _unit(part.direction)
        pen.arrow(part.b.point, part.b.point + reach, color=JOINT)
    pen.dot(part.b.point, "s" if isinstance(part, Prismatic) else "o")
    pen.name(part.b.point, part.name)


@symbol.register
def _distance(part: Distance, pen: Pen) -> None:
    _grounded(part, pen)
    pen.line([part.a.point, part.b.point], ls=(0, (1, 1.5)))
    for at in (part.a.point, part.b.point):
        pen.dot(at, "o", ms=4)
    pen.name(_middle(part.a, part.b), part.name)


@symbol.register
def _driver(part: Driver, pen: Pen) -> None:
    _grounded(part, pen)
    pen.turn(part.b.point, 1.3 * pen.size, color=JOINT)
    pen.name(part.b.point, part.name)


@symbol.register(Gear)
@symbol.register(RackAndPinion)
def _gear(part: Any, pen: Pen) -> None:
    pen.line([part.a.point, part.b.point], ls=(0, (6, 2, 1, 2)), lw=0.9)
    pen.name(_middle(part.a, part.b), part.name)


@symbol.register
def _rolling(part: RollingOnLine, pen: Pen) -> None:
    _along(pen, part.a.point, part.direction, 6.0)
    pen.circle(part.b.point, abs(part.radius), lw=0.9)
    pen.name(part.b.point, part.name)


@symbol.register
def _rolling_circle(part: RollingOnCircle, pen: Pen) -> None:
    for at, radius in zip((part.a.point, part.b.point), part.radii, strict=True):
        pen.circle(at, abs(radius), lw=0.9)
    pen.name(part.b.point, part.name)


@symbol.register
def _skate(part: Skate, pen: Pen) -> None:
    reach = pen.size * _unit(part.direction)
    pen.line([part.on.point - reach, part.on.point + reach], lw=3.0)
    pen.name(part.on.point, part.name)


@symbol.register
def _sliding(part: SlidingOnBeam, pen: Pen) -> None:
    pen.dot(part.a.point, "s")
    pen.name(part.a.point, part.name)


@symbol.register
def _between(part: Elastic, pen: Pen) -> None:
    """A zigzag, a dashpot or a spiral, by what resists."""
    _grounded(part, pen)
    a, b = np.array(part.a.point), np.array(part.b.point)
    length = float(np.hypot(*(b - a)))
    if isinstance(part, (TorsionSpring, Bushing)) or length < 0.1 * pen.size:
        turns = np.linspace(0.0, 2.0 * math.pi * 2.25, 90)
        radius = np.linspace(0.25, 1.3, 90) * pen.size
        pen.line(a + (radius * np.array([np.cos(turns), np.sin(turns)])).T, color=SPRING)
        if isinstance(part, Bushing):
            pen.dot(a, "s", ms=12, mfc="none", color=SPRING)
    elif isinstance(part, Damper):
        _dashpot(a, b, pen)
    else:
        pen.line(_zigzag(a, b, pen.size), color=SPRING)
    pen.name(0.5 * (a + b), part.name)


def _zigzag(a: Array, b: Array, size: float) -> Array:
    along = (b - a) / np.hypot(*(b - a))
    normal = np.array([-along[1], along[0]])
    ends = [0.0, 0.2, *np.linspace(0.2, 0.8, 2 * _TURNS + 1)[1:-1], 0.8, 1.0]
    sides = [0.0, 0.0, *((-1.0) ** np.arange(2 * _TURNS - 1)), 0.0, 0.0]
    return np.array(
        [a + x * (b - a) + 0.5 * size * side * normal for x, side in zip(ends, sides, strict=True)]
    )


def _dashpot(a: Array, b: Array, pen: Pen) -> None:
    along = (b - a) / np.hypot(*(b - a))
    half = 0.45 * pen.size * np.array([-along[1], along[0]])
    cup, mouth, piston = (a + x * (b - a) for x in (0.4, 0.62, 0.5))
    pen.line([a, cup], color=SPRING)
    pen.line([mouth - half, cup - half, cup + half, mouth + half], color=SPRING)
    pen.line([piston - 0.8 * half, piston + 0.8 * half], color=SPRING)
    pen.line([piston, b], color=SPRING)


@symbol.register
def _contact(part: Contact, pen: Pen) -> None:
    surface = part.surface
    if isinstance(surface, LineSurface):
        _along(pen, surface.on.point, surface.direction, 8.0, hatched=True)
    elif isinstance(surface, CircleSurface):
        pen.circle(surface.on.point, surface.radius, color="0.5")
    pen.dot(part.point.point, "v", ms=5)
    pen.name(part.point.point, part.name)


@symbol.register
def _force(part: Force, pen: Pen) -> None:
    inclination = part.on.inclination if part.axes == "body" else 0.0
    _push(pen, part.on, _values(part.laws), inclination)
    pen.name(part.on.point, part.name)


@symbol.register
def _moment(part: Moment, pen: Pen) -> None:
    (value,) = _values(part.laws)
    pen.turn(part.on.point, 1.6 * pen.size, math.copysign(1.0, value))
    pen.name(part.on.point, part.name)


@symbol.register
def _distributed(part: DistributedForce, pen: Pen) -> None:
    places = [part.beam.at(s) for s in np.linspace(0.0, part.beam.length, _ALONG_BEAM)]
    ends: list[Place] = [at.point for at in places]
    if part.laws:
        turned = part.axes == "section"
        load = _values(part.laws)
        ends = [_push(pen, at, load, at.inclination if turned else 0.0, 2.0) for at in places]
        pen.line(ends, color=LOAD, lw=0.8)
    else:
        # A formula of the place has no one direction.
        for at in places:
            pen.dot(at.point, "v", ms=4, color=LOAD)
    pen.name(ends[_ALONG_BEAM // 2], part.name)


@symbol.register
def _moving(part: MovingForce, pen: Pen) -> None:
    at = part.beam.at(min(max(part.start, 0.0), part.beam.length))
    tail = _push(pen, at, part.force)
    ahead = 2.0 * pen.size * math.copysign(1.0, part.speed)
    c, s = math.cos(at.inclination), math.sin(at.inclination)
    pen.arrow(tail, tail + ahead * np.array([c, s]), arrowstyle="->")
    pen.name(tail, part.name)


def _push(
    pen: Pen, at: Attachment, load: Sequence[float], inclination: float = 0.0, reach: float = 3.5
) -> Array:
    """An arrow that ends at a place; returns where it begins."""
    along = _unit(load)
    c, s = math.cos(inclination), math.sin(inclination)
    tail = np.array(at.point) - reach * pen.size * np.array([[c, -s], [s, c]]) @ along
    pen.arrow(tail, at.point)
    return tail


def _values(laws: Sequence[Law]) -> list[float]:
    """What laws give at t = 0, or at the first later time at which they give something."""
    for t in (0.0, *_LATER):
        values = [law.at(t) for law in laws]
        if any(values):
            return values
    return [0.0] * len(laws)


def _unit(direction: Sequence[float]) -> Array:
    size = math.hypot(*direction)
    return np.array(direction, float) / size if size > 0.0 else np.array([0.0, -1.0])


def _middle(a: Attachment, b: Attachment) -> Array:
    return 0.5 * (np.array(a.point) + np.array(b.point))


def _along(
    pen: Pen, at: Place, direction: Sequence[float], reach: float, hatched: bool = False
) -> None:
    """A line through a place, such as that of a guide."""
    along = _unit(direction)
    half = reach * pen.size * along
    pen.line([at - half, at + half], color="0.5", lw=1.0, ls="-" if hatched else (0, (5, 3)))
    if hatched:
        down = np.array([along[1], -along[0]])
        for x in np.linspace(-1.0, 1.0, 13)[1:]:
            foot = np.array(at) + x * half
            pen.line([foot, foot + 0.4 * pen.size * (down - along)], color="0.5", lw=0.7)
