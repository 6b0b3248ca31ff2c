"""Diagnosis of failed runs: values that are not finite, rank loss, abrupt forces, accelerations."""

from __future__ import annotations

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.dependent_constraints import build_constraint_jacobian
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.equations.watched_terms import compile_formula_forces

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
    changes = _measure_changes(e, times, q, v)
    worst = max(changes, key=changes.__getitem__, default="")
    inertia = StateEvaluator(e).mass_matrix(time, state.q) @ state.a
    if not worst or changes[worst] <= _MIN_CHANGE * np.max(np.abs(inertia) * e.position_scales):
        return ""
    return f"the force of {worst} changes abruptly within {duration:.2g} s"


def _measure_changes(e: EquationsOfMotion, times: Array, q: Array, v: Array) -> dict[str, float]:
    """Return the largest change of the force of each part from the first row on, in scaled form.

    Inertia, floating frames and forces by multipliers are left out.
    """
    changes: dict[str, float] = {}
    for term in compile_formula_forces(
        e, lambda kernel: not (kernel.has_accelerations or kernel.local.n_multipliers)
    ):
        force = term.evaluate(times, q[:, term.columns], v[:, term.columns])
        scaled = np.abs(force - force[0]) * (abs(term.operator) @ e.position_scales)
        change = float(np.max(np.nan_to_num(scaled, nan=np.inf), initial=0.0))
        changes[term.part] = max(change, changes.get(term.part, 0.0))
    return changes


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
