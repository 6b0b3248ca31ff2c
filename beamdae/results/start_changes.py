"""Differences between the drawing or the requested start and the actual start of a run."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, Start, State
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM
from beamdae.read_only import read_only_data

Array = np.ndarray

_MAX_UNREPORTED_DISPLACEMENT = 1e-3  # relative to the length of the mechanism
_MAX_UNREPORTED_VELOCITY_CHANGE = 1e-2  # relative to the largest requested velocity of the part
# Displacements by drivers up to this share of the length of the mechanism are preloads.
_MAX_PRELOAD = 0.05
_MIN_OPEN_GAP = 1e-9  # relative to the scale of the gap
_MAX_ROUNDING = 1e-9  # of velocities, relative to the largest one
_MIN_RATE = 1e-14  # of velocities relative to the length [1/s]; slower motions are at rest


@dataclass(frozen=True)
class StartChange:
    """Difference between the requested and the consistent start of one part.

    Attributes
    ----------
    part
        Name of the part.
    displacement, velocity
        Largest change of a coordinate [m] and of a velocity [m/s]. Changes of angles and angular
        velocities are multiplied by the size of the part.
    coordinate
        Name of the coordinate with the largest displacement.
    """

    part: str
    displacement: float
    velocity: float
    coordinate: str


@read_only_data
@dataclass(frozen=True)
class StartSummary:
    """Requested start of a run, and its changes to satisfy the joints.

    Attributes
    ----------
    request
        Requested start: "as drawn", "equilibrium", or a description of the given values.
    changes
        Changes to satisfy the joints, one entry per part with coordinates. For an equilibrium and a
        steady rotation, the changes of the drawing before it was searched for.
    warning
        Warning if no positions were requested and a part was displaced by more than a thousandth of
        the length of the mechanism to close the joints, or if a requested velocity was changed by
        more than a hundredth of it; otherwise empty.
    """

    request: str
    changes: tuple[StartChange, ...]
    warning: str

    @property
    def largest(self) -> StartChange | None:
        """Change with the largest displacement, or None if no part has coordinates."""
        return max(self.changes, key=lambda change: change.displacement, default=None)


def compare_start(e: EquationsOfMotion, state: State) -> StartSummary:
    """Compare the requested start of the equations with the actual first state of a run."""
    start = Start(AS_DRAWN, e.q0, e.v0, False) if e.start is None else e.start
    request, q, v, is_moved, drawn_closed_q, _ = start
    closed_q = state.q if drawn_closed_q is None else drawn_closed_q
    changes = []
    # First-order states do not move, and controllers set their held values at the start.
    for part in (x for x in e.parts if not x.is_state):
        lever = np.where(e.is_angle[part.rows], part.size, 1.0)
        displacement = np.abs(closed_q - q)[part.rows] * lever
        velocity = np.abs(state.v - v)[part.rows] * lever
        largest = e.q_names[part.rows][int(np.argmax(displacement))]
        changes.append(
            StartChange(part.name, float(displacement.max()), float(velocity.max()), largest)
        )
    summary = StartSummary(request, tuple(changes), "")
    warning = "" if is_moved else _describe_displacement(e, q, summary.largest)
    if request == AS_DRAWN and not warning:
        warning = _describe_lost_velocity(e, v, state)
    return replace(summary, warning=warning)


def drawing_warnings(e: EquationsOfMotion, time: Array) -> tuple[str, ...]:
    """Return `StartSummary.warning` of an analysis that begins with the drawing, if any.

    Parameters
    ----------
    e
        Equations of the active parts, with independent constraints and the drawing as start.
    time
        (t, branch).
    """
    # Imported here because runs do not need it.
    from beamdae.equations.formulations.static_equations import StaticEquations

    # The static equations, unlike the consistency solver, are compiled already.
    gaps = StaticEquations(e, time).residual(e.q0, np.zeros(e.m))[e.n :]
    if np.max(np.abs(gaps) / e.constraint_scales, initial=0.0) <= _MIN_OPEN_GAP:
        return ()
    closed_q, rest = ConsistencySolver(e).close_positions(time, e.q0), np.zeros(e.n)
    # At other times, drivers have left their positions in the drawing.
    drawn_q = e.q0 if time[0] == 0.0 else closed_q
    start = Start(EQUILIBRIUM, drawn_q, rest, False, closed_q)
    state = State(closed_q, rest, rest, np.zeros(e.m))
    return tuple(filter(None, (compare_start(replace(e, start=start), state).warning,)))


def _describe_displacement(e: EquationsOfMotion, q: Array, change: StartChange | None) -> str:
    """Return a sentence on the part that was displaced most from `q`, or an empty string.

    Small displacements by drivers alone, whose laws begin beside the drawing, are preloads.
    """
    if change is None or not change.displacement > _MAX_UNREPORTED_DISPLACEMENT * e.length:
        return ""
    # Only drivers have gaps at the requested positions.
    parts = {} if e.mechanism is None else e.mechanism.parts
    gaps = StateEvaluator(e).position_gaps(time_on_branch(e.breakpoints, 0.0), q)
    is_open = np.abs(gaps) > _MIN_OPEN_GAP * e.constraint_scales
    names = [e.lam_names[k].rpartition(".")[0] for k in np.flatnonzero(is_open)]
    is_driven = all(name in parts and parts[name].laws for name in names)
    if is_driven and change.displacement < _MAX_PRELOAD * e.length:
        return ""
    cause = "the joints are not closed in the reference configuration, and closing them displaces"
    remedy = "correct the positions of the parts, or pass start= with positions by name"
    if is_driven:
        cause = "drivers begin beside the reference configuration, which displaces"
        remedy = (
            "laws are positions relative to the drawing: begin them at 0, or pass "
            "lambda t: speed * t for a constant speed"
        )
    return (
        f"{change.part}: {cause} this part by {change.displacement:.3g} m (mostly "
        f"{change.coordinate}) in a mechanism of {e.length:.3g} m; {remedy}."
    )


def _describe_lost_velocity(e: EquationsOfMotion, requested: Array, state: State) -> str:
    """Return a sentence on the requested velocity that changed most, or an empty string."""
    scales, is_angle = e.position_scales, np.array([x.unit == "rad" for x in e.coordinates], bool)
    asked, actual, a = (np.abs(e.without_states(x)) / scales for x in (requested, state.v, state.a))
    changes = np.abs(e.without_states(state.v - requested)) / scales
    # A motion that reverses has no velocity, but one after a travel of its length.
    largest = max(np.max(asked), np.max(actual), np.sqrt(np.max(a))) if e.n else 0.0
    rounding = max(_MAX_ROUNDING * largest, _MIN_RATE)
    worst, largest_ratio = None, _MAX_UNREPORTED_VELOCITY_CHANGE
    for part in (x for x in e.parts if not x.is_state):
        # Elastic coordinates adapt to the rigid motion, and nodes of a beam to a given rotation.
        rows = np.arange(part.rows.start, part.rows.stop - len(e.q_names[part.deformations]))
        turns = rows[is_angle[rows]]
        is_turning = not part.rigid_count and bool(np.any(requested[turns]))
        for kind, k in enumerate((rows[~is_angle[rows]], turns)):
            if not len(k) or (is_turning and kind == 0):
                continue
            size = float(np.max(asked[k]))
            if size <= rounding and part.given_velocities[kind]:
                # A given zero is compared with the motion of the other bodies.
                size = float(np.max(actual[is_angle == bool(kind)]))
            ratio = float(np.max(changes[k])) / size if size > rounding else 0.0
            if ratio > largest_ratio:
                worst, largest_ratio = (part, int(k[np.argmax(changes[k])])), ratio
    if worst is None:
        return ""
    part, row = worst
    unit = f"{e.coordinates[row].unit}/s"
    return (
        f"{part.name}: the joints do not allow the given velocities, and the run starts with "
        f"{e.q_names[row]}_dot = {state.v[row]:.4g} {unit} instead of {requested[row]:.4g} {unit}; "
        "give velocities that the joints allow."
    )
