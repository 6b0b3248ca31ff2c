"""Critical loads of columns and of systems of rigid bars."""

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any

import numpy as np
from benchmarks.critical_loads.case import (
    EXACT_STRAINS,
    FLUTTER,
    LENGTH,
    STEEL,
    WIDTH,
    CriticalLoad,
    branches,
    build_frame,
    stiffness,
    strip,
)
from benchmarks.critical_loads.frame_stability import (
    Column,
    FrameDescription,
    Member,
    divergence_loads,
    flutter_load,
    frame_critical_loads,
)

import beamdae as bd

Springs = Mapping[str, tuple[float, float, float]]

# First-order difference between Engesser's formula with Green's stretch and frames that rotate
# with a chord, times the largest P / EA = P L^2 / (12 s^2 EI) of the cases.
_GREEN_DEPARTURE = 0.5

# Sections of a tapered column at s: width and height relative to s = 0.
Taper = Callable[[float], tuple[float, float]]


def frame(description: FrameDescription, end: float) -> dict[str, Any]:
    """Return the fields of the case of a frame loaded up to `end` [EI / L^2]."""
    return {
        "build": partial(build_frame, description),
        "reference": lambda slenderness, strain: branches(
            frame_critical_loads(description, stiffness(slenderness, strain), end)
        ),
        "path": lambda slenderness: {"to": end},
        "phase": description.wave_angle,
        "green_departure": _GREEN_DEPARTURE * end,
    }


def column(supports: Mapping[str, str], springs: Springs | None = None) -> FrameDescription:
    """Return a column from the foot "a" to the head "b", loaded at its head."""
    nodes = {"a": (0.0, 0.0), "b": (0.0, 1.0)}
    members = (Member("a", "b", 1.0),)
    return FrameDescription(nodes, members, supports, {"b": (0.0, -1.0)}, springs or {})


def stack(
    heights: tuple[float, ...],
    supports: Mapping[str, str],
    compressions: tuple[float, ...] | None = None,
    widths: tuple[float, ...] | None = None,
    springs: Springs | None = None,
    hinges: tuple[int, ...] = (),
) -> FrameDescription:
    """Return a straight column through nodes at the given heights, numbered from 0.

    `compressions` are the axial forces of the parts per unit load; each node carries the
    difference of the parts below and above it. `hinges` are the nodes with an internal hinge.
    """
    count = len(heights) - 1
    compressions, widths = compressions or (1.0,) * count, widths or (1.0,) * count
    members = tuple(
        Member(str(k), str(k + 1), compressions[k], widths[k], "a" if k in hinges else "")
        for k in range(count)
    )
    above = (*compressions[1:], 0.0)
    loads = {
        str(k + 1): (0.0, upper - lower)
        for k, (lower, upper) in enumerate(zip(compressions, above, strict=True))
        if lower != upper
    }
    return FrameDescription(
        {str(k): (0.0, height) for k, height in enumerate(heights)},
        members,
        supports,
        loads,
        springs or {},
    )


def winkler(count: int, modulus: float) -> FrameDescription:
    """Return a hinged column on `count` equal springs between its ends, of `modulus` [EI / L^4]."""
    heights = tuple(k / (count + 1) for k in range(count + 2))
    names = map(str, range(1, count + 1))
    springs = dict.fromkeys(names, (modulus / (count + 1), 0.0, 0.0))
    return stack(heights, {"0": "xy", str(count + 1): "x"}, springs=springs)


def portal(
    feet: str, braced: bool = False, beam: float = 1.0, bays: int = 1, stories: int = 1
) -> FrameDescription:
    """Return a frame of unit bays and stories under a unit load on the head of each column.

    `feet` are the fixed displacements of the feet; with `braced`, the floors do not sway. The
    inner columns of several bays are loaded like the outer ones. `beam` is the relative width of
    the beams.
    """
    nodes, members, supports, loads = {}, [], {}, {}
    for i in range(bays + 1):
        supports[f"{i}0"] = feet
        for j in range(stories + 1):
            nodes[f"{i}{j}"] = (float(i), float(j))
        members += [Member(f"{i}{j}", f"{i}{j + 1}", 1.0) for j in range(stories)]
        loads[f"{i}{stories}"] = (0.0, -1.0)
    for j in range(1, stories + 1):
        members += [Member(f"{i}{j}", f"{i + 1}{j}", width=beam) for i in range(bays)]
        if braced:
            supports[f"0{j}"] = "x"
    return FrameDescription(nodes, tuple(members), supports, loads)


