"""Structures of several beams: frames of straight beams, and divided curved beams."""

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
    as_text,
    require_choice,
    require_count,
    require_keywords,
    require_mapping,
    require_name,
    require_point,
    require_sequence,
    short_repr,
    suggest,
    warn_user,
)
from beamdae.parts.attachments import Attachment
from beamdae.parts.joints.joint import Weld
from beamdae.parts.mechanism import Mechanism
from beamdae.read_only import ReadOnlyDict

_MEMBER_FORMAT = "a pair of point names, optionally followed by a section"
_MAX_BODIES = 10_000
# Largest gap between the ends of a closed curve, relative to its length; joints reject larger gaps.
_MAX_CLOSING_GAP = 1e-6


class Frame(NamedTuple):
    """Beams and corners that `frame` added to a mechanism.

    Attributes
    ----------
    beams
        Beams by pair of point names (first point, second point), in the order given in `members`.
    corners
        Attachment at each point that has a beam, by the name of the point, for joints, loads and
        observables.
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
    """Add straight beams between named points, welded together where they meet.

    Any number of beams can meet at a corner, and they can enclose areas. The beam from A to B is
    named "name A-B"; the welds of corner B are named "name B", "name B 2" and so on.

    Parameters
    ----------
    mechanism
        The `Mechanism` to which the beams are added.
    name
        Prefix of the names.
    points
        Positions (x, y) [m] of corners and ends, by name.
    members
        The beams: pairs of point names, or triples of two point names and a section. For points
        with one-letter names, a string such as "AB" is a pair.
    section
        Section of the members that do not specify one.
    **settings
        Further keyword arguments of each `Beam`.

    Returns
    -------
    Frame
        The beams and the corners.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, or a member refers to an unknown point, has no section, or is
        listed twice.

    Warns
    -----
    BeamdaeWarning
        If no member uses a point. See also `Beam`.

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
    require_keywords(name, settings, Beam)
    points = require_mapping(name, "points", points, "a dictionary of positions (x, y) by name")
    positions = {
        require_name(name, key): require_point(name, f"point {key}", point)
        for key, point in points.items()
    }
    beams: dict[tuple[str, str], Beam] = {}
    ends: dict[str, list[Attachment]] = {key: [] for key in positions}
    for member in require_sequence(name, "members", members, "a list of pairs of point names"):
        a, b, member_section = _parse_member(name, member, positions, section)
        if (a, b) in beams or (b, a) in beams:
            raise BeamdaeError(
                f"{name}: the member {a}-{b} is listed twice; list each member once."
            )
        line = Line(positions[a], positions[b])
        beam = mechanism.add(Beam(f"{name} {a}-{b}", line, member_section, **settings))
        beams[a, b] = beam
        ends[a].append(beam.start)
        ends[b].append(beam.end)
    unused = [key for key, attachments in ends.items() if not attachments]
    if unused:
        # A dictionary of points may be shared by several frames.
        warn_user(
            f"{name}: no member uses point {', '.join(map(short_repr, unused))}, so the frame has "
            "no corner there; add a member, or omit the point."
        )
    corners = {key: attachments[0] for key, attachments in ends.items() if attachments}
    for key, corner in corners.items():
        for count, other in enumerate(ends[key][1:], start=1):
            weld = f"{name} {key}" if count == 1 else f"{name} {key} {count}"
            mechanism.add(Weld(weld, corner, other))
    return Frame(ReadOnlyDict(beams), ReadOnlyDict(corners))


def _parse_member(
    name: str, member: Any, positions: Mapping[str, Any], section: Any
) -> tuple[str, str, Any]:
    # A string such as "AB" is a pair of points with one-letter names.
    text = as_text(member)
    entries = (
        list(text) if text is not None else require_sequence(name, "member", member, _MEMBER_FORMAT)
    )
    if len(entries) not in (2, 3):
        raise BeamdaeError(f"{name}: a member must be {_MEMBER_FORMAT}, got {short_repr(member)}.")
    a, b, *own_section = entries
    for key in (a, b):
        if not isinstance(key, str) or key not in positions:
            raise BeamdaeError(
                f"{name}: the member {short_repr(member)} names an unknown point "
                f"{short_repr(key)}{suggest(key, positions)}; add this point to points "
                "or correct the member."
            )
    member_section = own_section[0] if own_section else section
    if member_section is None:
        raise BeamdaeError(
            f"{name}: the member {a}-{b} has no section; pass section= or a third entry of "
            "the member."
        )
    return a, b, member_section


def welded_beams(
    mechanism: Mechanism,
    name: str,
    curve: PlaneCurve,
    section: Section | SectionLaw | Taper,
    bodies: int,
    closed: bool = False,
    **settings: Any,
) -> list[Beam]:
    """Add a beam that consists of `bodies` beams of equal length, welded end to start.

    The strains of a floating frame, eqs. (5) and (6) of Pan & Liu (2012), hold for moderate
    rotations relative to the frame. A beam divided into n bodies can bend n times as far for the
    same rotations in each frame.

    Parameters
    ----------
    mechanism
        The `Mechanism` to which the beams are added.
    name
        Name of the beam if `bodies` is 1; otherwise, the beams are named "name 1", "name 2", ...
    curve, section
        Curve and section of the whole beam, as in `Beam`.
    bodies
        Number of beams, at most 10 000.
    closed
        If True, the end of the last beam is welded to the start of the first, for a curve whose
        ends meet. If False (default), the ends of a ring are not connected.
    **settings
        Further keyword arguments of each `Beam`. `elements` is the number of elements of each beam,
        `free_curve` the stress-free shape of the whole beam.

    Returns
    -------
    list of Beam
        The beams in order of arc length.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, or `closed` is True for a single body or for a curve whose ends
        do not meet.

    Warns
    -----
    BeamdaeWarning
        See `Beam`.

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
    whole_section = require_section(name, section, curve.length)
    free = settings.pop("free_curve", None)
    if free is not None:
        require_curve(f"{name}, free_curve", free)
    beams = []
    for k, (start, end) in enumerate(pairwise(np.linspace(0.0, curve.length, bodies + 1)), start=1):
        body_section = (
            whole_section if isinstance(whole_section, Section) else whole_section.law_from(start)
        )
        if free is not None:
            first, last = start / curve.length, end / curve.length
            settings["free_curve"] = Segment(free, first * free.length, last * free.length)
        beam = Beam(f"{name} {k}", Segment(curve, start, end), body_section, **settings)
        beams.append(mechanism.add(beam))
    for before, after in pairwise([*beams, beams[0]] if closed else beams):
        mechanism.add(Weld(f"{before.name} to {after.name}", before.end, after.start))
    return beams


def _require_closed_curve(name: str, curve: PlaneCurve, bodies: int) -> None:
    if bodies < 2:
        raise BeamdaeError(f"{name}: closed=True requires at least 2 bodies, got {bodies}.")
    ends = np.array([0.0, curve.length])
    gap = float(np.hypot(*np.diff(curve.point(ends), axis=0)[0]))
    if gap > _MAX_CLOSING_GAP * curve.length:
        raise BeamdaeError(
            f"{name}: closed=True requires a curve whose ends meet, but the ends are "
            f"{gap:.3g} m apart."
        )
