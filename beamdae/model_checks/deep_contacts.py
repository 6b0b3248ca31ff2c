"""Warnings about contacts that sink deeper than a touching part is thick, or deflects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from beamdae.beams.beam import BeamAttachment
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.part_warnings import starts_in_equilibrium
from beamdae.equations.starts.closing import solve_least_change
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.mobility import find_loose_groups
from beamdae.equations.surface_gaps import SurfaceGapTerm, compile_surface_gaps
from beamdae.errors import list_first, name_with_others
from beamdae.model_checks.model_contacts import contacts_of
from beamdae.parts.bodies.rigid_body import Ground, RigidBody
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    from beamdae.parts.forces.contact import Contact

Array = np.ndarray

_MAX_NAMES = 3  # of further contacts
_MIN_DEEPENING = 1.01  # depth relative to the one in the drawing
# Points pass through a circle beside its center less deep than by its radius.
_MAX_DEPTH_IN_CIRCLE = 0.5  # relative to the radius
_GAP_STEP = 1e-6  # of finite differences, relative to the length of the mechanism
# A contact is soft if it touches for this share of the run, and is deeper than this share of the
# height of a beam: less deep ones matter little, even if the beam hardly deflects.
_MIN_TIME_OF_SOFT_CONTACT = 0.5
_MIN_DEPTH_OF_SOFT_CONTACT = 0.1
# Width over length of outlines below which they are lines, which have no thickness.
_MAX_LINE_WIDTH = 1e-6


class _Depth(NamedTuple):
    """Largest penetration of a contact [m], with its time, branch and coordinates (n,)."""

    depth: float
    t: float
    branch: float
    q: Array
    gap: SurfaceGapTerm


def deep_contact_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning about contacts that sink deeper than a touching part is thick.

    The limit is the smallest known one: heights of beams, shapes of rigid bodies along the contact
    normal (without a shape, the largest distance of its known points), and half the radius of a
    circle that is touched from outside. Beams that no joint connects to the ground may fall on a
    layer of foam, into which they sink deeper than they are thick: of these, the limit is the
    length, unless the surface belongs to a body through which they may pass.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    if not contacts_of(equations):
        return
    depths: dict[str, _Depth] = {}
    for gap in compile_surface_gaps(equations):
        rows = [
            _Depth(-float(values[k]), float(x.t[k]), x.branch, x.state.q[k], gap)
            for x in trajectory.intervals
            if gap.part not in x.inactive
            for values in [gap.evaluate(x.t, x.branch, x.state.q)]
            for k in (0, int(np.argmin(values)))
        ]
        if not rows:
            continue
        deepest = max(rows, key=lambda x: x.depth)
        # Drawings may overlap by a preload, which has a warning if it is wrong.
        if starts_in_equilibrium(equations) or deepest.depth > _MIN_DEEPENING * rows[0].depth:
            depths[gap.part] = deepest
    yield from _describe(equations, depths)


def deep_start_warnings(equations: EquationsOfMotion, time: Array, state: State) -> Iterator[str]:
    """Yield the warning of `deep_contact_warnings` about a start in equilibrium at (t, branch)."""
    if starts_in_equilibrium(equations):
        yield from deep_rest_warnings(equations, time[None], state.q[None])


def deep_rest_warnings(equations: EquationsOfMotion, times: Array, q: Array) -> Iterator[str]:
    """Yield the warning of `deep_contact_warnings` about equilibria.

    Parameters
    ----------
    equations
        The equations of motion.
    times
        Rows (t, branch), (k, 2) [s].
    q
        Positions of each row, (k, n).
    """
    if not contacts_of(equations):
        return
    depths: dict[str, _Depth] = {}
    for gap in compile_surface_gaps(equations):
        rows = [
            _Depth(-float(gap.evaluate(np.array([t]), branch, row[None])[0]), t, branch, row, gap)
            for (t, branch), row in zip(times.tolist(), q, strict=True)
        ]
        depths[gap.part] = max(rows, key=lambda x: x.depth)
    yield from _describe(equations, depths)


def soft_contact_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning about contacts that are softer than the beams that they press.

    They touch during half of the run, sink on average deeper than a tenth of the height of a beam,
    and deeper than their normal force deflects the parts that they touch. Bodies that are free to
    move along the normal, such as those that fall on a soft floor, deflect without limit. Beams
    with several contacts are exempt: these may stand for an elastic foundation.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    """
    contacts, duration = contacts_of(equations), trajectory.end - trajectory.start
    if not contacts or not duration > 0.0:
        return
    touched = [x.body for contact in contacts.values() for x in contact.attachments]
    soft = []
    for gap in compile_surface_gaps(equations):
        sections = [
            x.body.section.at(x.s)
            for x in contacts[gap.part].attachments
            if isinstance(x, BeamAttachment) and x.s is not None and touched.count(x.body) == 1
        ]
        height = min((x.height for x in sections if x.height is not None), default=np.inf)
        intervals = [x for x in trajectory.intervals if gap.part not in x.inactive]
        depths = [-gap.evaluate(x.t, x.branch, x.state.q) for x in intervals]
        pairs = list(zip(intervals, depths, strict=True))
        touch = sum(_integrate(x.t, depth > 0.0) for x, depth in pairs)
        total = sum(_integrate(x.t, np.maximum(depth, 0.0)) for x, depth in pairs)
        if touch < _MIN_TIME_OF_SOFT_CONTACT * duration:
            continue
        mean = total / touch
        if not _MIN_DEPTH_OF_SOFT_CONTACT * height < mean < height:
            continue  # deeper ones have the warning of `deep_contact_warnings`
        x, depth = min(pairs, key=lambda pair: float(np.min(np.abs(pair[1] - mean))))
        k = int(np.argmin(np.abs(depth - mean)))
        state = _Depth(float(depth[k]), float(x.t[k]), x.branch, x.state.q[k], gap)
        deflection = _deflection(equations, contacts[gap.part], state, duration)
        if 0.0 < deflection < mean:
            soft.append((mean / deflection, gap.part, mean, deflection))
    if not soft:
        return
    (_, name, mean, deflection), *others = sorted(soft, reverse=True)
    yield (
        f"{name_with_others(name, [x[1] for x in others])}: the contact sinks {mean:.2g} m deep on "
        f"average, but its force deflects the parts that it touches by only {deflection:.2g} m; "
        "raise the stiffness if it does not stand for a soft layer."
    )


