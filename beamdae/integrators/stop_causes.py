"""Causes of early ends and failures of runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.dependent_constraints import build_constraint_jacobian
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.equations.watched_terms import compile_formula_forces
from beamdae.errors import list_first
from beamdae.integrators.integrator import DEFAULT_RTOL, Integrator
from beamdae.integrators.limits import PaceCheck, followed_vibration
from beamdae.integrators.sampling import RepeatedSample, describe_growth
from beamdae.model_checks.validity_ranges import describe_meaningless_strain, names_strains
from beamdae.results.outcome import Status
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_NEARLY_SINGULAR = 5e-2  # smallest singular value of the scaled G, with rows of length one
# That value, relative to its value at the start: linkages with short bars have small values.
_NEARLY_SINGULAR_RATIO = 0.25
# Displacement along the motion, in natural sizes, over which forces change before methods fail that
# shorten their steps.
_MAX_DISPLACEMENT = 1e-3
_SAMPLES = 101  # of the motion
_MIN_CHANGE = 0.5  # of a force along it, relative to the largest inertia force


def diagnose_failure(
    equations: EquationsOfMotion, time: Array, state: State, ahead: float, step: float
) -> str:
    """Describe the likely causes of the failure of a run that stopped after `state`.

    Parameters
    ----------
    equations
        Equations of motion of the run.
    time
        (t, branch) of the last state.
    state
        Last state of the run.
    ahead
        A slightly later time [s], at which forces may no longer be finite.
    step
        Length of the step that failed [s], or 0 if the method shortens its steps.

    Returns
    -------
    str
        Causes and remedies, separated by "; "; "" if no cause is evident.
    """
    with np.errstate(all="ignore"):
        not_finite = _describe_non_finite(equations, np.array([ahead, time[1]]), state)
        if not_finite:
            return not_finite
        causes = [
            describe_singular_position(equations, time, state),
            _describe_abrupt_force(equations, time, state, step),
            _describe_fastest_coordinate(equations, state),
        ]
    return "; ".join(filter(None, causes))


def _describe_non_finite(e: EquationsOfMotion, time: Array, state: State) -> str:
    evaluator = StateEvaluator(e)
    force = evaluator.force(time, state.q, state.v)
    rows = np.flatnonzero(~np.isfinite(force))
    if len(rows):
        return f"the force on {e.q_names[rows[0]]} is not finite after this time; check the laws"
    levels = evaluator.constraint_levels(time, state.q, state.v)
    rows = np.flatnonzero(~np.isfinite(levels).all(axis=0))
    return (
        f"{e.lam_names[rows[0]]} is not finite after this time; check the laws" if len(rows) else ""
    )


def describe_singular_position(e: EquationsOfMotion, time: Array, state: State) -> str:
    """Return a phrase naming the joints whose constraints nearly lose rank at this state, or ""."""
    if not e.m or not np.isfinite(state.q).all():
        return ""
    jacobian = build_constraint_jacobian(e)
    smallest = jacobian.smallest_singular_values(time[None], state.q[None])[0]
    if not smallest < _NEARLY_SINGULAR:
        return ""
    at_start = jacobian.smallest_singular_values(time[None], e.q0[None])[0]
    if smallest > _NEARLY_SINGULAR_RATIO * at_start:
        return ""
    names = ", ".join(jacobian.singular_joints(time, state.q))
    return (
        f"the mechanism is near a singular position of {names}; check that it can pass "
        "this position"
    )


def _describe_abrupt_force(e: EquationsOfMotion, time: Array, state: State, step: float) -> str:
    """Return a phrase naming the part whose force changes most along the motion, or "".

    The motion is that of a step or, if the method shortens its steps, a small displacement ahead.
    """
    speed = float(np.max(np.abs(state.v) / e.position_scales, initial=0.0))
    duration = step or _MAX_DISPLACEMENT / speed if speed > 0.0 else step
    if not 0.0 < duration < np.inf:
        return ""
    ahead = duration * np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    a = state.a if step else np.zeros(e.n)
    q, v = state.q + ahead * state.v + 0.5 * ahead**2 * a, state.v + ahead * a
    times = np.column_stack([time[0] + ahead[:, 0], np.full(len(ahead), time[1])])
    # Without inertia, floating frames and forces by multipliers.
    changes: dict[str, float] = {}
    for term in compile_formula_forces(
        e, lambda kernel: not (kernel.has_accelerations or kernel.local.n_multipliers)
    ):
        force = term.evaluate(times, q[:, term.columns], v[:, term.columns])
        scaled = np.abs(force - force[0]) * (abs(term.operator) @ e.position_scales)
        change = float(np.max(np.nan_to_num(scaled, nan=np.inf), initial=0.0))
        changes[term.part] = max(change, changes.get(term.part, 0.0))
    worst = max(changes, key=changes.__getitem__, default="")
    inertia = StateEvaluator(e).mass_matrix(time, state.q) @ state.a
    if not worst or changes[worst] <= _MIN_CHANGE * np.max(np.abs(inertia) * e.position_scales):
        return ""
    return f"the force of {worst} changes abruptly within {duration:.2g} s"


def _describe_fastest_coordinate(e: EquationsOfMotion, state: State) -> str:
    """Return a phrase naming the coordinate with the largest scaled acceleration, or ""."""
    rates = np.abs(state.a) / e.position_scales
    if not np.isfinite(rates).all() or not np.any(rates):
        return ""
    worst = int(np.argmax(rates))
    return (
        f"{e.q_names[worst]} has the largest acceleration ({state.a[worst]:.3g} "
        f"{e.coordinates[worst].unit}/s^2)"
    )


_STRAIN_SAMPLES = 256  # times since the last check of the motion at which strains are evaluated
_STEPS = 4096  # at the end of the run, which are examined
# Steps that follow a vibration take 5 to 60 a period; those of BDF of order 2 take 220.
_MIN_TURNS = 20
# Periods in the rest of the run; with fewer, the vibration may be the motion of interest.
_MIN_PERIODS = 1000.0
# Smaller velocities than this share of the largest one of the same unit may be rounding errors.
_MIN_SHARE = 1e-2
# Share of the amplitude that is left in the second half; with less, steps will grow.
_MIN_REMAINING_SHARE = 0.5


def name_cause(
    status: Status,
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    samples: Sequence[RepeatedSample],
    end: float,
    integrator: Integrator,
) -> Status:
    """Return the status with a growing input or a vibration as the first reason to stop.

    `samples` are those of controllers; the run should have reached `end` [s].
    """
    cause = describe_growth(samples)
    # Vibrations with meaningless strains are an effect, not a cause.
    if not cause and status.kind == "limited" and not names_strains(status):
        advice = ""
        if integrator.accuracy.name == "rtol" and integrator.accuracy.value < DEFAULT_RTOL:
            advice = f" or rtol={DEFAULT_RTOL:g}, which keeps deflections within 1 %"
        if integrator.method in ("Ida", "GeneralizedAlpha"):
            advice += ", choose Radau"
        cause = _describe_followed_vibration(equations, trajectory, end, advice)
    if not cause:
        return status
    stop, _, reason = status.sentence.partition(": ")
    return replace(status, sentence=f"{stop}: {cause.rstrip('.')}; {reason}")


def describe_hopeless_motion(
    check: PaceCheck, equations: EquationsOfMotion, trajectory: Trajectory
) -> str:
    """Return the reason to stop a long run, or "": its motion is meaningless, or it is stalled.

    A vibration that the steps follow is not part of the reason: `name_cause` adds it.
    """
    if beams_of(equations.mechanism):
        positions = trajectory.positions_at(
            np.linspace(check.begin, trajectory.end, _STRAIN_SAMPLES)
        )
        if strain := describe_meaningless_strain(equations, positions):
            return check.describe_motion(strain)
    vibration = check.is_steady and _describe_followed_vibration(equations, trajectory, check.end)
    followed_vibration.set(vibration or "")
    return check.describe_stall() if vibration and check.exceeds_limit else ""


def _describe_followed_vibration(
    equations: EquationsOfMotion, trajectory: Trajectory, end: float, advice: str = ""
) -> str:
    """Return a sentence about beams whose lasting vibrations the last steps follow, or "".

    The run should have reached `end` [s]. The period is measured by the turning points of the
    velocities of the beam's nodes. `advice` follows the sentence.
    """
    last = trajectory.intervals[-1]
    t, v = last.t[-_STEPS:], last.state.v[-_STEPS:]
    if len(t) <= _MIN_TURNS:
        return ""
    periods = {}
    for beam in beams_of(equations.mechanism):
        part = equations.coordinates_of_part(beam.name)
        rows = slice(part.rigid.stop, part.rows.stop)
        units = np.array([x.unit for x in equations.coordinates[rows]])
        turns = _count_turns(v[:, rows], units)
        if turns >= _MIN_TURNS and (end - t[-1]) * turns > 2.0 * _MIN_PERIODS * (t[-1] - t[0]):
            periods[beam.name] = 2.0 * (t[-1] - t[0]) / turns
    if not periods:
        return ""
    names = list_first(sorted(periods))
    return (
        f"the steps follow vibrations of {names} with a period of {min(periods.values()):.2g} s, "
        f"which hardly decay; set damping= of the sections{advice}, or use start='equilibrium' if "
        "the start causes the vibrations"
    )


def _count_turns(v: Array, units: Array) -> int:
    """Return the largest number of turning points of lasting vibrations in the columns of `v`."""
    sizes = np.ptp(v, axis=0)
    early, late = (np.ptp(half, axis=0) for half in np.array_split(v, 2))
    counts = np.count_nonzero(np.diff(np.signbit(np.diff(v, axis=0)), axis=0), axis=0)
    largest = np.array([np.max(sizes[units == x]) for x in units])
    lasts = (sizes > _MIN_SHARE * largest) & (late > _MIN_REMAINING_SHARE * early)
    return max(counts[lasts].tolist(), default=0)
