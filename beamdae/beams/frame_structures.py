"""Frames: straight beams between named points, rigidly joined where they meet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from beamdae.beams.beam import Beam
from beamdae.beams.sections import Section
from beamdae.beams.varying_section import SectionLaw, Taper
from beamdae.curves.plane_curves import Line
from beamdae.errors import BeamdaeError, require_point, require_sequence, short_repr, suggest
from beamdae.parts.attachments import Attachment
from beamdae.parts.joints.joint import Weld
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import require_name

_MEMBER = "a pair of names of points, or these and a section"


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
        a, b, own = _member(name, member, places, section)
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


def _member(
    name: str, member: Any, places: Mapping[str, Any], section: Any
) -> tuple[str, str, Any]:
    """Both points of a member, and its section."""
    # Points of one letter may be written together.
    given = (
        list(member)
        if isinstance(member, str)
        else require_sequence(name, "member", member, _MEMBER)
    )
    if len(given) not in (2, 3):
        raise BeamdaeError(f"{name}: a member must be {_MEMBER}, got {short_repr(member)}.")
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
