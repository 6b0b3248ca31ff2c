"""Random plane frames under proportional loads, and laws that their equilibrium paths obey."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import atan2, hypot, radians
from random import Random

import numpy as np
from properties.similarity import Similarity

import beamdae as bd

MAX_POINTS = 200
UNCHANGED = Similarity()
# Displaced and rotated, mirrored, and in mm, t and s.
SIMILARITIES = {
    "rotated": Similarity(angle=radians(37.0), shift=(3.0, -2.0)),
    "mirrored": Similarity(mirrored=True),
    "in mm": Similarity(length=1e3, mass=1e-3),
}
# Largest difference of equal load factors, relative to them or to a tenth of the target.
_RTOL = 1e-6
# Load factors at which paths are compared end within this distance.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Member:
    """Beam between two nodes; an arc turns by twice the angle `bend`."""

    first: int
    last: int
    bend: float
    height: float
    elements: int
    pinned: tuple[bool, bool]


@dataclass(frozen=True)
class Load:
    """Load on a member, at a fraction of its length; its size is relative to EI."""

    kind: str
    member: int
    position: float
    size: tuple[float, float]


@dataclass(frozen=True)
class Frame:
    """Frame of two to six members, some of which may move freely; `target` is a load factor."""

    nodes: tuple[tuple[float, float], ...]
    members: tuple[Member, ...]
    supports: dict[int, str]
    loads: tuple[Load, ...]
    formulation: str
    modulus: float
    target: float


def draw_frame(seed: int) -> Frame:
    """Return the random frame of a seed."""
    rng = Random(seed)
    nodes, members, count = [(0.0, 0.0)], list[Member](), rng.randint(2, 6)
    slenderness = rng.uniform(-3.0, -1.5)
    while len(members) < count:
        a, pairs = rng.randrange(len(nodes)), {frozenset((x.first, x.last)) for x in members}
        if len(nodes) > 2 and rng.random() < 0.3:
            b = rng.randrange(len(nodes))
            if b == a or frozenset((a, b)) in pairs:
                continue
        else:
            angle, length = rng.uniform(-0.3, np.pi + 0.3), rng.uniform(0.5, 1.5)
            x = nodes[a][0] + length * float(np.cos(angle))
            y = nodes[a][1] + length * float(np.sin(angle))
            if min(hypot(x - u, y - v) for u, v in nodes) < 0.3:
                continue
            b = len(nodes)
            nodes.append((x, y))
        bend = rng.choice([0.0, 0.0, rng.uniform(-0.8, 0.8)])
        height = 10.0 ** (slenderness + rng.uniform(-0.15, 0.15))
        pinned = rng.random() < 0.2, rng.random() < 0.2
        members.append(Member(a, b, bend, height, rng.randint(2, 4), pinned))
    supports = {0: rng.choice(["weld", "weld", "revolute"])}
    for node in range(1, len(nodes)):
        is_end = sum(node in (x.first, x.last) for x in members) == 1
        if rng.random() < (0.6 if is_end else 0.1):
            supports[node] = rng.choice(["weld", "revolute", "revolute", "slide"])
    loads = []
    for _ in range(rng.choice([1, 1, 2])):
        kind = rng.choice(["force", "force", "force", "follower", "moment", "distributed"])
        member, at = rng.randrange(count), rng.choice([0.5, 1.0, rng.uniform(0.1, 0.9)])
        angle, size = rng.choice([-np.pi / 2.0, rng.uniform(-np.pi, np.pi)]), rng.uniform(0.3, 1.0)
        way = size * float(np.cos(angle)), size * float(np.sin(angle))
        loads.append(Load(kind, member, at, way))
    formulation, modulus = rng.choice(["floating", "exact"]), 10.0 ** rng.uniform(7.0, 11.0)
    target = rng.choice([5.0, 15.0, 40.0, 150.0])
    return Frame(tuple(nodes), tuple(members), supports, tuple(loads), formulation, modulus, target)


def build_frame(
    frame: Frame,
    similar: Similarity = UNCHANGED,
    reversed_from: float | None = None,
    order: Random | None = None,
) -> bd.Mechanism:
    """Return the mechanism, whose scaled loads are named "load 0" and so on.

    With `reversed_from`, loads of this factor act in full, and the scaled ones are opposite. The
    random numbers `order` shuffle the parts.
    """
    options = {"formulation": "exact"} if frame.formulation == "exact" else {"strain": "exact"}
    number = similar.number
    material = bd.Material(number(frame.modulus, "Pa"), nu=0.3, rho=number(2000.0, "kg/m^3"))
    beams, ends, parts = [], dict[int, bd.results.Attachment](), []
    for k, member in enumerate(frame.members):
        curve = _draw_curve(frame, member, similar)
        section = bd.Section.rectangle(material, number(0.02, "m"), number(member.height, "m"))
        beams.append(bd.Beam(f"beam {k}", curve, section, member.elements, **options))
    for k, (member, beam) in enumerate(zip(frame.members, beams, strict=True)):
        places = zip(
            (member.first, member.last), member.pinned, (beam.start, beam.end), strict=True
        )
        for node, is_pinned, end in places:
            if node in ends:
                joint = bd.Revolute if is_pinned else bd.Weld
                parts.append(joint(f"joint {k} at {node}", ends[node], end))
            ends.setdefault(node, end)
    mech = bd.Mechanism()
    for node, kind in frame.supports.items():
        name, pair = f"support {node}", (mech.ground.at(*ends[node].point), ends[node])
        if kind == "slide":
            parts.append(bd.PointOnLine(name, *pair, direction=similar.way(1.0, 0.0, "")))
        else:
            parts.append((bd.Weld if kind == "weld" else bd.Revolute)(name, *pair))
    for k, load in enumerate(frame.loads):
        beam = beams[load.member]
        if reversed_from is not None:
            parts.append(_create_load(f"full {k}", load, frame, beam, reversed_from, similar))
        factor = 1.0 if reversed_from is None else -1.0
        parts.append(_create_load(f"load {k}", load, frame, beam, factor, similar))
    if order is not None:
        order.shuffle(beams)
        order.shuffle(parts)
    for part in (*beams, *parts):
        mech.add(part)
    return mech


def _draw_curve(frame: Frame, member: Member, similar: Similarity) -> bd.Line | bd.Arc:
    start, end = frame.nodes[member.first], frame.nodes[member.last]
    if not member.bend:
        return bd.Line(similar.point(*start), similar.point(*end))
    x, y = end[0] - start[0], end[1] - start[1]
    radius = hypot(x, y) / (2.0 * float(np.sin(member.bend)))
    return bd.Arc(
        similar.sense * similar.number(radius, "m"),
        similar.number(2.0 * radius * member.bend, "m"),
        start=similar.point(*start),
        angle=similar.heading(atan2(y, x) - member.bend),
    )


def _create_load(
    name: str, load: Load, frame: Frame, beam: bd.Beam, factor: float, similar: Similarity
) -> bd.Force | bd.Moment | bd.DistributedForce:
    stiffness = frame.modulus * 0.02 * frame.members[load.member].height ** 3 / 12.0
    x, y = (factor * size * stiffness for size in load.size)
    at = beam.at(load.position * beam.length)
    if load.kind == "distributed":
        return bd.DistributedForce(name, beam, similar.way(x, y, "N/m"))
    if load.kind == "moment":
        return bd.Moment(name, at, similar.turn(x, "N m"))
    axes = "body" if load.kind == "follower" else "inertial"
    return bd.Force(name, at, similar.way(x, y, "N"), axes=axes)


def trace(mech: bd.Mechanism, target: float, **settings) -> bd.results.Equilibrium:
    """Return the path by arc length to a load factor."""
    loads = [name for name in mech.parts if name.startswith("load")]
    settings = {"control": "arc length", "max_points": MAX_POINTS} | settings
    return bd.equilibrium(mech, loads=loads, to=target, **settings)


def check_path(frame: Frame) -> Iterator[tuple[str, str]]:
    """Yield the name of each law, and how the path of a frame departs from it, or "".

    Nothing is yielded if the program says that there is no equilibrium under small loads.
    """
    path = trace(build_frame(frame), frame.target)
    if not path.status.success and path.free:
        return
    failure = "" if path.status.kind in ("ok", "limited") else path.status.sentence
    yield "end", failure
    points = [(one.kind, one.factor) for one in path.critical]
    finer = trace(build_frame(frame), frame.target, step=0.025, max_points=2 * MAX_POINTS)
    others = {"halved steps": finer}
    for name, similar in SIMILARITIES.items():
        others[name] = trace(build_frame(frame, similar), frame.target)
    others["shuffled"] = trace(build_frame(frame, order=Random(0)), frame.target)
    for name, other in others.items():
        yield name, _compare(points, other, frame.target)
    yield "reversed", _compare_reversed(frame, path)


def _compare(points: list[tuple[str, float]], other: bd.results.Equilibrium, target: float) -> str:
    """Return how another path departs, up to the earlier end of both."""
    if other.status.kind not in ("ok", "limited"):
        return other.status.sentence
    found = [(one.kind, one.factor) for one in other.critical]
    if other.status.kind == "limited":
        count = min(len(points), len(found))
        points, found = points[:count], found[:count]
    return _compare_points(points, found, target)


def _compare_points(
    points: list[tuple[str, float]], found: list[tuple[str, float]], target: float
) -> str:
    are_equal = [kind for kind, _ in points] == [kind for kind, _ in found] and all(
        abs(p - other) <= _RTOL * max(abs(p), 0.1 * target)
        for (_, p), (_, other) in zip(points, found, strict=True)
    )
    return "" if are_equal else f"{points} became {found}"


def _compare_reversed(frame: Frame, path: bd.results.Equilibrium) -> str:
    """Return how the path from the end differs, between the loads that both have in common.

    The path begins at the last row that was reached under an increasing load.
    """
    critical, factors = {one.row for one in path.critical}, path.factors[:, -1]
    rows = [
        row
        for row in range(1, len(factors))
        if not {row - 1, row} & critical and max(factors[row - 1], 0.0) < factors[row]
    ]
    if not rows:
        return ""
    end = path.at(rows[-1])
    first = max(float(factors[0]), 0.0)
    # Others are passed only once.
    last_begin = int(np.flatnonzero(factors[: rows[-1]] <= first + _ROUNDING)[-1])
    mech = build_frame(frame, reversed_from=end.factor)
    settings = {"start": end, "max_points": 2 * MAX_POINTS}
    back = trace(mech, end.factor - first, **settings)
    if not back.status.success:
        return back.status.sentence
    if back.unstable[0] != end.unstable[-1]:
        return f"{end.unstable[-1]} became {back.unstable[0]} unstable directions"
    points = [(one.kind, one.factor) for one in end.critical if one.row > last_begin]
    found = [(one.kind, end.factor - one.factor) for one in back.critical[::-1]]
    return _compare_points(points, found, frame.target)
