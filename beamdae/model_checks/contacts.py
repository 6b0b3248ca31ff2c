"""Warnings about contacts that never touch, let bodies pass or hold at another impact speed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, cast

import numpy as np

from beamdae.beams.beam import BeamAttachment
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.part_warnings import starts_in_equilibrium
from beamdae.equations.starts.mobility import find_loose_groups
from beamdae.equations.surface_gaps import SurfaceGapTerm, compile_surface_gaps
from beamdae.errors import name_with_others
from beamdae.parts.bodies.rigid_body import Ground, RigidBody
from beamdae.results.trajectory import Interval, Trajectory

if TYPE_CHECKING:
    from beamdae.beams.beam_contact import BeamContact
    from beamdae.parts.forces.contact import Contact

Array = np.ndarray

_ROUNDING = 1e-10  # of gaps, relative to the length of the mechanism
# Gaps up to this multiple of the sizes of all bodies and of the change of the gap may be meant.
_MAX_DISTANCE = 5.0
_MIN_DEEPENING = 1.01  # of a depth relative to that in the drawing
_MAX_DEPTH_IN_CIRCLE = 0.5  # relative to the radius: points also pass beside the center
_MAX_RESTITUTION_CHANGE = 0.2
_RATE_STEP = 1e-3  # of central differences, relative to a step
_MIN_TRAVEL = 1e-5  # of impacts at their speed in the run, relative to the length


def contacts_of(equations: EquationsOfMotion) -> dict[str, Contact | BeamContact]:
    """Return the contacts of the mechanism by name."""
    parts = {} if equations.mechanism is None else equations.mechanism.parts
    return {name: cast("Contact | BeamContact", part) for name, part in parts.items() if part.gaps}


def untouched_contact_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[str]:
    """Yield a warning about contacts that are far away, or if no contact ever touches.

    Contacts are meant to touch if they have friction. Others may be guards and stops that are not
    reached.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    contacts, mechanism = contacts_of(equations), equations.mechanism
    if not contacts or mechanism is None or any(x.inactive for x in trajectory.intervals):
        return
    times = np.concatenate([x.t for x in trajectory.intervals])
    gaps: dict[str, Array] = {}
    for term in compile_surface_gaps(equations):
        if term.part in contacts:
            values = [term.evaluate(x.t, x.branch, x.state.q) for x in trajectory.intervals]
            gaps[term.part] = np.concatenate(values)
    size = sum(x.size for x in equations.parts if not x.is_state)
    named = [x for x, d in gaps.items() if np.min(d) > _MAX_DISTANCE * (size + np.ptp(d))]
    if not named:
        rounding = _ROUNDING * equations.length
        if any(np.min(d[1:], initial=0.0) < -rounding for d in gaps.values()):
            return
        if not any(contacts[name].friction > 0.0 for name in gaps):
            return
        named = list(gaps)
    first, *others = sorted(named, key=lambda name: float(np.min(gaps[name])))
    k = int(np.argmin(gaps[first]))
    yield (
        f"{name_with_others(first, others)}: the bodies do not touch during the run, with a "
        f"smallest distance of {max(gaps[first][k], 0.0):.3g} m at t = {times[k]:.4g} s; check the "
        "place, the direction and the unit of the surface, the motion, and t_end."
    )


