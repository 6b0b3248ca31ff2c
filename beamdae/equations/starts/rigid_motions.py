"""Motions of a mechanism in words: which body turns about which point, or travels where."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion

Array = np.ndarray

# Instantaneous centers farther away than so many lengths of the mechanism are those of a travel.
_FAR = 100.0
# What rounding leaves of zero in a motion of size one.
_NONE = 1e-9
# Of more names a sentence has the first ones.
_MOST_NAMES = 9
_FRAMES = (("x", "y", "angle"), ("x0", "y0", "theta"))
# Coordinates of the nodes of what has no frame.
_NODES = ("x", "y", "psi")


def join_names(names: Sequence[str]) -> str:
    """Names in words, of many the first ones."""
    if len(names) > _MOST_NAMES:
        names = [*names[: _MOST_NAMES - 1], f"{len(names) - _MOST_NAMES + 1} others"]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


class Body(NamedTuple):
    """Where a part has its rigid coordinates (x, y, perhaps an angle), and its elastic ones.

    What has no frame but nodes (n, 3) has the coordinates of the first as its own.
    """

    name: str
    place: tuple[int, int] | None
    angle: int | None
    others: tuple[int, ...]
    nodes: Array | None = None


def collect_bodies(e: EquationsOfMotion) -> tuple[Body, ...]:
    """The parts that have coordinates."""
    found = []
    for part in e.parts:
        own = {e.q_names[k].rpartition(".")[2]: k for k in range(part.rows.start, part.rows.stop)}
        nodes = _node_coordinates(own)
        if nodes is not None:
            x, y, angle = nodes[0].tolist()
            others = tuple(nodes[1:].ravel().tolist())
            found.append(Body(part.name, (x, y), angle, others, nodes))
            continue
        x, y, angle = next((names for names in _FRAMES if names[0] in own), _FRAMES[0])
        place = (own.pop(x), own.pop(y)) if x in own and y in own else None
        turn = own.pop(angle) if place is not None and angle in own else None
        found.append(Body(part.name, place, turn, tuple(own.values())))
    return tuple(found)


def _node_coordinates(own: dict[str, int]) -> Array | None:
    """Positions and angles of nodes, (n, 3), if that is all there is."""
    count = len(own) // len(_NODES)
    names = [f"{name}{k}" for k in range(count) for name in _NODES]
    if not count or set(names) != set(own):
        return None
    return np.array([own[name] for name in names]).reshape(count, len(_NODES))


def compute_rigid_motions(e: EquationsOfMotion, q: Array) -> Array:
    """Motions at q without deformation in natural sizes, (n, k); of other parts each coordinate."""
    columns: list[Array] = []
    for body in collect_bodies(e):
        if body.nodes is not None:
            columns += list(_rigid_motions_of_nodes(e, q, body.nodes).T)
            continue
        own = (*(body.place or ()), *body.others)
        if body.place is not None and body.angle is not None:
            own = (*body.place, body.angle)
        columns += list(np.eye(e.n)[np.sort(own)])
    return np.array(columns).reshape(-1, e.n).T


def _rigid_motions_of_nodes(e: EquationsOfMotion, q: Array, nodes: Array) -> Array:
    """Both travels of nodes and their turn about the first, in natural sizes, (n, 3)."""
    motions = np.zeros((e.n, 3))
    x, y, angle = nodes.T
    motions[x, 0] = motions[y, 1] = e.length
    motions[x, 2], motions[y, 2], motions[angle, 2] = q[y[0]] - q[y], q[x] - q[x[0]], 1.0
    return motions / e.position_scales[:, None]


def _motion_sizes(
    e: EquationsOfMotion, q: Array, body: Body, motion: Array
) -> tuple[float, float, float]:
    """Travel, turn and deformation in lengths of the mechanism, or rad."""
    scaled = motion / e.position_scales
    if body.nodes is not None:
        own, rigid = body.nodes.ravel(), _rigid_motions_of_nodes(e, q, body.nodes)
        shares = np.linalg.lstsq(rigid[own], scaled[own])[0]
        bent = float(np.max(np.abs(scaled[own] - rigid[own] @ shares)))
        return float(np.hypot(*shares[:2])), abs(float(shares[2])), bent
    travel = float(np.hypot(*scaled[list(body.place)])) if body.place else 0.0
    turn = abs(float(scaled[body.angle])) if body.angle is not None else 0.0
    return travel, turn, float(np.max(np.abs(scaled[list(body.others)]), initial=0.0))


def describe_largest_motion(e: EquationsOfMotion, q: Array, motion: Array) -> str:
    """What moves most in a motion, as a noun: "turn of the crank"."""
    moving = [(max(_motion_sizes(e, q, body, motion)), body) for body in collect_bodies(e)]
    most = max(size for size, _ in moving)
    body = next(body for size, body in moving if size >= most * (1.0 - 1e-6))
    travel, turn, bent = _motion_sizes(e, q, body, motion)
    if bent > max(travel, turn):
        worst = max(body.others, key=lambda k: abs(motion[k]) / e.position_scales[k])
        return f"deformation of the {body.name} ({e.q_names[worst]})"
    if turn * _FAR > travel:
        return f"turn of the {body.name}"
    return f"travel of the {body.name} along {_describe_direction(body, motion)}"


def describe_free_motion(e: EquationsOfMotion, q: Array, motion: Array) -> str:
    """A motion of all bodies that nothing holds, as a sentence: who turns about what."""
    who: dict[str, list[str]] = {}
    everything = collect_bodies(e)
    for body in everything:
        travel, turn, other = _motion_sizes(e, q, body, motion)
        if max(travel, turn, other) <= _NONE:
            continue
        if body.place is None:
            how = "move"
        elif body.angle is None or turn * _FAR <= travel:
            how = f"travel along {_describe_direction(body, motion)}"
        else:
            (x, y), rate = q[list(body.place)], motion[body.angle]
            dx, dy = motion[list(body.place)]
            size = _NONE * e.length
            center = [c if abs(c) > size else 0.0 for c in (x - dy / rate, y + dx / rate)]
            how = f"turn about ({center[0]:.4g}, {center[1]:.4g})"
        who.setdefault(how, []).append(body.name)
    if len(everything) > 1 and [len(names) for names in who.values()] == [len(everything)]:
        return f"the whole mechanism can {next(iter(who))}"
    told = [f"{join_names(names)} can {how}" for how, names in who.items()]
    others = sum(len(names) for names in list(who.values())[_MOST_NAMES:])
    return ", ".join([*told[:_MOST_NAMES], *([f"{others} others move along"] if others else [])])


def _describe_direction(body: Body, motion: Array) -> str:
    if body.place is None:
        return "its coordinate"
    along = motion[list(body.place)]
    along = along / np.linalg.norm(along)
    x, y = (value if abs(value) > _NONE else 0.0 for value in along)
    # Of a line both ways.
    x, y = (x, y) if (x, y) > (0.0, 0.0) else (0.0 - x, 0.0 - y)
    return f"({x:.3g}, {y:.3g})"
