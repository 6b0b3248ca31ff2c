"""Warnings about contacts that start inside a surface or let bodies pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.beams.beam import BeamAttachment
from beamdae.equations.assembly.observables import compile_quantities
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.rigid_motions import collect_bodies
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.equations.watched_terms import compile_surface_gaps
from beamdae.errors import name_with_others
from beamdae.parts.attachments import measure_extent
from beamdae.parts.bodies.rigid_body import RigidBody
from beamdae.parts.events import select_impacts
from beamdae.parts.mechanism import EQUILIBRIUM, Mechanism
from beamdae.parts.part import SurfaceGap
from beamdae.symbolic.statements import Quantity

if TYPE_CHECKING:
    from beamdae.results.run_data import RunData

Array = np.ndarray

_ROUNDING = 1e-9  # of gaps, relative to the length of the mechanism
# Forces of contacts relative to the other forces on a body, which balance them at rest
_MAX_START_RATIO = 20.0
_TRAVEL = 1e-3  # along the motion at the start, relative to the natural sizes
_MAX_DEPTH_IN_CIRCLE = 0.5  # relative to the radius: points also pass beside the center


def starts_in_equilibrium(equations: EquationsOfMotion) -> bool:
    """Return True if runs start in the equilibrium of the model."""
    return equations.start is not None and equations.start.description == EQUILIBRIUM


def start_inside_warnings(
    equations: EquationsOfMotion, active: EquationsOfMotion, time: Array, state: State
) -> Iterator[str]:
    """Yield a warning per contact, or gap of an impact, that starts inside its surface.

    Contacts that other forces press on the surface may be as deep as they are.

    Parameters
    ----------
    equations
        Equations of all parts; those of a constrained system yield no warnings.
    active
        Equations of the active parts, without redundant constraints.
    time, state
        (t, branch), and the consistent state at the start of the run.
    """
    if equations.mechanism is None or starts_in_equilibrium(equations):
        return
    yield from _deep_starts(equations, active, time, state)
    yield from _closed_gaps(equations, time, state)


def _deep_starts(
    equations: EquationsOfMotion, active: EquationsOfMotion, time: Array, state: State
) -> Iterator[str]:
    """Yield a warning per contact whose force exceeds all other forces on a body by far."""
    mechanism, configurations = _mechanism_of(equations), equations.configurations
    inactive = frozenset() if configurations is None else configurations.initially_inactive
    inside: list[tuple[Any, SurfaceGap, float]] = []
    for part in mechanism.parts.values():
        for gap in () if part.name in inactive else part.gaps:
            depth = -_evaluate(equations, part.name, gap.quantity, time, state, state.q)[0]
            if depth > _ROUNDING * equations.length:
                inside.append((part, gap, depth))
    if not inside:
        return
    # Forces of contacts have kinks.
    others = StateEvaluator(active).smooth_force(time, state.q, state.v)
    points = {x.name: x.points for x in collect_bodies(active) if len(x.points)}
    limits = {
        name: _MAX_START_RATIO * np.linalg.norm(np.sum(others[rows], axis=0))
        for name, rows in points.items()
    }
    for part, _, _ in inside:
        force = _evaluate(equations, part.name, part.force, time, state, state.q)
        for body in {x.name for x in part.bodies} & set(limits):
            limits[body] -= np.linalg.norm(force)
    for part, gap, depth in inside:
        if any(limits.get(x.name, 0.0) < 0.0 for x in part.bodies):
            yield (
                f"{part.name}: {gap.point} starts {depth:.3g} m inside the surface, far deeper "
                f"than at rest; {gap.remedy}, or build the model with "
                "bd.Mechanism(start='equilibrium') if it is a preload."
            )


def _closed_gaps(equations: EquationsOfMotion, time: Array, state: State) -> Iterator[str]:
    """Yield a warning per gap of an impact that starts inside its surface, or closed and closing.

    Neither crosses zero, so that the bodies pass through each other.
    """
    sizes, rounding = equations.position_scales, _ROUNDING * equations.length
    speed, rate = (float(np.max(np.abs(x) / sizes, initial=0.0)) for x in (state.v, state.a))
    h = _TRAVEL / (max(speed, np.sqrt(_TRAVEL * rate)) or 1.0)
    ahead = state.q + h * state.v + 0.5 * h**2 * state.a
    for event in _mechanism_of(equations).events:
        for impact in select_impacts(event.do):
            if not isinstance(impact.on, Quantity):
                continue
            distance, later = (
                _evaluate(equations, str(event.name), impact.on.current, time, state, q)[0]
                for q in (state.q, ahead)
            )
            if distance <= rounding and min(distance, later) < -rounding:
                is_inside = distance < -rounding
                how = ", inside the surface" if is_inside else " and closes without crossing zero"
                yield (
                    f"{event.name}: the gap of the impact starts at {distance:.3g} m{how}, where "
                    "no impact occurs; reverse the surface, or move the body away from it."
                )


def _mechanism_of(equations: EquationsOfMotion) -> Mechanism:
    assert equations.mechanism is not None
    return equations.mechanism


def _evaluate(
    equations: EquationsOfMotion,
    name: str,
    quantity: Quantity,
    time: Array,
    state: State,
    q: Array,
) -> Array:
    """Return the values of a quantity of a part at positions `q`."""
    (compiled,) = compile_quantities(_mechanism_of(equations), [(name, quantity)])
    return compiled.rows(time[None], q[None], state.v[None])[0]


def deep_contact_warnings(run: RunData) -> Iterator[str]:
    """Yield a warning about contacts that sink deeper in a run than a touching part is thick."""
    e, depths = run.equations, {}
    for gap in compile_surface_gaps(e):
        values = [
            gap.distance.values(x.with_branch(x.t), x.state)
            for x in run.trajectory.intervals
            if gap.part not in x.inactive
        ]
        depths[gap.part] = -float(min(map(np.min, values), default=0.0))
    yield from _describe_depths(e, depths)


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
    gaps = compile_surface_gaps(equations)
    depths = {x.part: -float(np.min(x.distance.rows(times, q, q))) for x in gaps}
    yield from _describe_depths(equations, depths)


def _describe_depths(equations: EquationsOfMotion, depths: Mapping[str, float]) -> Iterator[str]:
    """Yield a warning about the contact that is deepest relative to the smallest part."""
    deep = []
    for name, depth in depths.items():
        limit, part = min(_list_sizes(equations, name), default=(np.inf, ""))
        if depth > limit:
            deep.append((depth / limit, name, depth, limit, part))
    if deep:
        (_, name, depth, limit, part), *others = sorted(deep, reverse=True)
        yield (
            f"{name_with_others(name, [x[1] for x in others])}: the contact sinks {depth:.3g} m "
            f"deep, more than {part} ({limit:.3g} m), and may have passed through; raise the "
            "stiffness if it does not stand for a soft layer."
        )


def _list_sizes(equations: EquationsOfMotion, name: str) -> Iterator[tuple[float, str]]:
    """Yield the known sizes at a contact [m], and their descriptions.

    Beams that no joint connects to the ground may fall on a layer that is thicker than they are.
    """
    # Imported here, because few models have contacts.
    from beamdae.equations.starts.mobility import find_loose_groups
    from beamdae.parts.forces.contact import CircleSurface

    assert equations.mechanism is not None
    contact: Any = equations.mechanism.parts[name]
    surface = contact.surface
    loose = {body for group in find_loose_groups(equations) for body in group}
    for x in (contact.point, surface.on):
        if isinstance(x, BeamAttachment) and x.s is not None:
            if x.body.name in loose:
                yield x.body.curve.length, f"{x.body.name} is long"
            elif (height := x.body.section.at(x.s).height) is not None:
                yield height, f"{x.body.name} is thick"
        elif isinstance(x.body, RigidBody) and (extent := measure_extent([x.body])):
            yield extent, f"{x.body.name} is large"
    if isinstance(surface, CircleSurface) and surface.side == "outside":
        yield _MAX_DEPTH_IN_CIRCLE * surface.radius, "half the radius of the circle"


def impact_order_warnings(run: RunData) -> Iterator[str]:
    """Yield a warning about the first simultaneous impacts that close the gaps of each other."""
    names = {term.name for term in run.equations.events if select_impacts(term.do)}
    for t in dict.fromkeys(x.t for x in run.event_records):
        simultaneous = [x.name for x in run.event_records if x.t == t and x.name in names]
        different = list(dict.fromkeys(simultaneous))
        if 1 < len(different) < len(simultaneous):
            yield (
                f"{', '.join(different)}: these impacts at t = {t:.6g} s close the gaps of each "
                "other, so the motion after them depends on their order; make them one event, "
                "do=[bd.impact(...), bd.impact(...)]."
            )
            return