def closed_square() -> FrameDescription:
    """Return a square of welded bars whose uprights are compressed, held against sway."""
    nodes = {"a": (0.0, 0.0), "b": (0.0, 1.0), "c": (1.0, 0.0), "d": (1.0, 1.0)}
    members = (Member("a", "b", 1.0), Member("c", "d", 1.0), Member("a", "c"), Member("b", "d"))
    loads = {"b": (0.0, -1.0), "d": (0.0, -1.0)}
    return FrameDescription(nodes, members, {"a": "xy", "c": "y", "b": "x"}, loads)


def leaning_column() -> FrameDescription:
    """Return a cantilever that stabilizes a hinged, equally loaded column through a link."""
    nodes = {"a": (0.0, 0.0), "b": (0.0, 1.0), "c": (0.5, 0.0), "d": (0.5, 1.0)}
    members = (
        Member("a", "b", 1.0),
        Member("c", "d", 1.0),
        Member("b", "d", hinges="ab"),
    )
    loads = {"b": (0.0, -1.0), "d": (0.0, -1.0)}
    return FrameDescription(nodes, members, {"a": "xyr", "c": "xy"}, loads)


def tie_braced_column() -> FrameDescription:
    """Return a hinged column with two stays from a cross-arm at mid-height, not prestressed."""
    nodes = {
        "a": (0.0, 0.0),
        "o": (0.0, 0.5),
        "b": (0.0, 1.0),
        "l": (-0.2, 0.5),
        "r": (0.2, 0.5),
    }
    members = (
        Member("a", "o", 1.0),
        Member("o", "b", 1.0),
        Member("o", "l"),
        Member("o", "r"),
    )
    springs = {"l": (40.0, 0.0, 0.0), "r": (40.0, 0.0, 0.0)}
    return FrameDescription(nodes, members, {"a": "xy", "b": "x"}, {"b": (0.0, -1.0)}, springs)


FRAMES: dict[str, Callable[..., FrameDescription]] = {
    "column": column,
    "stack": stack,
    "winkler": winkler,
    "portal": portal,
    "closed square": closed_square,
    "leaning column": leaning_column,
    "braced column": tie_braced_column,
}


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
    if column.distributed:

        def density(s: Any) -> Any:
            load = unit / LENGTH
            return sum(c * load * (s / LENGTH) ** k for k, c in enumerate(column.distributed))

        # Uniform loads are constants, which every formulation takes.
        uniform = len(column.distributed) == 1
        if column.follower_distributed:
            law = (-density(0.0), 0.0) if uniform else lambda s, x, y, t: (-density(s), 0.0 * s)
            mech.add(bd.DistributedForce("drag", beam, law, axes="section"))
        else:
            law = (0.0, -density(0.0)) if uniform else lambda s, x, y, t: (0.0 * s, -density(s))
            mech.add(bd.DistributedForce("weight", beam, law))
    if column.foundation:
        modulus = column.foundation * unit / LENGTH**2
        mech.add(
            bd.DistributedForce("foundation", beam, lambda s, x, y, t: (-modulus * x, 0.0 * y))
        )
    return mech


@cache
def _flutter_near(column: Column, near: tuple[float, float], slenderness: float) -> tuple:
    """Follow the onset of flutter from slender columns, where it is `near`, to thicker ones."""
    for value in (1e6, *(s for s in (1e2, 3e1, 2e1, 1.4e1) if s > slenderness), slenderness):
        near = flutter_load(column, stiffness(value), near)
    return near


def _phase(column: Column, load: float, frequency: float = 0.0) -> float:
    """Return the largest wave number over the column, of motions with an angular frequency."""
    P, EI = abs(load) * column.compression(0.0), 1.0
    if column.bending:
        EI = min(column.bending(s)[0] for s in (0.0, 1.0))
    return float(np.sqrt(0.5 * P + np.sqrt(0.25 * P**2 + frequency**2)) / np.sqrt(EI))


