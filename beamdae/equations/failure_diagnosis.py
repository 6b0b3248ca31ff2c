"""Diagnosis of failed runs: non-finite values, rank loss, largest residual and acceleration."""

from __future__ import annotations

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formula_forces import (
    FormulaForceTerm,
    compile_formula_forces,
    name_formula_forces,
)
from beamdae.equations.friction_sliding import compile_sliding
from beamdae.equations.starts.rank import build_constraint_jacobian
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.errors import list_first

Array = np.ndarray

# Steps at the start in which high-frequency vibrations decay that a law excites there: 10 to 20.
STARTING_STEPS = 30
_NEARLY_SINGULAR = 5e-2  # smallest singular value of the scaled G, with rows of length one
# That value, relative to its value at the start: linkages with short bars have small values.
_NEARLY_SINGULAR_RATIO = 0.25
# Deviation of a force from a linear change over a step, relative to the largest force: friction
# that reverses within a step reaches 0.3 and more.
_ABRUPT_CHANGE = 0.1
_STEP_SAMPLES = 9
# Change of the sliding speed per step, relative to the regularization velocity, up to which
# Newton's iteration converges when a part sticks (479 of 480 runs; with 8, 350 of 480).
_MAX_SPEED_CHANGE = 5.0
_RECOMMENDED_SPEED_CHANGE = 4.0
# Motions relative to the sizes of the parts at which poles of forces are sought, their number, and
# the factor by which the force increases there, and again whenever the search is refined.
_POLE_DISTANCES, _POLE_SAMPLES = (1e-16, 0.1), 301
_POLE_GROWTH, _POLE_REFINEMENTS = 8.0, 3
_SIGNIFICANT_RESIDUAL = 1e-6  # relative to the size of the terms of the equation
_MAX_NAMES = 3
_MIN_FORCE = 1e-300  # avoids division by zero


def diagnose_failure(
    equations: EquationsOfMotion,
    time: Array,
    state: State,
    ahead: float,
    step: float,
    residual: Array | None = None,
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
    residual
        Residual of a first-order form where the run stopped, or None: the entries of q' = v, then
        of the forces and of the constraints.

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
            _describe_start(equations, time, step),
            _describe_pole(equations, time, state),
            _describe_sticking(equations, time, state, step),
            _describe_abrupt_forces(equations, time, state, step),
            _describe_largest_residual(equations, state, residual),
            _describe_fastest_coordinate(equations, state),
        ]
    return "; ".join(filter(None, causes))


def list_moving_drivers(equations: EquationsOfMotion, time: Array, q: Array) -> list[str]:
    """Return the names of drivers whose laws change at (t, branch), so that not all can rest."""
    rates = StateEvaluator(equations).constraint_levels(time, q, np.zeros(equations.n))[1]
    names = (equations.lam_names[k].rpartition(".")[0] for k in np.flatnonzero(rates))
    return list(dict.fromkeys(names))


def _describe_start(e: EquationsOfMotion, time: Array, step: float) -> str:
    """Return a phrase naming the drivers that move at the start if the run failed there, or ""."""
    if time[0] > STARTING_STEPS * step:
        return ""
    # At the last state, drivers move whose laws begin at rest.
    names = list_moving_drivers(e, np.zeros(2), e.q0)
    if not names:
        return ""
    return (
        f"{list_first(names, _MAX_NAMES)} starts with a velocity, which excites vibrations if the "
        "mechanism is at rest before; start the law smoothly, as bd.run_up does, or use an "
        "integrator with rtol"
    )


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


def _describe_pole(e: EquationsOfMotion, time: Array, state: State) -> str:
    """Return a phrase naming a part whose force has a pole near this state, or ""."""
    speed = float(np.max(np.abs(state.v) / e.position_scales, initial=0.0))
    if not (np.isfinite(speed) and speed > 0.0):
        return ""
    for name, term in zip(
        name_formula_forces(e, True), compile_formula_forces(e, True), strict=True
    ):
        for direction in (1.0, -1.0):
            distance = _find_pole(term, time, state, direction / speed)
            if distance is not None:
                return (
                    f"the force of {name} is infinite within {distance:.1g} s of this time, at "
                    "these velocities; bound its formula, or stop the run before by an event"
                )
    return ""


