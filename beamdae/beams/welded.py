"""A beam cut into several, each with a floating frame of its own."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.sections import Section
from beamdae.beams.varying_section import SectionLaw, Taper, require_section
from beamdae.curves.plane_curves import PlaneCurve, Segment, require_curve
from beamdae.errors import BeamdaeError, require_choice, require_count, short_repr
from beamdae.parts.joints.joint import Weld
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import require_name

_MOST_BODIES = 10_000
# Distance of the ends of a closed curve, over its length: where a joint would refuse them anyway.
_MOST_OPEN = 1e-6


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
    bodies = require_count(name, "bodies", bodies, most=_MOST_BODIES)
    if require_choice(name, "closed", closed, (False, True)):
        _require_ring(name, curve, bodies)
    if bodies == 1:
        return [mechanism.add(Beam(name, curve, section, **settings))]
    whole, free = require_section(name, section, curve.length), settings.pop("free_curve", None)
    beams = []
    for k, (start, end) in enumerate(pairwise(np.linspace(0.0, curve.length, bodies + 1)), start=1):
        own = whole if isinstance(whole, Section) else whole.beginning(start)
        if free is not None:
            settings["free_curve"] = _part_of(name, free, start / curve.length, end / curve.length)
        part = Segment(curve, start, end)
        beams.append(mechanism.add(Beam(f"{name} {k}", part, own, **settings)))
    for before, after in pairwise([*beams, beams[0]] if closed else beams):
        mechanism.add(Weld(f"{before.name} to {after.name}", before.end, after.start))
    return beams


def _part_of(name: str, free: Any, first: float, last: float) -> Segment:
    """The part of a free shape between two shares of its length."""
    length = require_curve(f"{name}, free_curve", free).length
    return Segment(free, first * length, last * length)


def _require_ring(name: str, curve: PlaneCurve, bodies: int) -> None:
    """Refuse a curve whose ends lie apart."""
    if bodies < 2:
        raise BeamdaeError(f"{name}: closed=True needs at least 2 bodies, got {bodies}.")
    ends = np.array([0.0, curve.length])
    apart = float(np.hypot(*np.diff(curve.point(ends), axis=0)[0]))
    if apart > _MOST_OPEN * curve.length:
        raise BeamdaeError(
            f"{name}: closed=True needs a curve whose ends meet, they lie {apart:.3g} m apart."
        )
