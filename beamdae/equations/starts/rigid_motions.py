"""Rigid motions of the bodies of a mechanism, descriptions of motions, and their sizes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import cache_on_owner
from beamdae.errors import join_names, list_first

Array = np.ndarray

_MAX_CENTER_DISTANCE = 100.0  # [lengths of the mechanism]; a farther center means translation
_ROUNDING = 1e-9  # rounding error in a motion of size one
_EQUAL_SIZE_TOLERANCE = 1e-6  # of bodies that move equally far, the first is named
_MAX_NAMES = 9  # names or phrases in a sentence
_POINT_NAME, _ANGLE_NAME = re.compile(r"x\d*"), re.compile(r"(?:angle|theta|psi)\d*")


def join_some_names(names: Sequence[str]) -> str:
    """Join names; of more than nine, list eight and the number of more names."""
    return list_first(names, _MAX_NAMES - 1) if len(names) > _MAX_NAMES else join_names(names)


class Body(NamedTuple):
    """Indices of the coordinates of a part.

    Coordinates are classified by their names: points have x and y, and inertial angles are called
    angle, theta or psi, with or without a number.

    Attributes
    ----------
    name
        Name of the part.
    points, angles
        Indices of the coordinates (x, y) of all points, (k, 2), and of all inertial angles.
    position, angle
        Indices of the rigid coordinates (x, y) and of the angle, or None. If `nodes` is not None,
        these are the coordinates of the first node.
    others
        Indices of elastic and other coordinates.
    nodes
        Indices (x, y, angle) of the nodes of a body without a floating frame, (k, 3), or None.
    """

    name: str
    points: Array
    angles: Array
    position: tuple[int, int] | None
    angle: int | None
    others: tuple[int, ...]
    nodes: Array | None = None


@cache_on_owner
def collect_bodies(e: EquationsOfMotion) -> tuple[Body, ...]:
    """Return a `Body` for each part of the equations."""
    bodies = []
    for part in e.parts:
        coordinates = range(part.rows.start, part.rows.stop)
        index = {e.q_names[k].rpartition(".")[2]: k for k in coordinates}
        pairs = [
            (k, index[f"y{name[1:]}"])
            for name, k in index.items()
            if _POINT_NAME.fullmatch(name) and f"y{name[1:]}" in index
        ]
        turning = [k for name, k in index.items() if _ANGLE_NAME.fullmatch(name) and e.is_angle[k]]
        points, angles = np.array(pairs, int).reshape(-1, 2), np.array(turning, int)
        nodes, is_beam = None, 3 * len(pairs) == 3 * len(turning) == len(index)
        if is_beam and pairs and set(index) != {"x", "y", "angle"}:
            nodes = np.column_stack([points, angles])
        position = pairs[0] if len(pairs) == 1 or nodes is not None else None
        angle = turning[0] if position is not None and turning else None
        rigid = {*(position or ()), angle}
        others = tuple(k for k in index.values() if k not in rigid)
        bodies.append(Body(part.name, points, angles, position, angle, others, nodes))
    return tuple(bodies)


def compute_rigid_motions(e: EquationsOfMotion, q: Array) -> Array:
    """Return the rigid motions at q as columns divided by `position_scales`, (n, k).

    Parts with a frame (x, y, angle) or with nodes contribute three motions, and other parts one
    motion per coordinate.
    """
    columns: list[Array] = []
    for body in collect_bodies(e):
        if body.nodes is not None:
            columns += list(_rigid_motions_of_nodes(e, q, body.nodes).T)
            continue
        indices = (*(body.position or ()), *body.others)
        if body.position is not None and body.angle is not None:
            indices = (*body.position, body.angle)
        columns += list(np.eye(e.n)[np.sort(indices)])
    return np.array(columns).reshape(-1, e.n).T


def _rigid_motions_of_nodes(e: EquationsOfMotion, q: Array, nodes: Array) -> Array:
    """Return scaled translations of nodes and their rotation about the first node, (n, 3)."""
    motions = np.zeros((e.n, 3))
    x, y, angle = nodes.T
    motions[x, 0] = motions[y, 1] = e.length
    motions[x, 2], motions[y, 2], motions[angle, 2] = q[y[0]] - q[y], q[x] - q[x[0]], 1.0
    return motions / e.position_scales[:, None]


def _motion_sizes(
    e: EquationsOfMotion, q: Array, body: Body, motion: Array
) -> tuple[float, float, float]:
    """Return translation, rotation and deformation, divided by `position_scales`."""
    scaled_motion = motion / e.position_scales
    if body.nodes is not None:
        indices, rigid = body.nodes.ravel(), _rigid_motions_of_nodes(e, q, body.nodes)
        shares = np.linalg.lstsq(rigid[indices], scaled_motion[indices])[0]
        deformation = float(np.max(np.abs(scaled_motion[indices] - rigid[indices] @ shares)))
        return float(np.hypot(*shares[:2])), abs(float(shares[2])), deformation
    translation = float(np.hypot(*scaled_motion[list(body.position)])) if body.position else 0.0
    rotation = abs(float(scaled_motion[body.angle])) if body.angle is not None else 0.0
    return (
        translation,
        rotation,
        float(np.max(np.abs(scaled_motion[list(body.others)]), initial=0.0)),
    )


def describe_largest_motion(e: EquationsOfMotion, q: Array, motion: Array) -> str:
    """Return a phrase for the largest part of a motion (n,), such as "rotation of the crank"."""
    sizes = [(max(_motion_sizes(e, q, body, motion)), body) for body in collect_bodies(e)]
    largest = max(size for size, _ in sizes)
    body = next(body for size, body in sizes if size >= largest * (1.0 - _EQUAL_SIZE_TOLERANCE))
    translation, rotation, deformation = _motion_sizes(e, q, body, motion)
    if deformation > max(translation, rotation):
        worst = max(body.others, key=lambda k: abs(motion[k]) / e.position_scales[k])
        return f"deformation of the {body.name} ({e.q_names[worst]})"
    if rotation * _MAX_CENTER_DISTANCE > translation:
        return f"rotation of the {body.name}"
    return f"translation of the {body.name} along {_describe_direction(body, motion)}"


def describe_free_motion(e: EquationsOfMotion, q: Array, motion: Array) -> str:
    """Return a phrase for a free motion (n,), such as "crank can rotate about (0, 0)"."""
    names_by_motion: dict[str, list[str]] = {}
    bodies = collect_bodies(e)
    for body in bodies:
        translation, rotation, deformation = _motion_sizes(e, q, body, motion)
        if max(translation, rotation, deformation) <= _ROUNDING:
            continue
        if body.position is None:
            phrase = "move"
        elif body.angle is None or rotation * _MAX_CENTER_DISTANCE <= translation:
            phrase = f"translate along {_describe_direction(body, motion)}"
        else:
            (x, y), rate = q[list(body.position)], motion[body.angle]
            dx, dy = motion[list(body.position)]
            rounding = _ROUNDING * e.length
            center = [c if abs(c) > rounding else 0.0 for c in (x - dy / rate, y + dx / rate)]
            phrase = f"rotate about ({center[0]:.4g}, {center[1]:.4g})"
        names_by_motion.setdefault(phrase, []).append(body.name)
    if len(bodies) > 1 and [len(x) for x in names_by_motion.values()] == [len(bodies)]:
        return f"the whole mechanism can {next(iter(names_by_motion))}"
    phrases = [
        f"{join_some_names(names)} can {phrase}" for phrase, names in names_by_motion.items()
    ]
    others = sum(len(names) for names in list(names_by_motion.values())[_MAX_NAMES:])
    more = [f"{others} more move along"] if others else []
    return ", ".join([*phrases[:_MAX_NAMES], *more])


def _describe_direction(body: Body, motion: Array) -> str:
    if body.position is None:
        return "its coordinate"
    along = motion[list(body.position)]
    along = along / np.linalg.norm(along)
    x, y = (value if abs(value) > _ROUNDING else 0.0 for value in along)
    # The sign of a direction is arbitrary: make x positive, or y if x = 0.
    x, y = (x, y) if (x, y) > (0.0, 0.0) else (0.0 - x, 0.0 - y)
    return f"({x:.3g}, {y:.3g})"


@dataclass(frozen=True)
class DisplacementMeasure:
    """Measures displacements; x and y of a point are combined into one distance.

    Attributes
    ----------
    scale
        Scale of each coordinate, (n,).
    point
        Index of the x coordinate of the point to which each coordinate belongs, (n,); coordinates
        that belong to no point refer to themselves.
    """

    scale: Array
    point: Array

    @classmethod
    def of(cls, e: EquationsOfMotion) -> DisplacementMeasure:
        """Return the measure for the bodies of these equations."""
        point = np.arange(e.n)
        for body in collect_bodies(e):
            point[body.points[:, 1]] = body.points[:, 0]
        return cls(e.position_scales, point)

    def distances(self, change: Array) -> Array:
        """Return the displacement of each coordinate, or of its point if it has one, (n,)."""
        # Solutions of nearly singular systems may overflow; their displacement is infinite.
        with np.errstate(over="ignore"):
            squares = np.bincount(self.point, change**2, len(change))
        return np.asarray(np.sqrt(squares)[self.point])

    def farthest(self, change: Array) -> float:
        """Return the largest displacement relative to the scale of its coordinate."""
        return float(np.max(self.distances(change) / self.scale, initial=0.0))