def deep_contact_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning about contacts that sink deeper in a run than a touching part is thick.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    """
    depths: dict[str, float] = {}
    for gap in compile_surface_gaps(equations) if contacts_of(equations) else ():
        values = [
            gap.evaluate(x.t, x.branch, x.state.q)
            for x in trajectory.intervals
            if gap.part not in x.inactive
        ]
        if not values:
            continue
        depth = -float(np.min(np.concatenate(values)))
        # Drawings may overlap by a preload, which has a warning if it is wrong.
        if starts_in_equilibrium(equations) or depth > -_MIN_DEEPENING * values[0][0]:
            depths[gap.part] = depth
    yield from _describe_depths(equations, depths)


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
    depths = {
        gap.part: max(
            -float(gap.evaluate(time[:1], time[1], row[None])[0])
            for time, row in zip(times, q, strict=True)
        )
        for gap in (compile_surface_gaps(equations) if contacts_of(equations) else ())
    }
    yield from _describe_depths(equations, depths)


def _describe_depths(equations: EquationsOfMotion, depths: dict[str, float]) -> Iterator[str]:
    """Yield a warning about the contact that is deepest relative to the smallest part."""
    deep = []
    for name, contact in contacts_of(equations).items():
        if (depth := depths.get(name, 0.0)) > 0.0:
            limit, part = _smallest_size(equations, contact)
            if depth > limit:
                deep.append((depth / limit, name, depth, limit, part))
    if not deep:
        return
    (_, name, depth, limit, part), *others = sorted(deep, reverse=True)
    yield (
        f"{name_with_others(name, [x[1] for x in others])}: the contact sinks {depth:.3g} m deep, "
        f"more than {part} ({limit:.3g} m), and may have passed through; raise the stiffness if it "
        "does not stand for a soft layer."
    )


def _smallest_size(
    equations: EquationsOfMotion, contact: Contact | BeamContact
) -> tuple[float, str]:
    """Return the smallest known size at a contact [m], and its description.

    Beams that no joint connects to the ground may fall on a layer that is thicker than they are.
    """
    from beamdae.parts.forces.surfaces import CircleSurface

    assert equations.mechanism is not None
    surface, parts = contact.surface, equations.mechanism.parts.values()
    loose = {name for group in find_loose_groups(equations) for name in group}
    known: list[tuple[float, str]] = []
    for x in (contact.point, surface.on):
        body = x.body
        if isinstance(x, BeamAttachment) and x.s is not None:
            height = x.body.section.at(x.s).height
            if body.name in loose and isinstance(surface.on.body, Ground):
                known.append((x.body.curve.length, f"{body.name} is long"))
            elif height is not None:
                known.append((height, f"{body.name} is thick"))
        elif isinstance(body, RigidBody):
            ends = [a.point for part in parts for a in part.attachments if a.body is body]
            points = np.array([*body.shape, body.center, *ends]).reshape(-1, 2)
            size = float(np.max(np.hypot(*(points[:, None] - points).T)))
            known.append((size, f"the largest distance between points of {body.name}"))
    if isinstance(surface, CircleSurface) and surface.side == "outside":
        known.append((_MAX_DEPTH_IN_CIRCLE * surface.radius, "half the radius of the circle"))
    return min((x for x in known if x[0] > 0.0), default=(np.inf, ""))


def impact_speed_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning about contacts whose restitution differs at the speed of their impacts.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    """
    contacts = {name: x for name, x in contacts_of(equations).items() if x.impact_speed}
    duration = trajectory.end - trajectory.start
    if not contacts or not duration > 0.0:
        return
    from beamdae.parts.forces.contact import restitution_at

    slowest = _MIN_TRAVEL * equations.length / duration
    wrong = []
    for gap in compile_surface_gaps(equations):
        contact = contacts.get(gap.part)
        if contact is None or contact.impact_speed is None:
            continue
        speed = max(_fastest_impact(gap, x) for x in trajectory.intervals)
        # Faster impacts may lie between the stored steps of long runs.
        is_known = trajectory.stores_all_steps or speed > contact.impact_speed
        if speed < slowest or not is_known:
            continue
        nominal = contact.restitution_or_elastic
        actual = restitution_at(speed, nominal, contact.impact_speed)
        if abs(actual - nominal) > _MAX_RESTITUTION_CHANGE:
            wrong.append((abs(actual - nominal), gap.part, speed, actual))
    if not wrong:
        return
    (_, name, speed, actual), *others = sorted(wrong, reverse=True)
    contact = contacts[name]
    yield (
        f"{name_with_others(name, [x[1] for x in others])}: the fastest impact is at {speed:.3g} "
        f"m/s, where the restitution is {actual:.2g}, because restitution="
        f"{contact.restitution_or_elastic:g} holds at impact_speed={contact.impact_speed:g}; pass "
        "the expected speed of the impact."
    )


def _fastest_impact(gap: SurfaceGapTerm, interval: Interval) -> float:
    """Return the largest speed [m/s] at which a gap closes, or 0."""
    t, state = interval.t, interval.state
    if gap.part in interval.inactive or len(t) < 2:
        return 0.0
    is_open = gap.evaluate(t, interval.branch, state.q) > _ROUNDING * gap.length
    # Bodies that touch at the start may have an impact there.
    closing = np.append(is_open[:-1] & ~is_open[1:], False)
    closing[0] |= not is_open[0]
    (k,) = np.nonzero(closing)
    ahead = _RATE_STEP * np.diff(t)[np.minimum(k, len(t) - 2)]
    change = ahead[:, None] * state.v[k]
    before, after = (
        gap.evaluate(t[k], interval.branch, q) for q in (state.q[k] - change, state.q[k] + change)
    )
    speeds = (before - after) / np.where(ahead > 0.0, 2.0 * ahead, np.inf)
    return float(np.max(speeds, initial=0.0))
