"""Columns under follower loads, distributed loads and with varying sections."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any

import numpy as np

import beamdae as bd
from benchmarks.critical_loads.case import (
    BRANCH,
    EXACT_STRAINS,
    FLUTTER,
    CriticalLoad,
    CriticalLoadCase,
)
from benchmarks.critical_loads.column_dynamics import Column, divergence_loads, flutter_load
from benchmarks.critical_loads.structures import LENGTH, STEEL, WIDTH, stiffness, strip

# Sections of a tapered column at s: width and height relative to s = 0.
Taper = Callable[[float], tuple[float, float]]


def build_column(
    column: Column,
    taper: Taper | None,
    slenderness: float,
    elements: int,
    settings: Mapping[str, Any],
) -> bd.Mechanism:
    """Return the column under its loads times EI / L^2."""
    height, section = LENGTH / slenderness, strip(slenderness)
    unit = section.EI / LENGTH**2
    period = np.sqrt(section.rhoA * LENGTH**4 / section.EI)
    sections: Any = strip(slenderness, damping=column.damping * period)
    if taper is not None:

        def sections(s: float) -> bd.Section:
            width, factor = taper(s / LENGTH)
            return bd.Section.rectangle(STEEL, width=WIDTH * width, height=height * factor)

    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (0.0, LENGTH))
    beam = mech.add(bd.Beam("column", line, sections, elements, **settings))
    foot, head = mech.ground.at(0.0, 0.0), mech.ground.at(0.0, LENGTH)
    joint = bd.Weld if column.start == "clamped" else bd.Revolute
    mech.add(joint("foot", foot, beam.start))
    if column.end == "hinged":
        mech.add(bd.PointOnLine("head", head, beam.end, (0.0, 1.0)))
    elif column.end == "clamped":
        mech.add(bd.Prismatic("head", head, beam.end, (0.0, 1.0)))
    if column.end_mass:
        mech.add(bd.PointMass("mass", column.end_mass * section.rhoA * LENGTH, on=beam.end))
    _add_end_load(mech, column, beam, unit)
    if column.distributed:
        _add_distributed_load(mech, column, beam, unit / LENGTH)
    if column.foundation:
        modulus = column.foundation * unit / LENGTH**2
        mech.add(
            bd.DistributedForce("foundation", beam, lambda s, x, y, t: (-modulus * x, 0.0 * y))
        )
    return mech


def _add_end_load(mech: bd.Mechanism, column: Column, beam: bd.Beam, unit: float) -> None:
    P = column.end_load * unit
    if column.line_of_action:
        mech.add(bd.Force("load", beam.end, (0.0, -P)))
        # The offset of the line of action from the end is -x: its moment is -(-x) (-P).
        mech.add(bd.ForceLaw("offset", beam.end, lambda end, t: (0.0, 0.0, P * end.position[0])))
    elif np.isfinite(column.cable):
        anchor = LENGTH * (1.0 - column.cable)

        def pull(end: Any, t: Any) -> tuple[Any, Any]:
            x, y = end.position
            distance = np.sqrt(x**2 + (y - anchor) ** 2)
            return -P * x / distance, -P * (y - anchor) / distance

        mech.add(bd.ForceLaw("load", beam.end, pull))
    else:
        for name, axes, share in (
            ("dead load", "inertial", 1.0 - column.follower_end),
            ("follower load", "body", column.follower_end),
        ):
            if P * share:
                mech.add(bd.Force(name, beam.end, (0.0, -P * share), axes=axes))


def _add_distributed_load(mech: bd.Mechanism, column: Column, beam: bd.Beam, unit: float) -> None:
    """Add a uniform or linear load; uniform ones as constants, which every formulation takes."""

    def density(s: Any) -> Any:
        return sum(c * unit * (s / LENGTH) ** k for k, c in enumerate(column.distributed))

    uniform = len(column.distributed) == 1
    if column.follower_distributed:
        law = (-density(0.0), 0.0) if uniform else lambda s, x, y, t: (-density(s), 0.0 * s)
        mech.add(bd.DistributedForce("drag", beam, law, axes="section"))
    else:
        law = (0.0, -density(0.0)) if uniform else lambda s, x, y, t: (0.0 * s, -density(s))
        mech.add(bd.DistributedForce("weight", beam, law))


@cache
def _flutter_near(column: Column, near: tuple[float, float], slenderness: float) -> tuple:
    """Follow the onset of flutter from slender columns, where it is `near`, to thicker ones."""
    for value in (1e6, *(s for s in (1e2, 3e1, 2e1, 1.4e1) if s > slenderness), slenderness):
        near = flutter_load(column, stiffness(value), near)
    return near


def flutter_reference(
    column: Column, near: tuple[float, float], slenderness: float, strain: str
) -> tuple[CriticalLoad, ...]:
    """Return the first onset of flutter."""
    return (CriticalLoad(FLUTTER, _flutter_near(column, near, slenderness)[0]),)


def divergence_reference(
    column: Column, end: float, slenderness: float, strain: str
) -> tuple[CriticalLoad, ...]:
    """Return the branch points up to the load `end`."""
    loads = divergence_loads(column, stiffness(slenderness), end)
    return tuple(CriticalLoad(BRANCH, load) for load in loads)


def _phase(column: Column, load: float, frequency: float = 0.0) -> float:
    """Return the largest wave number over the column, of motions with an angular frequency."""
    P, EI = abs(load) * column.compression(0.0), 1.0
    if column.bending:
        EI = min(column.bending(s)[0] for s in (0.0, 1.0))
    return float(np.sqrt(0.5 * P + np.sqrt(0.25 * P**2 + frequency**2)) / np.sqrt(EI))


def flutter_case(
    name: str,
    source: str,
    column: Column,
    near: tuple[float, float],
    published: float | None = None,
    digits: float = 1e-3,
    **settings: Any,
) -> CriticalLoadCase:
    """Return the case of a column that flutters at the load and frequency `near` if slender."""
    return CriticalLoadCase(
        "follower load",
        name,
        source,
        build=partial(build_column, column, None),
        reference=partial(flutter_reference, column, near),
        path=lambda slenderness: {"to": 1.1 * near[0], **settings},
        phase=lambda load: _phase(column, load, near[1]),
        published=published,
        digits=digits,
        # The frequencies coincide in a double root.
        formulations=EXACT_STRAINS,
    )


def divergence_case(
    group: str,
    name: str,
    source: str,
    column: Column,
    end: float,
    published: float | None = None,
    digits: float = 1e-3,
    taper: Taper | None = None,
    loads: list[str] | None = None,
    **settings: Any,
) -> CriticalLoadCase:
    """Return the case of a column that buckles statically, loaded up to `end` [EI / L^2]."""
    return CriticalLoadCase(
        group,
        name,
        source,
        build=partial(build_column, column, taper),
        reference=partial(divergence_reference, column, end),
        path=lambda slenderness: {"to": end, "loads": loads},
        phase=partial(_phase, column),
        published=published,
        digits=digits,
        formulations=EXACT_STRAINS,
        **settings,
    )


def _tapered(taper: Taper) -> Callable[[float], tuple[float, float, float]]:
    """Return the stiffness relative to s = 0 of a rectangular section."""

    def ratios(s: float) -> tuple[float, float, float]:
        width, height = taper(s)
        return width * height**3, width * height, width * height

    return ratios


def _tapered_case(
    name: str, source: str, taper: Taper, end: float, published: float | None
) -> CriticalLoadCase:
    column = Column(bending=_tapered(taper))
    # Sections vary along the elements as well.
    return divergence_case(
        "tapered", name, source, column, end, published, taper=taper, mesh_constant=1e-4
    )


TIMOSHENKO = "Timoshenko & Gere (1961)"
_WEIGHT = {"end_load": 0.0, "distributed": (1.0,)}
_DRAG = {**_WEIGHT, "follower_distributed": 1.0}

FOLLOWER_CASES = (
    flutter_case(
        "Beck",
        "M. Beck, ZAMP 3 (1952) 225",
        Column(follower_end=1.0),
        (20.05, 11.0),
        20.0509536,
        1e-7,
    ),
    flutter_case(
        "Pflueger, head mass 0.1",
        "A. Pflueger, ZAMM 35 (1955) 191: characteristic equation",
        Column(follower_end=1.0, end_mass=0.1),
        (17.6, 9.4),
    ),
    flutter_case(
        "Pflueger, head mass 1",
        "A. Pflueger, ZAMM 35 (1955) 191: characteristic equation",
        Column(follower_end=1.0, end_mass=1.0),
        (16.2, 6.3),
        16.212,
        1e-3,
    ),
    flutter_case(
        "Reut",
        "V. I. Reut (1939); V. V. Bolotin, Nonconservative Problems (1963)",
        Column(line_of_action=True),
        (20.05, 11.0),
        20.0509536,
        1e-7,
        loads=["load", "offset"],
    ),
    flutter_case(
        # The foundation raises the frequencies but not the load.
        "Beck on an elastic foundation",
        "T. E. Smith, G. Herrmann, J. Appl. Mech. 39 (1972) 628",
        Column(follower_end=1.0, foundation=50.0),
        (20.05, 13.1),
        20.0509536,
        1e-7,
        loads=["follower load"],
    ),
    flutter_case(
        "half follower, half dead",
        "H. Leipholz, Stability Theory (1970)",
        Column(follower_end=0.5),
        (16.05, 7.06),
        16.05,
        1e-3,
    ),
    flutter_case(
        "three quarters follower",
        "H. Leipholz, Stability Theory (1970)",
        Column(follower_end=0.75),
        (16.6, 9.0),
    ),
    flutter_case(
        "Leipholz, uniform drag",
        "H. Leipholz (1962): 40.05",
        Column(**_DRAG),
        (40.05, 11.0),
        40.0537,
        1e-4,
    ),
    flutter_case(
        "Hauger, linear drag",
        "W. Hauger, Ing.-Arch. 35 (1966) 221: characteristic equation",
        Column(end_load=0.0, distributed=(1.0, -1.0), follower_distributed=1.0),
        (150.6, 11.5),
    ),
    flutter_case(
        "Beck, small material damping",
        "V. V. Bolotin, N. I. Zhinzher (1969): 10.94",
        Column(follower_end=1.0, damping=1e-3),
        (10.94, 5.4),
        10.94,
        1e-3,
    ),
    flutter_case(
        "Beck, material damping",
        "characteristic equation",
        Column(follower_end=1.0, damping=0.05),
        (11.3, 5.3),
    ),
    divergence_case(
        "follower load",
        "a quarter follower: divergence",
        "H. Leipholz, Stability Theory (1970)",
        Column(follower_end=0.25),
        15.0,
        3.65052,
        1e-5,
    ),
    divergence_case(
        "follower load",
        "hinged, uniform drag: divergence",
        "A. Pflueger, Stabilitaetsprobleme (1950): 18.96",
        Column(start="hinged", end="hinged", **_DRAG),
        60.0,
        18.956,
        1e-4,
    ),
    divergence_case(
        "follower load",
        "clamped, hinged, uniform drag: divergence",
        "H. Leipholz, Stability Theory (1970)",
        Column(end="hinged", **_DRAG),
        80.0,
        57.01,
        1e-3,
    ),
    divergence_case(
        "follower load",
        "load through a cable to the foot",
        f"{TIMOSHENKO}: pi^2",
        Column(cable=1.0),
        30.0,
        9.8696044,
        1e-7,
        loads=["load"],
    ),
    divergence_case(
        "follower load",
        "load directed to twice the height below",
        f"{TIMOSHENKO}: tan(k L) = -k L",
        Column(cable=2.0),
        20.0,
        4.11586,
        1e-5,
        loads=["load"],
    ),
)
WEIGHT_CASES = (
    divergence_case(
        "own weight",
        "clamped, free",
        "A. G. Greenhill, Proc. Cambridge Phil. Soc. 4 (1881) 65: 7.8373",
        Column(**_WEIGHT),
        70.0,
        7.83735,
        1e-5,
    ),
    divergence_case(
        "own weight",
        "hinged, hinged",
        f"{TIMOSHENKO}",
        Column(start="hinged", end="hinged", **_WEIGHT),
        60.0,
        18.5687,
        1e-5,
    ),
    divergence_case(
        "own weight",
        "clamped, hinged",
        f"{TIMOSHENKO}",
        Column(end="hinged", **_WEIGHT),
        90.0,
        52.5007,
        1e-5,
    ),
    divergence_case(
        "own weight",
        "clamped, clamped",
        f"{TIMOSHENKO}",
        Column(end="clamped", **_WEIGHT),
        110.0,
        74.6286,
        1e-5,
    ),
    divergence_case(
        "own weight",
        "clamped, free, and a load at the head",
        f"{TIMOSHENKO}",
        Column(end_load=0.25, distributed=(1.0,)),
        35.0,
    ),
    divergence_case(
        "own weight",
        "linearly decreasing",
        f"{TIMOSHENKO}",
        Column(end_load=0.0, distributed=(1.0, -1.0)),
        60.0,
    ),
)
TAPERED_CASES = (
    _tapered_case(
        "width to a fifth",
        "A. N. Dinnik, Trans. ASME 51 (1929); Bessel functions",
        lambda s: (1.0 - 0.8 * s, 1.0),
        30.0,
        None,
    ),
    _tapered_case(
        "height to a half",
        "A. N. Dinnik, Trans. ASME 51 (1929); Bessel functions",
        lambda s: (1.0, 1.0 - 0.5 * s),
        25.0,
        None,
    ),
    _tapered_case(
        "pyramid, sides to a half",
        "A. N. Dinnik, Trans. ASME 51 (1929); elementary",
        lambda s: (1.0 - 0.5 * s, 1.0 - 0.5 * s),
        20.0,
        None,
    ),
)
