"""Starts inside a surface, and possible starts: only the former must be reported, part by part.

Each trial attaches one body to a mechanism with one surface, at three sizes, with and without
gravity. An impossible start must be refused, or a check and a run must report it with the name of
the part and a remedy. A possible start must not be reported.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import beamdae as bd
from robustness.trial_class import TrialClass

START_TIME_LIMIT = 60.0  # s
START_COUNT, QUICK_START_COUNT = 600, 20
RUN_TIME_LIMIT = 5.0  # s
_RUN_TIME = 1e-4  # s
_PART, _REPORT = "touch", "inside the surface"
_EXPONENT = 1.5
# Penetration of a contact under the weight of the body, relative to the size of the drawing.
_REST_DEPTHS = (1e-2, 1e-5)
_SIZES = (1e-3, 1.0, 1e3)  # m
_GRAVITIES = (0.0, 9.81)  # m/s^2
_STEEL = bd.Material.of("steel")


@dataclass(frozen=True)
class StartRow:
    """Row of the table of starts."""

    trial: str
    right: str
    ended: str
    complaint: str


@dataclass(frozen=True)
class _Point:
    """Point of a body at the origin, and the weight of the body for unit gravity [kg]."""

    attachment: Any
    mass: float


def _section(size: float) -> bd.Section:
    return bd.Section.rectangle(_STEEL, width=0.02 * size, height=0.01 * size)


def _beam(mech: bd.Mechanism, size: float, share: float, formulation: str) -> _Point:
    """Return the point at `share` of the length of a horizontal beam, which lies at the origin."""
    section, start = _section(size), -share * size
    line = bd.Line((start, 0.0), (start + size, 0.0))
    beam = mech.add(bd.Beam("body", line, section, elements=2, formulation=formulation))
    return _Point(beam.at(share * size), section.rhoA * size)


def _rigid_body(mech: bd.Mechanism, size: float) -> _Point:
    body = mech.add(bd.RigidBody("body", 2.0, 0.1 * size**2, center=(0.0, 0.1 * size)))
    return _Point(body.at(0.0, 0.0), 2.0)


BODIES: dict[str, Callable[[bd.Mechanism, float], _Point]] = {
    "particle": lambda m, size: _Point(m.add(bd.PointMass("body", 1.0, at=(0.0, 0.0))).point, 1.0),
    "rigid body": _rigid_body,
    "beam end": lambda m, size: _beam(m, size, 1.0, "floating frame"),
    "beam middle": lambda m, size: _beam(m, size, 0.5, "floating frame"),
    "exact beam end": lambda m, size: _beam(m, size, 1.0, "exact"),
    "exact beam middle": lambda m, size: _beam(m, size, 0.5, "exact"),
}


def _carriers(mech: bd.Mechanism, kind: str, at: tuple[float, float], size: float) -> Any:
    """Return an attachment at a point for a surface: on the ground, a body or a beam."""
    if kind == "ground":
        return mech.ground.at(*at)
    if kind == "body":
        return mech.add(bd.RigidBody("carrier", 5.0, size**2, center=at)).at(*at)
    line = bd.Line(at, (at[0] + size, at[1]))
    return mech.add(bd.Beam("carrier", line, _section(size), elements=1)).start


@dataclass(frozen=True)
class _Surface:
    """Surface near the origin, in units of the size.

    Attributes
    ----------
    depth
        Penetration of the origin; negative outside.
    at
        Position of the attachment.
    build
        Function (attachment, size) -> surface.
    """

    depth: float
    at: tuple[float, float]
    build: Callable[[Any, float], Any]


SURFACES = {
    "floor above": _Surface(1.0, (0.3, 1.0), lambda on, size: bd.LineSurface(on)),
    "reversed floor": _Surface(1.0, (0.3, -1.0), lambda on, size: bd.LineSurface(on, (-1.0, 0.0))),
    "reversed wall": _Surface(0.7, (-0.7, 0.0), lambda on, size: bd.LineSurface(on, (0.0, 3.0))),
    "center of a circle": _Surface(
        1.0, (0.0, 0.0), lambda on, size: bd.CircleSurface(on, 1.0 * size)
    ),
    "inside a circle": _Surface(0.6, (0.4, 0.0), lambda on, size: bd.CircleSurface(on, size)),
    "outside a bowl": _Surface(
        1.0, (0.0, 2.0), lambda on, size: bd.CircleSurface(on, size, side="inside")
    ),
    "floor": _Surface(-1.0, (0.3, -1.0), lambda on, size: bd.LineSurface(on)),
    "ceiling": _Surface(-1.0, (0.3, 1.0), lambda on, size: bd.LineSurface(on, (-1.0, 0.0))),
    "beside a circle": _Surface(-1.0, (2.0, 0.0), lambda on, size: bd.CircleSurface(on, size)),
    "in a bowl": _Surface(
        -1.0, (0.0, 0.0), lambda on, size: bd.CircleSurface(on, size, side="inside")
    ),
    "touching floor": _Surface(0.0, (0.3, 0.0), lambda on, size: bd.LineSurface(on)),
}


def _contact(mech: bd.Mechanism, point: _Point, surface: Any, size: float, depth: float) -> None:
    force = point.mass * 9.81
    stiffness = force / (depth * size) ** _EXPONENT
    mech.add(bd.Contact(_PART, point.attachment, surface, stiffness, _EXPONENT))


def _impact(mech: bd.Mechanism, point: _Point, surface: Any, size: float, depth: float) -> None:
    gap = surface.gap(point.attachment)
    mech.when(gap, 0.0, "down", bd.impact(gap, 0.5), name=_PART)


def _build(
    body: str, surface: str, carrier: str, kind: str, size: float, gravity: float, depth: float
) -> bd.Mechanism:
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    point = BODIES[body](mech, size)
    place = SURFACES[surface]
    on = _carriers(mech, carrier, (place.at[0] * size, place.at[1] * size), size)
    build = _impact if kind == "impact" else _contact
    build(mech, point, place.build(on, size), size, depth)
    return mech


def _resting(body: str, size: float, depth: float) -> bd.Mechanism:
    """Return a body that rests on one or two contacts, at the depth of the equilibrium."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    point = BODIES[body](mech, size)
    supports = [point.attachment]
    if body in ("beam end", "exact beam end"):
        supports.append(point.attachment.body.start)
    floor = bd.LineSurface(mech.ground.at(0.0, depth * size))
    stiffness = point.mass * 9.81 / len(supports) / (depth * size) ** _EXPONENT
    for k, support in enumerate(supports):
        mech.add(bd.Contact(f"{_PART} {k}", support, floor, stiffness, _EXPONENT))
    return mech


