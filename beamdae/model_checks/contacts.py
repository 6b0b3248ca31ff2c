"""Warnings about contacts that start inside a surface or let bodies pass."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.beams.beam import BeamAttachment
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.assembly.observables import compile_quantities
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.rigid_motions import collect_bodies
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.equations.surface_gaps import compile_surface_gaps
from beamdae.errors import name_with_others
from beamdae.parts.attachments import measure_extent
from beamdae.parts.bodies.rigid_body import RigidBody
from beamdae.parts.events import select_impacts
from beamdae.parts.mechanism import EQUILIBRIUM
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
    mechanism = equations.mechanism
    if mechanism is None or starts_in_equilibrium(equations):
        return

    def evaluate(name: str, quantity: Quantity, q: Array) -> Array:
        (compiled,) = compile_quantities(mechanism, [(name, quantity)])
        return compiled.rows(time[None], q[None], v)[0]

    v, rounding = state.v[None], _ROUNDING * equations.length
    configurations = equations.configurations
    inactive = frozenset() if configurations is None else configurations.initially_inactive
    pressures: dict[str, float] = defaultdict(float)
    inside = []
    for part in mechanism.parts.values():
        for gap in () if part.name in inactive else part.gaps:
            if (depth := -float(evaluate(part.name, gap.quantity, state.q)[0])) > rounding:
                inside.append((part, gap, depth))
                force: Any = part
                for body in {x.name for x in part.bodies}:
                    pressures[body] += float(
                        np.linalg.norm(evaluate(part.name, force.force, state.q))
                    )
    others = _forces_without({x.name for x, _, _ in inside}, active, time, state)
    points = {x.name: x.points for x in collect_bodies(active) if len(x.points)}
    for part, gap, depth in inside:
        for body in {x.name for x in part.bodies} & set(points):
            resultant = np.linalg.norm(np.sum(others[points[body]], axis=0))
            if pressures[body] > _MAX_START_RATIO * resultant:
                yield (
                    f"{part.name}: {gap.point} starts {depth:.3g} m inside the surface, far deeper "
                    f"than at rest; {gap.remedy}, or build the model with "
                    "bd.Mechanism(start='equilibrium') if it is a preload."
                )
                break
    sizes = equations.position_scales
    speed, rate = (float(np.max(np.abs(x) / sizes, initial=0.0)) for x in (state.v, state.a))
    h = _TRAVEL / (max(speed, np.sqrt(_TRAVEL * rate)) or 1.0)
    ahead = state.q + h * state.v + 0.5 * h**2 * state.a
    for event in mechanism.events:
        for impact in select_impacts(event.do):
            if isinstance(impact.on, Quantity):
                distance, later = (
                    float(evaluate(str(event.name), impact.on.current, q)[0])
                    for q in (state.q, ahead)
                )
                if min(distance, later) < -rounding:
                    how = "inside the surface" if distance < -rounding else "and closes"
                    yield (
                        f"{event.name}: the gap of the impact starts at {distance:.3g} m, {how}, "
                        "where no impact occurs; reverse the surface, or move the body away from "
                        "it."
                    )


def _forces_without(names: set[str], active: EquationsOfMotion, time: Array, state: State) -> Array:
    """Return the generalized forces F of all active parts but those of these names, (n,)."""
    assert active.mechanism is not None
    mechanism = copy(active.mechanism)
    mechanism.parts = {name: x for name, x in mechanism.parts.items() if name not in names}
    mechanism.observables, mechanism.events = {}, []
    others = active if not names else equations_of_motion(mechanism)
    return StateEvaluator(others).force(time, state.q, state.v)


def deep_contact_warnings(run: RunData) -> Iterator[str]:
    """Yield a warning about contacts that sink deeper in a run than a touching part is thick."""
    e, depths = run.equations, {}
    for gap in compile_surface_gaps(e):
        values = [
            gap.evaluate(x.t, x.branch, x.state.q)
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
    """Yield the known sizes at a contact [m], and their descriptions."""
    from beamdae.parts.forces.surfaces import CircleSurface

    assert equations.mechanism is not None
    contact: Any = equations.mechanism.parts[name]
    surface = contact.surface
    for x in (contact.point, surface.on):
        if isinstance(x, BeamAttachment) and x.s is not None:
            if (height := x.body.section.at(x.s).height) is not None:
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