def _deflection(
    equations: EquationsOfMotion, contact: Contact, state: _Depth, duration: float
) -> float:
    """Return the static deflection along the normal by the force of a contact [m]."""
    time, solver = np.array([state.t, state.branch]), ConsistencySolver(equations)
    stiffness, _, mass = solver.linearize_forces(time, solver.rest_state(state.q))
    rows = solver.constraint_matrix(time, state.q)
    steps = np.diag(_GAP_STEP * equations.position_scales)
    q = np.concatenate([state.q + steps, state.q - steps])
    forward, backward = np.split(state.gap.evaluate(np.full(len(q), state.t), state.branch, q), 2)
    normal = (forward - backward) / (2.0 * np.diag(steps))
    shape = solve_least_change(
        stiffness + mass / duration**2, rows, np.zeros(rows.shape[0]), normal
    )
    # Compliance of the parts, and of the contact in parallel with them.
    compliance = float(normal @ shape)
    force = float(contact.stiffness) * state.depth**contact.exponent
    of_contact = contact.exponent * force / state.depth
    return force * compliance / (1.0 - of_contact * compliance)


def _integrate(t: Array, values: Array) -> float:
    return float(0.5 * np.diff(t) @ (values[1:] + values[:-1].astype(float)))


def _describe(equations: EquationsOfMotion, depths: Mapping[str, _Depth]) -> Iterator[str]:
    """Yield one warning about the contact that is deepest relative to the limit."""
    deep = []
    for name, contact in contacts_of(equations).items():
        if name not in depths or not (depth := depths[name].depth) > 0.0:
            continue
        limit, part = _smallest_size(equations, contact, depths[name])
        if depth > limit:
            deep.append((depth / limit, name, depth, limit, part))
    if not deep:
        return
    (_, name, depth, limit, part), *others = sorted(deep, reverse=True)
    also = f" (also {list_first([x[1] for x in others], _MAX_NAMES)})" if others else ""
    yield (
        f"{name}{also}: the contact sinks {depth:.3g} m deep, more than {part} "
        f"({limit:.3g} m), and may have passed through; raise the stiffness if it does not "
        "stand for a soft layer."
    )


def _smallest_size(
    equations: EquationsOfMotion, contact: Contact, deepest: _Depth
) -> tuple[float, str]:
    """Return the smallest known size at a contact [m], and its description."""
    from beamdae.parts.forces.surfaces import CircleSurface

    known = []
    loose = {name for group in find_loose_groups(equations) for name in group}
    for x in contact.attachments:
        if isinstance(x, BeamAttachment) and x.s is not None:
            height = x.body.section.at(x.s).height
            if x.body.name in loose and isinstance(contact.surface.on.body, Ground):
                known.append((x.body.curve.length, f"{x.body.name} is long"))
            elif height is not None:
                known.append((height, f"{x.body.name} is thick"))
        elif isinstance(x.body, RigidBody):
            known.append(_size_of_body(equations, x.body, deepest))
    surface = contact.surface
    if isinstance(surface, CircleSurface) and surface.side == "outside":
        known.append((_MAX_DEPTH_IN_CIRCLE * surface.radius, "half the radius of the circle"))
    return min((x for x in known if x[0] > 0.0), default=(np.inf, ""))


def _size_of_body(
    equations: EquationsOfMotion, body: RigidBody, deepest: _Depth
) -> tuple[float, str]:
    """Return the size of a rigid body along the contact normal, and its description."""
    points = np.array(body.shape).reshape(-1, 2)
    if len(points) and _has_area(points):
        normal = _normal_in_body(equations, body, deepest)
        return float(np.ptp(points @ normal)), f"{body.name} is thick in this direction"
    if not len(points):
        assert equations.mechanism is not None
        points = np.array(
            [body.center]
            + [
                x.point
                for part in equations.mechanism.parts.values()
                for x in part.attachments
                if x.body is body
            ]
        )
    length = float(np.max(np.hypot(*(points[:, None] - points).T)))
    return length, f"the largest distance between points of {body.name}"


def _has_area(points: Array) -> bool:
    length, width = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(width > _MAX_LINE_WIDTH * length)


def _normal_in_body(equations: EquationsOfMotion, body: RigidBody, deepest: _Depth) -> Array:
    """Return the unit normal of a contact relative to one of its rigid bodies, (2,)."""
    rows = equations.coordinates_of_part(body.name).rows
    step = _GAP_STEP * equations.length
    q = np.repeat(deepest.q[None], 4, axis=0)
    q[[0, 1, 2, 3], rows.start + np.array([0, 0, 1, 1])] += step * np.array([1.0, -1.0, 1.0, -1.0])
    gaps = deepest.gap.evaluate(np.full(4, deepest.t), deepest.branch, q)
    x, y = gaps[::2] - gaps[1::2]
    c, s = np.cos(deepest.q[rows.start + 2]), np.sin(deepest.q[rows.start + 2])
    normal = np.array([c * x + s * y, c * y - s * x])
    return normal / np.linalg.norm(normal)