def collect_starts() -> dict[str, tuple[bool, Callable[[], bd.Mechanism]]]:
    """Return (whether the start is impossible, function that builds the mechanism) by name."""
    starts: dict[str, tuple[bool, Callable[[], bd.Mechanism]]] = {}
    for choice in product(
        BODIES, SURFACES, ("ground", "body", "beam"), ("contact", "impact"), _SIZES, _GRAVITIES
    ):
        body, surface, carrier, kind, size, gravity = choice
        for depth in _REST_DEPTHS if kind == "contact" else _REST_DEPTHS[:1]:
            name = f"{body}, {surface} on {carrier}, {kind}, {size:g} m, g {gravity:g}, {depth:g}"
            arguments = (*choice, depth)
            starts[name] = (
                SURFACES[surface].depth > 0.0,
                lambda arguments=arguments: _build(*arguments),
            )
    for body, size, depth in product(BODIES, _SIZES, _REST_DEPTHS):
        starts[f"{body}, resting, {size:g} m, {depth:g}"] = (
            False,
            lambda body=body, size=size, depth=depth: _resting(body, size, depth),
        )
    return starts


def try_start(name: str) -> StartRow:
    """Check and run the mechanism of a start and return its row."""
    is_impossible, build = collect_starts()[name]
    right = "refused or reported" if is_impossible else "not reported"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        try:
            mech = build()
            sentences = [bd.check(mech, predict=False).warnings]
            t_end = _RUN_TIME
            solution = bd.simulate(mech, bd.Radau(time_limit=RUN_TIME_LIMIT), t_end)
            sentences.append(solution.warnings)
        except bd.BeamdaeError as error:
            return StartRow(name, right, "refused", "" if is_impossible else str(error))
    reports = [any(x.startswith(_PART) and _REPORT in x for x in group) for group in sentences]
    ended = f"{solution.status.kind}, {'reported' if all(reports) else 'not reported'}"
    complaint = ""
    if is_impossible and not all(reports):
        complaint = f"it started inside and {'the run' if reports[0] else 'the check'} is silent"
    elif not is_impossible and any(reports):
        complaint = next(x for group in sentences for x in group if _REPORT in x)
    return StartRow(name, right, ended, complaint)


TRIALS = TrialClass(
    "starts",
    collect=lambda: list(collect_starts()),
    attempt=try_start,
    time_limit=START_TIME_LIMIT,
    quick_size=QUICK_START_COUNT,
    size=START_COUNT,
)