def flutter(
    end: None, /, near: tuple[float, float], loads: list[str] | None = None, **column: Any
) -> dict[str, Any]:
    """Return the fields of a `Column` that flutters at the load and frequency `near` if slender."""
    described = Column(**column)
    return {
        "build": partial(build_column, described, None),
        "reference": lambda slenderness, strain: (
            CriticalLoad(FLUTTER, _flutter_near(described, near, slenderness)[0]),
        ),
        "path": lambda slenderness: {"to": 1.1 * near[0], "loads": loads},
        "phase": lambda load: _phase(described, load, near[1]),
        # The frequencies coincide in a double root.
        "formulations": EXACT_STRAINS,
    }


def divergence(
    end: float, /, loads: list[str] | None = None, taper: Taper | None = None, **column: Any
) -> dict[str, Any]:
    """Return the fields of a `Column` that buckles statically, loaded up to `end` [EI / L^2]."""
    described = Column(**column)
    return {
        "build": partial(build_column, described, taper),
        "reference": lambda slenderness, strain: branches(
            divergence_loads(described, stiffness(slenderness), end)
        ),
        "path": lambda slenderness: {"to": end, "loads": loads},
        "phase": partial(_phase, described),
        "formulations": EXACT_STRAINS,
    }


def tapered(end: float, taper: tuple[float, float]) -> dict[str, Any]:
    """Return the fields of a column whose width and height decrease by these fractions."""

    def sizes(s: float) -> tuple[float, float]:
        return 1.0 - taper[0] * s, 1.0 - taper[1] * s

    def ratios(s: float) -> tuple[float, float, float]:
        width, height = sizes(s)
        return width * height**3, width * height, width * height

    # Sections vary along the elements as well.
    return divergence(end, taper=sizes, bending=ratios) | {"mesh_constant": 1e-4}


def build_bars(
    masses: tuple[float, ...],
    follower: float,
    damping: tuple[float, ...],
    lateral: float,
    rotational: float,
    slenderness: float,
    elements: int,
    settings: Mapping[str, Any],
) -> bd.Mechanism:
    """Return a chain of upright unit bars with springs and dampers in the hinges.

    Bar k carries the point mass `masses[k]` at its upper end and has negligible inertia; every
    joint has the torsion spring `rotational`, and every upper end a spring `lateral` to the ground.
    A unit load acts on the last end; the fraction `follower` of it rotates with the last bar.
    """
    mech = bd.Mechanism()
    light = {"mass": 1e-9, "inertia": 1e-9}
    lower, height = mech.ground.at(0.0, 0.0), 0.0
    for k in range(len(masses)):
        bar = mech.add(bd.RigidBody(f"bar {k}", **light, center=(0.0, height + 1.0)))
        foot, head = bar.at(0.0, height), bar.at(0.0, height + 1.0)
        mech.add(bd.Revolute(f"hinge {k}", lower, foot))
        damper = damping[k] if damping else 0.0
        if rotational or damper:
            mech.add(bd.TorsionSpring(f"spring {k}", lower, foot, rotational, damping=damper))
        if lateral:
            ground = mech.ground.at(0.0, height + 1.0)
            mech.add(bd.Bushing(f"support {k}", ground, head, kx=lateral))
        mech.add(bd.PointMass(f"mass {k}", masses[k], on=head))
        lower, height = head, height + 1.0
    for name, axes, share in (("dead", "inertial", 1.0 - follower), ("follower", "body", follower)):
        if share:
            mech.add(bd.Force(name, lower, (0.0, -share), axes=axes))
    return mech


def bars(
    end: float,
    loads: tuple[tuple[str, float], ...],
    masses: tuple[float, ...],
    follower: float = 0.0,
    damping: tuple[float, ...] = (),
    lateral: float = 0.0,
    rotational: float = 1.0,
) -> dict[str, Any]:
    """Return the fields of a case of rigid bars with known critical points."""
    points = tuple(CriticalLoad(*load) for load in loads)
    return {
        "build": partial(build_bars, masses, follower, damping, lateral, rotational),
        "reference": lambda slenderness, strain: points,
        "path": lambda slenderness: {"to": end},
        "phase": lambda load: 0.0,
        "order": 0,
        "axial_force": lambda load: 1.0,
        "formulations": ("exact",),
        "slenderness": (1e1,),
    }
