"""Shapes of a mechanism over time, for an animation."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from beamdae.beams.beam import Beam
from beamdae.errors import BeamdaeError, count
from beamdae.parts.bodies import Attachment, Ground, PointMass, RigidBody
from beamdae.parts.mechanism import Mechanism
from beamdae.results.solution import Solution
from beamdae.symbolic.compiled import evaluate_rows
from beamdae.symbolic.sparse_sums import constant

Array = np.ndarray


def frame_times(solution: Solution, frames: int = 120) -> Array:
    """Equally spaced times of a run, as far as it got: those of the frames of `shapes` [s]."""
    start = solution.trajectory.segments[0].t[0]
    return np.linspace(start, solution.trajectory.end, count("shapes", "frames", frames))


def shapes(
    mechanism: Mechanism, solution: Solution, frames: int = 120, points: int = 13
) -> list[dict[str, Any]]:
    """Where the bodies of a mechanism are in each frame.

    Parameters
    ----------
    mechanism
        The simulated one.
    solution
        A run of it.
    frames
        Number of times, see `frame_times`.
    points
        Number of sections a beam is drawn through.

    Returns
    -------
    list of dict
        One a body: "name", "kind" and "x", "y" [m], a list of points for each frame. By kind:
        "beam", points along the axis; "rigid", the points where something is attached to it, in
        the order of the parts, and its center if these are fewer than two; "point", a particle;
        "ground", the fixed points something is attached to.

    Raises
    ------
    BeamdaeError
        If the solution is that of another mechanism.
    """
    names = tuple(f"{b.name}.{c}" for b in _bodies(mechanism) for c in b.coordinate_names)
    if solution.equations.q_names != names:
        raise BeamdaeError("shapes: the solution is not one of this mechanism.")
    count("shapes", "points", points)
    bodies = [mechanism.ground, *_bodies(mechanism)]
    drawn = [(body, _outline(body, _attached(mechanism, body), points)) for body in bodies]
    drawn = [(body, places) for body, places in drawn if places]
    function = _positions(mechanism, [place for _, places in drawn for place in places])
    _, state = solution.trajectory.at(frame_times(solution, frames))
    positions = evaluate_rows(function, state.q)
    x, y = positions[:, ::2], positions[:, 1::2]
    ends = np.cumsum([0, *(len(places) for _, places in drawn)]).tolist()
    return [
        {
            "name": body.name,
            "kind": _kind(body),
            "x": x[:, first:last].tolist(),
            "y": y[:, first:last].tolist(),
        }
        for (body, _), (first, last) in zip(drawn, pairwise(ends), strict=True)
    ]


def _bodies(mechanism: Mechanism) -> list[Any]:
    return [part for part in mechanism.parts.values() if hasattr(part, "coordinate_names")]


def _kind(body: Any) -> str:
    kinds = {Ground: "ground", Beam: "beam", PointMass: "point"}
    return next((name for kind, name in kinds.items() if isinstance(body, kind)), "rigid")


def _attached(mechanism: Mechanism, body: Any) -> list[Attachment]:
    """Points of the body that joints, loads and particles refer to, each once."""
    fields = [value for part in mechanism.parts.values() for value in vars(part).values()]
    found = [x for x in fields if isinstance(x, Attachment) and x.body is body]
    return list({attachment.point: attachment for attachment in found}.values())


def _outline(body: Any, attached: list[Attachment], points: int) -> list[Attachment]:
    """The points a body is drawn through."""
    if isinstance(body, Beam):
        return [body.at(s) for s in np.linspace(0.0, body.length, points)]
    if isinstance(body, PointMass):
        return [body.point]
    if isinstance(body, RigidBody) and len(attached) < 2:
        center = body.at(*body.center)
        return attached if center.point in {a.point for a in attached} else [*attached, center]
    return attached


def _positions(mechanism: Mechanism, places: list[Attachment]) -> ca.Function:
    """All coordinates -> (x, y) of the places, one after the other."""
    bodies = _bodies(mechanism)
    ends = np.cumsum([0, *(len(b.coordinate_names) for b in bodies)]).tolist()
    q = ca.SX.sym("q", ends[-1])
    own = {id(b): q[i:j] for b, (i, j) in zip(bodies, pairwise(ends), strict=True)}
    nothing = ca.SX(0, 1)
    positions = [p.position(constant(p.operator) @ own.get(id(p.body), nothing)) for p in places]
    return ca.Function("positions", [q], [ca.densify(ca.vertcat(*positions))])
