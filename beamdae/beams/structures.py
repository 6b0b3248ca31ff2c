"""Frames: straight beams between named points, rigidly joined where they meet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.sections import Section, SectionLaw, Taper, require_section
from beamdae.curves.plane_curves import Line, PlaneCurve, Segment, require_curve
from beamdae.errors import (
    BeamdaeError,
    require_choice,
    require_count,
    require_name,
    require_point,
    require_sequence,
    short_repr,
    suggest,
)
from beamdae.parts.attachments import Attachment
from beamdae.parts.joints.joint import Weld
from beamdae.parts.mechanism import Mechanism

_MEMBER_FORMAT = "a pair of names of points, or these and a section"


class Frame(NamedTuple):
    """What `frame` added.

    Attributes
    ----------
    beams
        By the names of their two points, as they were given.
    corners
        The frame at each point: to be joined, loaded and observed.
    """

    beams: Mapping[tuple[str, str], Beam]
    corners: Mapping[str, Attachment]


def frame(
    mechanism: Mechanism,
    name: str,
    points: Mapping[str, tuple[float, float]],
    members: Sequence[Sequence[Any]],
    section: Section | SectionLaw | Taper | None = None,
    **settings: Any,
) -> Frame:
    """Add beams between named points, welded to each other wherever they meet.

    Beams are called "name A-B", the welds of the corner B "name B", "name B 2" and so on. Any
    number of beams meets in a corner, and they may enclose areas.

    Parameters
    ----------
    mechanism
        The Mechanism to add to.
    name
        What names begin with.
    points
        Names and places (x, y) of the corners and ends [m].
    members
        The beams: pairs of names of points, or triples of these and a section.
    section
        The section of those that come without one.
    settings
        Further arguments of each `Beam`.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> tube = bd.Section.pipe(bd.Material.of("steel"), diameter=0.05, wall=0.002)
    >>> corners = {"A": (0.0, 0.0), "B": (0.0, 1.0), "C": (2.0, 1.0), "D": (2.0, 0.0)}
    >>> portal = bd.frame(mech, "portal", corners, ["AB", "BC", "CD"], tube, elements=2)
    >>> clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), portal.corners["A"]))
    >>> list(mech.parts)
    ['portal A-B', 'portal B-C', 'portal C-D', 'portal B', 'portal C', 'clamp']
    """
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(f"frame: mechanism must be a Mechanism, got {short_repr(mechanism)}.")
    name = require_name("frame", name)
    if not isinstance(points, Mapping):
        raise BeamdaeError(
            f"{name}: points must be a dictionary of places, got {short_repr(points)}."
        )
    places = {
        require_name(name, key): require_point(name, f"point {key}", points[key]) for key in points
    }
    beams: dict[tuple[str, str], Beam] = {}
    meeting: dict[str, list[Attachment]] = {key: [] for key in places}
    for member in require_sequence(name, "members", members, "a list of pairs of names of points"):
        a, b, own = _parse_member(name, member, places, section)
        if (a, b) in beams or (b, a) in beams:
            raise BeamdaeError(f"{name}: the member {a}-{b} comes twice.")
        beam = mechanism.add(Beam(f"{name} {a}-{b}", Line(places[a], places[b]), own, **settings))
        beams[a, b] = beam
        meeting[a].append(beam.start)
        meeting[b].append(beam.end)
    for key, (first, *others) in ((k, ends) for k, ends in meeting.items() if ends):
        for count, other in enumerate(others, start=1):
            weld = f"{name} {key}" if count == 1 else f"{name} {key} {count}"
            mechanism.add(Weld(weld, first, other))
    return Frame(beams, {key: ends[0] for key, ends in meeting.items() if ends})


def _parse_member(
    name: str, member: Any, places: Mapping[str, Any], section: Any
) -> tuple[str, str, Any]:
    """Both points of a member, and its section."""
    # Points of one letter may be written together.
    given = (
        list(member)
        if isinstance(member, str)
        else require_sequence(name, "member", member, _MEMBER_FORMAT)
    )
    if len(given) not in (2, 3):
        raise BeamdaeError(f"{name}: a member must be {_MEMBER_FORMAT}, got {short_repr(member)}.")
    for key in given[:2]:
        if not isinstance(key, str) or key not in places:
            raise BeamdaeError(
                f"{name}: no point {short_repr(key)} of the member {short_repr(member)}"
                f"{suggest(key, places)}."
            )
    own = given[2] if len(given) == 3 else section
    if own is None:
        raise BeamdaeError(f"{name}: the member {given[0]}-{given[1]} needs a section.")
    return given[0], given[1], own


_MAX_BODIES = 10_000
# Distance of the ends of a closed curve, over its length: where a joint would refuse them anyway.
_MAX_CLOSING_GAP = 1e-6


def welded_beams(
    mechanism: Mechanism,
    name: str,
    curve: PlaneCurve,
    section: Section | SectionLaw | Taper,
    bodies: int,
    closed: bool = False,
    **settings: Any,
) -> list[Beam]:
    """Add a beam as `bodies` beams of equal length, welded end to start; returns them in order.

    The strains of eqs. (5) and (6) hold for moderate displacements relative to the floating frame:
    cut into n bodies a beam bends n times as far for the same deformation in each frame.

    Parameters
    ----------
    mechanism
        The Mechanism to add to.
    name
        The name of a single beam; several are called "name 1", "name 2", ...
    curve, section
        As in `Beam`, of the whole.
    bodies
        How many.
    closed
        Whether the last is welded to the first, of a curve whose ends meet; without it a ring is
        slit at its start.
    settings
        Further arguments of each `Beam`; `elements` is the number in each of them. `free_curve` is
        that of the whole.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> steel = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
    >>> strip = bd.Section.rectangle(steel, width=0.02, height=0.001)
    >>> arc = bd.Arc(radius=1.0, length=1.0)
    >>> [beam.name for beam in bd.welded_beams(mech, "strip", arc, strip, bodies=2, elements=4)]
    ['strip 1', 'strip 2']
    """
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(
            f"welded_beams: mechanism must be a Mechanism, got {short_repr(mechanism)}."
        )
    name = require_name("welded_beams", name)
    curve = require_curve(name, curve)
    bodies = require_count(name, "bodies", bodies, most=_MAX_BODIES)
    if require_choice(name, "closed", closed, (False, True)):
        _require_closed_curve(name, curve, bodies)
    if bodies == 1:
        return [mechanism.add(Beam(name, curve, section, **settings))]
    whole, free = require_section(name, section, curve.length), settings.pop("free_curve", None)
    beams = []
    for k, (start, end) in enumerate(pairwise(np.linspace(0.0, curve.length, bodies + 1)), start=1):
        own = whole if isinstance(whole, Section) else whole.law_from(start)
        if free is not None:
            settings["free_curve"] = _cut_free_curve(
                name, free, start / curve.length, end / curve.length
            )
        part = Segment(curve, start, end)
        beams.append(mechanism.add(Beam(f"{name} {k}", part, own, **settings)))
    for before, after in pairwise([*beams, beams[0]] if closed else beams):
        mechanism.add(Weld(f"{before.name} to {after.name}", before.end, after.start))
    return beams


def _cut_free_curve(name: str, free: Any, first: float, last: float) -> Segment:
    """The part of a free shape between two shares of its length."""
    length = require_curve(f"{name}, free_curve", free).length
    return Segment(free, first * length, last * length)


def _require_closed_curve(name: str, curve: PlaneCurve, bodies: int) -> None:
    """Refuse a curve whose ends lie apart."""
    if bodies < 2:
        raise BeamdaeError(f"{name}: closed=True needs at least 2 bodies, got {bodies}.")
    ends = np.array([0.0, curve.length])
    apart = float(np.hypot(*np.diff(curve.point(ends), axis=0)[0]))
    if apart > _MAX_CLOSING_GAP * curve.length:
        raise BeamdaeError(
            f"{name}: closed=True needs a curve whose ends meet, they lie {apart:.3g} m apart."
        )
