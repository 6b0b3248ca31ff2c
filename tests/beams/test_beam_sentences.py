"""Errors of beams and sections: one row a sentence, with a call that causes it.

Arguments of wrong types and signs have sentences in `tests/test_sentences.py`.
"""

import re

import numpy as np
import pytest

import beamdae as bd

ALLOY = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
STRIP = bd.Section.rectangle(ALLOY, width=0.02, height=0.001)
ARC, LINE = bd.Arc(radius=1.6, length=2.0), bd.Line((0.0, 0.0), (1.0, 0.0))
RING = bd.Arc(radius=0.5, length=np.pi)
DISK = bd.RigidBody("disk", 1.0, 0.1)
Section = bd.Section


def rod(curve=ARC, section=STRIP, **settings):
    return bd.Beam("rod", curve, section, **settings)


def taper(**sizes):
    return bd.taper(Section.circle, ALLOY, **sizes)


def frame(points=None, members=("AB",), section=STRIP):
    points = points or {"A": (0.0, 0.0), "B": (1.0, 0.0)}
    return bd.frame(bd.Mechanism(), "f", points, members, section)


def closed(curve, bodies):
    return bd.welded_beams(bd.Mechanism(), "w", curve, STRIP, bodies, closed=True)


def pressure(law):
    return bd.DistributedForce("p", rod(), law)


SENTENCES = {
    # Materials and sections
    r"nu must lie in \(-1, 0.5\], got 0.51": lambda: bd.Material(E=1.0, nu=0.51, rho=1.0),
    r"^Material.of: the name must be one of 'steel', .*\(did you mean 'steel'": lambda: (
        bd.Material.of("stel")
    ),
    "^Section.pipe: wall must be less than half the diameter .0.05 m., got 0.05": lambda: (
        Section.pipe(ALLOY, 0.1, 0.05)
    ),
    "^Section.i_profile: flange must be less than half the height .0.1 m., got 0.1": lambda: (
        Section.i_profile(ALLOY, 0.1, 0.2, 0.1, 0.01)
    ),
    "^Section.i_profile: web must be less than the width .0.1 m., got 0.1": lambda: (
        Section.i_profile(ALLOY, 0.1, 0.2, 0.01, 0.1)
    ),
    # Beams
    "^rod: section must be .* a taper or .* returns a Section, got 3": lambda: rod(section=3),
    "^rod: continuity='local' requires .* meet at kinks; set continuity='cartesian'": lambda: rod(
        continuity="local", nodes=2
    ),
    r"^rod: .*must ascend from 0 to 1 m, got \[0.0, 0.5, 0.5, 1.0\]": lambda: rod(
        LINE, elements=[0.0, 0.5, 0.5, 1.0]
    ),
    r"must ascend from 0 to 1 m, got \[-0.5, 1.0\]": lambda: rod(LINE, elements=[-0.5, 1.0]),
    "^rod: arc length s must": lambda: rod().at(2.1),
    # Values that a sentence compares have enough digits to differ.
    r"must lie in \[0, 1\] m, got 1.0000001 m": lambda: rod(LINE).at(1.0000001),
    r"within half the height of the section \(0.0029999996 m\), got 0.003 m": lambda: rod(
        section=Section.rectangle(ALLOY, width=0.02, height=0.0059999992)
    ).stress(0.0, 0.003),
    "^rod: offset 'top' requires the height of the section": lambda: rod(
        section=Section(ALLOY, 1e-4, 1e-9)
    ).stress(0.5, "top"),
    "^rod: frame 'chord' requires a curve with separate": lambda: rod(RING, frame="chord"),
    "^rod: strain and continuity must be omitted with formulation=": lambda: rod(
        formulation="exact", strain="green", continuity="cartesian"
    ),
    "^rod: formulation must be omitted": lambda: rod(formulation="exact", kinematics=print),
    "curve, 1 m, must differ by at most 1 % from the length of free_curve, 1.1 m": lambda: rod(
        LINE, free_curve=bd.Line((0, 0), (1.1, 0))
    ),
    # Sections along a beam
    "the call failed at s = 0 m: ZeroDivisionError": lambda: rod(section=lambda s: 1 / 0),
    "^rod, section at s = 0.5 m: Section.circle: diameter must be positive, got 0": lambda: rod(
        LINE, lambda s: Section.circle(ALLOY, 0.01 - 0.02 * s)
    ),
    r"^rod: the section varies along the beam; use section.at\(s\).EA": lambda: (
        rod(section=lambda s: STRIP).section.EA
    ),
    r"^taper: diameter must be a number, a pair .* or a list of numbers": lambda: taper(
        diameter=(1.0,)
    ),
    r"^taper: diameter \[1\] must be a number": lambda: taper(diameter=(1.0, "a", 3.0)),
    "^taper, section at 50 % of the length: Section.circle: diameter must be": lambda: taper(
        diameter=(0.01, 0.0, 0.01)
    ),
    "there is no argument 'width'": lambda: taper(width=1.0),
    # Loads and damping
    "^air: 'rod' is not part of this mechanism": lambda: bd.Mechanism().add(
        bd.AirDrag("air", rod(), 1.0)
    ),
    "^p: law must return 2 numbers": lambda: pressure(lambda s, x, y, t: s),
    "^p: law must be a formula": lambda: pressure(lambda t: (t, t)),
    r"^p: speed must not be zero; for a force at rest, use a Force on beam\.at\(s\)": lambda: (
        bd.MovingForce("p", rod(), (0, 1), 0.0)
    ),
    "^p: at speed = .* m/s, the force needs more than": lambda: bd.MovingForce(
        "p", rod(), (0, 1), 5e-324
    ),
    # Sliders
    r"^slide: the point must lie on the beam .* disk at \(0, 1\) is \S+ m off the axis": lambda: (
        bd.SlidingOnBeam("slide", DISK.at(0.0, 1.0), rod())
    ),
    "^slide: the point must belong to a body other than the beam": lambda: bd.SlidingOnBeam(
        "slide", (beam := rod()).end, beam
    ),
    # Frames
    "^f: the member 'AC' names an unknown point 'C'": lambda: frame(members=["AC"]),
    "^f: a member must be a pair of point names": lambda: frame(members=["A"]),
    "^f: the member B-A is listed twice": lambda: frame(members=["AB", "BA"]),
    "^f: the member A-B has no section": lambda: frame(section=None),
    "^f: point B must be a pair": lambda: frame(points={"A": (0, 0), "B": 1.0}),
    "^w: closed=True requires a curve whose ends meet, but the ends are 1.68 m apart": lambda: (
        closed(bd.Arc(1.0, 2.0), 3)
    ),
    "^w: closed=True requires at least 2 bodies, got 1": lambda: closed(RING, 1),
}


def test_errors_of_beams_are_one_sentence():
    for sentence, call in SENTENCES.items():
        with pytest.raises(bd.BeamdaeError, match=sentence) as caught:
            call()
        assert re.fullmatch(r".+\.", str(caught.value)), sentence