def _find_pole(term: FormulaForceTerm, time: Array, state: State, scale: float) -> float | None:
    """Return the time [s] to a pole of a force at constant velocities, or None.

    Poles are sought at _POLE_DISTANCES times `scale`, which is negative before the state.
    """

    def size(shares: Array) -> Array:
        q = state.q + (scale * shares)[:, None] * state.v
        v = np.broadcast_to(state.v, q.shape)
        force = np.abs(term.evaluate(np.full(len(shares), time[0]), time[1], q, v))
        return np.max(np.where(np.isnan(force), np.inf, force), axis=1)

    largest = _POLE_GROWTH * float(size(np.zeros(1))[0])
    shares = np.geomspace(*_POLE_DISTANCES, _POLE_SAMPLES)
    for _ in range(_POLE_REFINEMENTS):
        sizes = size(shares)
        k = int(np.argmax(sizes))
        # Forces that only increase, such as those of stiff springs, have no pole.
        if not (sizes[k] > largest > 0.0 and 0 < k < len(shares) - 1):
            return None
        if np.isinf(sizes[k]):
            break
        largest = _POLE_GROWTH * float(sizes[k])
        shares = np.linspace(shares[k - 1], shares[k + 1], _POLE_SAMPLES)
        k = len(shares) // 2
    return abs(scale) * float(shares[k])


def _describe_sticking(e: EquationsOfMotion, time: Array, state: State, step: float) -> str:
    """Return a phrase naming the friction that begins to stick within a step, and a step, or ""."""
    terms = compile_sliding(e) if step else ()
    end = state._replace(q=state.q + step * state.v, v=state.v + step * state.a)
    states = State(*(np.stack(x) for x in zip(state, end, strict=True)))
    times = np.array([time, [time[0] + step, time[1]]])
    for term in terms:
        speed, (now, later) = term.law.speed, term.evaluate(times, states).tolist()
        change = abs(later - now)
        if now * later <= 0.0 and change > _MAX_SPEED_CHANGE * speed:
            shorter = _RECOMMENDED_SPEED_CHANGE * speed / change * step
            return (
                f"{term.name} begins to stick, and its sliding speed changes by {change:.2g} m/s "
                f"per step, while {term.law.speed_name} is {speed:g} m/s; use a step of at most "
                f"{shorter:.1g} s, a larger {term.law.speed_name}=, or an integrator with rtol"
            )
    return ""


def _describe_abrupt_forces(e: EquationsOfMotion, time: Array, state: State, step: float) -> str:
    """Return a phrase naming the formulas that change abruptly within a step, or ""."""
    if not step:
        return ""
    share = np.linspace(0.0, 1.0, _STEP_SAMPLES)[:, None]
    ahead = step * share
    q = state.q + ahead * state.v + 0.5 * ahead**2 * state.a
    v = state.v + ahead * state.a
    names = []
    for name, term in zip(name_formula_forces(e), compile_formula_forces(e), strict=True):
        force = term.evaluate(time[0] + ahead[:, 0], time[1], q, v)
        deviation = np.abs(force - force[0] - share * (force[-1] - force[0]))
        if np.max(deviation) > _ABRUPT_CHANGE * np.max(np.abs(force)):
            names.append(name)
    if not names:
        return ""
    first = list_first(list(dict.fromkeys(names)), _MAX_NAMES)
    return f"steps of {step:.2g} s are too long for changes of the force of {first}"


def _describe_largest_residual(e: EquationsOfMotion, state: State, residual: Array | None) -> str:
    """Return a phrase naming the equation with the largest relative residual, or ""."""
    if residual is None or not np.isfinite(residual).all():
        return ""
    n, m = e.n, e.m
    speed = float(np.max(np.abs(state.v) / e.position_scales)) or 1.0
    force = max(float(np.max(np.abs(state.lam), initial=0.0)), _MIN_FORCE)
    sizes = np.concatenate(
        [speed * e.position_scales, np.full(n, force), np.full(len(residual) - 2 * n, e.length)]
    )
    relative = np.abs(residual) / sizes
    worst = int(np.argmax(relative))
    if not relative[worst] > _SIGNIFICANT_RESIDUAL:
        return ""
    if worst >= 2 * n:
        equation = f"the constraint {e.lam_names[(worst - 2 * n) % m]}"
    else:
        what = "the balance of forces on" if worst >= n else "the rate of"
        equation = f"{what} {e.q_names[worst % n]}"
    return f"the largest residual is in {equation}"


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
