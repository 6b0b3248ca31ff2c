"""Starts other than the drawing: positions and velocities by name, or static equilibrium."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, Start
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.least_strain import minimize_strain, solve_least_change
from beamdae.equations.starts.reduced_equations import remove_redundant_constraints
from beamdae.equations.starts.relaxation import relax_to_equilibrium
from beamdae.errors import BeamdaeError, short_repr, suggest
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM, require_start

Array = np.ndarray

_RATE = "_dot"
# Given positions are approached by steps that keep Newton's iteration near the joints, in the
# natural sizes of coordinates; closed to this much of them, in so many iterations.
_APPROACH, _CLOSED, _ITERATIONS = 0.2, 1e-11, 30


def apply_initial_conditions(
    equations: EquationsOfMotion, start: Any, t: float = 0.0
) -> EquationsOfMotion:
    """The same equations of motion, to be started otherwise than drawn.

    Parameters
    ----------
    start
        "as drawn"; "equilibrium" under the loads at time `t` [s], at rest; or positions and
        velocities by name ("part.coordinate", "part.coordinate_dot"), which are kept while the
        others follow by the least change that the joints ask for.

    Raises
    ------
    BeamdaeError
        If a name is unknown, the joints do not allow the values given, or nothing comes to rest.
    """
    start = require_start("start", start)
    if start == AS_DRAWN:
        return equations
    time = time_on_branch(equations, t)
    # Joints that are redundant would leave what holds them open.
    spared = remove_redundant_constraints(equations, time) if equations.redundant else None
    own = equations if spared is None else spared.equations
    if start == EQUILIBRIUM:
        q, _ = relax_to_equilibrium(StaticEquations(own, time), own.q0)
        v = np.zeros(equations.n)
        return replace(
            equations, q0=_freeze(q), v0=_freeze(v), start=Start(EQUILIBRIUM, q, v, True)
        )
    positions, velocities = _split_by_kind(equations, start)
    asked_q, asked_v = np.array(equations.q0), np.array(equations.v0)
    asked_q[list(positions)] = list(positions.values())
    asked_v[list(velocities)] = list(velocities.values())
    q = _close_with_positions(own, time, positions)
    v = _project_velocities(own, time, q, asked_v, list(velocities))
    told = ", ".join(f"{name} = {value:g}" for name, value in start.items()) or AS_DRAWN
    asked = Start(told, asked_q, asked_v, bool(positions))
    return replace(equations, q0=_freeze(q), v0=_freeze(v), start=asked)


def time_on_branch(e: EquationsOfMotion, t: float) -> Array:
    """(t, branch): a time [s] and one before the next breakpoint, by which laws choose a piece."""
    return np.array([t, t + 0.5 * (min((b for b in e.breakpoints if b > t), default=t + 1.0) - t)])


def _freeze(values: Array) -> Array:
    values.setflags(write=False)
    return values


def _split_by_kind(
    e: EquationsOfMotion, given: Mapping[str, float]
) -> tuple[dict[int, float], ...]:
    """Which positions and which velocities are given, by index."""
    index = {name: k for k, name in enumerate(e.q_names)}
    rates = {name + _RATE: k for name, k in index.items()}
    for name in given:
        if name not in index and name not in rates:
            raise BeamdaeError(
                f"start: there is no coordinate {short_repr(name)}{suggest(name, (*index, *rates))}, "
                f"they are called as in {e.q_names[0]!r} and {e.q_names[0] + _RATE!r}."
            )
    positions = {index[name]: value for name, value in given.items() if name in index}
    velocities = {rates[x]: value for x, value in given.items() if x in rates and x not in index}
    return positions, velocities


def _selection(columns: list[int], n: int) -> sp.csr_array:
    rows = (np.ones(len(columns)), (np.arange(len(columns)), columns))
    return sp.csr_array(rows, shape=(len(columns), n))


def _close_with_positions(e: EquationsOfMotion, time: Array, given: Mapping[int, float]) -> Array:
    """Positions with the given ones among them, the others as the joints have them."""
    starter, held = ConsistencySolver(e), _selection(list(given), e.n)
    q = drawn = starter.state(time, e.q0, e.v0).q
    if not given:
        return q
    begun, ends = held @ q, np.array(list(given.values()))
    change = np.max(np.abs(ends - begun) / (held @ e.position_scales))
    # On the way values that are given together may contradict each other.
    for share in np.linspace(0.0, 1.0, int(np.ceil(change / _APPROACH)) + 1)[1:-1]:
        nearer, missed = _impose_positions(
            starter, time, q, drawn, held, begun + share * (ends - begun)
        )
        q = nearer if _is_closed(e, missed) else q
    q, missed = _impose_positions(starter, time, q, drawn, held, ends)
    if not _is_closed(e, missed):
        told = ", ".join(f"{e.q_names[k]} = {value:g}" for k, value in given.items())
        raise BeamdaeError(
            f"start: the joints cannot be closed with {told}{_describe_gap(e, missed[: e.m])}; give fewer "
            "positions, or others."
        )
    q[list(given)] = ends
    return q


def _impose_positions(
    starter: ConsistencySolver, time: Array, begun: Array, drawn: Array, held: Any, wanted: Array
) -> tuple[Array, Array]:
    """Positions with these values of what is held, by Newton's method, and what they miss."""

    def asked(q: Array) -> tuple[Array, Any]:
        missed = np.concatenate([starter.position_gaps(time, q), held @ q - wanted])
        return missed, sp.vstack([starter.constraint_matrix(time, q), held])

    e, q = starter.equations, begun
    for _ in range(_ITERATIONS):
        missed, rows = asked(q)
        if _is_closed(e, missed) or not np.all(np.isfinite(missed)):
            break
        stiffness, _, mass = starter.linearize_forces(time, starter.rest_state(q))
        q = q + solve_least_change(stiffness + mass, rows, -missed)
    if q is begun or not _is_closed(e, missed):
        return q, missed
    q = minimize_strain(starter, time, begun, q, drawn, asked, 1.0)
    return q, asked(q)[0]


def _is_closed(e: EquationsOfMotion, missed: Array) -> bool:
    return bool(np.max(np.abs(missed), initial=0.0) <= _CLOSED * max(1.0, e.length))


def _describe_gap(e: EquationsOfMotion, missed: Array) -> str:
    if not e.m or not np.all(np.isfinite(missed)):
        return ""
    worst = int(np.argmax(np.abs(missed)))
    return f", {e.lam_names[worst]} stays open by {abs(missed[worst]):.3g}"


def _project_velocities(
    e: EquationsOfMotion, time: Array, q: Array, asked: Array, held: list[int]
) -> Array:
    """Velocities nearest to those asked for that the joints allow, those `held` among them."""
    starter, picked = ConsistencySolver(e), _selection(held, e.n)
    _, _, mass = starter.linearize_forces(time, starter.rest_state(q))
    rows = sp.vstack([starter.constraint_matrix(time, q), picked])
    off = np.concatenate([starter.constraint_levels(time, q, asked)[1], np.zeros(len(held))])
    v = asked + solve_least_change(mass, rows, -off)
    left = starter.constraint_levels(time, q, v)[1]
    size = max(1.0, e.length, float(np.max(np.abs(asked), initial=0.0)))
    kept = np.abs((v - asked)[held])
    if not max(np.max(np.abs(left), initial=0.0), np.max(kept, initial=0.0)) <= 1e-8 * size:
        told = ", ".join(f"{e.q_names[k]}{_RATE} = {asked[k]:g}" for k in held)
        raise BeamdaeError(f"start: the joints do not allow {told}; give fewer velocities.")
    v[held] = asked[held]
    return v
